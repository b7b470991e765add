"""Lv, Lian and Han: section 7 in three kinds of clutter, Figs. 1-9, and trackers that learn the clutter. The
paper prints no tables; its sentences are in lv_claims."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Drawing

from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns
from gmr_gym.evaluation.multi_target_summary import multi_target_differences, multi_target_summary
from gmr_gym.evaluation.summary import Estimate, bootstrap_mean
from gmr_gym.experiments.drawings import save
from gmr_gym.experiments.papers.lv_claims import FITTED, LEARNED, QUANTITIES, UNIFORM, asked
from gmr_gym.experiments.papers.lv_episode import TRACKS, episode_figures, mean_by_time
from gmr_gym.experiments.tables import Paper, Table
from gmr_gym.simulation.multi_target import MultiTargetScenario

RUNS = 100
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


def _rows(
    scenario: MultiTargetScenario, results: Mapping[str, MultiTargetRuns]
) -> dict[str, dict[str, Estimate]]:
    """The figures of `multi_target_summary`, and wasserstein_printed (m): as eq. 41 has it, 0 where either
    set is empty."""
    rows = multi_target_summary(scenario, results)
    for name, runs in results.items():
        rows[name]["wasserstein_printed"] = bootstrap_mean(np.nan_to_num(runs.wasserstein).mean(axis=1))
    return rows


def _table(
    name: str, title: str, trackers: tuple[str, ...], settings: dict[str, Any] | None = None,
    columns: tuple[str, ...] = COLUMNS,
) -> Table:  # fmt: skip
    return Table(
        name=name,
        title=title,
        env_id="gmr_gym/UnknownClutter-v0",
        settings=settings or {},
        trackers={tracker: {} for tracker in trackers},
        runs=RUNS,
        summarise=_rows,
        columns=columns,
        paired=multi_target_differences,
    )


TABLES = (
    _table("groups", "section 7.1, trackers told that clutter is uniform", ALL),
    _table("groups-told", "section 7.1, told the true clutter", TOLD, {"told": "true"}),
    _table("uniform", "clutter that is uniform indeed", ALL, {"clutter": "uniform"}),
    _table("dense", "groups four times denser", ALL, {"clutter": "dense"}),
    _table("dense-told", "groups four times denser, told the true clutter", TOLD,
           {"clutter": "dense", "told": "true"}),
    _table("drift", "groups that drift at 7 m/s", (UNIFORM, LEARNED, "pmb", TRACKS), {"groups": DRIFT}),
    _table("reductions", "GM-PHD told the true clutter, by reduction", REDUCED, {"told": "true"},
           (*COLUMNS[:-2], "components", "time_per_scan")),
)  # fmt: skip


def figures(
    table: Table,
    scenario: MultiTargetScenario,
    results: Mapping[str, MultiTargetRuns],
    rows: Mapping[str, Mapping[str, Estimate]],
    out: Path,
) -> None:
    """Means over runs by scan; of the section's own clutter also one episode: Figs. 1-9, and the clutter as
    fitted and as learned."""
    save(_by_scan(results), out / f"by-scan-{table.name}.png")
    if table.name != "groups":
        return
    episode_figures(scenario, results, out)


def _by_scan(results: Mapping[str, MultiTargetRuns]) -> Drawing:
    """Means over runs; of the Wasserstein distance over those in which it is defined, and the share of the
    others."""
    drawing = Drawing(figsize=(10, 11), layout="constrained")
    panels = drawing.subplots(4, 1, sharex=True)
    for i, (name, runs) in enumerate(results.items()):
        style = {"lw": 1, "ls": "-" if i < 10 else "--", "label": name}
        time = np.arange(1, runs.ospa.shape[1] + 1)
        undefined = 100 * np.isnan(runs.wasserstein).mean(axis=0)
        curves = runs.named.mean(axis=0), runs.ospa.mean(axis=0), mean_by_time(runs.wasserstein), undefined
        for axes, curve in zip(panels, curves, strict=True):
            axes.plot(time, curve, **style)
    panels[0].plot(time, runs.targets.mean(axis=0), "k", lw=2, label="there")
    labels = ("targets named", "OSPA, m", "Wasserstein, m, where defined", "undefined, % of runs")
    for axes, label in zip(panels, labels, strict=True):
        axes.set(ylabel=label, ylim=(0, None))
    panels[0].set_yscale("symlog", linthresh=5)
    panels[-1].set(xlabel="scan")
    handles = panels[0].get_legend_handles_labels()
    drawing.legend(*handles, fontsize=8, ncols=4, loc="outside upper center")
    return drawing


PAPER = Paper(TABLES, figures, QUANTITIES, asked(table.name for table in TABLES))
