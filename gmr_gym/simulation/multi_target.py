"""Scenarios of many targets: truth, detections and clutter, drawn or recorded before the first scan."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.models.clutter import Clutter
from gmr_gym.models.kalman import Sensor
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.simulation.clutter_points import Parts, false_alarms_into, parts_of, scans_into
from gmr_gym.simulation.single_target import Scan, capacity, stream


@dataclass(frozen=True)
class MultiTargetScenario:
    """A scenario of targets that appear and disappear, and the model that a tracker assumes.

    The sensor reports nothing outside the box of the clutter, neither clutter nor targets. `model` and
    `model.sensor` are the filter model; `sensor`, `detection_probability` and `clutter` are the true ones.
    """

    model: MultiTargetModel  # that a tracker assumes
    truth: Callable[[np.random.Generator], np.ndarray]  # states (T, m, d), nan where a target is absent
    targets: int  # m, the number that ever appear
    sensor: Sensor  # the true one; model.sensor is the one that the tracker assumes
    # P_D, or a function of states (..., d); it returns (...), anything where a target is absent
    detection_probability: float | Callable[[np.ndarray], np.ndarray]
    clutter: Callable[[int], Clutter]  # the true intensity at scan t (from 0)
    horizon: int  # scans, T
    period: float  # s
    position: tuple[int, ...]  # which states are coordinates, m
    velocity: tuple[int, ...]  # which states are velocities, m/s
    cutoff: float  # m, and
    order: float  # of the distance between sets that scores an estimate

    @property
    def busiest(self) -> float:
        """Expected number of false alarms in the scan that has most of them."""
        return max(self.clutter(t).expected for t in range(self.horizon))

    @cached_property
    def parts(self) -> Parts:
        """The true clutter of all scans, as `scans_into` draws it."""
        return parts_of([self.clutter(t) for t in range(self.horizon)])

    def __getstate__(self) -> dict[str, Any]:
        """Its fields alone: stored runs are found by them, whether or not an episode was drawn before."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @property
    def most_in_scan(self) -> int:
        """Detections that an array for one scan has room for, see `capacity`."""
        return capacity(self.busiest) - 1 + self.targets

    @property
    def most(self) -> int:
        """Detections that an array for a whole episode has room for, see `capacity`."""
        return capacity(float(self.parts.w.sum())) + self.horizon * self.targets


class MultiTargetEpisode(NamedTuple):
    """One drawn episode. Nothing in it depends on the estimates of a tracker."""

    x: np.ndarray  # (T, m, d), true states, nan where a target is absent
    z: np.ndarray  # (N, p), the detections of all scans, those of one scan in random order
    origin: np.ndarray  # (N,), index of the target, -1 clutter
    first: np.ndarray  # (T + 1,), scan t has z[first[t] : first[t + 1]]


@dataclass(frozen=True)
class RecordedScenario(MultiTargetScenario):
    """A scenario whose episodes are parts of recorded ones: as many scans running as the horizon has.

    What is true is not known but for the targets' paths: `sensor` and `detection_probability` are those that
    a tracker assumes, and the `clutter` expects nan false alarms, in the box that the sensor covers.
    """

    recordings: tuple[MultiTargetEpisode, ...]  # of `targets` targets each, and no fewer scans than `horizon`

    @property
    def most_in_scan(self) -> int:
        """Detections in the scan that has most of them."""
        return max(int(np.diff(each.first).max()) for each in self.recordings)

    @property
    def most(self) -> int:
        """Detections in the episode that has most of them."""
        T = self.horizon
        return max(
            int((each.first[T:] - each.first[: len(each.first) - T]).max()) for each in self.recordings
        )


def part_of(
    recordings: Sequence[MultiTargetEpisode], horizon: int, rng: np.random.Generator
) -> MultiTargetEpisode:
    """So many scans of one of the recordings, from any scan on: which one and from where are drawn."""
    x, z, origin, first = recordings[int(rng.integers(len(recordings)))]
    start = int(rng.integers(len(x) - horizon + 1))
    first = first[start : start + horizon + 1]
    held = slice(first[0], first[-1])
    return MultiTargetEpisode(x[start : start + horizon], z[held], origin[held], first - first[0])


def draw(scenario: MultiTargetScenario, seed: int | np.random.SeedSequence) -> MultiTargetEpisode:
    """Draw one episode.

    Truth, detections and clutter have a random stream each. Of a `RecordedScenario` a part is drawn.

    Parameters
    ----------
    scenario : MultiTargetScenario
    seed : int or SeedSequence

    Returns
    -------
    MultiTargetEpisode

    Raises
    ------
    ValueError
        If the truth has another number of scans or targets than the scenario.

    Examples
    --------
    >>> from gmr_gym.scenarios.lv import unknown_clutter
    >>> from gmr_gym.simulation.multi_target import draw, scan
    >>> episode = draw(unknown_clutter(horizon=5), seed=1)
    >>> episode.x.shape
    (5, 3, 6)
    >>> scan(episode, 0).z.shape[1]
    2
    """
    for_truth, for_detection, for_clutter = (stream(seed, i) for i in range(3))
    if isinstance(scenario, RecordedScenario):
        return part_of(scenario.recordings, scenario.horizon, for_truth)
    x = scenario.truth(for_truth)
    shape = (scenario.horizon, scenario.targets)
    if x.shape[:2] != shape:
        raise ValueError(f"truth must be {shape[0]} scans of {shape[1]} targets, got shape {x.shape}")
    R = scenario.sensor.R
    noise = for_detection.standard_normal((*shape, len(R))) @ np.linalg.cholesky(R).T
    measured = scenario.sensor.measure(x) + noise  # nan where a target is absent: in no box
    P_D = scenario.detection_probability
    detected = for_detection.random(shape) < (P_D(x) if callable(P_D) else P_D)
    ranks = for_detection.random(shape)
    z = np.empty((scenario.most, len(R)))
    origin = np.empty(scenario.most, int)
    first = scans_into(z, origin, scenario.parts, measured, detected, ranks, for_clutter)
    return MultiTargetEpisode(x, z[: first[-1]], origin[: first[-1]], first)


def scan(episode: MultiTargetEpisode, t: int) -> Scan:
    """Scan t (from 0) of an episode.

    Parameters
    ----------
    episode : MultiTargetEpisode
    t : int
        Number of the scan, from 0.

    Returns
    -------
    Scan
    """
    span = slice(episode.first[t], episode.first[t + 1])
    return Scan(episode.z[span], episode.origin[span])


def draw_clutter(clutter: Clutter, rng: np.random.Generator) -> np.ndarray:
    """Draw the false alarms of one scan.

    They form a Poisson process of intensity `clutter.density` inside the box. Points of Gaussians and
    ellipses that fall outside the box are dropped, not drawn again. The density inside the box is then as
    given, and `clutter.expected` exceeds the expected number of points where a component reaches out.

    Parameters
    ----------
    clutter : Clutter
    rng : Generator

    Returns
    -------
    ndarray (k, p)
        False alarms, m.
    """
    z = np.empty((capacity(clutter.expected), len(clutter.low)))
    return z[: false_alarms_into(z, parts_of([clutter]), 0, rng)]
