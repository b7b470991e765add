"""Scenarios of one target: the truth, its detections and the clutter, one scan at a time."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import pdtr, pdtrik

from gmr_gym.models.gating import Gates
from gmr_gym.models.kalman import Sensor
from gmr_gym.models.model import Model
from gmr_gym.models.sensing import MeasurementModel
from gmr_gym.simulation.philox import buffer_for
from gmr_gym.simulation.scans import (
    Region,
    Scene,
    TargetDetection,
    View,
    centre_into,
    clutter_into,
    insert_into,
    measure_all,
    scan_into,
)

LossRule = Callable[[Gates, np.ndarray, np.ndarray], bool]
UNUSED = np.random.default_rng(0)


class Truth(NamedTuple):
    """True states at scans 1, 2, ... and the motion model that led to each."""

    x: np.ndarray  # (T, d)
    mode: np.ndarray  # (T,), index into model.motions, -1 where the target follows none of them


class Window(NamedTuple):
    """The box in which clutter falls: fixed on the ground, or centred on the predicted estimate."""

    low: np.ndarray  # (p,), m; relative to the centre when it follows
    high: np.ndarray  # (p,), m
    follows: bool
    # whether the sensor reports nothing outside; False where the paper's truth runs along the edge
    limits_view: bool = True

    @property
    def volume(self) -> float:
        """Volume of the box, m^p (radians for angles)."""
        return float(np.prod(self.high - self.low))


@dataclass(frozen=True)
class Scenario:
    """A scenario of one target, and the model that a tracker assumes.

    A window that follows is centred on the latest submitted estimate, predicted one period ahead. Where the
    window limits the view, a detection of the target outside it is not reported: a single point out there
    would give the target away. With a `region`, clutter lies on the ground of that region and does not depend
    on the window; the window that follows is the part of it in view, and only that part is drawn.

    Raises
    ------
    ValueError
        If there is a region and the sensor is not of the plane.
    """

    model: Model
    truth: Callable[[np.random.Generator], Truth]
    sensor: MeasurementModel  # the true one; model.sensor is the one that the tracker assumes
    detection_probability: float
    clutter_rate: float  # expected false alarms in the window, per scan
    window: Window
    horizon: int  # scans
    period: float  # s
    position: tuple[int, ...]  # which states are coordinates, m
    velocity: tuple[int, ...]  # which states are velocities, m/s
    loss_rule: LossRule  # (gates, true state, target's detection) -> is this scan off target?
    patience: int  # scans in a row off target that make a track lost
    cutoff: float  # m, an error beyond counts as this much
    region: Window | None = None  # in the plane: ground with clutter and in view; None for all of the window

    def __post_init__(self):
        if self.region is not None and not (len(self.region.low) == len(self.window.low) == 2):
            raise ValueError("a region needs a sensor of the plane: window and region with two sides each")

    def centre(self, estimate: np.ndarray) -> np.ndarray:
        """Centre of the window of the next scan.

        Parameters
        ----------
        estimate : ndarray (d,)
            Estimate of this scan.

        Returns
        -------
        ndarray (p,)
            Measurement of the estimate predicted one period ahead; zeros for a fixed window.
        """
        centre = np.zeros(len(self.window.low))
        if self.window.follows:
            motion, sensor = self.model.motions[0], self.model.sensor
            if not isinstance(sensor, Sensor):
                return sensor.measure(motion.F @ estimate + motion.offset)
            centre_into(centre, (motion.F, motion.offset, sensor.H), np.asarray(estimate, float))
        return centre


class Episode(NamedTuple):
    """One drawn episode: all that does not depend on the estimates. The clutter follows from the key."""

    x: np.ndarray  # (T, d), true states
    mode: np.ndarray  # (T,), index of the motion that led to each, -1 for none of the model's
    z: np.ndarray  # (T, p), noisy measurements of them
    detected: np.ndarray  # (T,), whether the target is detected
    slot: np.ndarray  # (T,), in [0, 1): place of the target's detection among the clutter
    key: np.ndarray  # (2,), from which, with a scan's number, detections and clutter are drawn


class Scan(NamedTuple):
    """The detections of one scan and their origins."""

    z: np.ndarray  # (k, p)
    origin: np.ndarray  # (k,), index of the target (0 for a single one), -1 for clutter


def draw(scenario: Scenario, seed: int | np.random.SeedSequence) -> Episode:
    """Draw one episode.

    The truth is drawn by a generator of its own. Detections and clutter are functions of the seed's key and
    the number of a scan; the clutter of a scan is drawn later, by `scan`, as it may depend on the estimate.

    Parameters
    ----------
    scenario : Scenario
    seed : int or SeedSequence

    Returns
    -------
    Episode

    Examples
    --------
    >>> from gmr_gym.scenarios.dortenzio import turning_target
    >>> from gmr_gym.simulation import draw
    >>> episode = draw(turning_target(), seed=1)
    >>> episode.x.shape
    (100, 4)
    >>> draw(turning_target(), seed=1).z[0].round(1).tolist() == episode.z[0].round(1).tolist()
    True
    """
    x, mode = draw_truth(scenario, seed)
    key, z = key_of(seed), np.array(scenario.sensor.measure(x))
    detection_draw, slot = measure_all(z, key, scenario.sensor.R)
    z, possible = scenario.sensor.wrap_and_validate(z)
    return Episode(x, mode, z, (detection_draw < scenario.detection_probability) & possible, slot, key)


def draw_truth(scenario: Scenario, seed: int | np.random.SeedSequence) -> Truth:
    """The truth of the episode of a seed."""
    # a scripted truth draws nothing, and making a generator takes as long as ten scans
    return scenario.truth(UNUSED if is_scripted(scenario) else stream(seed, 0))


def is_scripted(scenario: Scenario) -> bool:
    """Whether the target takes the same path in every episode."""
    return getattr(scenario.truth, "func", None) is scripted


def scripted(x: np.ndarray, rng: np.random.Generator) -> Truth:
    """The truth of a target that follows the same path in every episode.

    Parameters
    ----------
    x : ndarray (T, d)
        States.
    rng : Generator
        Not used.

    Returns
    -------
    Truth
    """
    return Truth(x, np.full(len(x), -1))


def key_of(seed: int | np.random.SeedSequence) -> np.ndarray:
    """Key (2,) of an episode's detections and clutter."""
    return _sequence(seed).generate_state(2)


