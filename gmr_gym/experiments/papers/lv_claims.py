"""What Lv, Lian and Han say of their finite mixtures against a GM-PHD filter that takes clutter for uniform,
in three kinds of clutter; what learning the clutter brings beside, in sentences that begin with "ours"."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.evaluation.metrics import cardinality_error
from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns
from gmr_gym.evaluation.multi_target_summary import compared, defined, mean_where
from gmr_gym.evaluation.summary import Estimate, bootstrap_mean
from gmr_gym.experiments.tables import Claim, judged, no_event_width
from gmr_gym.simulation.multi_target import MultiTargetScenario

UNIFORM, LEARNED = "gm-phd", "learning-phd"
FITTED = ("fmm-em", "fmm-em:repaired=True", "fmm-gibbs", "fmm-gibbs:repaired=True")
# m: "about 10 m, approximately the square root of trace(Sigma)", which is 14.1
RIGHT = float(np.sqrt(200.0))
SETTLED = slice(25, 44)  # scans 26 to 44, in which targets 1 and 2 are there, no other, and none appears
# m of OSPA, little beside the 27 that taking clutter for uniform costs: between a clutter that is learned and
# one that is told, and what learning may cost where there is nothing to learn
CLOSE, LITTLE = 2.0, 0.5


class Evidence(NamedTuple):
    """Of one tracker, run by run (runs,)."""

    ospa: np.ndarray  # m, mean over scans
    printed: np.ndarray  # m, Wasserstein as eq. 41 has it, 0 where either set is empty, mean over scans
    wasserstein: np.ndarray  # (runs, T), m; nan where either set is empty
    off: np.ndarray  # by how many targets the number named was wrong, mean over scans
    false: np.ndarray  # estimates of nothing in a scan
    density: np.ndarray  # error of the intensity of clutter
    right: np.ndarray  # m, Wasserstein over the scans whose number was right; nan for none
    lost: np.ndarray  # targets lost in SETTLED
    again: np.ndarray  # and found again


def evidence(scenario: MultiTargetScenario, results: Mapping[str, MultiTargetRuns]) -> dict[str, Evidence]:
    """What the claims need of every tracker of a table."""
    found = {}
    for name, runs in results.items():
        right = (runs.named == runs.targets) & (runs.targets > 0)
        one = scenario.cutoff**scenario.order / 2
        missed = np.diff(np.rint(runs.missed[:, SETTLED] / one), axis=1)
        found[name] = Evidence(
            runs.ospa.mean(axis=1),
            np.nan_to_num(runs.wasserstein).mean(axis=1),
            runs.wasserstein,
            cardinality_error(runs.named, runs.targets).mean(axis=1),
            runs.false.mean(axis=1) / one,
            compared(runs.density_error),
            mean_where(runs.wasserstein, right),
            np.maximum(missed, 0).sum(axis=1),
            np.maximum(-missed, 0).sum(axis=1),
        )
    return found


def claims(evidence: Mapping[str, Mapping[str, Evidence]]) -> list[dict[str, Any]]:
    """A record for each sentence that the tables at hand can tell of; differences are run by run, on the same
    episodes."""
    asked = [
        (claim, table, name, ((table, name), (table, UNIFORM)))
        for table in evidence
        for name in FITTED
        for claim in PRINTED
    ]
    records = []
    for claim, table, name, needed in (*asked, *ACROSS):
        if all(other in evidence.get(where, ()) for where, other in needed):
            values = claim.value(*(evidence[where][other] for where, other in needed))
            if len(values):
                (figure,) = no_event_width([bootstrap_mean(values)], len(values))
            else:
                figure = Estimate(np.nan)
            records.append(judged(claim, figure, len(values), table=table, runs=name))
    return records


PRINTED = (
    Claim(
        "estimation accuracy of the target number improves",
        "number wrong by: gm-phd's less its own", 0.0, lambda own, phd: phd.off - own.off,
    ),
    Claim(
        "fake targets decrease",
        "estimates of nothing in a scan: gm-phd's less its own", 0.0, lambda own, phd: phd.false - own.false,
    ),
    Claim(
        "the Wasserstein distance is better",
        "gm-phd's less its own, m, both 0 where nothing is named", 0.0,
        lambda own, phd: phd.printed - own.printed,
    ),
    Claim(
        "ours: so it is over the scans at which both have one",
        "gm-phd's less its own, m", 0.0,
        lambda own, phd: defined(compared(phd.wasserstein - own.wasserstein)),
    ),
    Claim(
        "ours: by OSPA, too, which does not reward losing everything",
        "gm-phd's less its own, m", 0.0, lambda own, phd: phd.ospa - own.ospa,
    ),
    Claim(
        "with the number right the Wasserstein distance is about 10 m",
        f"{RIGHT:.1f} m less the distance there", 0.0, lambda own, phd: RIGHT - defined(own.right),
    ),
    Claim(
        "the fitted clutter converges to the real one",
        "share of clutter wrong: gm-phd's less its own", 0.0, lambda own, phd: phd.density - own.density,
    ),
    Claim(
        "a target that gets lost gets lost provisionally",
        "targets found again in scans 26 to 44 less half of those lost there", 0.0,
        lambda own, phd: own.again - own.lost / 2,
    ),
)  # fmt: skip
DENSER = Claim(
    "the denser the clutter that targets pass, the more fake targets",
    "estimates of nothing in a scan: less those where clutter is thinner", 0.0,
    lambda thin, thick: thick.false - thin.false,
)  # fmt: skip
AS_GOOD = Claim(
    "ours: a clutter that is learned is as good as one that is told",
    f"{CLOSE:g} m less the OSPA by which gm-phd with the true clutter is better", 0.0,
    lambda learned, told: CLOSE - (learned.ospa - told.ospa),
)  # fmt: skip
FREE = Claim(
    "ours: learning costs nothing where clutter is uniform",
    f"{LITTLE:g} m less the OSPA by which gm-phd is better", 0.0,
    lambda learned, uniform: LITTLE - (learned.ospa - uniform.ospa),
)  # fmt: skip
# with the table and the tracker they are about, and whose evidence they take
ACROSS = (
    (DENSER, "groups", UNIFORM, (("uniform", UNIFORM), ("groups", UNIFORM))),
    (DENSER, "dense", UNIFORM, (("groups", UNIFORM), ("dense", UNIFORM))),
    (AS_GOOD, "groups", LEARNED, (("groups", LEARNED), ("groups-told", UNIFORM))),
    (AS_GOOD, "dense", LEARNED, (("dense", LEARNED), ("dense-told", UNIFORM))),
    (FREE, "uniform", LEARNED, (("uniform", LEARNED), ("uniform", UNIFORM))),
)
