"""Lv, Lian and Han: section 7 in three kinds of clutter, Figs. 1-9, and trackers that learn the clutter. The
paper prints no tables; its sentences are in lv_claims."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from gmr_gym.envs.render import ellipses
from gmr_gym.evaluation.metrics import wasserstein
from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns, density_error, places, play
from gmr_gym.evaluation.multi_target_summary import mean_where, multi_target_differences, multi_target_summary
from gmr_gym.evaluation.summary import Estimate, bootstrap_mean
from gmr_gym.experiments.drawings import save
from gmr_gym.experiments.papers.lv_claims import FITTED, LEARNED, QUANTITIES, UNIFORM, asked
from gmr_gym.experiments.specs import tracker_of
from gmr_gym.experiments.tables import Paper, Table
from gmr_gym.filters.tracker import MultiTargetReport
from gmr_gym.mixture import joined
from gmr_gym.models.clutter import Clutter
from gmr_gym.scenarios.lv import ELLIPSE_95
from gmr_gym.simulation.multi_target import MultiTargetEpisode, MultiTargetScenario, draw, scan

RUNS = 100
TRACKS = "learning-pmb"
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
    episode = draw(scenario, 0)
    said = {
        name: [account for account, _ in play(tracker_of(name, scenario), episode)]
        for name in (UNIFORM, "fmm-em", "fmm-em:repaired=True", LEARNED, TRACKS)
    }
    save(_tracks(scenario, episode), out / "figure-1.png")
    errors = _density_errors(scenario, said["fmm-em"])
    # the scan whose fit is best, and the one whose fit is worst
    for figure, t in (("figure-2", int(np.argmin(errors))), ("figure-3", int(np.argmax(errors)))):
        save(_fitted(scenario, episode, said["fmm-em"][t], t), out / f"{figure}.png")
    for figure, name in (
        ("figures-4-6-8", UNIFORM), ("figures-5-7-9", "fmm-em"),
        ("figures-5-7-9-repaired", "fmm-em:repaired=True"), ("learning-pmb", TRACKS),
    ):  # fmt: skip
        runs = results[name]
        save(_episode(name, scenario, episode, said[name], runs), out / f"{figure}.png")
    save(_intensities(scenario, said), out / "clutter.png")


def _by_scan(results: Mapping[str, MultiTargetRuns]) -> Drawing:
    """Means over runs; of the Wasserstein distance over those in which it is defined, and the share of the
    others."""
    drawing = Drawing(figsize=(10, 11), layout="constrained")
    panels = drawing.subplots(4, 1, sharex=True)
    for i, (name, runs) in enumerate(results.items()):
        style = {"lw": 1, "ls": "-" if i < 10 else "--", "label": name}
        time = np.arange(1, runs.ospa.shape[1] + 1)
        undefined = 100 * np.isnan(runs.wasserstein).mean(axis=0)
        curves = runs.named.mean(axis=0), runs.ospa.mean(axis=0), _by_time(runs.wasserstein), undefined
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


def _by_time(distance: np.ndarray) -> np.ndarray:
    """Means (T,) over the runs (runs, T) in which there is a distance; a gap where there is none."""
    return mean_where(distance.T, np.isfinite(distance.T))


def _tracks(scenario: MultiTargetScenario, episode: MultiTargetEpisode) -> Drawing:
    """Fig. 1: a circle where a target begins, a square where it ends; the groups of clutter behind."""
    drawing = Drawing(figsize=(6, 6), layout="constrained")
    axes = drawing.subplots()
    _groups(axes, scenario.clutter(0))
    for i, (path, line) in enumerate(zip(_paths(scenario, episode), ("-", ":", "--"), strict=False)):
        there = path[np.isfinite(path[:, 0])]
        axes.plot(*there.T, f"k{line}", label=f"target {i + 1}")
        axes.plot(*there[:1].T, "ko", mfc="none")
        axes.plot(*there[-1:].T, "ks", mfc="none")
    axes.legend(fontsize=8)
    return drawing


def _fitted(
    scenario: MultiTargetScenario, episode: MultiTargetEpisode, account: MultiTargetReport, t: int
) -> Drawing:
    """Figs. 2-3: 95 % ellipses of the real clutter and of the Gaussians fitted to one scan."""
    drawing = Drawing(figsize=(6, 6), layout="constrained")
    axes = drawing.subplots()
    true = scenario.clutter(t)
    _groups(axes, true)
    axes.plot(*scan(episode, t).z.T, ".", color="0.6", ms=4)
    parts = account.clutter.gaussians
    axes.add_collection(
        ellipses(axes, parts.m, ELLIPSE_95 * parts.P, edgecolors="C1", linestyles=":", linewidths=1.6)
    )
    wrong = density_error(account.clutter, true, places(true))
    axes.set(title=f"scan {t + 1}: {wrong:.0%} of the clutter wrong")
    return drawing


def _groups(axes: Axes, clutter: Clutter) -> None:
    shapes = joined((clutter.gaussians._replace(P=ELLIPSE_95 * clutter.gaussians.P), clutter.ellipses))
    axes.add_collection(ellipses(axes, shapes.m, shapes.P, edgecolors="0.5", linewidths=1))
    axes.set(
        xlim=(clutter.low[0], clutter.high[0]), ylim=(clutter.low[1], clutter.high[1]),
        xlabel="x, m", ylabel="y, m", aspect="equal",
    )  # fmt: skip


def _paths(scenario: MultiTargetScenario, episode: MultiTargetEpisode) -> np.ndarray:
    """Positions (m, T, 2), nan where a target is absent."""
    return episode.x[:, :, list(scenario.position)].swapaxes(0, 1)


def _episode(
    name: str,
    scenario: MultiTargetScenario,
    episode: MultiTargetEpisode,
    said: list[MultiTargetReport],
    runs: MultiTargetRuns,
) -> Drawing:
    """Figs. 4, 6 and 8 in one, or 5, 7 and 9: number, positions and Wasserstein distance by time of an
    episode; of the last also its mean over runs."""
    drawing = Drawing(figsize=(9, 10), layout="constrained")
    number, *along, distance = drawing.subplots(4, 1, sharex=True)
    time = scenario.period * np.arange(1, scenario.horizon + 1)
    paths = _paths(scenario, episode)
    there = np.isfinite(paths[:, :, 0]).sum(axis=0)
    number.step(time, there, "k", where="mid", label="true")
    number.plot(time, [len(account.x) for account in said], "C1o", mfc="none", ms=4, label="named")
    number.set(ylabel="targets", title=f"{name}, one episode")
    number.legend(fontsize=8)
    for i, axes in enumerate(along):
        axes.plot(time, paths[:, :, i].T, "k", lw=1.5)
        at = np.repeat(time, [len(account.x) for account in said])
        named = np.concatenate([account.x[:, scenario.position[i]] for account in said])
        axes.plot(at, named, "C1o", mfc="none", ms=3)
        axes.set(ylabel=f"{'xy'[i]}, m")
    own = [_distance(scenario, account, paths[:, t]) for t, account in enumerate(said)]
    distance.plot(time, own, "C1o-", mfc="none", ms=3, lw=0.7, label="this episode")
    distance.plot(time, _by_time(runs.wasserstein), "k", lw=1, label="mean of the runs with one")
    nothing = time[np.isnan(own)]
    distance.plot(nothing, np.zeros_like(nothing), "kx", ms=4, label=f"none at {len(nothing)} scans")
    distance.set(xlabel="time, s", ylabel="Wasserstein, m", ylim=(0, None))
    distance.legend(fontsize=8)
    return drawing


def _distance(scenario: MultiTargetScenario, account: MultiTargetReport, there: np.ndarray) -> float:
    truth = there[np.isfinite(there[:, 0])]
    return wasserstein(account.x[:, list(scenario.position)], truth)


def _density_errors(scenario: MultiTargetScenario, said: list[MultiTargetReport]) -> list[float]:
    every = [scenario.clutter(t) for t in range(len(said))]
    grid = places(every[0])
    return [density_error(account.clutter, true, grid) for account, true in zip(said, every, strict=True)]


def _intensities(scenario: MultiTargetScenario, said: Mapping[str, list[MultiTargetReport]]) -> Drawing:
    """kappa after the last scan, on one scale of colours."""
    drawing = Drawing(figsize=(12, 3.6), layout="constrained")
    panels = drawing.subplots(1, 4, sharey=True)
    last = scenario.horizon - 1
    true = scenario.clutter(last)
    shown = {"true": true, "fitted to one scan (fmm-em)": said["fmm-em"][last].clutter}
    shown |= {f"learned ({name})": said[name][last].clutter for name in (LEARNED, TRACKS)}
    at = places(true)
    side = round(len(at) ** 0.5)
    box = (true.low[0], true.high[0], true.low[1], true.high[1])
    most = 1.5 * true.density(at).max()
    for axes, (name, clutter) in zip(panels, shown.items(), strict=True):
        image = axes.imshow(
            clutter.density(at).reshape(side, side),
            origin="lower",
            extent=box,
            vmin=0,
            vmax=most,
            cmap="viridis",
        )
        axes.set_title(name, size=9)
    drawing.colorbar(image, ax=panels, label="false detections a scan, per m²")
    return drawing


PAPER = Paper(TABLES, figures, QUANTITIES, asked(table.name for table in TABLES))
