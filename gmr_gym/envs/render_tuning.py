"""Drawing of a tracker whose thresholds are set scan by scan."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gmr_gym.envs.render import Panel, Tracked
from gmr_gym.envs.render_marks import HYPOTHESIS, INK, style_plane, style_strip
from gmr_gym.envs.render_sheet import SIZE, Sheet
from gmr_gym.filters.mht import MAX_HYPOTHESES, ScanUpdate
from gmr_gym.filters.tracker import Report
from gmr_gym.mixture import Mixture, mean_and_covariance, moments
from gmr_gym.models.gating import Gates
from gmr_gym.reduction.n_scan import extended
from gmr_gym.simulation.single_target import Episode, Scan, Scenario, scan
from gmr_gym.tuning.assumed import assumed, every, processed
from gmr_gym.tuning.features import at_start
from gmr_gym.tuning.instances import SCANS
from gmr_gym.tuning.recent import at_first
from gmr_gym.tuning.thresholds import DEPTH, DORTENZIO, REDUCERS, Thresholds, reduced, to_action

# of the parameters, in their order
DASHES = "-", "--", ":", "-.", (0, (5, 1)), (0, (1, 4)), (0, (6, 3, 1, 3)), (0, (3, 1, 1, 1, 1, 1))


class TuningCanvas:
    """Images of episodes of `ReductionTuningEnv`: the posterior of the scan last reduced, near the estimate,
    before and after the reduction; below, by scan, how many hypotheses there were and the actions.

    The tracker is run again for them: the same scans, under the same thresholds and factors.

    Parameters
    ----------
    scenario : Scenario
    parameters : sequence of str
        What an action sets.
    reducer : str
        One of `REDUCERS`.
    on_screen : bool
        Whether to open a window.
    """

    def __init__(self, scenario: Scenario, parameters: Sequence[str], reducer: str, on_screen: bool = False):
        self.parameters, self._reducer = parameters, list(REDUCERS).index(reducer)
        self._sheet = Sheet(SIZE, 2, 2, 8 + len(parameters), across=True, on_screen=on_screen)
        self.figure = self._sheet.figure
        self.panels = [Panel(scenario, plane, (), "") for plane in self._sheet.planes]
        for i, plane in enumerate(self._sheet.planes):
            style_plane(plane, labelled=i == 0)
        ((counts, actions),) = self._sheet.strips
        for strip in (counts, actions):
            style_strip(strip, SCANS, labelled=True)
        counts.set(yscale="log", ylim=(0.8, MAX_HYPOTHESES), xlabel="", ylabel="hypotheses")
        counts.set_yticks([1, 10, 100, 1000], labels=["1", "10", "100", "1000"])
        counts.tick_params(labelbottom=False)
        actions.set(ylim=(-1.1, 1.1), ylabel="action")
        self._counts = [
            *counts.step([], [], where="mid", color=INK, lw=1.2, label="number before the reduction"),
            *counts.step([], [], where="mid", color=HYPOTHESIS, lw=1.6, label="number kept"),
        ]
        self._actions = [
            *(actions.step([], [], ls=dashes, where="mid", color=INK, lw=1.4, label=name)[0]
              for name, dashes in zip(parameters, DASHES, strict=False))
        ]  # fmt: skip
        self._episode: Episode | None = None
        self._belief: Mixture
        self._history: np.ndarray  # of its hypotheses, see `tuning.thresholds.reduced`
        self._row: np.ndarray  # the thresholds of the scan before
        self._estimates: list[np.ndarray]
        self._numbers: list[tuple[int, int]]  # of hypotheses before and after, by scan
        self._last: tuple[Scan, Report, Report | None]  # of the scan drawn, before and after its reduction

    def draw(
        self, scenario: Scenario, episode: Episode, thresholds: Sequence[Thresholds]
    ) -> np.ndarray | None:
        """Draw the scan that was last reduced; before any, the posterior of scan 1.

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
            self._episode, self._belief = episode, scenario.model.prior
            self._history, self._row = np.zeros((1, DEPTH), np.int64), np.array(DORTENZIO, float)
            self._estimates, self._numbers = [], []
        for each in thresholds[len(self._estimates) :]:
            seen, full = self._next_scan(scenario, episode)
            before = full.posterior.mixture
            self._row = np.array(each, float)
            history = extended(self._history, full.posterior.parent, full.posterior.detection)
            *belief, _, _, _, _, self._history = reduced(self._reducer, *before, history, self._row, 0.0, 0)
            self._belief = Mixture(*belief)
            self._last = seen, _report(before, full), _report(self._belief, full)
            self._estimates.append(self._last[2].x[0])
            self._numbers.append((len(before.w), len(self._belief.w)))
        if not self._estimates:
            seen, full = self._next_scan(scenario, episode)
            self._last = seen, _report(full.posterior.mixture, full), None
        self._planes(scenario, episode)
        self._strips(thresholds)
        return self._sheet.shown()

    def close(self) -> None:
        """Close the window, if there is one."""
        self._sheet.close()

    def _next_scan(self, scenario: Scenario, episode: Episode) -> tuple[Scan, ScanUpdate]:
        """The next scan, and the belief predicted and updated by it."""
        estimate = self._estimates[-1] if self._estimates else moments(scenario.model.prior)[0]
        seen = scan(scenario, episode, len(self._estimates), scenario.centre(estimate))
        model = scenario.model
        hypotheses, gates, *_ = processed(
            (self._belief[:], self._history), seen.z, assumed(model), self._row, at_start(model)[:],
            at_first(0.0), 0.0, False,
        )  # fmt: skip
        return seen, ScanUpdate(every(hypotheses), Gates(*gates))

    def _planes(self, scenario: Scenario, episode: Episode) -> None:
        seen, before, after = self._last
        t = max(len(self._estimates) - 1, 0)
        titles = "before the reduction", "after it" if after else "not reduced yet"
        for panel, report, title in zip(self.panels, (before, after), titles, strict=True):
            panel.scenario, panel.title = scenario, title
            panel.draw(episode, t, Tracked(seen, self._estimates, report))
            panel.plane.set(**self._near(before))
        if not self.figure.legends:
            self._sheet.name(
                [*self.panels[0].marks(Tracked(seen, (), before)), *self._counts, *self._actions]
            )

    def _near(self, report: Report) -> dict[str, Any]:
        """Limits about the estimate within which all gates lie, of sides that double from scan to scan, if
        they must."""
        gates, centre = report.gates, report.x[0, list(self.panels[0].scenario.position)]
        reach = np.sqrt(gates.threshold * gates.S.diagonal(axis1=1, axis2=2))
        half = 2.0 ** np.ceil(np.log2((np.abs(gates.z - centre) + reach).max()))
        box = self._sheet.planes[0].get_position(original=True)
        ends = np.array([[-1, 1]]) * half * [[1], [box.height / box.width * SIZE[1] / SIZE[0]]]
        return {"xlim": centre[0] + ends[0], "ylim": centre[1] + ends[1]}

    def _strips(self, thresholds: Sequence[Thresholds]) -> None:
        by_scan = np.arange(1, len(thresholds) + 1)
        for line, numbers in zip(self._counts, np.reshape(self._numbers, (-1, 2)).T, strict=True):
            line.set_data(by_scan, numbers)
        actions = np.array([to_action(each, self.parameters) for each in thresholds])
        for line, values in zip(self._actions, actions.reshape(-1, len(self.parameters)).T, strict=True):
            line.set_data(by_scan, values)


def _report(posterior: Mixture, full: ScanUpdate) -> Report:
    mean, covariance = mean_and_covariance(posterior)
    return Report(mean[None], covariance[None], full.gates, posterior)
