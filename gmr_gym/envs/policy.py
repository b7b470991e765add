"""A tracker as a policy: observation in, action out."""

from typing import Any

import numpy as np

from gmr_gym.filters.tracker import MultiTargetTracker, Tracker


class Policy:
    """A tracker as a policy for a tracking environment.

    `report` is the tracker's last report.

    Parameters
    ----------
    tracker : Tracker

    Examples
    --------
    >>> import gymnasium
    >>> from gmr_gym import Policy, make_tracker
    >>> env = gymnasium.make("gmr_gym/TurningTarget-v0", clutter_rate=20)
    >>> policy = Policy(make_tracker("nearest-neighbour", env.unwrapped.scenario.model))
    >>> observation, info = env.reset(seed=1)
    >>> policy(observation).shape
    (4,)
    """

    def __init__(self, tracker: Tracker | MultiTargetTracker):
        self.tracker = tracker
        self.report: Any = None  # Report or MultiTargetReport
        self._belief: Any = None
        self._time = np.inf

    def __call__(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        """The action for an observation.

        A time that is not after the last one begins a new episode.

        Parameters
        ----------
        observation : dict
            As the environment emits it.

        Returns
        -------
        ndarray (d,)
            The estimate of the observed scan.
        """
        time = float(observation["time"][0])
        if time <= self._time:
            self._belief = self.tracker.init()
        self._time = time
        z = observation["scan"][observation["mask"].astype(bool)]
        self._belief, self.report = self.tracker.step(self._belief, z)
        return self._action()

    def _action(self) -> np.ndarray:
        return self.report.x[0]


class MultiTargetPolicy(Policy):
    """A tracker of many targets as a policy for an environment of many targets.

    `report` is the tracker's last report.

    Parameters
    ----------
    tracker : MultiTargetTracker
    targets : int
        Rows of an action, the largest number of declared targets.
    labels : bool
        Whether the environment's actions have labels: those of the tracker.

    Examples
    --------
    >>> import gymnasium
    >>> from gmr_gym import MultiTargetPolicy, make_tracker
    >>> env = gymnasium.make("gmr_gym/UnknownClutter-v0", targets=10)
    >>> policy = MultiTargetPolicy(make_tracker("gm-phd", env.unwrapped.scenario.model), targets=10)
    """

    def __init__(self, tracker: MultiTargetTracker, targets: int = 10, labels: bool = False):
        super().__init__(tracker)
        self.targets, self.labels = targets, labels

    def _action(self) -> np.ndarray:
        """The declared targets, the largest existence first, as rows [existence, state] or [existence, state,
        label] (targets, 1 + d or 2 + d).

        Existence is 1 in each row of a declared target: every declared target counts.
        """
        order = np.argsort(-self.report.existence, kind="stable")[: self.targets]
        declared = np.column_stack([np.ones(len(order)), self.report.x[order]])
        if self.labels:
            declared = np.column_stack([declared, self.report.label[order]])
        rows = np.zeros((self.targets, declared.shape[1]))
        rows[: len(declared)] = declared
        return rows
