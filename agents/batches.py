"""Many episodes side by side, played again and again: what a search tries its candidates on.

An episode gets the reward without a price, and its work, so that it is judged at any price."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from judge import Policy, seeds_of

from gmr_gym.simulation.single_target import draw
from gmr_gym.tuning.instances import instances, world
from gmr_gym.tuning.recent import ALL_FEATURES
from gmr_gym.tuning.scans import EPISODE, STEP, begin, stepped
from gmr_gym.tuning.thresholds import DORTENZIO, REDUCERS, from_actions, threshold_index


class Outcome(NamedTuple):
    """What a policy did in n episodes."""

    reward: np.ndarray  # (n,), sum over scans, at the price 0
    work: np.ndarray  # (n,), sum over scans
    lost: np.ndarray  # (n,), 1 for an episode that a loss ended

    def value(self, price: float) -> float:
        """Mean reward of an episode at a price of work."""
        return float((self.reward - price * self.work).mean())


class Batch:
    """The episodes of a table of instances: run i of an instance is that of `judge.played`."""

    def __init__(self, table: str, runs: int, seed: int):
        self.scenarios = [world(row) for row in instances(table).values()]
        drawn = [
            (scenario, draw(scenario, s))
            for place, scenario in enumerate(self.scenarios)
            for s in seeds_of(seed, place, runs)
        ]
        self._begun = np.zeros(len(drawn), EPISODE)
        for row, (scenario, episode) in zip(self._begun, drawn, strict=True):
            begin(row, scenario, episode)

    def played(self, policy: Policy, reducer: str, parameters: Sequence[str]) -> Outcome:
        """One policy that sees all features and sets these parameters of a reducer."""
        at, seen = threshold_index(parameters), np.arange(len(ALL_FEATURES))
        state, n = self._begun.copy(), len(self._begun)
        state["reducer"] = list(REDUCERS).index(reducer)
        steps, observations = np.zeros(n, STEP), np.zeros((n, len(seen)), np.float32)
        thresholds = np.tile(np.array(DORTENZIO, float), (n, 1))
        found, running, t = Outcome(*np.zeros((3, n))), np.arange(n), 0
        stepped(state, running, thresholds, steps, observations, seen)
        while len(running):
            actions = asked(policy, observations[running], t)
            thresholds[running] = from_actions(actions, at, np.array(DORTENZIO, float))
            stepped(state, running, thresholds, steps, observations, seen)
            now = steps[running]
            found.reward[running] += now["reward"]
            found.work[running] += now["work"]
            found.lost[running] = now["terminated"]
            running, t = running[~(now["terminated"] | now["truncated"])], t + 1
        return found


def asked(policy: Policy, observations: np.ndarray, t: int) -> np.ndarray:
    """The actions (n, j) of a policy for observations (n, k)."""
    if hasattr(policy, "many"):
        return policy.many(observations, t)
    return np.array([policy(features, t) for features in observations], float)
