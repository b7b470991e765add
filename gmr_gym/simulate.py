"""The world: a scenario's truth, its detections and its clutter, one scan at a time."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, partial
from typing import NamedTuple

import numpy as np
from numba import njit
from scipy import stats

from gmr_gym.association import Gates
from gmr_gym.kalman import Sensing, Sensor
from gmr_gym.mixture import cholesky_into
from gmr_gym.model import Model
from gmr_gym.philox import normals_into, pair, poisson, uniforms_into

Loss = Callable[[Gates, np.ndarray, np.ndarray], bool]
CELL = 500.0  # m, side of the squares in which clutter on the ground is drawn
# streams of an episode's key
NOISE, DETECTION, COUNT, PLACES, GROUND_COUNT, GROUND_PLACES = range(6)
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
    ends_sight: bool = True

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
    sensor: Sensing  # the world's own; model.sensor is what the tracker believes
    detection_probability: float
    clutter_rate: float  # expected false detections in the window, a scan
    window: Window
    horizon: int  # scans
    period: float  # s
    position: tuple[int, ...]  # which states are coordinates, m
    velocity: tuple[int, ...]  # which states are velocities, m/s
    off_target: Loss  # (gates, true state, target's detection) -> is the target out of sight?
    patience: int  # scans in a row off target that make a track lost
    cutoff: float  # m, an error beyond counts as this much
    region: Window | None = None  # in the plane: where there is clutter and sight; None for all of the window

    def __post_init__(self):
        if self.region is not None and not (len(self.region.low) == len(self.window.low) == 2):
            raise ValueError("a region needs a sensor of the plane: window and region with two sides each")

    def centre(self, estimate: np.ndarray) -> np.ndarray:
        """Where the window of the next scan is centred after the estimate (d,) of this one: on it,
        carried forward one period, or, fixed on the ground, nowhere else than where it was."""
        if not self.window.follows:
            return np.zeros(len(self.window.low))
        motion = self.model.motions[0]
        return self.model.sensor.observed(motion.F @ estimate + motion.offset)


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


class View(NamedTuple):
    """What `scan_into` has to know of a scenario; `viewed` reads it off."""

    clutter_rate: float  # expected false detections in the window, a scan
    low: np.ndarray  # (p,), m, of the window, relative to its centre
    high: np.ndarray  # (p,), m
    ends_sight: bool
    region_low: np.ndarray  # (2,), m, of the region; (0,) where there is none
    region_high: np.ndarray  # (2,), m


def draw(scenario: Scenario, seed: int | np.random.SeedSequence) -> Episode:
    """One episode: its truth drawn by a generator of its own, and of its detections and clutter, which are
    functions of the seed's key and of a scan's number, the part that waits for no estimate."""
    sequence = _sequence(seed)
    x, mode = scenario.truth(stream(sequence, 0))
    key = sequence.generate_state(2)
    noise, luck, slot = _chances(key, len(x), scenario.sensor.R)
    z, possible = scenario.sensor.settled(scenario.sensor.observed(x) + noise)
    return Episode(x, mode, z, (luck < scenario.detection_probability) & possible, slot, key)


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
    return int(stats.poisson.ppf(1 - 1e-12, clutter_rate)) + 1


def viewed(scenario: Scenario) -> View:
    """What `scan_into` has to know of the scenario."""
    low, high, _, ends_sight = scenario.window
    region = scenario.region
    corners = (NOWHERE, NOWHERE) if region is None else (region.low, region.high)
    return View(float(scenario.clutter_rate), low, high, bool(ends_sight), *corners)


def scan(scenario: Scenario, episode: Episode, t: int, centre: np.ndarray) -> Scan:
    """Scan t (from 0) of the episode; centre (p,) places a window that follows."""
    view = viewed(scenario)
    z = np.empty((capacity(view.clutter_rate), len(view.low)))
    if not scenario.window.follows:
        centre = np.zeros(len(view.low))
    make = scan_into if isinstance(scenario.sensor, Sensor) else partial(_settled_into, scenario)
    k, place = make(z, view, episode.key, t, centre, episode.z[t], episode.detected[t], episode.slot[t])
    origin = np.full(k, -1)
    if place >= 0:
        origin[place] = 0
    return Scan(z[:k], origin)


def _settled_into(scenario, z, view, key, t, centre, target, detected, slot) -> tuple[int, int]:
    """`scan_into` for a sensor that reports not every point of its space, and not all where they fell."""
    k = clutter_into(z, view, key, t, centre)
    settled, possible = scenario.sensor.settled(z[:k])
    settled = settled[possible]
    k = len(settled)
    z[:k] = settled
    away = scenario.sensor.relative(target, centre) if scenario.window.follows else target
    seen = detected and (not view.ends_sight or bool(((view.low <= away) & (away <= view.high)).all()))
    return insert_into(z, k, int(slot * (k + 1)), target) if seen else (k, -1)


@njit(cache=True, error_model="numpy")
def scan_into(z, view, key, t, centre, target, detected, slot):
    """Scan t of the episode that has the key (2,), by a linear sensor whose View is placed at centre (p,),
    zeros where it stands fast: its k detections, one a row of z (capacity, p), among them that of the target
    (p,) where it is `detected` and in sight, in a place that `slot` in [0, 1) decides. Returns k and the
    target's row, -1 for none; the rows from k on are left as they are."""
    seen = detected
    if view.ends_sight:
        for c in range(len(target)):
            away = target[c] - centre[c]
            seen = seen and view.low[c] <= away and away <= view.high[c]
            if len(view.region_low) > 0:
                seen = seen and view.region_low[c] <= target[c] and target[c] <= view.region_high[c]
    if len(view.region_low) > 0:
        k, place = ground_into(z, view, key, t, centre, slot)
    else:
        k = clutter_into(z, view, key, t, centre)
        place = int(slot * (k + 1))
    if not seen:
        return k, -1
    return insert_into(z, k, place, target)


