"""Runs as numbers with intervals, one row of a table per tracker."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from gmr_gym.evaluation.metrics import credibility, lost_at, nees
from gmr_gym.evaluation.montecarlo import Runs
from gmr_gym.simulation.single_target import Scenario

CONFIDENCE = 0.95
# runs, below which no claim is judged: with fewer normal errors, a 99 % interval by their sample standard
# deviation misses the mean more than twice as often as stated (Student's t)
FEWEST = 23


class Estimate(NamedTuple):
    """A number and its 95 % interval; low and high are nan where there is none."""

    value: float
    low: float = np.nan
    high: float = np.nan


def not_lost(scenario: Scenario, runs: Runs) -> np.ndarray:
    """Which runs kept their track, by the scenario's loss rule.

    Parameters
    ----------
    scenario : Scenario
    runs : Runs

    Returns
    -------
    ndarray of bool (runs,)
    """
    return lost_at(runs.off_target, scenario.patience) < 0


def in_common(own: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Which runs no tracker lost.

    A tracker that lost every run has none, and does not count for the others: with it no run would remain.

    Parameters
    ----------
    own : mapping of str to ndarray of bool (runs,)
        By tracker, the runs that it did not lose, see `not_lost`.

    Returns
    -------
    dict of str to ndarray of bool (runs,)

    Examples
    --------
    >>> import numpy as np
    >>> from gmr_gym.evaluation.summary import in_common
    >>> own = {"a": np.array([True, True, False]), "b": np.array([False, True, True]), "c": np.zeros(3, bool)}
    >>> {name: mask.tolist() for name, mask in in_common(own).items() if name != "b"}
    {'a': [False, True, False], 'c': [False, False, False]}
    """
    some = [mine for mine in own.values() if mine.any()]
    return {name: np.logical_and.reduce([mine, *some]) for name, mine in own.items()}


def errors(scenario: Scenario, runs: Runs) -> tuple[np.ndarray, np.ndarray]:
    """Euclidean errors of the estimates.

    Parameters
    ----------
    scenario : Scenario
    runs : Runs

    Returns
    -------
    position : ndarray (runs, T)
        m.
    velocity : ndarray (runs, T)
        m/s.
    """
    error = runs.x - runs.truth
    return (
        np.linalg.norm(error[..., list(scenario.position)], axis=-1),
        np.linalg.norm(error[..., list(scenario.velocity)], axis=-1),
    )


def capped_error(scenario: Scenario, runs: Runs) -> np.ndarray:
    """Position error (runs,), m, averaged over the scans, each counted at most as the scenario's cutoff."""
    return np.minimum(errors(scenario, runs)[0], scenario.cutoff).mean(axis=1)


def summary(scenario: Scenario, results: Mapping[str, Runs]) -> dict[str, dict[str, Estimate]]:
    """Summarise runs, one row per tracker.

    Parameters
    ----------
    scenario : Scenario
    results : mapping of str to Runs

    Returns
    -------
    dict of str to dict of str to Estimate
        track_loss (share of runs); rmse and error (position, m: root mean square and mean Euclidean error),
        velocity_rmse_own (m/s), anees_own (1 is credible), nci_own and inclination_own (dB); components,
        gate_area (m^2) and time_per_scan (s, median) over all runs and scans. `_own` is over the runs that
        the tracker did not lose, `_common` over those that no tracker lost, trackers that lost every run
        apart.
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
        defined = np.isfinite(index)  # a fixed initial state leaves too little spread in the first scan
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
    """Differences of every tracker from the first, run by run on the same episodes.

    Parameters
    ----------
    scenario : Scenario
    results : mapping of str to Runs

    Returns
    -------
    dict of str to dict of str to Estimate
        track_loss over all runs, and error_common (position, m) over the runs that neither of the two lost.
    """
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
    """Mean of paired differences of shares, with its 95 % interval.

    Where no run differs a bootstrap interval has no width; it is then as wide as that of no event in as many
    runs.

    Parameters
    ----------
    difference : ndarray (runs,)
        -1, 0 or 1.

    Returns
    -------
    Estimate
    """
    if difference.any():
        return bootstrap_mean(difference)
    most = wilson(0, len(difference)).high
    return Estimate(0.0, -most, most)


def wilson(count: int, total: int) -> Estimate:
    r"""Share of events with its 95 % Wilson interval.

    Parameters
    ----------
    count : int
        Number of events.
    total : int
        Number of trials.

    Returns
    -------
    Estimate

    Notes
    -----
    For the share :math:`\hat p` of n trials and the normal quantile z = 1.96,

    .. math::

       \frac{\hat p + z^2 / 2n \pm z \sqrt{\hat p (1 - \hat p) / n + z^2 / 4n^2}}{1 + z^2 / n}

    Examples
    --------
    >>> from gmr_gym.evaluation.summary import wilson
    >>> [round(number, 3) for number in wilson(10, 100)]
    [0.1, 0.055, 0.174]
    """
    from scipy.stats import binomtest

    low, high = binomtest(count, total).proportion_ci(CONFIDENCE, method="wilson")
    return Estimate(count / total, float(low), float(high))


def bootstrap_mean(values: np.ndarray) -> Estimate:
    """Mean over runs with its 95 % bootstrap interval (percentiles).

    Parameters
    ----------
    values : ndarray (runs,)

    Returns
    -------
    Estimate
        All nan for no runs; without an interval for one run, and where the mean is not finite.
    """
    from scipy.stats import bootstrap  # takes a second to import

    if len(values) == 0:
        return Estimate(np.nan)
    value = float(np.mean(values))
    if len(values) < 2 or not np.isfinite(value):  # unbounded gates have no mean area
        return Estimate(value)
    if np.ptp(values) == 0:
        return Estimate(value, value, value)
    interval = bootstrap(
        (values,), np.mean, n_resamples=2000, batch=200, confidence_level=CONFIDENCE,
        method="percentile", rng=np.random.default_rng(0),
    ).confidence_interval  # fmt: skip
    return Estimate(value, float(interval.low), float(interval.high))


def _root(estimate: Estimate) -> Estimate:
    return Estimate(*np.sqrt(estimate).tolist())
