"""A tracker as a policy: observation in, action out."""

from typing import Any

import numpy as np

from gmr_gym.filters.tracker import MultiTargetTracker, Tracker


class Policy:
    """Plays a tracking environment with a tracker; `report` is what it last said.

    >>> policy = Policy(make_tracker("runnalls-30", env.unwrapped.scenario.model))
    >>> observation, info = env.reset(seed=1)
    >>> action = policy(observation)
    """

    def __init__(self, tracker: Tracker | MultiTargetTracker):
        self.tracker = tracker
        self.report: Any = None  # Report, or Account
        self._belief: Any = None
        self._time = np.inf

    def __call__(self, observation: dict[str, np.ndarray]) -> np.ndarray:
        """The estimate (d,) of the observed scan. Time that goes backwards means a new episode."""
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
    """Plays an environment of many targets with a tracker of them, up to `targets` named in a scan; `report`
    is its last account.

    >>> policy = MultiTargetPolicy(make_tracker("learning-pmb", env.unwrapped.scenario.model), targets=10)
    """

    def __init__(self, tracker: MultiTargetTracker, targets: int = 10):
        super().__init__(tracker)
        self.targets = targets

    def _action(self) -> np.ndarray:
        """The targets it names, the surest first, as rows [existence, state] (targets, 1 + d); existence 1,
        for whoever is named is to count."""
        x = self.report.x[np.argsort(-self.report.existence, kind="stable")[: self.targets]]
        rows = np.zeros((self.targets, 1 + x.shape[1]))
        rows[: len(x), 0], rows[: len(x), 1:] = 1.0, x
        return rows
