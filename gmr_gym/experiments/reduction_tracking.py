"""What reductions do to tracking: lost tracks and errors by number of components, on the same episodes."""

from collections.abc import Iterable, Iterator, Mapping
from itertools import groupby
from typing import NamedTuple

import numpy as np

from gmr_gym.evaluation.montecarlo import Runs
from gmr_gym.evaluation.summary import (
    Estimate,
    bootstrap_mean,
    capped_error,
    not_lost,
    paired_share,
    wilson,
)
from gmr_gym.experiments.evidence import Rows
from gmr_gym.experiments.reduction_quality import Trial
from gmr_gym.simulation.single_target import Scenario

REFERENCE = "runnalls"  # what others are compared with
Cell = tuple[str, int, str]  # environment, components, reduction


class Outcome(NamedTuple):
    """What runs come to, by run; their covariances take gigabytes for all reductions together."""

    lost: np.ndarray  # (runs,)
    error: np.ndarray  # (runs,), m, no scan counted as more than the scenario's cutoff
    components: np.ndarray  # (runs,), mean over scans
    time_per_scan: float  # s, median


def unfit(trials: Mapping[str, Trial], slowest: float) -> dict[str, str]:
    """Why reductions do not track: those that are left out of an environment's posteriors, or take more than
    `slowest` times as long as Runnalls' for one."""
    longest = slowest * trials[REFERENCE].seconds
    slow = {
        name: f"{one.seconds / trials[REFERENCE].seconds:.3g} times as long as {REFERENCE} for a posterior"
        for name, one in trials.items()
        if one.seconds > longest
    }
    return slow | {name: one.reason for name, one in trials.items() if one.reason}


def outcome(scenario: Scenario, runs: Runs) -> Outcome:
    """What runs come to."""
    return Outcome(
        ~not_lost(scenario, runs), capped_error(scenario, runs), runs.components.mean(axis=1),
        float(np.nanmedian(runs.seconds)),
    )  # fmt: skip


def tables(outcomes: Iterable[tuple[Cell, Outcome]]) -> Iterator[tuple[tuple[str, int], Rows]]:
    """Figures of the reductions in each environment at each number of components, fewest losses first."""
    for key, group in groupby(outcomes, key=lambda item: item[0][:2]):
        found = {name: one for (*_, name), one in group}
        rows = {name: row(one, found[REFERENCE]) for name, one in found.items()}
        order = sorted(
            rows, key=lambda name: (rows[name]["track_loss"].value, rows[name]["error_capped"].value)
        )
        yield key, {name: rows[name] for name in order}


def row(one: Outcome, reference: Outcome) -> dict[str, Estimate]:
    """Figures of runs, and their differences from those of the reference, run by run."""
    return {
        "track_loss": wilson(int(one.lost.sum()), len(one.lost)),
        "track_loss_difference": paired_share(one.lost.astype(float) - reference.lost),
        "error_capped": bootstrap_mean(one.error),
        "error_difference": bootstrap_mean(one.error - reference.error),
        "components": Estimate(float(one.components.mean())),
        "time_per_scan": Estimate(one.time_per_scan),
    }
