"""Runs of many targets as numbers with intervals, one row of a table per tracker."""

from collections.abc import Mapping

import numpy as np

from gmr_gym.evaluation.metrics import cardinality_error
from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns
from gmr_gym.evaluation.summary import Estimate, bootstrap_mean
from gmr_gym.simulation.multi_target import MultiTargetScenario

TRAJECTORY_PARTS = "trajectory_localisation", "trajectory_missed", "trajectory_false", "trajectory_switches"
TRACK_FIGURES = (
    "trajectory_gospa", *TRAJECTORY_PARTS, "switches", "labels_kept", "fragments", "time_to_find",
    "existence_bias", "existence_brier", "anees",
)  # fmt: skip


def multi_target_summary(
    scenario: MultiTargetScenario, results: Mapping[str, MultiTargetRuns]
) -> dict[str, dict[str, Estimate]]:
    """Summarise runs, one row per tracker: means over scans with intervals over runs.

    Parameters
    ----------
    scenario : MultiTargetScenario
    results : mapping of str to MultiTargetRuns

    Returns
    -------
    dict of str to dict of str to Estimate
        ospa and gospa (m); localisation, missed and false, the parts of gospa (m^2 with order 2);
        cardinality_bias (declared minus true targets) and cardinality_error (its absolute value); wasserstein
        (m) over the scans at which it is defined, and wasserstein_undefined, the share of the other scans;
        density_error, components, the figures of `track_figures`, and time_per_scan (s, median).
    """
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
            **{key: bootstrap_mean(defined(each)) for key, each in track_figures(scenario, runs).items()},
            "time_per_scan": Estimate(float(np.median(runs.seconds))),
        }
    return rows


def track_figures(scenario: MultiTargetScenario, runs: MultiTargetRuns) -> dict[str, np.ndarray]:
    """What becomes of labelled targets, run by run.

    Parameters
    ----------
    scenario : MultiTargetScenario
    runs : MultiTargetRuns

    Returns
    -------
    dict of str to ndarray (runs,)
        trajectory_gospa (m), the root of the mean over scans of what it is the sum of, and these means,
        trajectory_localisation, trajectory_missed, trajectory_false and trajectory_switches (m^2 with order
        2); switches and fragments in all scans; labels_kept, the share of the scans of targets at which they
        are found by the label by which they were found first; time_to_find (s), from the first scan of a
        target to the first at which it is found, or its last; existence_bias, the mean existence of declared
        targets less the share that is real, existence_brier, the mean square of the difference of each;
        anees, the normalised squared error of the states of found targets over the number of states. nan
        where there is nothing to tell, as of labels where no declared target has one.
    """
    parts = {field: getattr(runs, field).mean(axis=1) for field in TRAJECTORY_PARTS}

    def per(total: np.ndarray, number: np.ndarray) -> np.ndarray:
        number = number.sum(axis=1)
        return np.where(number > 0, total.sum(axis=1), np.nan) / np.maximum(number, 1)

    d = scenario.sensor.H.shape[1]
    return dict(zip(TRACK_FIGURES, (
        sum(parts.values()) ** (1 / scenario.order), *parts.values(),
        runs.switches.sum(axis=1), per(runs.kept, runs.targets), runs.fragments.sum(axis=1),
        scenario.period * per(runs.unfound, runs.appeared),
        per(runs.existence - runs.found, runs.named), per(runs.squared_surprise, runs.named),
        per(runs.nees, runs.believed) / d,
    ), strict=True))  # fmt: skip


def reliability(runs: MultiTargetRuns) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """How far probabilities of existence are to be believed.

    Parameters
    ----------
    runs : MultiTargetRuns

    Returns
    -------
    existence : ndarray (b,)
        Mean reported probability of the declared targets of each bin of existence; nan where there are none.
    real : ndarray (b,)
        Share of them that are near a true target, paired off.
    number : ndarray (b,)
        How many they are, of all runs and scans.
    """
    number, real, existence = (
        each.sum(axis=(0, 1)) for each in (runs.binned, runs.binned_found, runs.binned_existence)
    )
    some = np.where(number > 0, number, np.nan)
    return existence / some, real / some, number


def multi_target_differences(
    scenario: MultiTargetScenario, results: Mapping[str, MultiTargetRuns]
) -> dict[str, dict[str, Estimate]]:
    """Differences of every tracker from the first, run by run on the same episodes.

    Parameters
    ----------
    scenario : MultiTargetScenario
    results : mapping of str to MultiTargetRuns

    Returns
    -------
    dict of str to dict of str to Estimate
        ospa, gospa and trajectory_gospa (m), and cardinality_error.
    """
    (reference, against), *others = results.items()
    return {
        f"{name} - {reference}": {
            "ospa": bootstrap_mean((runs.ospa - against.ospa).mean(axis=1)),
            "gospa": bootstrap_mean((runs.gospa - against.gospa).mean(axis=1)),
            "trajectory_gospa": bootstrap_mean(
                defined(_trajectory_gospa(scenario, runs) - _trajectory_gospa(scenario, against))
            ),
            "cardinality_error": bootstrap_mean(
                cardinality_error(runs.named, runs.targets).mean(axis=1)
                - cardinality_error(against.named, against.targets).mean(axis=1)
            ),
        }
        for name, runs in others
    }


def _trajectory_gospa(scenario: MultiTargetScenario, runs: MultiTargetRuns) -> np.ndarray:
    return track_figures(scenario, runs)["trajectory_gospa"]


def compared(values: np.ndarray) -> np.ndarray:
    """Means (runs,) over the scans at which values (runs, T) are finite; nan where none is."""
    return mean_where(values, np.isfinite(values))


def defined(values: np.ndarray) -> np.ndarray:
    """The finite ones of the values (runs,): a run without a value is left out, not counted as 0."""
    return values[np.isfinite(values)]


def mean_where(values: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """Means (runs,) of values (runs, T) over the scans in the mask (runs, T); nan where there are none."""
    total = np.where(mask, values, 0.0).sum(axis=1)
    return np.where(mask.any(axis=1), total, np.nan) / np.maximum(mask.sum(axis=1), 1)
