"""Williams' four targets that meet and part, as Garcia-Fernandez and others have them: every tracker of many
targets, scan by scan. Papers order the trackers by GOSPA; here each order is judged before, at and after the
meeting."""

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Drawing

from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns
from gmr_gym.evaluation.multi_target_summary import (
    defined,
    multi_target_differences,
    multi_target_summary,
    reliability,
    track_figures,
)
from gmr_gym.evaluation.summary import Estimate, bootstrap_mean
from gmr_gym.experiments.claims import Asked, Claim, number
from gmr_gym.experiments.drawings import by_tracker, canvas, legend_above, save
from gmr_gym.experiments.evidence import Evidence, Quantities, Rows
from gmr_gym.experiments.tables import Paper, Table
from gmr_gym.simulation.multi_target import MultiTargetScenario

Results = Mapping[str, MultiTargetRuns]  # by tracker
PHD, CPHD, GNN, JPDA, JIPDA, TOMHT = "gm-phd", "gm-cphd", "gnn", "jpda", "jipda", "tomht"
PMB, PMBM = "pmb", "pmbm"
LOOPY, EXCHANGED = "pmb:association=belief-propagation", "pmb:projection=variational"
# the papers' limits of tracks and leaves that may not be, where a tracker's own are higher
FAINT, DROP = {"prune_existence": 1e-5}, {"drop": 1e-5}
TRACKERS: dict[str, dict[str, float]] = {
    PHD: {}, CPHD: {}, GNN: {}, JPDA: {}, JIPDA: DROP, "lmb": FAINT,
    **dict.fromkeys((PMB, LOOPY, EXCHANGED, "pmb:projection=momb"), FAINT | {"prune_weight": 1e-5}),
    PMBM: {}, "mbm": {}, "delta-glmb": {}, TOMHT: FAINT,
}  # fmt: skip
# most hypotheses of a track, and which reduction decides on them
Budget = tuple[str, int]
BUDGETS: dict[str, tuple[Budget, ...]] = {
    PMBM: (("runnalls", 1), ("runnalls", 3), ("runnalls", 10), ("west", 3), ("capping", 3), ("ise", 3)),
    TOMHT: (("runnalls", 1), ("runnalls", 3), ("runnalls", 10), ("capping", 3)),
    JIPDA: (("runnalls", 10), ("capping", 10)),
}


def reduced(tracker: str, budget: Budget | None) -> str:
    """The tracker with up to so many hypotheses in every track, by a reduction; None for all of them."""
    return tracker if budget is None else f"{tracker}:components={budget[1]},reduction={budget[0]}"


REDUCED = {
    reduced(tracker, budget): TRACKERS[tracker]
    for tracker, budgets in BUDGETS.items()
    for budget in (None, *budgets)
}
# scans, from 0, in which a target is within a few deviations of another, and those before and after
PHASES = {"before": slice(10, 35), "meeting": slice(35, 46), "after": slice(46, 81)}
# tens of scans at which labels are compared with those by which targets were found first
LABELS = {"before": slice(25, 35), "after": slice(71, 81)}
COLUMNS = (
    "gospa_rms", *(f"gospa_{phase}" for phase in PHASES), "localisation", "missed", "false",
    "trajectory_gospa", "trajectory_switches", "switches",
    *(f"labels_kept_{phase}" for phase in LABELS), "cardinality_error", "anees", "time_per_scan",
)  # fmt: skip
HARDER = {"detection_probability": 0.7, "clutter_rate": 30.0}
OFTEN = 50  # declared targets that a bin of existence must have to be drawn
TRUTH = {"truth_seed": 0}  # one truth for all runs, as in the papers


def _square(phase: slice, scenario: MultiTargetScenario, runs: MultiTargetRuns) -> np.ndarray:
    """Mean square of GOSPA over scans, m^2, run by run."""
    return (runs.gospa[:, phase] ** 2).mean(axis=1)


# of one tracker, run by run (runs,)
QUANTITIES: Quantities = {
    "all": partial(_square, slice(None)),
    **{phase: partial(_square, scans) for phase, scans in PHASES.items()},
    "trajectory": lambda scenario, runs: track_figures(scenario, runs)["trajectory_gospa"] ** 2,
    "lost": lambda scenario, runs: 1.0 - _kept(LABELS["after"], runs),
}


def _kept(scans: slice, runs: MultiTargetRuns) -> np.ndarray:
    """Share of the targets that are found by the label by which they were found first, run by run."""
    return runs.kept[:, scans].sum(axis=1) / runs.targets[:, scans].sum(axis=1)


def _rows(scenario: MultiTargetScenario, results: Results) -> Rows:
    """The figures of `multi_target_summary`, the root mean square of GOSPA over runs and scans (m), of all
    scans and of those before, at and after the meeting, and the labels kept before and after it."""
    rows = multi_target_summary(scenario, results)
    for name, runs in results.items():
        for figure, scans in {"rms": slice(None), **PHASES}.items():
            square = bootstrap_mean(_square(scans, scenario, runs))
            rows[name][f"gospa_{figure}"] = Estimate(*np.sqrt(square).tolist())
        for figure, scans in LABELS.items():
            rows[name][f"labels_kept_{figure}"] = bootstrap_mean(defined(_kept(scans, runs)))
    return rows


