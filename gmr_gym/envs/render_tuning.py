"""Drawing of a tracker whose thresholds are set scan by scan, beside its environment and not inside."""

from collections.abc import Sequence

import numpy as np

from gmr_gym.envs.render import Canvas
from gmr_gym.filters.mht import ScanUpdate, predict_and_update, prune_and_reduce
from gmr_gym.filters.tracker import Report
from gmr_gym.mixture import Mixture, mean_and_covariance, moments
from gmr_gym.reduction.runnalls import greedy
from gmr_gym.simulation.single_target import Episode, Scan, Scenario, scan
from gmr_gym.tuning.thresholds import Thresholds


class TuningCanvas:
    """Pictures of episodes of `ReductionTuningEnv`, for which the tracker goes its way once more: the same
    scans, reduced by the same thresholds."""

    def __init__(self, scenario: Scenario, on_screen: bool = False):
        self._canvas = Canvas(scenario, on_screen)
        self._episode: Episode | None = None
        self._belief: Mixture
        self._estimates: list[np.ndarray]
        self._last: tuple[Scan, Report]  # that was reduced

    def draw(
        self, scenario: Scenario, episode: Episode, thresholds: Sequence[Thresholds]
    ) -> np.ndarray | None:
        """The picture (height, width, 3) of the scan that the last of the thresholds reduced, with what was
        kept, or before there are any of scan 1, with all hypotheses; on a screen it is shown and None
        returned."""
        if episode is not self._episode:
            self._canvas.scenario, self._canvas.title = scenario, ""
            self._episode, self._belief, self._estimates = episode, scenario.model.prior, []
        for each in thresholds[len(self._estimates) :]:
            seen, full = self._look(scenario, episode)
            self._belief = prune_and_reduce(
                full.posterior.mixture, greedy(each.components, each.alpha), each.prune, each.prune_density
            )
            self._last = seen, _report(self._belief, full)
            self._estimates.append(self._last[1].x[0])
            self._canvas.title = f"alpha {each.alpha:.2g}, prune {each.prune:.2g}"
        if not self._estimates:
            seen, full = self._look(scenario, episode)
            self._last = seen, _report(full.posterior.mixture, full)
        seen, report = self._last
        return self._canvas.draw(episode, seen, max(len(self._estimates) - 1, 0), self._estimates, report)

    def close(self):
        """Close the window, if there is one."""
        self._canvas.close()

    def _look(self, scenario: Scenario, episode: Episode) -> tuple[Scan, ScanUpdate]:
        """The next scan, and the belief expanded by it."""
        estimate = self._estimates[-1] if self._estimates else moments(scenario.model.prior)[0]
        seen = scan(scenario, episode, len(self._estimates), scenario.centre(estimate))
        return seen, predict_and_update(self._belief, scenario.model, seen.z)


def _report(posterior: Mixture, full: ScanUpdate) -> Report:
    mean, covariance = mean_and_covariance(posterior)
    return Report(mean[None], covariance[None], full.gates, posterior)
