"""Many targets: what a tracker of them is told, what it says, and the intensity of clutter.

An intensity is a density whose integral is an expected number; its weights are never normalised.
"""

from typing import NamedTuple, Protocol

import numpy as np

from gmr_gym.association import unit_ball
from gmr_gym.kalman import Motion, Sensor
from gmr_gym.mixture import Mixture, checked, log_density
from gmr_gym.models import check_density, check_probability
from gmr_gym.validation import check_covariance


class Clutter(NamedTuple):
    """Intensity of false detections in a scan, over a box: uniform, Gaussian and elliptic parts."""

    low: np.ndarray  # (p,), m
    high: np.ndarray  # (p,), m
    uniform: float  # expected number, uniform in the box
    gaussians: Mixture  # weights are expected numbers; may hold none, shapes (0,), (0, p), (0, p, p)
    ellipses: Mixture  # likewise, each uniform where (z - m)' P^-1 (z - m) <= 1

    @property
    def expected(self) -> float:
        """Number of false detections in a scan."""
        return float(self.uniform + self.gaussians.w.sum() + self.ellipses.w.sum())

    @property
    def volume(self) -> float:
        """Of the box, m^p."""
        return np.prod(self.high - self.low)

    def density(self, z: np.ndarray) -> np.ndarray:
        """kappa(z) (k,), per unit of the detections' space, at detections z (k, p): Gaussians are not cut off
        at the box, and the uniform part is taken to go on beyond it, so that nothing has no explanation."""
        kappa = np.full(len(z), self.uniform / self.volume)
        if len(self.gaussians.w):
            kappa += np.exp(log_density(self.gaussians, z))
        for w, m, P in zip(*self.ellipses, strict=True):
            L = np.linalg.cholesky(P)
            inside = (np.linalg.solve(L, (z - m).T) ** 2).sum(axis=0) <= 1
            kappa += inside * w / (unit_ball(len(m)) * np.prod(np.diag(L)))
        return kappa


class Population(NamedTuple):
    """What a tracker of many targets is told; `population` checks one."""

    motion: Motion
    sensor: Sensor
    detection_probability: float  # P_D
    survival_probability: float  # P_S, of a target from scan to scan
    births: Mixture  # intensity of targets that appear in a scan, of themselves
    spawn_weight: float  # expected number that each target spawns in a scan
    spawn_covariance: np.ndarray  # (d, d), of the spawned about where their parent moves
    clutter: Clutter  # what it believes of false detections


class Account(NamedTuple):
    """What a tracker of many targets says of a scan."""

    x: np.ndarray  # (j, d), the targets it is ready to name
    existence: np.ndarray  # (j,), how sure it is of each, in [0, 1]
    label: np.ndarray  # (j,), the same from scan to scan for what it takes to be the same target; -1 for none
    expected: float  # number of targets
    intensity: Mixture  # of targets, what it believes; weights sum to `expected`, but for rounding
    clutter: Clutter  # what it believes of false detections, after the scan


class ManyTracker(Protocol):
    """As `tracker.Tracker`, for many targets: frozen parameters, a belief in and out."""

    @property
    def population(self) -> Population:
        """What it was told."""

    def init(self) -> object:
        """The belief one period before the first scan."""

    def step(self, belief, z: np.ndarray) -> tuple[object, Account]:
        """The belief after the scan z (k, p) one period later, and the account of that scan."""


def population(
    motion: Motion,
    sensor: Sensor,
    detection_probability: float,
    survival_probability: float,
    births: Mixture,
    clutter: Clutter,
    spawn_weight: float = 0.0,
    spawn_covariance=None,
) -> Population:
    """Checked Population. Raises ValueError naming the argument for a probability outside (0, 1], for shapes
    that do not fit each other, for intensities that are none and for clutter that is nowhere."""
    d = len(motion.F)
    if not isinstance(sensor, Sensor):
        raise ValueError(f"sensor must be linear, a Sensor of positions, got a {type(sensor).__name__}")
    if sensor.H.shape[1] != d:
        raise ValueError(f"sensor.H has {sensor.H.shape[1]} columns, but the motion has {d} states")
    check_probability("detection_probability", detection_probability)
    check_probability("survival_probability", survival_probability)
    births = checked(births, "births.")
    if births.m.shape[1] != d:
        raise ValueError(f"births have {births.m.shape[1]} states, but the motion has {d}")
    if not 0 <= spawn_weight < np.inf:
        raise ValueError(f"spawn_weight must be an expected number, got {spawn_weight}")
    spread = np.eye(d) if spawn_covariance is None else np.array(spawn_covariance, float)
    if spread.shape != (d, d):
        raise ValueError(f"spawn_covariance must have shape {(d, d)}, got {spread.shape}")
    check_covariance("spawn_covariance", spread)
    finite = np.isfinite(clutter.low).all() and np.isfinite(clutter.high).all()
    if len(clutter.low) != len(sensor.H) or not (finite and (clutter.low < clutter.high).all()):
        raise ValueError(
            f"clutter must be over a finite box of {len(sensor.H)} sides, got {clutter.low} to {clutter.high}"
        )
    clutter = clutter._replace(
        gaussians=checked(clutter.gaussians, "clutter.gaussians."),
        ellipses=checked(clutter.ellipses, "clutter.ellipses."),
    )
    if not 0 < clutter.uniform < np.inf:
        raise ValueError(
            "clutter.uniform must be positive and finite, got "
            f"{clutter.uniform}: a detection far from all else needs an explanation"
        )
    with np.errstate(all="ignore"):
        density = clutter.uniform / clutter.volume
    check_density("clutter.uniform over the volume of its box", density)
    return Population(
        motion, sensor, float(detection_probability), float(survival_probability), births,
        float(spawn_weight), spread, clutter,
    )  # fmt: skip


def uniform_clutter(low, high, expected: float) -> Clutter:
    """`expected` false detections a scan, uniform between two opposite corners (p,)."""
    low, high = np.array(low, float), np.array(high, float)
    return Clutter(low, high, float(expected), nothing(len(low)), nothing(len(low)))


def nothing(d: int) -> Mixture:
    """The intensity of no component in d dimensions."""
    return Mixture(np.empty(0), np.empty((0, d)), np.empty((0, d, d)))
