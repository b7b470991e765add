"""Lv, Lian and Han: section 7 in three kinds of clutter, Figs. 1-9, and trackers that learn the clutter. The
paper prints no tables; its sentences set finite mixtures against a GM-PHD filter that takes clutter for
uniform, and those on what learning the clutter brings beside begin with "ours"."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Drawing

from gmr_gym.evaluation.metrics import cardinality_error
from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns
from gmr_gym.evaluation.multi_target_summary import (
    compared,
    defined,
    mean_where,
    multi_target_differences,
    multi_target_summary,
)
from gmr_gym.evaluation.summary import bootstrap_mean
from gmr_gym.experiments.claims import Asked, Claim, number
from gmr_gym.experiments.drawings import by_tracker, legend_above, save
from gmr_gym.experiments.evidence import Evidence, Quantities, Rows
from gmr_gym.experiments.papers.lv_episode import (
    LEARNED,
    TRACKS,
    UNIFORM,
    as_published,
    episode_figures,
    mean_by_time,
)
from gmr_gym.experiments.tables import Paper, Table
from gmr_gym.simulation.multi_target import MultiTargetScenario

Results = Mapping[str, MultiTargetRuns]  # by tracker
FITTED = ("fmm-em", "fmm-em:repaired=True", "fmm-gibbs", "fmm-gibbs:repaired=True")
COLUMNS = (
    "cardinality_bias", "wasserstein_printed", "wasserstein", "wasserstein_undefined", "ospa", "gospa",
    "localisation", "missed", "false", "density_error", "time_per_scan",
)  # fmt: skip
ALL = (
    UNIFORM, "gm-cphd", *FITTED, "fitted-phd", "fitted-phd:repaired=True", LEARNED, "pmb", TRACKS,
)  # fmt: skip
TOLD = (UNIFORM, "gm-cphd", "pmb")
# of the true clutter, so that nothing but the reduction differs
REDUCED = tuple(
    f"gm-phd:reduction={reduction},components={components}"
    for reduction, components in (
        ("vo-ma", 100), ("runnalls", 100), ("adaptive", 100),
        ("vo-ma", 20), ("runnalls", 20), ("adaptive", 20), ("west", 20), ("capping", 20),
    )
)  # fmt: skip
# the groups move together, across the square's middle
DRIFT = (
    (0.3, (500.0, 300.0), (300.0, 200.0), (-6.0, -4.0)),
    (0.2, (-100.0, 500.0), (200.0, 200.0), (-6.0, -4.0)),
    (0.2, (300.0, -100.0), (200.0, 200.0), (-6.0, -4.0)),
)
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


def _rows(scenario: MultiTargetScenario, results: Results) -> Rows:
    """The figures of `multi_target_summary`, and wasserstein_printed (m): as eq. 41 has it, 0 where either
    set is empty."""
    rows = multi_target_summary(scenario, results)
    for name, runs in results.items():
        rows[name]["wasserstein_printed"] = bootstrap_mean(QUANTITIES["printed"](scenario, runs))
    return rows


_table = partial(
    Table, env_id="gmr_gym/UnknownClutter-v0", runs=100, summarise=_rows, columns=COLUMNS,
    paired=multi_target_differences,
)  # fmt: skip
TABLES = (
    _table("groups", "section 7.1, clutter assumed uniform", trackers=as_published(ALL)),
    _table("groups-told", "section 7.1, the true clutter assumed",
           settings={"told": "true"}, trackers=as_published(TOLD)),
    _table("uniform", "clutter that is uniform indeed",
           settings={"clutter": "uniform"}, trackers=as_published(ALL)),
    _table("dense", "groups four times denser", settings={"clutter": "dense"}, trackers=as_published(ALL)),
    _table("dense-told", "groups four times denser, the true clutter assumed",
           settings={"clutter": "dense", "told": "true"}, trackers=as_published(TOLD)),
    _table("drift", "groups that drift at 7 m/s",
           settings={"groups": DRIFT}, trackers=as_published((UNIFORM, LEARNED, "pmb", TRACKS))),
    _table("reductions", "GM-PHD with the true clutter, by reduction",
           settings={"told": "true"}, trackers=as_published(REDUCED),
           columns=(*COLUMNS[:-2], "components", "time_per_scan")),
)  # fmt: skip

# what the paper says, run by run on the same episodes


@number
def less(quantity: str, own: Evidence, phd: Evidence) -> np.ndarray:
    """By how much it is less than gm-phd's, run by run (runs,)."""
    return getattr(phd, quantity) - getattr(own, quantity)


PRINTED = (
    Claim("estimation accuracy of the target number improves",
          "cardinality error: gm-phd's less its own", 0.0, less("off")),
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
    "ours: clutter that is learned is as good as clutter that is known",
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
# the printed sentences, of every fitted tracker of every table, and those across tables
ASKED = (
    *(
        Asked(
            tuple(claim._replace(of=name, against=UNIFORM) for claim in PRINTED), (table.name,), name,
            run_by_run=True,
        )
        for table in TABLES for name in FITTED
    ),
    *ACROSS,
)  # fmt: skip


def figures(table: Table, scenario: MultiTargetScenario, results: Results, rows: Rows, out: Path) -> None:
    """Means over runs by scan; of the section's own clutter also one episode: Figs. 1-9, and the clutter as
    fitted and as learned."""
    save(_by_scan(results), out / f"by-scan-{table.name}.png")
    if table.name == "groups":
        episode_figures(scenario, results, out)


def _by_scan(results: Results) -> Drawing:
    """Means over runs; of the Wasserstein distance over those in which it is defined, and the share of the
    others."""
    curves = {
        "targets named": lambda runs: runs.named.mean(axis=0),
        "OSPA, m": lambda runs: runs.ospa.mean(axis=0),
        "Wasserstein, m, where defined": lambda runs: mean_by_time(runs.wasserstein),
        "undefined, % of runs": lambda runs: 100 * np.isnan(runs.wasserstein).mean(axis=0),
    }
    some = next(iter(results.values()))
    scans = np.arange(1, some.ospa.shape[1] + 1)
    drawing, panels = by_tracker(10, 11, scans, {
        label: {name: curve(runs) for name, runs in results.items()} for label, curve in curves.items()
    })  # fmt: skip
    panels[0].plot(scans, some.targets.mean(axis=0), "k", lw=2, label="there")
    for axes in panels:
        axes.set(ylim=(0, None))
    panels[0].set_yscale("symlog", linthresh=5)
    panels[-1].set(xlabel="scan")
    legend_above(drawing, fontsize=8, ncols=4)
    return drawing


PAPER = Paper(TABLES, figures, QUANTITIES, ASKED)
