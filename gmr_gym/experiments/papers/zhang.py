"""Zhang and Liu: the two cases of section 6 (Figs. 1-2), the reductions of section 3, and the filters of
section 4 without clutter. The paper prints curves and no figures; its sentences are in zhang_claims."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Drawing

from gmr_gym.evaluation.curves import CURVES, averages, curves, errors_of
from gmr_gym.evaluation.montecarlo import Runs
from gmr_gym.evaluation.summary import Estimate, in_common, not_lost
from gmr_gym.experiments.drawings import error_against_time, save
from gmr_gym.experiments.output import write_rows
from gmr_gym.experiments.papers.zhang_claims import ASKED, QUANTITIES, ROLES
from gmr_gym.experiments.tables import Paper, Table
from gmr_gym.reduction.clustering import LINKAGES
from gmr_gym.reduction.dissimilarity import MEASURES
from gmr_gym.simulation.single_target import Scenario

QUIET = 0.01  # of the printed Q = I, at which an acceleration is but two deviations of the process noise
COLUMNS = (
    "track_loss", "rmse_all", "rmse_common", "velocity_rmse_common", "nci_all", "nci_common",
    "inclination_common", "components", "gate_area", "time_per_scan",
)  # fmt: skip
SETS = ("all", "common")
LABELS = ("position RMSE, m", "velocity RMSE, m/s", "NCI, dB", "inclination, dB")


def _table(
    name: str, title: str, case: str, quiet: bool, trackers: Mapping[str, dict], judged: bool = False
) -> Table:
    settings = {"case": case} | ({"process_variance": QUIET} if quiet else {})
    return Table(
        name=name,
        title=title + (f", Q = {QUIET:g} I" if quiet else ", Q = I"),
        env_id="gmr_gym/JumpMarkov-v0",
        settings=settings,
        trackers=dict(trackers),
        summarise=averages,
        columns=COLUMNS,
        roles=ROLES if judged else None,
    )


def _rivals(components: int) -> dict[str, dict]:
    names = (f"mmg-{components}", f"imm-mht-{components}", "imm-pda", "clairvoyant")
    return {name: {} for name in names}


REDUCTIONS = (
    "runnalls", "greedy-isd",
    *(f"{linkage}-{measure}" for linkage in LINKAGES for measure in MEASURES),
    "k-means", *(f"k-medoids-{measure}" for measure in MEASURES), "capping",
)  # fmt: skip
CLEAR: dict[str, dict] = {"mmg-10": {}, "imm": {}, "gpb1": {}, "gpb2": {}, "b-best-10": {}}
TABLES = (
    _table("1", "case 1, clutter 1e-4 per m^2", "1", False, _rivals(10), judged=True),
    _table("2", "case 2, clutter 3e-4 per m^2", "2", False, _rivals(15), judged=True),
    _table("1-quiet", "case 1, clutter 1e-4 per m^2", "1", True, _rivals(10), judged=True),
    _table("2-quiet", "case 2, clutter 3e-4 per m^2", "2", True, _rivals(15), judged=True),
    _table("clear", "no clutter", "clear", False, CLEAR),
    _table("clear-quiet", "no clutter", "clear", True, CLEAR),
    _table(
        "reductions", "case 2, MMG with 15 components by reduction", "2", True,
        {f"mmg-15:reduction={name}": {} for name in REDUCTIONS},
    ),
)  # fmt: skip


def figures(
    table: Table,
    scenario: Scenario,
    results: Mapping[str, Runs],
    rows: Mapping[str, Mapping[str, Estimate]],
    out: Path,
) -> None:
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


def _four_curves(drawn) -> Drawing:
    drawing = Drawing(figsize=(11, 8), layout="constrained")
    panels = drawing.subplots(2, 2).ravel()
    for (name, which), values in drawn.items():
        style = {"lw": 1.6, "label": name} if which == "common" else {"lw": 0.9, "ls": ":"}
        colour = f"C{[tracker for tracker, _ in drawn].index(name) // len(SETS)}"
        for axes, curve in zip(panels, values, strict=True):
            axes.plot(np.arange(1, len(curve) + 1), curve, color=colour, **style)
    for axes, label in zip(panels, LABELS, strict=True):
        axes.set(xlabel="scan", ylabel=label)
    for axes in panels[:2]:
        axes.set_yscale("log")
    panels[3].axhline(0, color="0.6", lw=0.8)
    panels[0].legend(title="solid: runs that none lost; dotted: all", fontsize=8, title_fontsize=8)
    return drawing


PAPER = Paper(TABLES, figures, QUANTITIES, ASKED)
