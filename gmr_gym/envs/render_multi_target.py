"""Drawing of many targets."""

import numpy as np

from gmr_gym.envs.render import CLUTTER, ESTIMATE, INK, TRUTH, Sheet, ellipses
from gmr_gym.filters.tracker import MultiTargetReport
from gmr_gym.mixture import joined
from gmr_gym.models.clutter import Clutter
from gmr_gym.simulation.multi_target import MultiTargetEpisode, MultiTargetScenario
from gmr_gym.simulation.single_target import Scan

EDGE = 5.99  # squared Mahalanobis distance, within which 95 % of a Gaussian of the plane lie


class MultiTargetCanvas:
    """Images of an episode, scan by scan: detections, true tracks, estimates and the clutter's components.

    With a tracker's reports they also show the clutter that it assumes, dotted, and the 95 % ellipses of its
    components.

    Parameters
    ----------
    scenario : MultiTargetScenario
    on_screen : bool
        Whether to open a window.
    title : str
    """

    def __init__(self, scenario: MultiTargetScenario, on_screen: bool = False, title: str = ""):
        self.scenario = scenario
        self._title = title
        self._sheet = Sheet(on_screen)
        self.figure = self._sheet.figure

    def draw(
        self,
        episode: MultiTargetEpisode,
        scan: Scan,
        t: int,
        estimates: list[np.ndarray],
        report: MultiTargetReport | None = None,
    ) -> np.ndarray | None:
        """Draw one scan.

        Parameters
        ----------
        episode : MultiTargetEpisode
        scan : Scan
        t : int
            Number of the scan, from 0.
        estimates : list of ndarray (j, 2)
            Estimates of each scan so far.
        report : MultiTargetReport, optional
            The tracker's report of this scan.

        Returns
        -------
        ndarray (height, width, 3) or None
            None where the image is shown in a window.
        """
        self.figure.clear()
        axes = self.figure.add_axes((0.13, 0.08, 0.84, 0.86))
        clutter = self.scenario.clutter(t)
        _clutter(axes, clutter, edgecolors=CLUTTER, linewidths=0.8)
        if report is not None:
            _clutter(axes, report.clutter, edgecolors=INK, linewidths=0.8, linestyles=":")
            self._components(axes, report)
        axes.plot(*scan.z.T, ".", color=CLUTTER, ms=4, label="detections")
        axes.plot(*scan.z[scan.origin >= 0].T, "o", color=TRUTH, ms=6, mfc="none")
        paths = episode.x[: t + 1][:, :, list(self.scenario.position)]
        for i, path in enumerate(paths.swapaxes(0, 1)):
            axes.plot(*path.T, color=TRUTH, lw=1.4, label="truth" if i == 0 else None)
        if sum(map(len, estimates)):
            points = np.concatenate(estimates)
            axes.plot(*points.T, ".", color=ESTIMATE, ms=3, label="estimates")
            axes.plot(*estimates[-1].T, "x", color=ESTIMATE, ms=7)
        margin = 0.03 * (clutter.high - clutter.low)
        axes.set_xlim(clutter.low[0] - margin[0], clutter.high[0] + margin[0])
        axes.set_ylim(clutter.low[1] - margin[1], clutter.high[1] + margin[1])
        axes.set_aspect("equal")
        axes.set_xlabel("x, m")
        axes.set_ylabel("y, m")
        axes.set_title(f"{self._title}  t = {(t + 1) * self.scenario.period:g} s", loc="left", color=INK)
        axes.legend(loc="upper right", fontsize=8, framealpha=0.9)
        return self._sheet.shown()

    def close(self):
        """Close the window, if there is one."""
        self._sheet.close()

    def _components(self, axes, report):
        p, at = report.intensity, list(self.scenario.position)
        colours = [(25 / 255, 103 / 255, 210 / 255, a) for a in np.sqrt(np.clip(p.w, 1e-3, 1))]
        spread = EDGE * p.P[:, at][:, :, at]
        axes.add_collection(ellipses(axes, p.m[:, at], spread, edgecolors=colours, linewidths=1.2))


def _clutter(axes, clutter: Clutter, **style):
    """Ellipses of the clutter: the 95 % ellipse of each Gaussian, and each uniform ellipse."""
    groups = joined((clutter.gaussians._replace(P=EDGE * clutter.gaussians.P), clutter.ellipses))
    if len(groups.w):
        axes.add_collection(ellipses(axes, groups.m, groups.P, **style))
