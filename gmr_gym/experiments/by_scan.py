"""What becomes of a target scan by scan, as means over runs."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from gmr_gym.evaluation.metrics import cardinality_error, lost_at
from gmr_gym.evaluation.summary import errors, in_common, not_lost
from gmr_gym.simulation.multi_target import MultiTargetScenario
from gmr_gym.simulation.single_target import Scenario

Means = dict[str, dict[str, np.ndarray]]  # by tracker and figure, (T,)


def by_scan(scenario: Scenario | MultiTargetScenario, results: Mapping[str, Any]) -> Means:
    """Of one target: error_common (m), over the runs that no tracker lost, and track_loss, the share of runs
    that are lost by then. Of many: gospa (m), trajectory_switches (m^2), cardinality_bias and
    cardinality_error. Of both: components."""
    found = _multi_target(results) if isinstance(scenario, MultiTargetScenario) else _one(scenario, results)
    return {
        name: {**found[name], "components": runs.components.mean(axis=0)} for name, runs in results.items()
    }


def _one(scenario: Scenario, results: Mapping[str, Any]) -> Means:
    kept = in_common({name: not_lost(scenario, runs) for name, runs in results.items()})
    means = {}
    for name, runs in results.items():
        position, scans = errors(scenario, runs)[0][kept[name]], np.arange(runs.x.shape[1])
        lost = lost_at(runs.off_target, scenario.patience)[:, None]
        means[name] = {
            "error_common": position.sum(axis=0) / len(position)
            if len(position)
            else np.full(len(scans), np.nan),
            "track_loss": ((lost >= 0) & (lost <= scans)).mean(axis=0),
        }
    return means


def _multi_target(results: Mapping[str, Any]) -> Means:
    return {
        name: {
            "gospa": runs.gospa.mean(axis=0),
            "trajectory_switches": runs.trajectory_switches.mean(axis=0),
            "cardinality_bias": (runs.named - runs.targets.astype(float)).mean(axis=0),
            "cardinality_error": cardinality_error(runs.named, runs.targets).mean(axis=0),
        }
        for name, runs in results.items()
    }
