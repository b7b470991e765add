"""D'Ortenzio, Manes and Orguner: Tables 1-4, what they print in dortenzio.csv, and Fig. 1."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gmr_gym.evaluation.montecarlo import Runs
from gmr_gym.evaluation.summary import Estimate, not_lost, summary
from gmr_gym.experiments.drawings import canvas, save
from gmr_gym.experiments.evidence import Results, Rows
from gmr_gym.experiments.tables import Paper, Table, printed_in
from gmr_gym.simulation.single_target import Scenario

WORLDS = {  # by table: false alarms a scan, gamma, gamma~ (s^2 / m^4)
    "1": (150, 5e-4, 1e-10), "2": (300, 5e-4, 1e-10), "3": (300, 5e-4, 1e-10), "4": (300, 1e-4, 1e-12),
}  # fmt: skip
BESIDE = ("n-scan", "cluster")  # reductions that the paper does not try, pruned as its own are


def _table(name: str, rows: dict[str, dict[str, float]]) -> Table:
    clutter_rate, gamma, gamma_density = WORLDS[name]
    pruning = {"prune_weight": gamma, "prune_density": gamma_density}
    return Table(
        name,
        f"clutter {clutter_rate} a scan, gamma {gamma:g}, gamma~ {gamma_density:g}, alpha 0.05",
        "gmr_gym/TurningTarget-v0",
        {"clutter_rate": clutter_rate},
        # capping is the paper's "capping-only" scheme: it does not prune
        {tracker: {} if tracker.startswith("capping") else pruning for tracker in (*rows, *BESIDE)},
        # the one error it prints is set beside both of ours
        {tracker: row | {"error_common": row["rmse_own"]} for tracker, row in rows.items()},
        summarise=_summary,
    )


def _summary(scenario: Scenario, results: Mapping[str, Runs]) -> dict[str, dict[str, Estimate]]:
    """`summary`, where the runs in common are those that the paper's trackers kept, and the row's own."""
    papers = {name: runs for name, runs in results.items() if name not in BESIDE}
    rows = summary(scenario, papers)
    for name in results.keys() - papers.keys():
        rows[name] = summary(scenario, papers | {name: results[name]})[name]
    return {name: rows[name] for name in results}


TABLES = tuple(_table(name, rows) for name, rows in printed_in("dortenzio").items())


def figures(table: Table, scenario: Scenario, results: Results, rows: Rows, out: Path) -> None:
    """Fig. 1, from Table 1: one run's paths, hypotheses kept and detections per gate. The run is the
    first in which capping alone loses the target, as in the paper, or else the first."""
    if table.name != "1":
        return
    results = {name: runs for name, runs in results.items() if name not in BESIDE}
    alike = {name: not_lost(scenario, runs) ^ name.startswith("capping") for name, runs in results.items()}
    i = int(np.logical_and.reduce(list(alike.values())).argmax())
    drawing, (paths, components, gated) = canvas(8, 10, 3, height_ratios=(2, 1, 1))
    truth = next(iter(results.values())).truth[i][:, list(scenario.position)]
    paths.plot(*truth.T, "k", lw=2, label="truth")
    scans = np.arange(1, len(truth) + 1)
    for name, runs in results.items():
        paths.plot(*runs.x[i][:, list(scenario.position)].T, lw=1.2, label=name)
        components.plot(scans, runs.components[i], lw=1.2)
        gated.plot(scans, runs.gated[i], lw=1.2)
    low, high = scenario.window[:2]
    paths.set(xlim=(low[0] - 100, high[0] + 100), ylim=(low[1] - 100, high[1] + 100))
    paths.set(title=f"(a) run {i}", xlabel="x, m", ylabel="y, m", aspect="equal")
    paths.legend(fontsize=8)
    components.set(title="(b) hypotheses kept", xlabel="scan")
    gated.set(title="(c) mean detections per gate", xlabel="scan")
    save(drawing, out / "figure-1.png")


PAPER = Paper(TABLES, figures)
