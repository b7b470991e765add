"""Lv, Lian and Han's Figs. 1-9: what is seen of one episode."""

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing

from gmr_gym.envs.lookup import tracker_of
from gmr_gym.envs.render_marks import ellipses
from gmr_gym.evaluation.metrics import wasserstein
from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns, density_error, places, play
from gmr_gym.evaluation.multi_target_summary import mean_where
from gmr_gym.experiments.drawings import canvas, save
from gmr_gym.filters.tracker import MultiTargetReport
from gmr_gym.mixture import joined
from gmr_gym.models.clutter import Clutter
from gmr_gym.scenarios.lv import ELLIPSE_95
from gmr_gym.simulation.multi_target import MultiTargetEpisode, MultiTargetScenario, draw, scan

UNIFORM, LEARNED, TRACKS = "gm-phd", "learning-phd", "learning-pmb"


def as_published(trackers: Iterable[str]) -> dict[str, dict[str, Any]]:
    """PHD filters declare targets as Vo and Ma's do, and tracks are found by belief propagation, as
    Williams's, and are as many in known clutter as in learned."""
    phd, loopy = {"estimator": "components"}, {"association": "belief-propagation"}
    pmb: dict[str, Any] = {**loopy, "prune_existence": 1e-3, "tracks": 200}
    own = {"gm-phd": phd, "fitted-phd": phd, "learning-phd": phd, "pmb": pmb, "learning-pmb": loopy}
    return {name: own.get(name.partition(":")[0], {}) for name in trackers}


def mean_by_time(distance: np.ndarray) -> np.ndarray:
    """Means (T,) over the runs (runs, T) in which there is a distance; a gap where there is none."""
    return mean_where(distance.T, np.isfinite(distance.T))


def episode_figures(scenario: MultiTargetScenario, results: Mapping[str, MultiTargetRuns], out: Path) -> None:
    """Figs. 1-9 of the first episode, and the clutter as fitted and as learned."""
    episode = draw(scenario, 0)
    said = {
        name: [account for account, _ in play(tracker_of(name, scenario, **parameters), episode)]
        for name, parameters in as_published(
            (UNIFORM, "fmm-em", "fmm-em:repaired=True", LEARNED, TRACKS)
        ).items()
    }
    save(_tracks(scenario, episode), out / "figure-1.png")
    fits = said["fmm-em"]
    errors = [_clutter_wrong(scenario, account, t) for t, account in enumerate(fits)]
    # the scan whose fit is best, and the one whose fit is worst
    for figure, t in (("figure-2", int(np.argmin(errors))), ("figure-3", int(np.argmax(errors)))):
        save(_fitted(scenario, episode, fits[t], t), out / f"{figure}.png")
    for figure, name in (
        ("figures-4-6-8", UNIFORM), ("figures-5-7-9", "fmm-em"),
        ("figures-5-7-9-repaired", "fmm-em:repaired=True"), ("learning-pmb", TRACKS),
    ):  # fmt: skip
        save(_episode(name, scenario, episode, said[name], results[name]), out / f"{figure}.png")
    save(_intensities(scenario, said), out / "clutter.png")


def _clutter_wrong(scenario: MultiTargetScenario, account: MultiTargetReport, t: int) -> float:
    """Share of the clutter."""
    true = scenario.clutter(t)
    return density_error(account.clutter, true, places(true))


def _tracks(scenario: MultiTargetScenario, episode: MultiTargetEpisode) -> Drawing:
    """Fig. 1: a circle where a target begins, a square where it ends; the groups of clutter behind."""
    drawing, axes = canvas(6, 6)
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
    drawing, axes = canvas(6, 6)
    _groups(axes, scenario.clutter(t))
    axes.plot(*scan(episode, t).z.T, ".", color="0.6", ms=4)
    style = {"edgecolors": "C1", "linestyles": ":", "linewidths": 1.6}
    parts = account.clutter.gaussians
    axes.add_collection(ellipses(axes, parts.m, ELLIPSE_95 * parts.P, **style))
    axes.set(title=f"scan {t + 1}: {_clutter_wrong(scenario, account, t):.0%} of the clutter wrong")
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
    drawing, (number, *along, distance) = canvas(9, 10, 4, 1, sharex=True)
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
    own = [
        wasserstein(account.x[:, list(scenario.position)], at[np.isfinite(at[:, 0])])
        for account, at in zip(said, paths.swapaxes(0, 1), strict=True)
    ]
    distance.plot(time, own, "C1o-", mfc="none", ms=3, lw=0.7, label="this episode")
    distance.plot(time, mean_by_time(runs.wasserstein), "k", lw=1, label="mean of the runs with one")
    nothing = time[np.isnan(own)]
    distance.plot(nothing, np.zeros_like(nothing), "kx", ms=4, label=f"none at {len(nothing)} scans")
    distance.set(xlabel="time, s", ylabel="Wasserstein, m", ylim=(0, None))
    distance.legend(fontsize=8)
    return drawing


def _intensities(scenario: MultiTargetScenario, said: Mapping[str, list[MultiTargetReport]]) -> Drawing:
    """kappa after the last scan, on one scale of colours."""
    drawing, panels = canvas(12, 3.6, 1, 4, sharey=True)
    last = scenario.horizon - 1
    true = scenario.clutter(last)
    shown = {"true": true, "fitted to one scan (fmm-em)": said["fmm-em"][last].clutter}
    shown |= {f"learned ({name})": said[name][last].clutter for name in (LEARNED, TRACKS)}
    at = places(true)
    side = round(len(at) ** 0.5)
    box = (true.low[0], true.high[0], true.low[1], true.high[1])
    most = 1.5 * true.density(at).max()
    for axes, (name, clutter) in zip(panels, shown.items(), strict=True):
        square = clutter.density(at).reshape(side, side)
        image = axes.imshow(square, "viridis", origin="lower", extent=box, vmin=0, vmax=most)
        axes.set_title(name, size=9)
    drawing.colorbar(image, ax=panels, label="false detections a scan, per m²")
    return drawing
