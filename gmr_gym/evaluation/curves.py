"""Error and credibility per scan, over runs: the figures of Zhang, section 6.2, with intervals."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple
from warnings import catch_warnings, simplefilter

import numpy as np
from scipy.special import ndtri

from gmr_gym.evaluation.metrics import credibility, nees
from gmr_gym.evaluation.montecarlo import Runs
from gmr_gym.evaluation.summary import CONFIDENCE, Estimate, bootstrap_mean, in_common, not_lost, wilson
from gmr_gym.simulation.single_target import Scenario

RESAMPLES = 200


class Errors(NamedTuple):
    """Errors of one tracker, by run and scan."""

    error: np.ndarray  # (runs, T, d)
    claimed: np.ndarray  # (runs, T), normalised squared by the tracker's covariance (NEES)
    position: np.ndarray  # (runs, T), squared, m^2
    velocity: np.ndarray  # (runs, T), squared, (m/s)^2


class Curves(NamedTuple):
    """Means over runs, one number per scan (T,)."""

    rmse: np.ndarray  # position, m
    velocity_rmse: np.ndarray  # m/s
    nci: np.ndarray  # dB
    inclination: np.ndarray  # dB


CURVES = Curves._fields


def errors_of(scenario: Scenario, runs: Runs) -> Errors:
    """Errors of all runs.

    Parameters
    ----------
    scenario : Scenario
    runs : Runs

    Returns
    -------
    Errors
    """
    error = runs.x - runs.truth
    position, velocity = (
        (error[..., list(states)] ** 2).sum(axis=-1) for states in (scenario.position, scenario.velocity)
    )
    return Errors(error, nees(error, runs.P), position, velocity)


def curves(errors: Errors, weight: np.ndarray) -> Curves:
    """Curves over weighted runs.

    Parameters
    ----------
    errors : Errors
    weight : ndarray (runs,)
        Weight of each run, as a mask or the counts of a resampling.

    Returns
    -------
    Curves
        All nan where every weight is 0.
    """
    if not weight.any():
        return Curves(*np.full((len(CURVES), errors.position.shape[1]), np.nan))
    share = weight / weight.sum()
    index, inclination = credibility(errors.error, errors.claimed, weight)
    return Curves(np.sqrt(share @ errors.position), np.sqrt(share @ errors.velocity), index, inclination)


def resampled(statistic: Callable[[np.ndarray], np.ndarray], mask: np.ndarray) -> list[Estimate]:
    """A statistic of runs with its bootstrap interval.

    The interval is normal, by the bootstrap's standard error. Percentiles would be biased: with repeated runs
    in a sample the credibility comes out higher.

    Parameters
    ----------
    statistic : callable
        Maps weights (runs,) to numbers (s,).
    mask : ndarray (runs,)
        The runs to use.

    Returns
    -------
    list of Estimate
        s of them; all nan for fewer than two runs.
    """
    from scipy.stats import DegenerateDataWarning, bootstrap

    chosen = np.flatnonzero(mask)
    if len(chosen) < 2:
        return [Estimate(np.nan)] * len(statistic(np.ones(len(mask))))
    with catch_warnings():
        simplefilter("ignore", DegenerateDataWarning)  # of an interval that is not used
        error = bootstrap(
            (chosen,), lambda drawn: statistic(np.bincount(drawn.astype(int), minlength=len(mask))),
            vectorized=False, n_resamples=RESAMPLES, method="percentile", rng=np.random.default_rng(0),
        ).standard_error  # fmt: skip
    value = statistic(mask.astype(float))
    reach = ndtri((1 + CONFIDENCE) / 2) * error
    return [Estimate(*map(float, row)) for row in zip(value, value - reach, value + reach, strict=True)]


def averages(scenario: Scenario, results: Mapping[str, Runs]) -> dict[str, dict[str, Estimate]]:
    """Averages of the curves over the scans, one row per tracker.

    Parameters
    ----------
    scenario : Scenario
    results : mapping of str to Runs

    Returns
    -------
    dict of str to dict of str to Estimate
        track_loss (share of runs); the four curves, `_all` over all runs and `_common` over the runs that no
        tracker lost, trackers that lost every run apart; components, gate_area (m^2), time_per_scan (s,
        median) and time_worst (s).

    References
    ----------
    Zhang and Liu, section 6.2.
    """
    own = {name: not_lost(scenario, runs) for name, runs in results.items()}
    common = in_common(own)
    rows = {}
    for name, runs in results.items():
        errors = errors_of(scenario, runs)
        rows[name] = {"track_loss": wilson(int((~own[name]).sum()), len(runs.x))}
        for which, mask in (("all", np.ones(len(runs.x), bool)), ("common", common[name])):
            estimates = resampled(partial(_over_scans, errors), mask)
            rows[name] |= {f"{field}_{which}": one for field, one in zip(CURVES, estimates, strict=True)}
        rows[name] |= {
            "components": bootstrap_mean(runs.components.mean(axis=1)),
            "gate_area": bootstrap_mean(runs.gate_volume.mean(axis=1)),
            "time_per_scan": Estimate(float(np.nanmedian(runs.seconds))),
            "time_worst": Estimate(float(np.nanmax(runs.seconds))),
        }
    return rows


def _over_scans(errors: Errors, weight: np.ndarray) -> np.ndarray:
    return np.mean(curves(errors, weight), axis=1)
