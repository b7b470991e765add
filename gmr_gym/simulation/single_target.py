"""The world: a scenario's truth, its detections and its clutter, one scan at a time."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
from scipy.special import pdtr, pdtrik

from gmr_gym.models.gating import Gates
from gmr_gym.models.kalman import Sensor
from gmr_gym.models.model import Model
from gmr_gym.models.sensing import MeasurementModel
from gmr_gym.simulation.philox import buffer_for
from gmr_gym.simulation.scans import View, centre_into, clutter_into, insert_into, measure_all, scan_into

LossRule = Callable[[Gates, np.ndarray, np.ndarray], bool]
UNUSED = np.random.default_rng(0)
NOWHERE = np.empty(0)  # m, the corners of no region


class Truth(NamedTuple):
    """States at scans 1, 2, ... and which of the model's motions led to each."""

    x: np.ndarray  # (T, d)
    mode: np.ndarray  # (T,), index into model.motions, -1 where the target follows none of them


class Window(NamedTuple):
    """Where clutter falls: a box on the ground, or one carried along by the tracker's estimate."""

    low: np.ndarray  # (p,), m; relative to the centre when it follows
    high: np.ndarray  # (p,), m
    follows: bool
    # whether the sensor sees nothing outside: not so where the paper's truth runs along the edge
    limits_view: bool = True

    @property
    def volume(self) -> float:
        return float(np.prod(self.high - self.low))


@dataclass(frozen=True)
class Scenario:
    """The world of one target, and what a tracker is told of it.

    A window that follows is centred on the latest submitted estimate carried forward one period. A
    detection of the target outside a window that ends sight is not seen: a lone point there would
    betray it. Where there is a region, clutter stands fast on its ground whoever looks, and the window
    that follows is what is seen of it: only what it covers is ever drawn.
    """

    model: Model
    truth: Callable[[np.random.Generator], Truth]
    sensor: MeasurementModel  # the world's own; model.sensor is what the tracker believes
    detection_probability: float
    clutter_rate: float  # expected false detections in the window, a scan
    window: Window
    horizon: int  # scans
    period: float  # s
    position: tuple[int, ...]  # which states are coordinates, m
    velocity: tuple[int, ...]  # which states are velocities, m/s
    loss_rule: LossRule  # (gates, true state, target's detection) -> is the target out of sight?
    patience: int  # scans in a row off target that make a track lost
    cutoff: float  # m, an error beyond counts as this much
    region: Window | None = None  # in the plane: where there is clutter and sight; None for all of the window

    def __post_init__(self):
        if self.region is not None and not (len(self.region.low) == len(self.window.low) == 2):
            raise ValueError("a region needs a sensor of the plane: window and region with two sides each")

    def centre(self, estimate: np.ndarray) -> np.ndarray:
        """Where the window of the next scan is centred after the estimate (d,) of this one: on it,
        carried forward one period, or, fixed on the ground, nowhere else than where it was."""
        centre = np.zeros(len(self.window.low))
        if self.window.follows:
            motion, sensor = self.model.motions[0], self.model.sensor
            if not isinstance(sensor, Sensor):
                return sensor.measure(motion.F @ estimate + motion.offset)
            centre_into(centre, (motion.F, motion.offset, sensor.H), np.asarray(estimate, float))
        return centre


class Episode(NamedTuple):
    """What chance decides in one episode whatever a tracker submits; its clutter follows from the key."""

    x: np.ndarray  # (T, d), true states
    mode: np.ndarray  # (T,), the motion that led to each, -1 for none of the model's
    z: np.ndarray  # (T, p), what the sensor would say of them
    detected: np.ndarray  # (T,), whether it does
    slot: np.ndarray  # (T,), in [0, 1): where among the clutter the target's detection stands
    key: np.ndarray  # (2,), of everything but the truth: with a scan's number it makes the scan


class Scan(NamedTuple):
    """The detections of one scan, and whose they are."""

    z: np.ndarray  # (k, p)
    origin: np.ndarray  # (k,), index of the target, 0 where there is but one; -1 clutter


