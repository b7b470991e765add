"""What reductions do to tracking: lost tracks and errors by number of components, on the same episodes."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from typing import NamedTuple

import numpy as np

from gmr_gym.evaluation.montecarlo import Runs
from gmr_gym.evaluation.reduction_costs import Costs
from gmr_gym.evaluation.summary import Estimate, bootstrap_mean, capped_error, not_lost, paired_share, wilson
from gmr_gym.experiments.reduction_quality import Rows, left_out, tracker_with
from gmr_gym.experiments.sweeps import Sweep, runs_shown
from gmr_gym.simulation.single_target import Scenario

REFERENCE = "runnalls"  # what others are compared with
Cell = tuple[str, int, str]  # environment, components, reduction


class Outcome(NamedTuple):
    """What runs come to, by run; their covariances take gigabytes for all reductions together."""

    lost: np.ndarray  # (runs,)
    error: np.ndarray  # (runs,), m, no scan counted as more than the scenario's cutoff
    components: np.ndarray  # (runs,), mean over scans
    time_per_scan: float  # s, median


def fit(costs: Mapping[str, Costs], slowest: float) -> tuple[list[str], dict[str, str]]:
    """Reductions that take at most `slowest` times as long as Runnalls' for the posteriors of an environment,
    and why each of the others does not track there."""
    seconds = {name: float(np.median(found.seconds)) for name, found in costs.items()}
    unfit = left_out(costs) | {
        name: f"{taken / seconds[REFERENCE]:.3g} times as long as {REFERENCE} for a posterior"
        for name, taken in seconds.items()
        if taken > slowest * seconds[REFERENCE]
    }
    return [name for name in costs if name not in unfit], unfit


def tracked(
    scenarios: Mapping[str, Scenario], names: Mapping[str, Sequence[str]], counts: Sequence[int], sweep: Sweep
) -> Iterator[tuple[Cell, Outcome]]:
    """Runs the reductions `names` of every environment at every number of components, one after the other; of
    a shard see `runs_shown`."""
    cells = [(env_id, n, name) for env_id in scenarios for n in counts for name in names[env_id]]
    work = [
        (scenarios[env_id], {name: tracker_with(scenarios[env_id], components=n, reduction=name)})
        for env_id, n, name in cells
    ]
    for cell, found in zip(cells, runs_shown("tracking", work, sweep), strict=True):
        yield cell, found if sweep.shard else outcome(scenarios[cell[0]], found[cell[2]])


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
