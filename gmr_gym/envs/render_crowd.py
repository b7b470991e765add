"""Drawing of many targets, beside their environment and not inside."""

import numpy as np

from gmr_gym.crowd import Crowd, ManyScenario
from gmr_gym.envs.render import CLUTTER, ESTIMATE, INK, TRUTH, Sheet, ellipses
from gmr_gym.mixture import joined
from gmr_gym.simulate import Scan


class CrowdCanvas:
    """Pictures of an episode, scan by scan: detections, true tracks, estimates and where clutter crowds."""

    def __init__(self, scenario: ManyScenario, on_screen: bool = False):
        self.scenario = scenario
        self._sheet = Sheet(on_screen)
        self.figure = self._sheet.figure

    def draw(self, crowd: Crowd, scan: Scan, t: int, estimates: list[np.ndarray]) -> np.ndarray | None:
        """The picture (height, width, 3) of scan t (from 0) and the estimates (j, 2) of each scan so far; on
        a screen it is shown and None returned."""
        self.figure.clear()
        axes = self.figure.add_axes((0.13, 0.08, 0.84, 0.86))
        clutter = self.scenario.clutter(t)
        # 95 % of each Gaussian, all of each ellipse
        groups = joined((clutter.gaussians._replace(P=5.99 * clutter.gaussians.P), clutter.ellipses))
        if len(groups.w):
            axes.add_collection(ellipses(axes, groups.m, groups.P, edgecolors=CLUTTER, linewidths=0.8))
        axes.plot(*scan.z.T, ".", color=CLUTTER, ms=4, label="detections")
        axes.plot(*scan.z[scan.origin >= 0].T, "o", color=TRUTH, ms=6, mfc="none")
        paths = crowd.x[: t + 1][:, :, list(self.scenario.position)]
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
        axes.set_title(f"t = {(t + 1) * self.scenario.period:g} s", loc="left", color=INK)
        axes.legend(loc="upper right", fontsize=8, framealpha=0.9)
        return self._sheet.shown()

    def close(self):
        """Close the window, if there is one."""
        self._sheet.close()