@njit(cache=True, error_model="numpy")
def insert_into(z, k, place, target):
    """Makes room among the first k rows of z for the target (p,) in a place of its own; returns k + 1 and
    the place."""
    p = len(target)
    for i in range(k, place, -1):
        for c in range(p):
            z[i, c] = z[i - 1, c]
    for c in range(p):
        z[place, c] = target[c]
    return k + 1, place


@njit(cache=True, error_model="numpy")
def clutter_into(z, view, key, t, centre):
    """Clutter of scan t, uniform in the window placed at centre (p,), one point a row of z (capacity, p);
    returns how many, always less than the rows."""
    at = (t, 0, 0)
    k, p = min(poisson(view.clutter_rate, key, COUNT, at), len(z) - 1), z.shape[1]
    uniforms_into(z.reshape(-1)[: k * p], key, PLACES, at)
    for c in range(p):
        low, side, middle = view.low[c], view.high[c] - view.low[c], centre[c]
        for i in range(k):
            z[i, c] = low + side * z[i, c] + middle
    return k


@njit(cache=True, error_model="numpy")
def ground_into(z, view, key, t, centre, slot):
    """What a window at centre (2,) shows of the clutter of scan t that stands fast on a region's ground, one
    point a row of z (capacity, 2); returns how many, always less than the rows, and how many of them rank
    below `slot`.

    It is a Poisson process, drawn square by square from streams that each square of the grid about the
    region's corner has to itself. Its order is by ranks of its own: that of the squares would give the
    target away."""
    low, high, squares = np.empty(2), np.empty(2), np.empty((2, 2), np.int64)
    corner, expected = view.region_low, view.clutter_rate * CELL**2
    for c in range(2):
        low[c] = max(view.low[c] + centre[c], corner[c])
        high[c] = min(view.high[c] + centre[c], view.region_high[c])
        expected /= view.high[c] - view.low[c]
        if not low[c] < high[c]:
            return 0, 0
        squares[c, 0], squares[c, 1] = (low[c] - corner[c]) // CELL, (high[c] - corner[c]) // CELL
    ranks, k = np.empty(len(z)), 0
    for i in range(squares[0, 0], squares[0, 1] + 1):
        for j in range(squares[1, 0], squares[1, 1] + 1):
            # squares are counted from 1: 0 is where the episode's other streams are
            at = (t, i + 1, j + 1)
            points = np.empty(3 * poisson(expected, key, GROUND_COUNT, at))
            uniforms_into(points, key, GROUND_PLACES, at)
            for n in range(0, len(points), 3):
                x, y = corner[0] + CELL * (i + points[n]), corner[1] + CELL * (j + points[n + 1])
                if low[0] <= x <= high[0] and low[1] <= y <= high[1] and k < len(z) - 1:
                    z[k, 0], z[k, 1], ranks[k] = x, y, points[n + 2]
                    k += 1
    _sort(z, ranks, k)
    place = 0
    while place < k and ranks[place] < slot:
        place += 1
    return k, place


@njit(cache=True, error_model="numpy")
def _sort(z, ranks, k):
    """Puts the first k rows of z (capacity, 2) in the order of their ranks (Shell 1959)."""
    gap = k
    while gap > 1:
        gap = max(1, int(gap / 2.25))
        for i in range(gap, k):
            x, y, rank, j = z[i, 0], z[i, 1], ranks[i], i
            while j >= gap and ranks[j - gap] > rank:
                z[j, 0], z[j, 1], ranks[j] = z[j - gap, 0], z[j - gap, 1], ranks[j - gap]
                j -= gap
            z[j, 0], z[j, 1], ranks[j] = x, y, rank


@njit(cache=True, error_model="numpy")
def _chances(key, T, R):
    """Noise (T, p) of covariance R (p, p), and for every scan two uniforms (T,) in [0, 1)."""
    p = len(R)
    L, normal = np.zeros((p, p)), np.empty(p)
    cholesky_into(L, R)
    noise, luck, slot = np.empty((T, p)), np.empty(T), np.empty(T)
    for t in range(T):
        at = (t, 0, 0)
        normals_into(normal, key, NOISE, at)
        for r in range(p):
            noise[t, r] = 0.0
            for c in range(r + 1):
                noise[t, r] += L[r, c] * normal[c]
        luck[t], slot[t] = pair(key, DETECTION, 0, at)
    return noise, luck, slot
