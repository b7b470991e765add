"""From runs to figures with intervals: one row of a table per tracker."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from gmr_gym.evaluation.metrics import credibility, lost_at, nees
from gmr_gym.evaluation.montecarlo import Runs
from gmr_gym.simulation.single_target import Scenario

CONFIDENCE = 0.95
# runs, below which none is judged: of so many normal errors an interval of 99 % by their own deviation leaves
# the mean out more than twice as often as it says (Student's t)
FEWEST = 23


class Estimate(NamedTuple):
    """A figure and its 95 % interval; low and high are nan where none is given."""

    value: float
    low: float = np.nan
    high: float = np.nan


def not_lost(scenario: Scenario, runs: Runs) -> np.ndarray:
    """Which runs (runs,) the scenario's gate rule does not call lost."""
    return lost_at(runs.off_target, scenario.patience) < 0


def in_common(own: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Of each tracker the runs (runs,) that it and all others kept. One that lost every run has none, and no
    say in those of the others: with it there would be nothing to compare."""
    some = [mine for mine in own.values() if mine.any()]
    return {name: np.logical_and.reduce([mine, *some]) for name, mine in own.items()}


def errors(scenario: Scenario, runs: Runs) -> tuple[np.ndarray, np.ndarray]:
    """Position error (m) and velocity error (m/s), Euclidean, each (runs, T)."""
    error = runs.x - runs.truth
    return (
        np.linalg.norm(error[..., list(scenario.position)], axis=-1),
        np.linalg.norm(error[..., list(scenario.velocity)], axis=-1),
    )


def summary(scenario: Scenario, results: Mapping[str, Runs]) -> dict[str, dict[str, Estimate]]:
    """One row of figures per tracker; `_own` is over the runs the tracker itself kept, `_common`
    over the runs that all trackers of the table kept that kept any:

    track_loss (share of runs), rmse and error (position, m: root mean square and mean Euclidean),
    velocity_rmse_own (m/s), anees_own (1 is credible), nci_own and inclination_own (dB),
    components, gate_area (m^2) and time_per_scan (s, median) over all runs and scans.
    """
    own = {name: not_lost(scenario, runs) for name, runs in results.items()}
    common = in_common(own)
    rows = {}
    for name, runs in results.items():
        position, velocity = errors(scenario, runs)
        error = runs.x - runs.truth
        mine = own[name]
        claimed = nees(error, runs.P)
        index, inclination = credibility(error[mine], claimed[mine])
        defined = np.isfinite(index)  # a scripted start leaves too little spread in the first scan
        consistency = claimed.mean(axis=1) / error.shape[-1]
        rows[name] = {
            "track_loss": wilson(int((~mine).sum()), len(mine)),
            "rmse_own": _root(bootstrap_mean((position[mine] ** 2).mean(axis=1))),
            "rmse_common": _root(bootstrap_mean((position[common[name]] ** 2).mean(axis=1))),
            "error_own": bootstrap_mean(position[mine].mean(axis=1)),
            "error_common": bootstrap_mean(position[common[name]].mean(axis=1)),
            "velocity_rmse_own": _root(bootstrap_mean((velocity[mine] ** 2).mean(axis=1))),
            "anees_own": bootstrap_mean(consistency[mine]),
            "nci_own": Estimate(float(index[defined].mean()) if defined.any() else np.nan),
            "inclination_own": Estimate(float(inclination[defined].mean()) if defined.any() else np.nan),
            "components": bootstrap_mean(runs.components.mean(axis=1)),
            "gate_area": bootstrap_mean(runs.gate_volume.mean(axis=1)),
            "time_per_scan": Estimate(float(np.nanmedian(runs.seconds))),
        }
    return rows


def differences(scenario: Scenario, results: Mapping[str, Runs]) -> dict[str, dict[str, Estimate]]:
    """Every tracker minus the first, run by run on the same episodes: track_loss over all runs,
    error (position, m) over the runs that neither of the two lost."""
    (reference, against), *others = results.items()
    kept_reference = not_lost(scenario, against)
    error_reference = errors(scenario, against)[0].mean(axis=1)
    rows = {}
    for name, runs in others:
        mine = not_lost(scenario, runs)
        both = mine & kept_reference
        gain = errors(scenario, runs)[0].mean(axis=1) - error_reference
        rows[f"{name} - {reference}"] = {
            "track_loss": paired_share(kept_reference.astype(float) - mine),
            "error_common": bootstrap_mean(gain[both]),
        }
    return rows


def paired_share(difference: np.ndarray) -> Estimate:
    """Mean of differences -1, 0 or 1. Where none differs a bootstrap would claim certainty: the
    interval is then as wide as that of no event in as many runs."""
    if difference.any():
        return bootstrap_mean(difference)
    most = wilson(0, len(difference)).high
    return Estimate(0.0, -most, most)


def wilson(count: int, total: int) -> Estimate:
    """Share with its Wilson interval."""
    from scipy.stats import binomtest

    low, high = binomtest(count, total).proportion_ci(CONFIDENCE, method="wilson")
    return Estimate(count / total, float(low), float(high))


def bootstrap_mean(values: np.ndarray) -> Estimate:
    """Mean over runs (runs,) with its bootstrap interval; all nan for no runs."""
    from scipy.stats import bootstrap  # takes a second to import

    if len(values) == 0:
        return Estimate(np.nan)
    value = float(np.mean(values))
    if len(values) < 2 or not np.isfinite(value):  # gates without end have no mean area
        return Estimate(value)
    if np.ptp(values) == 0:
        return Estimate(value, value, value)
    interval = bootstrap(
        (values,), np.mean, n_resamples=2000, batch=200, confidence_level=CONFIDENCE,
        method="percentile", rng=np.random.default_rng(0),
    ).confidence_interval  # fmt: skip
    return Estimate(value, float(interval.low), float(interval.high))


def _root(figure: Estimate) -> Estimate:
    return Estimate(*np.sqrt(figure).tolist())
