"""What only hindsight can do: bounds, to be held against policies that see nothing but features."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

# Of an action, a threshold each: alpha from 2e-3 to a half, gamma from 3e-5 to a hundredth, three to a decade
LEVELS = np.linspace(-0.25, 1, 6)


def grid(parameters: int, levels: np.ndarray = LEVELS) -> np.ndarray:
    """Every combination of the levels (m,) as an action, (m ** parameters, parameters)."""
    return np.array(list(product(levels, repeat=parameters)))


@dataclass(frozen=True)
class ByInstance:
    """Constant thresholds for each instance, by its name."""

    actions: Mapping[str, np.ndarray]  # (j,) each

    def watching(self, env: Any) -> Callable[[np.ndarray, int], np.ndarray]:
        """The policy in an environment."""
        return lambda features, t: self.actions[env.instance_id]


@dataclass(frozen=True)
class Greedy:
    """Of a few actions that which, held for some scans, brings the most reward: it sees the truth and the
    detections to come.

    Held for one scan the cheapest would win: merging keeps the mean, so that what a reduction spoils shows in
    the estimates of the scans after it. It is no upper bound: it holds what a policy may change, and a
    target that is lost later looks as good as one that is not.
    """

    actions: np.ndarray  # (m, j)
    scans: int = 8

    def watching(self, env: Any) -> Callable[[np.ndarray, int], np.ndarray]:
        """The policy in an environment."""
        return lambda features, t: self.actions[
            int(np.argmax([env.lookahead_reward(action, self.scans) for action in self.actions]))
        ]
