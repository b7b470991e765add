"""A tracker as a policy: observation in, action out."""

from typing import Any

import numpy as np

from gmr_gym.tracker import Report, Tracker


class Policy:
    """Plays a tracking environment with a tracker; `report` is what it last said.

    >>> policy = Policy(make_tracker("runnalls-30", env.unwrapped.scenario.model))
    >>> observation, info = env.reset(seed=1)
    >>> action = policy(observation)
    """

    def __init__(self, tracker: Tracker):
        self.tracker = tracker
        self.report: Report | None = None
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
        return self.report.x[0]
