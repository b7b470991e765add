"""Drawing of a tracker whose thresholds are set scan by scan."""

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
    """Images of episodes of `ReductionTuningEnv`.

    The tracker is run again for them: the same scans, reduced by the same thresholds.

    Parameters
    ----------
    scenario : Scenario
    on_screen : bool
        Whether to open a window.
    """

    def __init__(self, scenario: Scenario, on_screen: bool = False):
        self._canvas = Canvas(scenario, on_screen)
        self._episode: Episode | None = None
        self._belief: Mixture
        self._estimates: list[np.ndarray]
        self._last: tuple[Scan, Report]  # that was reduced

    def draw(
        self, scenario: Scenario, episode: Episode, thresholds: Sequence[Thresholds]
    ) -> np.ndarray | None:
        """Draw the scan that was last reduced, with the hypotheses kept; before any, scan 1 with all
        hypotheses.

        Parameters
        ----------
        scenario : Scenario
        episode : Episode
        thresholds : sequence of Thresholds
            By which the scans were reduced so far.

        Returns
        -------
        ndarray (height, width, 3) or None
            None where the image is shown in a window.
        """
        if episode is not self._episode:
            self._canvas.scenario, self._canvas.title = scenario, ""
            self._episode, self._belief, self._estimates = episode, scenario.model.prior, []
        for each in thresholds[len(self._estimates) :]:
            seen, full = self._next_scan(scenario, episode)
            self._belief = prune_and_reduce(
                full.posterior.mixture, greedy(each.components, each.alpha), each.prune, each.prune_density
            )
            self._last = seen, _report(self._belief, full)
            self._estimates.append(self._last[1].x[0])
            self._canvas.title = f"alpha {each.alpha:.2g}, prune {each.prune:.2g}"
        if not self._estimates:
            seen, full = self._next_scan(scenario, episode)
            self._last = seen, _report(full.posterior.mixture, full)
        seen, report = self._last
        return self._canvas.draw(episode, seen, max(len(self._estimates) - 1, 0), self._estimates, report)

    def close(self):
        """Close the window, if there is one."""
        self._canvas.close()

    def _next_scan(self, scenario: Scenario, episode: Episode) -> tuple[Scan, ScanUpdate]:
        """The next scan, and the belief predicted and updated by it."""
        estimate = self._estimates[-1] if self._estimates else moments(scenario.model.prior)[0]
        seen = scan(scenario, episode, len(self._estimates), scenario.centre(estimate))
        return seen, predict_and_update(self._belief, scenario.model, seen.z)


def _report(posterior: Mixture, full: ScanUpdate) -> Report:
    mean, covariance = mean_and_covariance(posterior)
    return Report(mean[None], covariance[None], full.gates, posterior)
