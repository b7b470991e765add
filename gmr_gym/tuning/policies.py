"""Policies that set thresholds: policy(features (k,), t) -> action (j,), with t the scan from 0.

The features are the first or all of `gmr_gym.tuning.recent.ALL_FEATURES`, and the action is what
`gmr_gym.tuning.thresholds.from_action` takes. Learned policies and the ones they are compared with have this
one interface.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gmr_gym.checks import check_count
from gmr_gym.tuning.network import Network
from gmr_gym.tuning.recent import feature_index


@dataclass(frozen=True)
class Constant:
    """The same action at every scan."""

    action: np.ndarray  # (j,)

    def __call__(self, features: np.ndarray, t: int) -> np.ndarray:
        """The action (j,) at scan t."""
        return self.action


@dataclass(frozen=True)
class Schedule:
    """Actions by time: row i for the scans from i * every on, the last row from then on.

    Raises
    ------
    ValueError
        If `every` is not a positive whole number.
    """

    actions: np.ndarray  # (m, j)
    every: int  # scans

    def __post_init__(self):
        check_count(self.every, "every")

    def __call__(self, features: np.ndarray, t: int) -> np.ndarray:
        """The action (j,) at scan t."""
        return self.actions[min(t // self.every, len(self.actions) - 1)]


@dataclass(frozen=True)
class Rule:
    """Log thresholds that are linear in a few features, clipped to the box.

    On "kept" or "given_up" alone it is a controller of the number of hypotheses, or of the loss of a
    reduction.
    """

    names: Sequence[str]  # i of ALL_FEATURES
    gain: np.ndarray  # (j, i)
    bias: np.ndarray  # (j,)

    def __call__(self, features: np.ndarray, t: int) -> np.ndarray:
        """The action (j,) for the features (k,) of scan t."""
        return np.clip(self.bias + self.gain @ features[feature_index(self.names)], -1, 1)


@dataclass(frozen=True)
class ByTable:
    """A table of actions by features of the scenario; the action of the nearest cell is taken."""

    names: Sequence[str]  # i of ALL_FEATURES, such as "clutter" and "detection"
    cells: np.ndarray  # (m, i), their values
    actions: np.ndarray  # (m, j)

    def __call__(self, features: np.ndarray, t: int) -> np.ndarray:
        """The action (j,) for the features (k,) of scan t."""
        distance = ((self.cells - features[feature_index(self.names)]) ** 2).sum(axis=1)
        return self.actions[distance.argmin()]


@dataclass
class Random:
    """Actions drawn uniformly from the box, anew every so many scans.

    It keeps its last draw, and its random stream continues from episode to episode.

    Raises
    ------
    ValueError
        If `every` is not a positive whole number.
    """

    size: int  # j
    every: int  # scans
    rng: np.random.Generator
    _action: np.ndarray = field(init=False)

    def __post_init__(self):
        check_count(self.every, "every")

    def watching(self, env: Any) -> "Random":
        """Itself: with one stream it plays one episode after another, never two at once."""
        return self

    def __call__(self, features: np.ndarray, t: int) -> np.ndarray:
        """The action (j,) at scan t."""
        if t % self.every == 0:
            self._action = self.rng.uniform(-1, 1, self.size)
        return self._action


@dataclass(frozen=True)
class ByNetwork:
    """The actions of a trained network."""

    network: Network

    def __call__(self, features: np.ndarray, t: int) -> np.ndarray:
        """The action (j,) for the features (k,) of scan t."""
        return self.network(features)

    def many(self, features: np.ndarray, t: int) -> np.ndarray:
        """The actions (n, j) for features (n, k) of n episodes, each as if alone."""
        return self.network(features)
