"""Drawing of one target: one canvas for render() and for films.

What a radar measures is drawn from above, in metres about the radar.
"""

from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure

from gmr_gym.filters.tracker import Report
from gmr_gym.models.radar import Radar
from gmr_gym.simulation.single_target import Episode, Scan, Scenario

INK, CLUTTER, TRUTH, ESTIMATE, HYPOTHESIS = "#222222", "#9aa0a6", "#1a7f37", "#c5221f", "#1967d2"
GATES, PAPER = "#d0d7de", "#ffffff"
INKS = INK, CLUTTER, TRUTH, ESTIMATE, HYPOTHESIS, GATES


class Sheet:
    """A figure of 640 by 640 pixels, in memory or in a window."""

    def __init__(self, on_screen: bool = False):
        self._window: Any = None
        if on_screen:
            import matplotlib.pyplot as plt

            self._window = plt
            self.figure = plt.figure(figsize=(6.4, 6.4))
        else:
            self.figure = Figure(figsize=(6.4, 6.4), dpi=100)
            self._pixels = FigureCanvasAgg(self.figure)

    def shown(self) -> np.ndarray | None:
        """The image (height, width, 3); None where it is shown in a window."""
        if self._window is not None:
            self._window.pause(1e-3)
            return None
        self._pixels.draw()
        return np.asarray(self._pixels.buffer_rgba())[..., :3].copy()

    def close(self):
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close(self.figure)


class Canvas:
    """Images of an episode, scan by scan.

    With a tracker's reports they also show its gates, its hypotheses (weight as opacity) and their number.

    Parameters
    ----------
    scenario : Scenario
    on_screen : bool
        Whether to open a window.
    title : str
    """

    def __init__(self, scenario: Scenario, on_screen: bool = False, title: str = ""):
        self.scenario = scenario
        self.title = title
        self._counts: list[float] = []
        self._sheet = Sheet(on_screen)
        self.figure = self._sheet.figure

    def draw(
        self,
        episode: Episode,
        scan: Scan,
        t: int,
        estimates: list[np.ndarray],
        report: Report | None = None,
    ) -> np.ndarray | None:
        """Draw one scan.

        Parameters
        ----------
        episode : Episode
        scan : Scan
        t : int
            Number of the scan, from 0.
        estimates : list of ndarray (d,)
            Estimates up to this scan.
        report : Report, optional
            The tracker's report of this scan.

        Returns
        -------
        ndarray (height, width, 3) or None
            None where the image is shown in a window.
        """
        self.figure.clear()
        if report is None:
            axes = self.figure.add_axes((0.11, 0.08, 0.86, 0.86))
        else:
            axes = self.figure.add_axes((0.11, 0.27, 0.86, 0.68))
            self._strip(t, len(report.mixture.w))
        self._scan(axes, episode, scan, t)
        if report is not None:
            self._hypotheses(axes, report)
        if estimates:
            path = np.array(estimates)[:, list(self.scenario.position[:2])]
            axes.plot(*path.T, color=ESTIMATE, lw=1.4, label="estimate")
        self._frame(axes, episode, t, estimates)
        return self._sheet.shown()

    def close(self):
        """Close the window, if there is one."""
        self._sheet.close()

    def _scan(self, axes, episode, scan, t):
        z = self.scenario.model.sensor.to_gate_space(scan.z)[:, :2]
        axes.plot(*z.T, ".", color=CLUTTER, ms=4, label="detections")
        seen = min(t + 1, len(episode.x))
        axes.plot(*episode.x[:seen, list(self.scenario.position[:2])].T, color=TRUTH, lw=1.4, label="truth")
        axes.plot(*z[scan.origin == 0].T, "o", color=TRUTH, ms=6, mfc="none")

    def _hypotheses(self, axes, report):
        gates, p = report.gates, report.mixture
        if np.isfinite(gates.threshold):
            # the projection of an ellipsoid is the ellipse of the block of its covariance
            shapes = gates.S[:, :2, :2] * gates.threshold
            outlines = ellipses(axes, gates.z[:, :2], shapes, edgecolors=GATES, linewidths=0.8)
            axes.add_collection(outlines)
        at = list(self.scenario.position[:2])
        opacity = np.clip(np.sqrt(p.w / p.w.max()), 0.04, 1)
        # 95 % of each hypothesis
        spread = p.P[:, at][:, :, at] * 5.99
        colours = [(25 / 255, 103 / 255, 210 / 255, a) for a in opacity]
        axes.add_collection(ellipses(axes, p.m[:, at], spread, edgecolors=colours, linewidths=1.2))

    def _frame(self, axes, episode, t, estimates):
        low, high = self._view(estimates[-1] if estimates else episode.x[min(t, len(episode.x) - 1)])
        margin = 0.06 * (high - low)
        axes.set_xlim(low[0] - margin[0], high[0] + margin[0])
        axes.set_ylim(low[1] - margin[1], high[1] + margin[1])
        axes.set_aspect("equal")
        if isinstance(self.scenario.model.sensor, Radar):
            axes.locator_params(axis="x", nbins=4)  # labels of six figures under a narrow box would overlap
        axes.set_xlabel("x, m")
        axes.set_ylabel("y, m")
        axes.set_title(f"{self.title}  t = {(t + 1) * self.scenario.period:g} s", loc="left")
        axes.legend(loc="upper right", fontsize=8, framealpha=0.9)

    def _view(self, estimate):
        """Lower and upper corner (2,), m, of the window about the estimate (d,)."""
        sensor = self.scenario.model.sensor
        low, high, follows, _ = self.scenario.window
        if follows:
            at = sensor.measure(estimate)
            low, high = at + low, at + high
        if not isinstance(sensor, Radar):
            return low, high
        # its edges are curved: take the box about a grid of its points
        sides = np.linspace(low, high, 9).T
        points, possible = sensor.wrap_and_validate(
            np.stack(np.meshgrid(*sides), axis=-1).reshape(-1, len(low))
        )
        placed = sensor.to_gate_space(points[possible])[:, :2]
        low, high = placed.min(axis=0), placed.max(axis=0)
        # one scale for both axes even where the window is a thin strip: the box is then drawn wider
        half = np.maximum(high - low, (high - low).max() / 3) / 2
        return (low + high) / 2 - half, (low + high) / 2 + half

    def _strip(self, t, count):
        del self._counts[t:]
        self._counts += [np.nan] * (t - len(self._counts))  # scans that were not drawn
        self._counts.append(count)
        strip = self.figure.add_axes((0.11, 0.07, 0.86, 0.12))
        strip.step(np.arange(1, len(self._counts) + 1), self._counts, where="mid", color=HYPOTHESIS)
        strip.set_xlim(0, self.scenario.horizon + 1)
        strip.set_ylim(0, max(10, 1.1 * np.nanmax(self._counts)))
        strip.set_xlabel("scan")
        strip.set_ylabel("hypotheses")


def ellipses(axes, centres, shapes, **style):
    """A collection of the ellipses (x - centre)' shape^-1 (x - centre) = 1.

    Parameters
    ----------
    axes : matplotlib Axes
    centres : ndarray (n, 2)
    shapes : ndarray (n, 2, 2)
    **style
        Of matplotlib's EllipseCollection.

    Returns
    -------
    EllipseCollection
    """
    values, vectors = np.linalg.eigh(shapes)
    axes_lengths = 2 * np.sqrt(values)
    angles = np.degrees(np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1]))
    return EllipseCollection(
        axes_lengths[:, 1], axes_lengths[:, 0], angles, units="xy", offsets=centres,
        offset_transform=axes.transData, facecolors="none", **style,
    )  # fmt: skip