_table = partial(
    Table, env_id="gmr_gym/MeetingTargets-v0", runs=100, summarise=_rows, columns=COLUMNS,
    paired=multi_target_differences,
)  # fmt: skip
TABLES = (
    _table("together", "all four targets there from the first scan", settings=TRUTH, trackers=TRACKERS),
    _table("staggered", "targets born one after another",
           settings=TRUTH | {"staggered": True}, trackers=TRACKERS),
    _table("harder", "detected with 0.7 among thirty false alarms",
           settings=TRUTH | HARDER, trackers=TRACKERS),
    _table("reductions", "PMBM, track-oriented MHT and JIPDA by what reduces the hypotheses of a track",
           settings=TRUTH, trackers=REDUCED),
)  # fmt: skip


@number
def less(quantity: str, own: Evidence, rival: Evidence) -> np.ndarray:
    """By how much it is less than the rival's, run by run (runs,)."""
    return defined(getattr(rival, quantity) - getattr(own, quantity))


def _better(of: str, against: str, quantity: str, where: str, what: str = "mean square GOSPA") -> Claim:
    return Claim(
        f"{of} is better than {against}{where}", f"{what}, m²: that of {against} less its own", 0.0,
        less(quantity), of, against,
    )  # fmt: skip


# who is said to be better than whom
ORDER = (
    (PMBM, EXCHANGED), (EXCHANGED, PMB), (PMBM, PMB), (PMB, LOOPY), (PMB, JIPDA), (JIPDA, JPDA), (JPDA, GNN),
    (TOMHT, GNN), (PMB, CPHD), (CPHD, PHD),
)  # fmt: skip
CLAIMS = (
    *(_better(of, against, "all", "") for of, against in ORDER),
    *(_better(PMBM, PMB, phase, f" {where}")
      for phase, where in (("before", "before they meet"), ("meeting", "where they meet"),
                           ("after", "after they have met"))),
    *(_better(of, against, phase, f" {where}")
      for of, against in ((EXCHANGED, PMB), (PMB, LOOPY))
      for phase, where in (("meeting", "where they meet"), ("after", "after they have met"))),
    _better(PMBM, PMB, "trajectory", " by trajectories", "mean over scans of the square of T-GOSPA"),
    *(Claim(f"{of} keeps more labels through the meeting than {against}",
            f"share of targets: labels kept less those of {against}", 0.0, less("lost"), of, against)
      for of, against in ((PMB, PMBM), (PMB, TOMHT), (PMB, CPHD), (EXCHANGED, PMBM))),
)  # fmt: skip
ONE, FEW, MANY = (("runnalls", components) for components in (1, 3, 10))
CAPPED, LEAST_SQUARES = ("capping", 3), ("ise", 3)
# which budget is said to be better than which
OF_REDUCTIONS: tuple[tuple[str, Budget | None, Budget | None], ...] = (
    (PMBM, None, FEW), (PMBM, FEW, ONE), (PMBM, FEW, CAPPED), (PMBM, FEW, ("west", 3)),
    (PMBM, LEAST_SQUARES, FEW), (PMBM, None, MANY),
    (TOMHT, None, FEW), (TOMHT, FEW, ONE), (TOMHT, FEW, CAPPED), (TOMHT, None, MANY),
    (JIPDA, MANY, None), (JIPDA, ("capping", 10), MANY),
)  # fmt: skip
REDUCTION_CLAIMS = tuple(
    _better(reduced(tracker, own), reduced(tracker, rival), phase, where)
    for tracker, own, rival in OF_REDUCTIONS
    for phase, where in (("all", ""), ("meeting", " where they meet"))
)
ASKED = (
    *(Asked(CLAIMS, (table.name,), run_by_run=True) for table in TABLES[:3]),
    Asked(REDUCTION_CLAIMS, (TABLES[3].name,), run_by_run=True),
)


def figures(table: Table, scenario: MultiTargetScenario, results: Results, rows: Rows, out: Path) -> None:
    """Means over runs by scan, and the share of declared targets that are real by their existence."""
    save(_by_scan(results), out / f"by-scan-{table.name}.png")
    save(_existence(results), out / f"existence-{table.name}.png")


def _existence(results: Results) -> Drawing:
    """The share of declared targets that are real against their mean existence, bin by bin."""
    drawing, axes = canvas(7, 6)
    axes.plot([0.4, 1.0], [0.4, 1.0], color="0.7", lw=1)
    for i, (name, runs) in enumerate(results.items()):
        existence, real, number = reliability(runs)
        often = number >= OFTEN
        if often.any() and np.ptp(existence[often]) > 0:  # trackers without existence say 1
            axes.plot(existence[often], real[often], "o-" if i < 10 else "s--", ms=3, lw=1, label=name)
    axes.set(xlabel="reported probability of existence", ylabel="share near a true target")
    legend_above(drawing, fontsize=8, ncols=3)
    return drawing


def _by_scan(results: Results) -> Drawing:
    """Roots of means over runs of squared GOSPA and of its parts, and what switched labels cost."""
    curves: dict[str, Callable[[MultiTargetRuns], np.ndarray]] = {
        "GOSPA, m": lambda runs: runs.gospa**2,
        "localisation, m": lambda runs: runs.localisation,
        "missed, m": lambda runs: runs.missed,
        "false, m": lambda runs: runs.false,
        "switches of T-GOSPA, m": lambda runs: runs.trajectory_switches,
    }
    scans = np.arange(1, next(iter(results.values())).gospa.shape[1] + 1)
    drawing, panels = by_tracker(9, 11, scans, {
        label: {name: np.sqrt(curve(runs).mean(axis=0)) for name, runs in results.items()}
        for label, curve in curves.items()
    })  # fmt: skip
    for axes in panels:
        axes.set(ylim=(0, None))
    panels[-1].set(xlabel="scan")
    legend_above(drawing, fontsize=8, ncols=4)
    return drawing


PAPER = Paper(TABLES, figures, QUANTITIES, ASKED)
