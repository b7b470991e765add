"""What a tracker of many targets does in a run, scored."""

from collections.abc import Iterator
from itertools import islice
from time import perf_counter
from typing import NamedTuple

import numpy as np

from gmr_gym.evaluation.metrics import gospa, ospa, wasserstein
from gmr_gym.filters.tracker import MultiTargetReport, MultiTargetTracker
from gmr_gym.models.clutter import Clutter
from gmr_gym.simulation.multi_target import MultiTargetEpisode, MultiTargetScenario, draw, scan

SIDE = 40  # places along each side of the box at which intensities of clutter are compared
EVERY = 5  # scans between comparisons


class MultiTargetRuns(NamedTuple):
    """What one tracker did, run by run (first axis) and scan by scan (second)."""

    ospa: np.ndarray  # (runs, T), m, with the scenario's cutoff and order
    gospa: np.ndarray  # (runs, T), m, and its parts, m^order:
    localisation: np.ndarray  # (runs, T)
    missed: np.ndarray  # (runs, T)
    false: np.ndarray  # (runs, T)
    wasserstein: np.ndarray  # (runs, T), m; nan where either set is empty
    targets: np.ndarray  # (runs, T), how many there were
    named: np.ndarray  # (runs, T), how many were named
    expected: np.ndarray  # (runs, T), how many were expected
    components: np.ndarray  # (runs, T), of the intensity kept
    # (runs, T), integral over the box of the difference between believed and true intensity of clutter, as a
    # share of what is truly expected; nan at scans that are left out
    density_error: np.ndarray
    seconds: np.ndarray  # (runs, T), of the tracker alone


def run_multi_target_once(
    scenario: MultiTargetScenario,
    tracker: MultiTargetTracker,
    seed: int | np.random.SeedSequence,
    scans: int | None = None,
) -> MultiTargetRuns:
    """One run of all scans, or of the first few; the arrays of MultiTargetRuns without their first axis."""
    episode, rows = draw(scenario, seed), []
    at, grid = list(scenario.position), None
    for t, (account, seconds) in islice(enumerate(play(tracker, episode)), scans):
        x = episode.x[t]
        truth, found = x[np.isfinite(x).all(axis=1)][:, at], account.x[:, at]
        parts = gospa(found, truth, scenario.cutoff, scenario.order)
        off = np.nan
        if t % EVERY == 0:
            true = scenario.clutter(t)
            grid = places(true) if grid is None else grid
            off = density_error(account.clutter, true, grid)
        rows.append((
            ospa(found, truth, scenario.cutoff, scenario.order), *parts, wasserstein(found, truth),
            len(truth), len(found), account.expected_targets, len(account.intensity.w), off, seconds,
        ))  # fmt: skip
    return MultiTargetRuns(*map(np.array, zip(*rows, strict=True)))


def play(
    tracker: MultiTargetTracker, episode: MultiTargetEpisode
) -> Iterator[tuple[MultiTargetReport, float]]:
    """What the tracker says of each scan of the episode, and how long it took, s."""
    belief = tracker.init()
    for t in range(len(episode.x)):
        z = scan(episode, t).z
        started = perf_counter()
        belief, account = tracker.step(belief, z)
        yield account, perf_counter() - started


def density_error(believed: Clutter, true: Clutter, places: np.ndarray) -> float:
    """Integral of the difference of two intensities over the box, from its value at places (k, p) that stand
    for equal parts of it, as a share of what the true one expects; nan where that is nothing."""
    cell = true.volume / len(places)
    difference = np.abs(believed.density(places) - true.density(places)).sum() * cell
    return float(difference / true.expected) if true.expected > 0 else np.nan


def places(clutter: Clutter) -> np.ndarray:
    """Middles (SIDE^p, p) of equal parts of the box."""
    sides = [
        low + (high - low) * (np.arange(SIDE) + 0.5) / SIDE
        for low, high in zip(clutter.low, clutter.high, strict=True)
    ]
    return np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, len(sides))