def draw(scenario: Scenario, seed: int | np.random.SeedSequence) -> Episode:
    """One episode: its truth drawn by a generator of its own, and of its detections and clutter, which are
    functions of the seed's key and of a scan's number, the part that waits for no estimate."""
    x, mode = draw_truth(scenario, seed)
    key, z = key_of(seed), np.array(scenario.sensor.measure(x))
    detection_draw, slot = measure_all(z, key, scenario.sensor.R)
    z, possible = scenario.sensor.wrap_and_validate(z)
    return Episode(x, mode, z, (detection_draw < scenario.detection_probability) & possible, slot, key)


def draw_truth(scenario: Scenario, seed: int | np.random.SeedSequence) -> Truth:
    """The truth of the episode of a seed."""
    # a script draws nothing, and a generator of its own would take as long as ten scans
    return scenario.truth(UNUSED if is_scripted(scenario) else stream(seed, 0))


def is_scripted(scenario: Scenario) -> bool:
    """Whether the target goes the same way in every episode."""
    return getattr(scenario.truth, "func", None) is scripted


def scripted(x: np.ndarray, rng: np.random.Generator) -> Truth:
    """The truth of a target whose states x (T, d) chance has no part in."""
    return Truth(x, np.full(len(x), -1))


def key_of(seed: int | np.random.SeedSequence) -> np.ndarray:
    """Key (2,) of an episode's detections and clutter."""
    return _sequence(seed).generate_state(2)


def stream(seed: int | np.random.SeedSequence, i: int) -> np.random.Generator:
    """Stream i of a seed."""
    sequence = _sequence(seed)
    # not spawn(), which would give other streams when one sequence is drawn from twice
    return np.random.default_rng(np.random.SeedSequence(sequence.entropy, spawn_key=(*sequence.spawn_key, i)))


def _sequence(seed: int | np.random.SeedSequence) -> np.random.SeedSequence:
    return seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)


@lru_cache
def capacity(clutter_rate: float) -> int:
    """Detections that a scan has room for: the quantile of the clutter at 1 - 1e-12, and the target's own."""
    share = 1 - 1e-12
    quantile = np.ceil(pdtrik(share, clutter_rate))
    return int(quantile - (pdtr(quantile - 1, clutter_rate) >= share)) + 1  # rounding may step over it


def view_of(scenario: Scenario) -> View:
    """What `scan_into` has to know of the scenario."""
    low, high, _, limits_view = scenario.window
    region = scenario.region
    corners = (NOWHERE, NOWHERE) if region is None else (region.low, region.high)
    return View(float(scenario.clutter_rate), low, high, bool(limits_view), *corners)


def window_motion(scenario: Scenario) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
    """F (d, d), offset (d,) and H (p, d) by which `centre_into` places the window, empty where it stands
    fast; None where the sensor is not linear."""
    motion, sensor = scenario.model.motions[0], scenario.model.sensor
    if not isinstance(sensor, Sensor):
        return None
    if not scenario.window.follows:
        return np.empty((0, 0)), np.empty(0), np.empty((0, 0))
    return motion.F, motion.offset, sensor.H


def scan(scenario: Scenario, episode: Episode, t: int, centre: np.ndarray) -> Scan:
    """Scan t (from 0) of the episode; centre (p,) places a window that follows."""
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
    """`scan` written to the rows of z (capacity, p), for a centre that is zeros where the window does not
    follow: how many detections there are, and the row of the target's own, -1 for none."""
    make = scan_into if isinstance(scenario.sensor, Sensor) else partial(_settled_into, scenario)
    return make(z, view, episode.key, t, centre, episode.z[t], episode.detected[t], episode.slot[t])


def _settled_into(scenario, z, view, key, t, centre, target, detected, slot) -> tuple[int, int]:
    """`scan_into` for a sensor that reports not every point of its space, and not all where they fell."""
    k = clutter_into(z, view, key, t, centre, buffer_for(len(z)))
    settled, possible = scenario.sensor.wrap_and_validate(z[:k])
    settled = settled[possible]
    k = len(settled)
    z[:k] = settled
    away = scenario.sensor.relative(target, centre) if scenario.window.follows else target
    seen = detected and (not view.limits_view or bool(((view.low <= away) & (away <= view.high)).all()))
    return insert_into(z, k, int(slot * (k + 1)), target) if seen else (k, -1)