def stream(seed: int | np.random.SeedSequence, i: int) -> np.random.Generator:
    """Random generator of stream i of a seed."""
    sequence = _sequence(seed)
    # not spawn(), which would give other streams when one sequence is drawn from twice
    return np.random.default_rng(np.random.SeedSequence(sequence.entropy, spawn_key=(*sequence.spawn_key, i)))


def _sequence(seed: int | np.random.SeedSequence) -> np.random.SeedSequence:
    return seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)


@lru_cache
def capacity(clutter_rate: float) -> int:
    """Detections that an array for one scan has room for.

    It is the quantile of the Poisson clutter at 1 - 1e-12, plus one for the target.
    """
    share = 1 - 1e-12
    quantile = np.ceil(pdtrik(share, clutter_rate))
    return int(quantile - (pdtr(quantile - 1, clutter_rate) >= share)) + 1  # rounding may step over it


def view_of(scenario: Scenario) -> View:
    """What `scan_into` needs of a scenario."""
    low, high, _, limits_view = scenario.window
    ground = scenario.region and Region(scenario.region.low, scenario.region.high)
    return View(float(scenario.clutter_rate), low, high, bool(limits_view), ground)


def scene_of(scenario: Scenario) -> Scene:
    """What `scans_into` needs of a scenario."""
    motion, sensor = scenario.model.motions[0], scenario.model.sensor
    window_motion = None
    if isinstance(sensor, Sensor):
        fixed = np.empty((0, 0)), np.empty(0), np.empty((0, 0))
        window_motion = (motion.F, motion.offset, sensor.H) if scenario.window.follows else fixed
    rows, P_D = capacity(scenario.clutter_rate), float(scenario.detection_probability)
    return Scene(view_of(scenario), rows, scenario.sensor.R, P_D, window_motion)


def scan(scenario: Scenario, episode: Episode, t: int, centre: np.ndarray) -> Scan:
    """Scan t of an episode.

    Parameters
    ----------
    scenario : Scenario
    episode : Episode
    t : int
        Number of the scan, from 0.
    centre : ndarray (p,)
        Centre of a window that follows, see `Scenario.centre`; not used for a fixed window.

    Returns
    -------
    Scan

    Examples
    --------
    >>> import numpy as np
    >>> from gmr_gym.scenarios.dortenzio import turning_target
    >>> from gmr_gym.simulation import draw, scan
    >>> scenario = turning_target(clutter_rate=0, detection_probability=1)
    >>> first = scan(scenario, draw(scenario, seed=1), 0, np.zeros(2))
    >>> first.z.shape, first.origin.tolist()
    ((1, 2), [0])
    """
    z = np.empty((capacity(scenario.clutter_rate), len(centre)))
    if not scenario.window.follows:
        centre = np.zeros(len(centre))
    k, place = make_scan(z, scenario, view_of(scenario), episode, t, centre)
    origin = np.full(k, -1)
    if place >= 0:
        origin[place] = 0
    return Scan(z[:k], origin)


def make_scan(
    z: np.ndarray, scenario: Scenario, view: View, episode: Episode, t: int, centre: np.ndarray
) -> tuple[int, int]:
    """`scan` written to the first rows of z (capacity, p).

    Parameters
    ----------
    z : ndarray (capacity, p)
        Overwritten.
    scenario : Scenario
    view : View
        `view_of` the scenario.
    episode : Episode
    t : int
        Number of the scan, from 0.
    centre : ndarray (p,)
        Zeros for a fixed window.

    Returns
    -------
    k : int
        Number of detections.
    place : int
        Row of the target's detection, -1 for none.
    """
    target, detected, slot = episode.z[t], episode.detected[t], episode.slot[t]
    if isinstance(scenario.sensor, Sensor):
        return scan_into(z, view, episode.key, t, centre, target, detected, slot)
    own = TargetDetection(target, detected, slot)
    return _wrapped_into(z, scenario, view, episode.key, t, centre, own)


def _wrapped_into(z, scenario, view, key, t, centre, own) -> tuple[int, int]:
    """`scan_into` for a sensor that wraps points, and does not report all of them."""
    target, detected, slot = own
    k = clutter_into(z, view, key, t, centre, buffer_for(len(z)))
    wrapped, possible = scenario.sensor.wrap_and_validate(z[:k])
    wrapped = wrapped[possible]
    k = len(wrapped)
    z[:k] = wrapped
    away = scenario.sensor.relative(target, centre) if scenario.window.follows else target
    seen = detected and (not view.limits_view or bool(((view.low <= away) & (away <= view.high)).all()))
    return insert_into(z, k, int(slot * (k + 1)), target) if seen else (k, -1)
