"""Drawing of many targets."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.lines import Line2D

from gmr_gym.envs.render import Canvas, Panel, Tracked
from gmr_gym.envs.render_marks import (
    CLUTTER,
    EDGE,
    ESTIMATE,
    HYPOTHESIS,
    INK,
    TRUTH,
    add_ellipses,
    over_scans,
    ring,
)
from gmr_gym.mixture import joined
from gmr_gym.models.clutter import Clutter


class MultiTargetPanel(Panel):
    """The artists of one tracker of many targets."""

    names = 5, 2

    def _lines(self) -> list[Line2D]:
        plot = self.plane.plot
        detections, truth, own, estimates = super()._lines()
        truth.set_markevery([])  # of tracks that end there is no latest point
        estimates.set(ls="", marker=".", ms=3, mew=1, markevery=None, label="estimates")
        (self.latest,) = plot([], [], "x", color=ESTIMATE, ms=7)
        return [detections, truth, own, estimates]

    def marks(self, shown: Tracked) -> list[Line2D]:
        """What the legend names: all that is drawn."""
        latest = Line2D([], [], ls="", marker="x", color=ESTIMATE, ms=6, label="estimates")
        found = [self.detections, self.own, self.truth, latest]
        if _has_groups(self.scenario.clutter(0)):
            found.append(ring(CLUTTER, "true clutter, 95 %"))
        if shown.report is not None:
            found.append(Line2D([], [], color=INK, ls=":", lw=1.5, label="clutter assumed, 95 %"))
            found.append(ring(HYPOTHESIS, "hypotheses, faint: of low weight"))
        return found

    def draw(self, episode: Any, t: int, shown: Tracked) -> None:
        """Draw scan t (from 0) of an episode."""
        z, origin = shown.scan
        self.detections.set_data(*z[:, :2].T)
        self.own.set_data(*z[origin >= 0, :2].T)
        paths = episode.x[: t + 1][:, :, list(self.scenario.position[:2])]
        # one line with gaps, between tracks and where a target is absent
        gap = np.full((1, *paths.shape[1:]), np.nan)
        self.truth.set_data(*np.concatenate([paths, gap]).swapaxes(0, 1).reshape(-1, 2).T)
        found = [each[:, :2] for each in shown.estimates]
        self.estimate.set_data(*np.concatenate([np.empty((0, 2)), *found]).T)
        self.latest.set_data(*(found[-1].T if found else ([], [])))
        self.say(t)
        for old in [*self.plane.collections]:
            old.remove()
        self._clutter(self.scenario.clutter(t), CLUTTER)
        if shown.report is not None:
            self._clutter(shown.report.clutter, INK, linestyles=":")
            self._components(shown.report.intensity)
        present = np.isfinite(paths).all(axis=2).sum(axis=1)
        for strip in self.strips:
            over_scans(strip, "targets", {TRUTH: present, ESTIMATE: [len(each) for each in found]})

    def _components(self, p: Any) -> None:
        at = list(self.scenario.position[:2])
        opacity = np.sqrt(np.clip(p.w, 1e-3, 1))
        add_ellipses(self.plane, p.m[:, at], EDGE * p.P[:, at][:, :, at], HYPOTHESIS, 1.2, opacity)

    def _clutter(self, clutter: Clutter, colour: str, **style: Any) -> None:
        """Ellipses of the clutter: the 95 % ellipse of each Gaussian, and each uniform ellipse."""
        if _has_groups(clutter):
            groups = joined((clutter.gaussians._replace(P=EDGE * clutter.gaussians.P), clutter.ellipses))
            add_ellipses(self.plane, groups.m[:, :2], groups.P[:, :2, :2], colour, 0.9, **style)


class MultiTargetCanvas(Canvas):
    """Images of an episode, scan by scan: detections, true tracks, estimates and the clutter's components.

    With a tracker's reports they also show the clutter that it assumes, dotted, the 95 % ellipses of its
    components, and the numbers of targets, true and estimated. Parameters are those of `Canvas`.
    """

    panel = MultiTargetPanel

    def _ratio(self) -> float:
        clutter = self.scenario.clutter(0)
        width, height = (clutter.high - clutter.low)[:2]
        return float(np.clip(height / width, 0.4, 1.2))

    def _view(self, episode: Any, t: int, shown: Sequence[Tracked]) -> tuple[np.ndarray, np.ndarray]:
        clutter = self.scenario.clutter(t)
        return clutter.low[:2], clutter.high[:2]


def _has_groups(clutter: Clutter) -> bool:
    return len(clutter.gaussians.w) + len(clutter.ellipses.w) > 0
