"""Lv, Lian and Han: section 7 in three kinds of clutter, Figs. 1-9, and trackers that learn the clutter. The
paper prints no tables; its sentences are in lv_claims."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Drawing

from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns
from gmr_gym.evaluation.multi_target_summary import multi_target_differences, multi_target_summary
from gmr_gym.evaluation.summary import bootstrap_mean
from gmr_gym.experiments.drawings import by_tracker, legend_above, save
from gmr_gym.experiments.evidence import Rows
from gmr_gym.experiments.papers.lv_claims import FITTED, LEARNED, QUANTITIES, UNIFORM, asked
from gmr_gym.experiments.papers.lv_episode import TRACKS, episode_figures, mean_by_time
from gmr_gym.experiments.tables import Paper, Table, plainly
from gmr_gym.simulation.multi_target import MultiTargetScenario

Results = Mapping[str, MultiTargetRuns]  # by tracker
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
    _table("groups", "section 7.1, trackers told that clutter is uniform", trackers=plainly(ALL)),
    _table("groups-told", "section 7.1, told the true clutter",
           settings={"told": "true"}, trackers=plainly(TOLD)),
    _table("uniform", "clutter that is uniform indeed",
           settings={"clutter": "uniform"}, trackers=plainly(ALL)),
    _table("dense", "groups four times denser", settings={"clutter": "dense"}, trackers=plainly(ALL)),
    _table("dense-told", "groups four times denser, told the true clutter",
           settings={"clutter": "dense", "told": "true"}, trackers=plainly(TOLD)),
    _table("drift", "groups that drift at 7 m/s",
           settings={"groups": DRIFT}, trackers=plainly((UNIFORM, LEARNED, "pmb", TRACKS))),
    _table("reductions", "GM-PHD told the true clutter, by reduction",
           settings={"told": "true"}, trackers=plainly(REDUCED),
           columns=(*COLUMNS[:-2], "components", "time_per_scan")),
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


PAPER = Paper(TABLES, figures, QUANTITIES, asked(table.name for table in TABLES))
