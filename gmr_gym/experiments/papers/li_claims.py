"""What Li, Wu and Zhang say of their IMM-DCM-PDA against IMM-EKF-PDA: of error, loss and time."""

from collections.abc import Callable
from functools import partial

import numpy as np

from gmr_gym.evaluation.montecarlo import Runs
from gmr_gym.evaluation.summary import not_lost
from gmr_gym.experiments.claims import Claim
from gmr_gym.experiments.evidence import Evidence, Quantities, error
from gmr_gym.simulation.single_target import Scenario

EKF, DCM = "imm-ekf-pda", "imm-dcm-pda"
AXES = ("x", "y", "z")
NO_SLOWER = 10.0  # %: a longer scan within this counts as no slower


def squared_by_axis(first: int, scenario: Scenario, runs: Runs) -> np.ndarray:
    """Squared error by axis (runs, 3), mean over the scans from the first on, m^2."""
    return (error(scenario, runs)[:, first:, list(scenario.position)] ** 2).mean(axis=1)


QUANTITIES: Quantities = {
    "squared": partial(squared_by_axis, 0),
    "kept": not_lost,
    "seconds": lambda scenario, runs: np.median(runs.seconds, axis=1),  # of a scan
}


def rmse(one: Evidence, weight: np.ndarray) -> np.ndarray:
    """Of the position, and of each axis (4,), m."""
    squared = weight / weight.sum() @ one.squared
    return np.sqrt(np.append(squared.sum(), squared))


def saved(one: Evidence, against: Evidence, weight: np.ndarray) -> np.ndarray:
    """Share (4,) of the error of `against` that `one` does not make, %."""
    return 100 * (1 - rmse(one, weight) / rmse(against, weight))


def _error_saved(i: int, weight: np.ndarray, dcm: Evidence, ekf: Evidence) -> float:
    """Over the runs that neither lost, %; of the position, or of an axis."""
    both = weight * (dcm.kept & ekf.kept)
    return float(saved(dcm, ekf, both)[i]) if both.any() else np.nan


def _lost_less(weight: np.ndarray, dcm: Evidence, ekf: Evidence) -> float:
    return float(weight @ (dcm.kept.astype(float) - ekf.kept) / weight.sum())


def _time_saved(weight: np.ndarray, dcm: Evidence, ekf: Evidence) -> float:
    return float(100 * (1 - weight @ dcm.seconds / (weight @ ekf.seconds)))


BETTER = "better tracking performance than IMM-EKF-PDA"
_SAID: tuple[tuple[str, str, float, Callable], ...] = (
    (BETTER, "position error saved, %", 0.0, partial(_error_saved, 0)),
    *(
        (f"smaller {axis} error (Fig. {i + 1})", f"{axis} error saved, %", 0.0, partial(_error_saved, i))
        for i, axis in enumerate(AXES, 1)
    ),
    (BETTER, "share of runs lost less", 0.0, _lost_less),
    ("no more computation than IMM-EKF-PDA", "time of a scan saved, %", -NO_SLOWER, _time_saved),
)
CLAIMS = tuple(Claim(*said, DCM, EKF, widened=said[-1] is _lost_less) for said in _SAID)
