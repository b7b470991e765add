"""One environment for every scenario of many targets."""

from collections.abc import Sequence
from numbers import Integral

import gymnasium as gym
import numpy as np

from gmr_gym.checks import _check_positive, check_choice, check_flag
from gmr_gym.envs.episodic import EXTENT, EpisodicEnv
from gmr_gym.envs.labels import Trajectories, labels_of
from gmr_gym.evaluation.set_distances import set_distances
from gmr_gym.points import absent
from gmr_gym.simulation.multi_target import MultiTargetEpisode, MultiTargetScenario, draw, scan
from gmr_gym.simulation.single_target import Scan

EXISTENCE_THRESHOLD = 0.5  # existence from which a row counts as an estimate
PARTS = "localisation", "missed", "false"  # of GOSPA, as in info
COLUMN = {"gospa": 0, "ospa": 4}  # of what `set_distances` returns
TRAJECTORY = "trajectory-gospa"


class MultiTargetEnv(EpisodicEnv):
    """Targets that appear and disappear in clutter, to be detected and located scan by scan.

    ## Description
    A sensor reports a scan of points; each target has at most one of them. `reset` emits scan 1;
    `step(estimates)` scores the estimates for the scan just seen and emits the next.

    ## Observation space
    A flat `Dict` of float64 boxes (and one of int8), metres and seconds:

    | key | shape | meaning |
    |---|---|---|
    | `scan` | (capacity, p) | detections in random order, padded with zeros |
    | `mask` | (capacity,) | 1 where a row of `scan` is a detection |
    | `time` | (1,) | time of the scan, s; the first is one period after 0 |

    The capacity is the Poisson quantile of the clutter at 1 - 1e-12 in the scan that has most of it, plus one
    for each target; of recorded detections the number in the scan that has most.

    ## Action space
    `Box((targets, 1 + d), float64)`: a row for each estimate, its existence in [0, 1] and its state within
    +-1e7. A row counts as an estimate when its existence is at least 0.5; the others must be finite all the
    same. A row of which anything is masked does not count. `targets` is the largest number of targets that
    can be declared.

    With `labels=True` the shape is (targets, 2 + d), and the last column a label: the whole number next to it
    says which estimates of different scans are of one target. Negative is none; no two estimates of a scan
    may have the same.

    ## Reward
    Minus the GOSPA distance (or OSPA) of the estimated positions to the true ones, with the scenario's cutoff
    and order (100 m and 2 for UnknownClutter, 50 m and 2 for RecordedRadar). With "trajectory-gospa" minus
    what the scan adds to the trajectory GOSPA of the episode so far: rewards sum to minus that of the
    episode. It needs labels, and solves a linear programme in every step.

    ## Starting state
    There is no prior. Truth, detections and clutter come from separate streams of the seed, so that every
    policy meets the same episode, whatever it submits.

    ## Episode end
    `truncated` after the last scan, with an empty observation; never `terminated`.

    ## Info
    Of the scan observed `truth` (m, d), zeros where a target is absent, `present` (m,), whether it exists,
    and `origin` (capacity,), the index of a target, -1 clutter, -2 padding. After a step `error`, the
    distance in m, and the parts of GOSPA, whatever the metric: `localisation`, `missed` and `false`, m^order.
    They are for scoring and drawing: a policy that reads them cheats.

    ## Arguments
    `scenario`: "module:function" that returns a MultiTargetScenario; `targets`: rows of an action; `metric`:
    "gospa", "ospa" or "trajectory-gospa"; `labels`: whether actions have them; `switching`: what trajectory
    GOSPA charges for a switched label, m, by default a tenth of the cutoff; `observe`: "detections", or
    "truth" for the fully observed twin, whose observation has `truth` and `present` (int8) of info too; every
    other keyword goes to the function.
    """

    scenario: MultiTargetScenario
    metric: str
    labels: bool
    switching: float  # m
    shape: tuple[int, int]  # of a scan, padded

    def __init__(
        self,
        scenario: str,
        targets: int = 10,
        metric: str = "gospa",
        labels: bool = False,
        switching: float | None = None,
        render_mode: str | None = None,
        observe: str = "detections",
        **arguments,
    ):
        check_choice("metric", metric, (*COLUMN, TRAJECTORY))
        check_flag("labels", labels)
        if metric == TRAJECTORY and not labels:
            raise ValueError(f"metric {TRAJECTORY} compares trajectories: it needs labels=True")
        if switching is not None:
            _check_positive(switching=switching)
        if isinstance(targets, bool) or not (isinstance(targets, Integral) and 1 <= targets <= 1000):
            raise ValueError(f"targets must be a whole number of rows between 1 and 1000, got {targets!r}")
        super().__init__(scenario, render_mode, observe, arguments)
        self.metric, self.labels = metric, labels
        self.switching = self.scenario.cutoff / 10 if switching is None else switching
        p, d = self.scenario.sensor.H.shape
        self._capacity = self.scenario.most_in_scan
        self.shape = self._capacity, p
        end = (self.scenario.horizon + 1) * self.scenario.period
        spaces: dict[str, gym.Space] = {
            "scan": gym.spaces.Box(-EXTENT, EXTENT, self.shape, np.float64),
            "mask": gym.spaces.Box(0, 1, (self._capacity,), np.int8),
            "time": gym.spaces.Box(0.0, end, (1,), np.float64),
        }  # fmt: skip
        if self.shows_truth:
            spaces |= {
                "truth": gym.spaces.Box(-EXTENT, EXTENT, (self.scenario.targets, d), np.float64),
                "present": gym.spaces.Box(0, 1, (self.scenario.targets,), np.int8),
            }
        self.observation_space = gym.spaces.Dict(spaces)
        low, high = np.full((2, targets, 1 + d + labels), EXTENT)
        low *= -1
        low[:, 0], high[:, 0] = 0.0, 1.0
        if labels:
            low[:, -1] = -1.0
        self.action_space = gym.spaces.Box(low, high, dtype=np.float64)

    def step(self, action):
        """Score the estimates of the current scan, and emit the next.

        Parameters
        ----------
        action : array_like (targets, 1 + d) or (targets, 2 + d)
            Rows [existence, state], or [existence, state, label].

        Returns
        -------
        observation, reward, terminated, truncated, info

        Raises
        ------
        RuntimeError
            If no episode is running.
        ValueError
            For another shape, an existence outside [0, 1], a state that is not finite, or a label of two.
        """
        rows = self._checked(action)
        at = estimates(rows, self._position)
        x = self._episode.x[self._t]
        truth = targets_at(x, self._position)
        labels = labels_of(rows, rows[:, 0] >= EXISTENCE_THRESHOLD) if self.labels else np.empty(0, int)
        scores = set_distances(at, truth, self.scenario.cutoff, self.scenario.order)
        self._estimates.append(at)
        self._t += 1
        observation, info = self._emit()
        if self.metric == TRAJECTORY:
            error = self._trajectories.grown_by(at, labels, x[:, self._position])
        else:
            error = scores[COLUMN[self.metric]]
        info |= {"error": error, **dict(zip(PARTS, scores[1:4], strict=True))}
        return observation, -error, False, self._t >= self.scenario.horizon, info

    def new_trajectories(self) -> Trajectories:
        """Those of an episode that begins."""
        return Trajectories(self.scenario.cutoff, self.scenario.order, self.switching)

    def _drawn(self, seed: int) -> MultiTargetEpisode:
        self._trajectories = self.new_trajectories()
        return draw(self.scenario, seed)

    def _seen(self, t: int) -> Scan:
        return scan(self._episode, t)

    def _truth(self, t: int):
        x = self._episode.x[t]
        present = ~np.isnan(x).any(axis=1)
        # zeros, as nan is not equal to nan where two copies are compared
        return {"truth": np.where(present[:, None], x, 0.0), "present": present}

    def _state(self, t: int):
        if t < self.scenario.horizon:
            x, present = self._truth(t).values()
            return {"truth": x, "present": present.astype(np.int8)}
        m, d = self.scenario.targets, self.scenario.sensor.H.shape[1]
        return {"truth": np.zeros((m, d)), "present": np.zeros(m, np.int8)}

    def nothing_more(self) -> dict[str, np.ndarray]:
        """The observation past the last scan."""
        end = (self.scenario.horizon + 1) * self.scenario.period
        seen: dict[str, np.ndarray] = {
            "scan": np.zeros(self.shape),
            "mask": np.zeros(self._capacity, np.int8),
            "time": np.array([end]),
        }
        return seen | (self._state(self.scenario.horizon) if self.shows_truth else {})

    def _checked(self, action) -> np.ndarray:
        if (hidden := absent(action)) is not None:
            action = np.where(hidden.reshape(-1, 1), 0.0, np.ma.getdata(action))
        rows = super()._checked(action)
        if not ((rows[:, 0] >= 0) & (rows[:, 0] <= 1)).all():
            raise ValueError(f"existence, the first column, must lie in [0, 1], got {rows[:, 0].tolist()}")
        if not (np.abs(rows[:, 1:]) <= EXTENT).all():
            raise ValueError(f"action must be finite and within +-{EXTENT:g} in every row")
        return rows

    def _new_canvas(self, on_screen: bool):
        from gmr_gym.envs.render_multi_target import MultiTargetCanvas

        return MultiTargetCanvas(self.scenario, on_screen)


def estimates(rows: np.ndarray, position: Sequence[int] | np.ndarray) -> np.ndarray:
    """Positions (j, p) of the rows [existence, state, ...] of an action that count as estimates."""
    return rows[rows[:, 0] >= EXISTENCE_THRESHOLD, 1:][:, position]


def targets_at(x: np.ndarray, position: Sequence[int] | np.ndarray) -> np.ndarray:
    """Positions (k, p) of the states x (m, d) of the targets that are there."""
    truth = x[:, position]
    return truth[~np.isnan(truth).any(axis=1)]
