"""The world: a scenario's truth, its detections and its clutter, one scan at a time."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from typing import NamedTuple

import numpy as np

from gmr_gym.association import Gates
from gmr_gym.kalman import Sensing
from gmr_gym.model import Model

Loss = Callable[[Gates, np.ndarray, np.ndarray], bool]
CELL = 500.0  # m, side of the squares in which clutter on the ground is drawn


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
    """Everything that chance decides in one episode, drawn before the first scan, so that every
    tracker meets the same world whatever it submits."""

    x: np.ndarray  # (T, d), true states
    mode: np.ndarray  # (T,), the motion that led to each, -1 for none of the model's
    z: np.ndarray  # (T, p), what the sensor would say of them
    detected: np.ndarray  # (T,), whether it does
    slot: np.ndarray  # (T,), in [0, 1): where among the clutter the target's detection stands
    clutter: np.ndarray  # (N, p), in [0, 1): places in the window
    first: np.ndarray  # (T + 1,), scan t has clutter[first[t] : first[t + 1]]
    ground: np.ndarray  # (2,), key of the clutter that stands fast on the ground


class Scan(NamedTuple):
    """The detections of one scan, and whose they are."""

    z: np.ndarray  # (k, p)
    origin: np.ndarray  # (k,), index of the target, 0 where there is but one; -1 clutter


def draw(scenario: Scenario, seed: int | np.random.SeedSequence) -> Episode:
    """One episode; truth, detection and clutter each draw from their own stream."""
    for_truth, for_detection, for_clutter = streams(seed)
    x, mode = scenario.truth(for_truth)
    R = scenario.sensor.R
    noise = for_detection.standard_normal((len(x), len(R))) @ np.linalg.cholesky(R).T
    detected = for_detection.random(len(x)) < scenario.detection_probability
    slot = for_detection.random(len(x))
    rate = scenario.clutter_rate if scenario.region is None else 0.0
    first = np.append(0, np.cumsum(for_clutter.poisson(rate, len(x))))
    clutter = for_clutter.random((first[-1], len(R)))
    ground = for_clutter.integers(2**64, size=2, dtype=np.uint64)
    z, possible = scenario.sensor.settled(scenario.sensor.observed(x) + noise)
    return Episode(x, mode, z, detected & possible, slot, clutter, first, ground)


def streams(seed: int | np.random.SeedSequence) -> list[np.random.Generator]:
    """Three streams of one seed: for truth, detection and clutter."""
    sequence = seed if isinstance(seed, np.random.SeedSequence) else np.random.SeedSequence(seed)
    # not spawn(), which would give other streams when one sequence is drawn from twice
    return [
        np.random.default_rng(np.random.SeedSequence(sequence.entropy, spawn_key=(*sequence.spawn_key, i)))
        for i in range(3)
    ]


def scan(scenario: Scenario, episode: Episode, t: int, centre: np.ndarray) -> Scan:
    """Scan t (from 0) of the episode; centre (p,) places a window that follows."""
    low, high, follows, ends_sight = scenario.window
    z = low + (high - low) * episode.clutter[episode.first[t] : episode.first[t + 1]]
    target = episode.z[t]
    away = scenario.sensor.relative(target, centre) if follows else target
    seen = episode.detected[t] and (not ends_sight or bool(((low <= away) & (away <= high)).all()))
    if follows:
        z += centre
        low, high = low + centre, high + centre
    z, possible = scenario.sensor.settled(z)
    if not possible.all():
        z = z[possible]
    slot = int(episode.slot[t] * (len(z) + 1))
    if scenario.region is not None:
        low, high = np.maximum(low, scenario.region.low), np.minimum(high, scenario.region.high)
        density = scenario.clutter_rate / scenario.window.volume
        z, rank = _on_the_ground(episode.ground, t, density, scenario.region.low, low, high)
        slot = int(np.searchsorted(rank, episode.slot[t]))
        seen = seen and (not ends_sight or bool(((low <= target) & (target <= high)).all()))
    if not seen:
        return Scan(z, np.full(len(z), -1))
    origin = np.full(len(z) + 1, -1)
    origin[slot] = 0
    return Scan(np.concatenate((z[:slot], target[None], z[slot:])), origin)


def _on_the_ground(key, t, density, corner, low, high) -> tuple[np.ndarray, np.ndarray]:
    """Clutter (k, 2) of scan t between low and high, and its rank (k,) in [0, 1), by which it is sorted: a
    Poisson process, drawn square by square from a stream that each square of the grid about `corner`
    has to itself. Without ranks of its own the order of squares would give the target away."""
    z, rank = np.empty((0, 2)), np.empty(0)
    if density == 0 or not (low < high).all():
        return z, rank
    squares = [
        range(int(first), int(last) + 1)
        for first, last in zip((low - corner) // CELL, (high - corner) // CELL, strict=True)
    ]
    bits = np.random.Philox(key=key)
    draws, fresh = np.random.Generator(bits), bits.state
    parts = []
    for at in product(*squares):
        # the counter's first word counts draws; the other three name the scan and the square of the plane
        fresh["state"]["counter"][:] = (0, t, *at)
        bits.state = fresh
        points = draws.random((draws.poisson(density * CELL**2), 3))
        points[:, :2] = corner + CELL * (np.array(at) + points[:, :2])
        parts.append(points)
    points = np.concatenate(parts)
    z, rank = points[:, :2], points[:, 2]
    inside = np.flatnonzero(((low <= z) & (z <= high)).all(axis=1))
    order = inside[np.argsort(rank[inside])]
    return z[order], rank[order]
