"""Zhang and Liu: the two cases of section 6 (Figs. 1-2), the reductions of section 3, and the filters of
section 4 without clutter. The paper prints curves and no figures; its sentences are in zhang_claims."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Drawing

from gmr_gym.evaluation.curves import CURVES, Curves, averages, curves, errors_of
from gmr_gym.evaluation.summary import in_common, not_lost
from gmr_gym.experiments.drawings import canvas, error_against_time, save
from gmr_gym.experiments.evidence import Results, Rows
from gmr_gym.experiments.output import write_rows
from gmr_gym.experiments.papers.zhang_claims import ASKED, QUANTITIES, ROLES
from gmr_gym.experiments.tables import Paper, Table, plainly
from gmr_gym.reduction.clustering import LINKAGES
from gmr_gym.reduction.dissimilarity import MEASURES
from gmr_gym.simulation.single_target import Scenario

QUIET = 0.01  # of the printed Q = I, at which an acceleration is but two deviations of the process noise
LESS = f"Q = {QUIET:g} I"
COLUMNS = (
    "track_loss", "rmse_all", "rmse_common", "velocity_rmse_common", "nci_all", "nci_common",
    "inclination_common", "components", "gate_area", "time_per_scan",
)  # fmt: skip
SETS = ("all", "common")
LABELS = ("position RMSE, m", "velocity RMSE, m/s", "NCI, dB", "inclination, dB")


def _table(
    name: str, title: str, trackers: Iterable[str], roles: tuple[str, ...] | None = None, **settings: Any
) -> Table:
    return Table(
        name, title, "gmr_gym/JumpMarkov-v0", settings, plainly(trackers),
        summarise=averages, columns=COLUMNS, roles=roles,
    )  # fmt: skip


REDUCTIONS = (
    "runnalls", "greedy-isd",
    *(f"{linkage}-{measure}" for linkage in LINKAGES for measure in MEASURES),
    "k-means", *(f"k-medoids-{measure}" for measure in MEASURES), "capping",
)  # fmt: skip
CASE_1 = ("mmg-10", "imm-mht-10", "imm-pda", "clairvoyant")
CASE_2 = ("mmg-15", "imm-mht-15", "imm-pda", "clairvoyant")
CLEAR = ("mmg-10", "imm", "gpb1", "gpb2", "b-best-10")
TABLES = (
    _table("1", "case 1, clutter 1e-4 per m^2, Q = I", CASE_1, ROLES, case="1"),
    _table("2", "case 2, clutter 3e-4 per m^2, Q = I", CASE_2, ROLES, case="2"),
    _table("1-quiet", f"case 1, clutter 1e-4 per m^2, {LESS}", CASE_1, ROLES,
           case="1", process_variance=QUIET),
    _table("2-quiet", f"case 2, clutter 3e-4 per m^2, {LESS}", CASE_2, ROLES,
           case="2", process_variance=QUIET),
    _table("clear", "no clutter, Q = I", CLEAR, case="clear"),
    _table("clear-quiet", f"no clutter, {LESS}", CLEAR, case="clear", process_variance=QUIET),
    _table("reductions", f"case 2, MMG with 15 components by reduction, {LESS}",
           [f"mmg-15:reduction={name}" for name in REDUCTIONS], case="2", process_variance=QUIET),
)  # fmt: skip


def figures(table: Table, scenario: Scenario, results: Results, rows: Rows, out: Path) -> None:
    """The four curves of a table (Figs. 1-2) as a plot and, scan by scan, in a file; for the reductions
    error against time."""
    common = in_common({name: not_lost(scenario, runs) for name, runs in results.items()})
    drawn, lines = {}, []
    for name, runs in results.items():
        errors = errors_of(scenario, runs)
        for which, mask in zip(SETS, (np.ones(len(runs.x), bool), common[name]), strict=True):
            drawn[name, which] = curves(errors, mask)
            scans = np.arange(1, runs.x.shape[1] + 1).tolist()
            columns = [scans, *(curve.tolist() for curve in drawn[name, which])]
            lines += [[name, which, *row] for row in zip(*columns, strict=True)]
    write_rows(out / f"scans-{table.name}.csv", ("tracker", "runs", "scan", *CURVES), lines)
    if table.name == "reductions":
        label = "position RMSE over runs that none lost, m"
        drawing = error_against_time(rows, "rmse_common", label, lambda name: name.partition("=")[2])
    else:
        drawing = _four_curves(drawn)
    save(drawing, out / f"figure-{table.name}.png")


def _four_curves(drawn: Mapping[tuple[str, str], Curves]) -> Drawing:
    drawing, panels = canvas(11, 8, 2, 2)
    for i, ((name, which), values) in enumerate(drawn.items()):
        style = {"lw": 1.6, "label": name} if which == "common" else {"lw": 0.9, "ls": ":"}
        for axes, curve in zip(panels.flat, values, strict=True):
            axes.plot(np.arange(1, len(curve) + 1), curve, color=f"C{i // len(SETS)}", **style)
    for axes, label in zip(panels.flat, LABELS, strict=True):
        axes.set(xlabel="scan", ylabel=label)
    for axes in panels[0]:
        axes.set_yscale("log")
    panels[1, 1].axhline(0, color="0.6", lw=0.8)
    panels[0, 0].legend(title="solid: runs that none lost; dotted: all", fontsize=8, title_fontsize=8)
    return drawing


PAPER = Paper(TABLES, figures, QUANTITIES, ASKED)
