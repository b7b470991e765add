"""The world of many targets: their truth, their detections and the clutter about them, drawn before the first
scan."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gmr_gym.models.clutter import Clutter
from gmr_gym.models.kalman import Sensor
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.simulation.single_target import Scan, stream


@dataclass(frozen=True)
class MultiTargetScenario:
    """The world of targets that come and go, and what a tracker is told of it.

    Nothing outside the box of the clutter is ever reported, be it clutter or a target.
    """

    model: MultiTargetModel  # what a tracker is told
    truth: Callable[[np.random.Generator], np.ndarray]  # states (T, m, d), nan where a target is absent
    targets: int  # m, all that ever appear
    sensor: Sensor  # the world's own; population.sensor is what the tracker believes
    detection_probability: float
    clutter: Callable[[int], Clutter]  # the true intensity at scan t (from 0)
    horizon: int  # scans, T
    period: float  # s
    position: tuple[int, ...]  # which states are coordinates, m
    velocity: tuple[int, ...]  # which states are velocities, m/s
    cutoff: float  # m, and
    order: float  # of the distance between sets that scores an estimate

    @property
    def busiest(self) -> float:
        """Expected number of false detections in the scan that has most of them."""
        return max(self.clutter(t).expected for t in range(self.horizon))


class MultiTargetEpisode(NamedTuple):
    """Everything that chance decides in one episode: nothing in it depends on what a tracker submits."""

    x: np.ndarray  # (T, m, d), true states, nan where a target is absent
    z: np.ndarray  # (N, p), the detections of all scans, those of one scan in random order
    origin: np.ndarray  # (N,), index of the target, -1 clutter
    first: np.ndarray  # (T + 1,), scan t has z[first[t] : first[t + 1]]


def draw(scenario: MultiTargetScenario, seed: int | np.random.SeedSequence) -> MultiTargetEpisode:
    """One episode; truth, detection and clutter each draw from their own stream.

    Raises ValueError for a truth that has not the scans and the targets that the scenario names."""
    for_truth, for_detection, for_clutter = (stream(seed, i) for i in range(3))
    x = scenario.truth(for_truth)
    shape = (scenario.horizon, scenario.targets)
    if x.shape[:2] != shape:
        raise ValueError(f"truth must be {shape[0]} scans of {shape[1]} targets, got shape {x.shape}")
    R = scenario.sensor.R
    noise = for_detection.standard_normal((*shape, len(R))) @ np.linalg.cholesky(R).T
    heard = scenario.sensor.measure(x) + noise  # nan where absent, which no box holds
    detected = for_detection.random(shape) < scenario.detection_probability
    ranks = for_detection.random(shape)
    scans = []
    for t in range(scenario.horizon):
        clutter = scenario.clutter(t)
        seen = np.flatnonzero(detected[t] & inside(clutter, heard[t]))
        false = draw_clutter(clutter, for_clutter)
        # ranks of their own, so that clutter stands in the same order whoever is among it
        order = np.argsort(np.concatenate((ranks[t, seen], for_clutter.random(len(false)))))
        origin = np.concatenate((seen, np.full(len(false), -1)))
        scans.append(Scan(np.concatenate((heard[t, seen], false))[order], origin[order]))
    z, origin = map(np.concatenate, zip(*scans, strict=True))
    return MultiTargetEpisode(x, z, origin, np.cumsum([0, *(len(one.z) for one in scans)]))


def scan(crowd: MultiTargetEpisode, t: int) -> Scan:
    """Scan t (from 0) of the episode."""
    span = slice(crowd.first[t], crowd.first[t + 1])
    return Scan(crowd.z[span], crowd.origin[span])


def draw_clutter(clutter: Clutter, rng: np.random.Generator) -> np.ndarray:
    """False detections (k, p) of one scan: a Poisson process of intensity `clutter.density` inside the box.

    Points of Gaussians and ellipses that fall outside the box are dropped, not drawn again: so the density
    inside is as it stands, and `clutter.expected` is more than what is seen where a part reaches out."""
    low, high = clutter.low, clutter.high
    p = len(low)
    parts = [low + (high - low) * rng.random((rng.poisson(clutter.uniform), p))]
    for w, m, P in zip(*clutter.gaussians, strict=True):
        parts.append(m + rng.standard_normal((rng.poisson(w), p)) @ np.linalg.cholesky(P).T)
    for w, m, P in zip(*clutter.ellipses, strict=True):
        ball = rng.standard_normal((rng.poisson(w), p))
        ball *= (rng.random(len(ball)) ** (1 / p) / np.linalg.norm(ball, axis=1))[:, None]
        parts.append(m + ball @ np.linalg.cholesky(P).T)
    z = np.concatenate(parts)
    return z[inside(clutter, z)]


def inside(clutter: Clutter, z: np.ndarray) -> np.ndarray:
    """Which of the points z (k, p) lie in the clutter's box (k,)."""
    return np.all((clutter.low <= z) & (z <= clutter.high), axis=1)
