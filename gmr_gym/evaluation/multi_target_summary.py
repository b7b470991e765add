"""From runs of many targets to figures with intervals: one row of a table per tracker."""

from collections.abc import Mapping

import numpy as np

from gmr_gym.evaluation.metrics import cardinality_error
from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns
from gmr_gym.evaluation.summary import Estimate, bootstrap_mean
from gmr_gym.simulation.multi_target import MultiTargetScenario


def multi_target_summary(
    scenario: MultiTargetScenario, results: Mapping[str, MultiTargetRuns]
) -> dict[str, dict[str, Estimate]]:
    """One row of figures per tracker, means over scans with intervals over runs: ospa and gospa (m), what
    gospa is made of (m^2 with order 2), cardinality_bias (targets named less those there),
    cardinality_error (its size), wasserstein (m) over the scans at which it is defined and the share
    wasserstein_undefined of those at which it is not, density_error, components, time_per_scan (s,
    median)."""
    rows = {}
    for name, runs in results.items():
        surplus = (runs.named - runs.targets).astype(float)
        fields = ("ospa", "gospa", "localisation", "missed", "false")
        rows[name] = {field: bootstrap_mean(getattr(runs, field).mean(axis=1)) for field in fields} | {
            "wasserstein": bootstrap_mean(defined(compared(runs.wasserstein))),
            "wasserstein_undefined": bootstrap_mean(np.isnan(runs.wasserstein).mean(axis=1)),
            "cardinality_bias": bootstrap_mean(surplus.mean(axis=1)),
            "cardinality_error": bootstrap_mean(cardinality_error(runs.named, runs.targets).mean(axis=1)),
            "density_error": bootstrap_mean(defined(compared(runs.density_error))),
            "components": bootstrap_mean(runs.components.mean(axis=1)),
            "time_per_scan": Estimate(float(np.median(runs.seconds))),
        }
    return rows


def multi_target_differences(
    scenario: MultiTargetScenario, results: Mapping[str, MultiTargetRuns]
) -> dict[str, dict[str, Estimate]]:
    """Every tracker minus the first, run by run on the same episodes: ospa, gospa (m), cardinality_error."""
    (reference, against), *others = results.items()
    return {
        f"{name} - {reference}": {
            "ospa": bootstrap_mean((runs.ospa - against.ospa).mean(axis=1)),
            "gospa": bootstrap_mean((runs.gospa - against.gospa).mean(axis=1)),
            "cardinality_error": bootstrap_mean(
                cardinality_error(runs.named, runs.targets).mean(axis=1)
                - cardinality_error(against.named, against.targets).mean(axis=1)
            ),
        }
        for name, runs in others
    }


def compared(values: np.ndarray) -> np.ndarray:
    """Means (runs,) over the scans at which values (runs, T) are defined; nan where none is."""
    return mean_where(values, np.isfinite(values))


def defined(values: np.ndarray) -> np.ndarray:
    """Those of the values (runs,) that are numbers: a run without one is left out, it is no 0."""
    return values[np.isfinite(values)]


def mean_where(values: np.ndarray, there: np.ndarray) -> np.ndarray:
    """Means (runs,) of values (runs, T) over the scans that are `there` (runs, T); nan for none."""
    total = np.where(there, values, 0.0).sum(axis=1)
    return np.where(there.any(axis=1), total, np.nan) / np.maximum(there.sum(axis=1), 1)
