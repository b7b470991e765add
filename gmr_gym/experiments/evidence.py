"""What claims and tables need of a tracker's runs, once the runs themselves are gone: named quantities, and
the rows and differences that tables of several errors have alike."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from types import SimpleNamespace
from typing import Any

import numpy as np

from gmr_gym.evaluation.curves import resampled
from gmr_gym.evaluation.montecarlo import Runs
from gmr_gym.evaluation.summary import Estimate, in_common, paired_share, wilson
from gmr_gym.simulation.single_target import Scenario

Quantities = Mapping[str, Callable[[Any, Any], Any]]  # name -> (scenario, runs) -> arrays (runs, ...)
Results = Mapping[str, Runs]  # by tracker
Rows = dict[str, dict[str, Estimate]]  # by tracker and metric


class Evidence(SimpleNamespace):
    """The quantities of one tracker's runs by name, each (runs, ...); `kept` (runs,) are the runs it did not
    lose."""


def measured(quantities: Quantities, scenario: Any, runs: Any) -> Evidence:
    """The quantities of one tracker's runs."""
    return Evidence(**{name: quantity(scenario, runs) for name, quantity in quantities.items()})


def all_measured(
    quantities: Quantities, scenario: Any, results: Mapping[str, Any], names: Iterable[str] | None = None
) -> dict[str, Evidence]:
    """The quantities of every tracker's runs; with `names`, of as many of the first, by these names."""
    each = zip(results if names is None else names, results.values(), strict=names is None)
    return {name: measured(quantities, scenario, runs) for name, runs in each}


def error(scenario: Scenario, runs: Runs) -> np.ndarray:
    """Of the state (runs, T, d)."""
    return runs.x - runs.truth


def squared_position(scenario: Scenario, runs: Runs) -> np.ndarray:
    """Squared error of the position (runs, T), m^2."""
    return (error(scenario, runs)[..., list(scenario.position)] ** 2).sum(axis=-1)


def squared_velocity(scenario: Scenario, runs: Runs) -> np.ndarray:
    """Squared error of the velocity (runs, T), (m/s)^2."""
    return (error(scenario, runs)[..., list(scenario.velocity)] ** 2).sum(axis=-1)


def mean(weight: np.ndarray, values: np.ndarray) -> float:
    """Over the runs as often as they are drawn; nan where none is."""
    return float(weight @ values / weight.sum()) if weight.any() else np.nan


def error_rows(every: Mapping[str, Evidence], names: Sequence[str], errors: Callable) -> Rows:
    """The share of runs lost, and the errors(evidence, weight) by these names: `_own` over the runs the
    tracker kept, `_common` over those that all trackers kept that kept any."""
    common = in_common({name: one.kept for name, one in every.items()})
    rows: Rows = {}
    for name, one in every.items():
        rows[name] = {"track_loss": wilson(int((~one.kept).sum()), len(one.kept))}
        for which, mask in (("own", one.kept), ("common", common[name])):
            figures = resampled(partial(errors, one), mask)
            rows[name] |= {f"{error}_{which}": f for error, f in zip(names, figures, strict=True)}
    return rows


def error_differences(
    quantities: Quantities, names: Sequence[str], errors: Callable, scenario: Any, results: Mapping[str, Any]
) -> Rows:
    """Every tracker minus the first on the same episodes: track_loss over all runs, the errors(evidence,
    weight) by these names over the runs that neither of the two lost."""

    def gains(one: Evidence, against: Evidence) -> dict[str, Estimate]:
        both = one.kept & against.kept
        figures = resampled(lambda weight: errors(one, weight) - errors(against, weight), both)
        return {f"{error}_common": figure for error, figure in zip(names, figures, strict=True)}

    return differences(quantities, gains, scenario, results)


def differences(
    quantities: Quantities,
    gains: Callable[[Evidence, Evidence], dict[str, Estimate]],
    scenario: Any,
    results: Mapping[str, Any],
) -> Rows:
    """Every tracker minus the first on the same episodes: track_loss over all runs, and gains(one, first)."""
    (reference, against), *others = all_measured(quantities, scenario, results).items()
    return {
        f"{name} - {reference}": {
            "track_loss": paired_share(against.kept.astype(float) - one.kept),
            **gains(one, against),
        }
        for name, one in others
    }
