"""What Lv, Lian and Han say of their finite mixtures against a GM-PHD filter that takes clutter for uniform,
in three kinds of clutter; what learning the clutter brings beside, in sentences that begin with "ours"."""

from collections.abc import Iterable
from functools import partial

import numpy as np

from gmr_gym.evaluation.metrics import cardinality_error
from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns
from gmr_gym.evaluation.multi_target_summary import compared, defined, mean_where
from gmr_gym.experiments.claims import Asked, Claim, number
from gmr_gym.experiments.evidence import Evidence, Quantities
from gmr_gym.simulation.multi_target import MultiTargetScenario

UNIFORM, LEARNED = "gm-phd", "learning-phd"
FITTED = ("fmm-em", "fmm-em:repaired=True", "fmm-gibbs", "fmm-gibbs:repaired=True")
# m: "about 10 m, approximately the square root of trace(Sigma)", which is 14.1
RIGHT = float(np.sqrt(200.0))
SETTLED = slice(25, 44)  # scans 26 to 44, in which targets 1 and 2 are there, no other, and none appears
# m of OSPA, little beside the 27 that taking clutter for uniform costs: between a clutter that is learned and
# one that is told, and what learning may cost where there is nothing to learn
CLOSE, LITTLE = 2.0, 0.5


def _right(scenario: MultiTargetScenario, runs: MultiTargetRuns) -> np.ndarray:
    return mean_where(runs.wasserstein, (runs.named == runs.targets) & (runs.targets > 0))


def _one(scenario: MultiTargetScenario) -> float:
    """What one target missed, or one estimate of nothing, is in GOSPA."""
    return scenario.cutoff**scenario.order / 2


def _newly_missed(sign: int, scenario: MultiTargetScenario, runs: MultiTargetRuns) -> np.ndarray:
    missed = np.diff(np.rint(runs.missed[:, SETTLED] / _one(scenario)), axis=1)
    return np.maximum(sign * missed, 0).sum(axis=1)


# of one tracker, run by run (runs,)
QUANTITIES: Quantities = {
    "ospa": lambda scenario, runs: runs.ospa.mean(axis=1),  # m
    # m, Wasserstein as eq. 41 has it, 0 where either set is empty
    "printed": lambda scenario, runs: np.nan_to_num(runs.wasserstein).mean(axis=1),
    "wasserstein": lambda scenario, runs: runs.wasserstein,  # (runs, T), m; nan where either set is empty
    # by how many targets the number named was wrong
    "off": lambda scenario, runs: cardinality_error(runs.named, runs.targets).mean(axis=1),
    # estimates of nothing in a scan
    "false": lambda scenario, runs: runs.false.mean(axis=1) / _one(scenario),
    "density": lambda scenario, runs: compared(runs.density_error),  # error of the intensity of clutter
    "right": _right,  # m, Wasserstein over the scans whose number was right; nan for none
    "lost": partial(_newly_missed, 1),  # targets lost in SETTLED
    "again": partial(_newly_missed, -1),  # and found again
}


@number
def less(quantity: str, own: Evidence, phd: Evidence) -> np.ndarray:
    """By how much it is less than gm-phd's, run by run (runs,)."""
    return getattr(phd, quantity) - getattr(own, quantity)


PRINTED = (
    Claim("estimation accuracy of the target number improves",
          "number wrong by: gm-phd's less its own", 0.0, less("off")),
    Claim("fake targets decrease",
          "estimates of nothing in a scan: gm-phd's less its own", 0.0, less("false")),
    Claim("the Wasserstein distance is better",
          "gm-phd's less its own, m, both 0 where nothing is named", 0.0, less("printed")),
    Claim("ours: so it is over the scans at which both have one",
          "gm-phd's less its own, m", 0.0,
          lambda own, phd: defined(compared(phd.wasserstein - own.wasserstein))),
    Claim("ours: by OSPA, too, which does not reward losing everything",
          "gm-phd's less its own, m", 0.0, less("ospa")),
    Claim("with the number right the Wasserstein distance is about 10 m",
          f"{RIGHT:.1f} m less the distance there", 0.0, lambda own, phd: RIGHT - defined(own.right)),
    Claim("the fitted clutter converges to the real one",
          "share of clutter wrong: gm-phd's less its own", 0.0, less("density")),
    Claim("a target that gets lost gets lost provisionally",
          "targets found again in scans 26 to 44 less half of those lost there", 0.0,
          lambda own, phd: own.again - own.lost / 2),
)  # fmt: skip
DENSER = Claim(
    "the denser the clutter that targets pass, the more fake targets",
    "estimates of nothing in a scan: less those where clutter is thinner", 0.0,
    less("false"), UNIFORM, UNIFORM,
)  # fmt: skip
AS_GOOD = Claim(
    "ours: a clutter that is learned is as good as one that is told",
    f"{CLOSE:g} m less the OSPA by which gm-phd with the true clutter is better", 0.0,
    CLOSE + less("ospa"), LEARNED, UNIFORM,
)  # fmt: skip
FREE = Claim(
    "ours: learning costs nothing where clutter is uniform",
    f"{LITTLE:g} m less the OSPA by which gm-phd is better", 0.0,
    LITTLE + less("ospa"), LEARNED, UNIFORM,
)  # fmt: skip
ACROSS = (
    Asked((DENSER,), ("uniform", "groups"), UNIFORM, "groups", run_by_run=True),
    Asked((DENSER,), ("groups", "dense"), UNIFORM, "dense", run_by_run=True),
    Asked((AS_GOOD,), ("groups", "groups-told"), LEARNED, "groups", run_by_run=True),
    Asked((AS_GOOD,), ("dense", "dense-told"), LEARNED, "dense", run_by_run=True),
    Asked((FREE,), ("uniform",), LEARNED, run_by_run=True),
)


def asked(tables: Iterable[str]) -> tuple[Asked, ...]:
    """The printed sentences of every fitted tracker of these tables, and those across tables; differences are
    run by run, on the same episodes."""
    printed = {name: tuple(claim._replace(of=name, against=UNIFORM) for claim in PRINTED) for name in FITTED}
    each = [Asked(printed[name], (table,), name, run_by_run=True) for table in tables for name in FITTED]
    return (*each, *ACROSS)
