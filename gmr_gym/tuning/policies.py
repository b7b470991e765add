"""Policies that set thresholds: policy(features (k,), t) -> action (j,), t the scan from 0.

The features are those of `gmr_gym.tuning.features`, and the action is what
`gmr_gym.tuning.thresholds.from_action` takes. A learned policy and those that it has to beat go through the
same door.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gmr_gym.checks import check_count
from gmr_gym.tuning.features import FEATURES
from gmr_gym.tuning.network import Network


@dataclass(frozen=True)
class Constant:
    """The same thresholds at every scan."""

    action: np.ndarray  # (j,)

    def __call__(self, features: np.ndarray, t: int) -> np.ndarray:
        return self.action


@dataclass(frozen=True)
class Schedule:
    """Thresholds by the clock: row i for scans i * every and on, the last row from then on."""

    actions: np.ndarray  # (m, j)
    every: int  # scans

    def __post_init__(self):
        check_count(self.every, "every")

    def __call__(self, features: np.ndarray, t: int) -> np.ndarray:
        return self.actions[min(t // self.every, len(self.actions) - 1)]


@dataclass(frozen=True)
class Rule:
    """Log thresholds linear in a few features, kept within the box. On "kept" or "given_up" alone it steers
    the number of hypotheses, or the loss of a reduction, towards a target."""

    names: Sequence[str]  # i of FEATURES
    gain: np.ndarray  # (j, i)
    bias: np.ndarray  # (j,)

    def __call__(self, features: np.ndarray, t: int) -> np.ndarray:
        return np.clip(self.bias + self.gain @ features[places(self.names)], -1, 1)


@dataclass(frozen=True)
class ByTable:
    """Thresholds by what is known of the world, as an engineer tabulates them: those of the nearest cell."""

    names: Sequence[str]  # i of FEATURES, such as "clutter" and "detection"
    cells: np.ndarray  # (m, i), their values
    actions: np.ndarray  # (m, j)

    def __call__(self, features: np.ndarray, t: int) -> np.ndarray:
        distance = ((self.cells - features[places(self.names)]) ** 2).sum(axis=1)
        return self.actions[distance.argmin()]


@dataclass
class Random:
    """Thresholds drawn evenly over the box anew every so many scans. It remembers what it drew, and goes on
    with its own stream from episode to episode."""

    size: int  # j
    every: int  # scans
    rng: np.random.Generator
    _action: np.ndarray = field(init=False)

    def __post_init__(self):
        check_count(self.every, "every")

    def watching(self, env: Any) -> "Random":
        """Itself: having a stream, it plays one episode after another and no two at once."""
        return self

    def __call__(self, features: np.ndarray, t: int) -> np.ndarray:
        if t % self.every == 0:
            self._action = self.rng.uniform(-1, 1, self.size)
        return self._action


@dataclass(frozen=True)
class ByNetwork:
    """What a trained network says of the features."""

    network: Network

    def __call__(self, features: np.ndarray, t: int) -> np.ndarray:
        return self.network(features)

    def many(self, features: np.ndarray, t: int) -> np.ndarray:
        """The actions (n, j) for features (n, k) of as many episodes, each as if alone."""
        return self.network(features)


def places(names: Sequence[str]) -> list[int]:
    """Where the named features stand; ValueError for one that is not there."""
    for name in names:
        if name not in FEATURES:
            raise ValueError(f"unknown feature {name!r}; choose from {', '.join(FEATURES)}")
    return [FEATURES.index(name) for name in names]
