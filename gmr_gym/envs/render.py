"""Drawing of one target: one canvas for render() and for films.

What a radar measures is drawn from above, in metres about the radar.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from gmr_gym.envs.render_marks import (
    CLUTTER,
    EDGE,
    ESTIMATE,
    GATES,
    HYPOTHESIS,
    INK,
    PAPER,
    TRUTH,
    add_ellipses,
    link,
    over_scans,
    ring,
    style_plane,
    style_strip,
)
from gmr_gym.envs.render_sheet import SIZE, Sheet, height_for
from gmr_gym.models.radar import Radar
from gmr_gym.simulation.single_target import Scan, Scenario

TITLE, LETTER = 11, 0.6  # points, and width of a letter as a share of its size
LATEST = slice(-1, None)  # of a path, the point that has a marker
MARGIN = 0.06  # of a side of what is seen, around it


class Tracked(NamedTuple):
    """What a panel shows of a scan.

    Attributes
    ----------
    scan : Scan
        The detections.
    estimates : sequence of ndarray
        Up to this scan: states (d,), of many targets positions (j, 2).
    report : Report or MultiTargetReport, optional
        The tracker's report of this scan.
    counts : sequence of int
        Hypotheses kept, scan by scan.
    lost_at : int
        Scan, from 0, at which the track was lost; -1 for one that is not.
    """

    scan: Scan
    estimates: Sequence[np.ndarray]
    report: Any = None
    counts: Sequence[int] = ()
    lost_at: int = -1


class Panel:
    """The artists of one tracker, which change from scan to scan.

    Parameters
    ----------
    scenario : Scenario
    plane : Axes
    strips : sequence of Axes
        One for the number of hypotheses, or none.
    title : str
    """

    names = 4, 2  # marks in the legend: of every picture, and of a tracker's reports

    def __init__(self, scenario: Any, plane: Axes, strips: Sequence[Axes], title: str):
        self.scenario, self.plane, self.strips, self.title = scenario, plane, strips, title
        self.detections, self.truth, self.own, self.estimate = self._lines()
        self._above = plane.text(
            0, 1.02, "", color=INK, size=TITLE, transform=plane.transAxes, parse_math=False
        )
        self._lost = plane.annotate(
            "", (0, 0), (8, 8), xycoords="axes fraction", textcoords="offset points", color=ESTIMATE,
            weight="bold", bbox={"facecolor": PAPER, "edgecolor": ESTIMATE},
        )  # fmt: skip

    def _lines(self) -> list[Line2D]:
        plot = self.plane.plot
        return [
            *plot([], [], ".", color=CLUTTER, ms=4, label="detections"),
            *plot([], [], "o-", color=TRUTH, lw=1.4, ms=4, markevery=LATEST, label="truth"),
            *plot([], [], "o", color=TRUTH, ms=6, mfc="none", label="target-originated detection"),
            *plot([], [], "x-", color=ESTIMATE, lw=1.4, ms=6, markevery=LATEST, label="estimate"),
        ]

    def marks(self, shown: Tracked) -> list[Line2D]:
        """What the legend names: all that is drawn."""
        found = [self.detections, self.own, self.truth, self.estimate]
        if shown.report is not None:
            gated = bool(np.isfinite(shown.report.gates.threshold))
            found += [ring(GATES, "gates")] * gated + [ring(HYPOTHESIS, "hypotheses, faint: of low weight")]
        return found

    def draw(self, episode: Any, t: int, shown: Tracked) -> None:
        """Draw scan t (from 0) of an episode."""
        at = list(self.scenario.position[:2])
        z = self.scenario.model.sensor.to_gate_space(shown.scan.z)[:, :2]
        self.detections.set_data(*z.T)
        self.own.set_data(*z[shown.scan.origin == 0].T)
        self.truth.set_data(*episode.x[: t + 1, at].T)
        self.estimate.set_data(*np.reshape(shown.estimates, (-1, episode.x.shape[1]))[:, at].T)
        self._lost.set_text(f"target lost at scan {shown.lost_at + 1}" if shown.lost_at >= 0 else "")
        self.say(t)
        for old in [*self.plane.collections]:
            old.remove()
        if shown.report is not None:
            self._hypotheses(shown.report)
        for strip in self.strips:
            over_scans(strip, "hypotheses", {HYPOTHESIS: shown.counts})

    def say(self, t: int) -> None:
        """Write the title, as much of it as has room, and the time above the plane."""
        time = f"t = {(t + 1) * self.scenario.period:g} s"
        figure = self.plane.figure
        inches = self.plane.get_position(original=True).width * figure.bbox.width / figure.dpi
        room = int(inches * 72 / (LETTER * TITLE)) - len(time) - 2
        title = self.title if len(self.title) <= room else f"{self.title[: max(room - 1, 0)]}…"
        self._above.set_text("  ".join(filter(None, (title, time))))

    def _hypotheses(self, report: Any) -> None:
        gates, p = report.gates, report.mixture
        if np.isfinite(gates.threshold):
            # the projection of an ellipsoid is the ellipse of the block of its covariance
            add_ellipses(self.plane, gates.z[:, :2], gates.S[:, :2, :2] * gates.threshold, GATES, 0.8)
        at = list(self.scenario.position[:2])
        opacity = np.clip(np.sqrt(p.w / p.w.max(initial=0.0)), 0.04, 1)
        add_ellipses(self.plane, p.m[:, at], EDGE * p.P[:, at][:, :, at], HYPOTHESIS, 1.2, opacity)


class Canvas:
    """Images of an episode, scan by scan.

    With a tracker's reports they also show its gates, its hypotheses (weight as opacity) and their number.

    Parameters
    ----------
    scenario : Scenario
    on_screen : bool
        Whether to open a window.
    titles : sequence of str
        Of panels side by side, one for each tracker. All show the same part of the plane.
    size : tuple of int
        Width and height, pixels; a height of 0 for what the scenario's view takes.
    tracked : bool
        Whether there are reports of a tracker.
    scans : int, optional
        Length of the strip; the scenario's by default.
    """

    panel = Panel

    def __init__(
        self,
        scenario: Any,
        on_screen: bool = False,
        titles: Sequence[str] = ("",),
        size: tuple[int, int] = SIZE,
        tracked: bool = False,
        scans: int | None = None,
    ):
        self.scenario = scenario
        panels, strips, marks = len(titles), int(tracked), sum(self.panel.names[: 1 + tracked])
        width, height = size
        height = height or height_for(width, panels, strips, marks, self._ratio())
        self._sheet = Sheet((width, height), panels, strips, marks, on_screen=on_screen)
        self.figure, self._named = self._sheet.figure, False
        self.panels: list[Panel] = []
        for title, plane, below in zip(titles, self._sheet.planes, self._sheet.strips, strict=True):
            style_plane(plane, labelled=not self.panels)
            for strip in below:
                style_strip(strip, scans or scenario.horizon, labelled=not self.panels)
            self.panels.append(self.panel(scenario, plane, below, title))

    def draw(self, episode: Any, t: int, shown: Sequence[Tracked]) -> np.ndarray | None:
        """Draw one scan.

        Parameters
        ----------
        episode : Episode
        t : int
            Number of the scan, from 0.
        shown : sequence of Tracked
            What each panel shows.

        Returns
        -------
        ndarray (height, width, 3) or None
            None where the image is shown in a window.
        """
        self.place(episode, t, shown)
        return self._sheet.shown()

    def place(self, episode: Any, t: int, shown: Sequence[Tracked]) -> None:
        """As `draw`, without an image: for `save`."""
        for panel, each in zip(self.panels, shown, strict=True):
            panel.draw(episode, t, each)
        if not self._named:
            self._sheet.name(self.panels[0].marks(shown[0]))
            self._named = True
        low, high = self._view(episode, t, shown)
        margin = MARGIN * (high - low)
        for panel in self.panels:
            panel.plane.set(
                xlim=(low[0] - margin[0], high[0] + margin[0]), ylim=(low[1] - margin[1], high[1] + margin[1])
            )
        for beside in zip(*self._sheet.strips, strict=True):
            link(beside)

    def save(self, out: Any) -> None:
        """Write what was drawn last to a .png or .svg file."""
        self._sheet.save(out)

    def close(self) -> None:
        """Close the window, if there is one."""
        self._sheet.close()

    def _ratio(self) -> float:
        """Height of what is seen, as a share of its width."""
        low, high, follows, _ = self.scenario.window
        if follows or isinstance(self.scenario.model.sensor, Radar):
            return 1.0
        return float(np.clip((high[1] - low[1]) / (high[0] - low[0]), 0.4, 1.2))

    def _view(self, episode: Any, t: int, shown: Sequence[Tracked]) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner (2,), m, of the window: one that follows is about the estimate, or about the
        target where there is none, or several."""
        latest = shown[0].estimates[-1:] if len(shown) == 1 else ()
        about = [state for state in latest if np.isfinite(state).all()]
        return view(self.scenario, [*about, episode.x[min(t, len(episode.x) - 1)]][0])


def view(scenario: Scenario, state: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner (2,), m, of a scenario's window about a state (d,)."""
    sensor = scenario.model.sensor
    low, high, follows, _ = scenario.window
    if follows:
        at = sensor.measure(state)
        low, high = at + low, at + high
    if not isinstance(sensor, Radar):
        return low, high
    # its edges are curved: take the box about a grid of its points
    sides = np.linspace(low, high, 9).T
    points, possible = sensor.wrap_and_validate(np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, len(low)))
    placed = sensor.to_gate_space(points[possible])[:, :2]
    low, high = placed.min(axis=0), placed.max(axis=0)
    # one scale for both axes even where the window is a thin strip: the box is then drawn wider
    half = np.maximum(high - low, (high - low).max() / 3) / 2
    return (low + high) / 2 - half, (low + high) / 2 + half
