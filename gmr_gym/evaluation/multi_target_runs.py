"""Runs of trackers of many targets, scored."""

from collections.abc import Iterator
from itertools import islice
from time import perf_counter
from typing import NamedTuple

import numpy as np

from gmr_gym.evaluation.metrics import gospa, ospa, wasserstein
from gmr_gym.evaluation.track_scores import declared, track_scores
from gmr_gym.filters.tracker import MultiTargetReport, MultiTargetTracker
from gmr_gym.models.clutter import Clutter
from gmr_gym.simulation.multi_target import MultiTargetEpisode, MultiTargetScenario, draw, scan

SIDE = 40  # points along each side of the box at which clutter intensities are compared
EVERY = 5  # scans between comparisons


class MultiTargetRuns(NamedTuple):
    """Results of one tracker, by run (first axis) and scan (second)."""

    ospa: np.ndarray  # (runs, T), m, with the scenario's cutoff and order
    gospa: np.ndarray  # (runs, T), m, and its parts, m^order:
    localisation: np.ndarray  # (runs, T)
    missed: np.ndarray  # (runs, T)
    false: np.ndarray  # (runs, T)
    wasserstein: np.ndarray  # (runs, T), m; nan where either set is empty
    targets: np.ndarray  # (runs, T), number of true targets
    named: np.ndarray  # (runs, T), number of declared targets
    expected: np.ndarray  # (runs, T), expected number of targets
    components: np.ndarray  # (runs, T), of the intensity kept
    # (runs, T), integral over the box of the absolute difference between assumed and true clutter intensity,
    # over the true expected number; nan at scans between comparisons
    density_error: np.ndarray
    # (runs, T) each, see `TrackScores`
    trajectory_localisation: np.ndarray
    trajectory_missed: np.ndarray
    trajectory_false: np.ndarray
    trajectory_switches: np.ndarray
    switches: np.ndarray
    kept: np.ndarray
    fragments: np.ndarray
    appeared: np.ndarray
    unfound: np.ndarray
    found: np.ndarray
    existence: np.ndarray
    squared_surprise: np.ndarray
    nees: np.ndarray
    believed: np.ndarray
    # (runs, T, b) each, by bin of existence
    binned: np.ndarray
    binned_found: np.ndarray
    binned_existence: np.ndarray
    seconds: np.ndarray  # (runs, T), time of the tracker alone


def run_multi_target_once(
    scenario: MultiTargetScenario,
    tracker: MultiTargetTracker,
    seed: int | np.random.SeedSequence,
    scans: int | None = None,
) -> MultiTargetRuns:
    """Run a tracker of many targets through one episode.

    Parameters
    ----------
    scenario : MultiTargetScenario
    tracker : MultiTargetTracker
    seed : int or SeedSequence
    scans : int, optional
        Number of scans to run; all by default.

    Returns
    -------
    MultiTargetRuns
        Arrays without the axis of runs.
    """
    episode, rows, named, times = draw(scenario, seed), [], [], []
    at, grid = list(scenario.position), None
    for t, (report, seconds) in islice(enumerate(play(tracker, episode)), scans):
        x = episode.x[t]
        truth, found = x[np.isfinite(x).all(axis=1)][:, at], report.x[:, at]
        parts = gospa(found, truth, scenario.cutoff, scenario.order)
        off = np.nan
        if t % EVERY == 0:
            true = scenario.clutter(t)
            grid = places(true) if grid is None else grid
            off = density_error(report.clutter, true, grid)
        rows.append((
            ospa(found, truth, scenario.cutoff, scenario.order), *parts, wasserstein(found, truth),
            len(truth), len(found), report.expected_targets, len(report.intensity.w), off,
        ))  # fmt: skip
        named.append(declared(report))
        times.append(seconds)
    scores = track_scores(named, episode.x[: len(named)], at, scenario.cutoff, scenario.order)
    sets = [np.array(column) for column in zip(*rows, strict=True)]
    return MultiTargetRuns(*[*sets, *scores, np.array(times)])


def play(
    tracker: MultiTargetTracker, episode: MultiTargetEpisode
) -> Iterator[tuple[MultiTargetReport, float]]:
    """Run a tracker through an episode, scan by scan.

    Parameters
    ----------
    tracker : MultiTargetTracker
    episode : MultiTargetEpisode

    Yields
    ------
    report : MultiTargetReport
    seconds : float
        Time of the tracker alone.
    """
    belief = tracker.init()
    for t in range(len(episode.x)):
        z = scan(episode, t).z
        started = perf_counter()
        belief, report = tracker.step(belief, z)
        yield report, perf_counter() - started


def density_error(assumed: Clutter, true: Clutter, points: np.ndarray) -> float:
    """Relative error of a clutter intensity.

    Parameters
    ----------
    assumed : Clutter
        Intensity of the tracker.
    true : Clutter
        Intensity of the scenario.
    points : ndarray (k, p)
        Points that stand for equal parts of the box, see `places`.

    Returns
    -------
    float
        Integral over the box of the absolute difference, divided by the true expected number; nan where that
        is 0.
    """
    cell = true.volume / len(points)
    difference = np.abs(assumed.density(points) - true.density(points)).sum() * cell
    return float(difference / true.expected) if true.expected > 0 else np.nan


def places(clutter: Clutter) -> np.ndarray:
    """Centres (SIDE^p, p) of equal parts of the box of the clutter."""
    sides = [
        low + (high - low) * (np.arange(SIDE) + 0.5) / SIDE
        for low, high in zip(clutter.low, clutter.high, strict=True)
    ]
    return np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, len(sides))
