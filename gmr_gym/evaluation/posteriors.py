"""Mixtures as trackers meet them: what enters their reduction, scan by scan."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from gmr_gym.evaluation.montecarlo import run_once
from gmr_gym.evaluation.multi_target_runs import run_multi_target_once
from gmr_gym.mixture import Mixture, normalised
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.simulation.multi_target import MultiTargetScenario
from gmr_gym.simulation.single_target import Scenario

A_EPISODE = 5  # most mixtures that are taken of one
EPISODES = 100  # most that are played


class Keeping:
    """A reduction that keeps what it is given."""

    def __init__(self, reduce: Callable[..., Reduced]):
        self.reduce = reduce
        self.entered: list[Mixture] = []

    def __call__(self, p: Mixture, *modes: np.ndarray) -> Reduced:
        self.entered.append(p)
        return self.reduce(p, *modes)


def posteriors(
    scenario: Scenario | MultiTargetScenario, tracker: Any, count: int, seed: int, more_than: int, most: int
) -> list[Mixture]:
    """Mixtures at random scans of random episodes, as they enter a tracker's reduction.

    Parameters
    ----------
    scenario : Scenario or MultiTargetScenario
    tracker : Tracker or MultiTargetTracker
        A dataclass with a reduction in its field `reduce`. It plays the episodes.
    count : int
        Number of mixtures.
    seed : int
        Of the episodes, which are those of `gmr_gym.evaluation.run`, and of the scans in them.
    more_than, most : int
        Mixtures of at most `more_than` components, or of more than `most`, are not taken.

    Returns
    -------
    list of Mixture
        Of weights that sum to 1.

    Raises
    ------
    ValueError
        For a tracker without such a field, and where too few scans have such mixtures.
    """
    if "reduce" not in getattr(tracker, "__dataclass_fields__", ()):
        raise ValueError(f"{type(tracker).__name__} has no reduction in a field `reduce`")
    found: list[Mixture] = []
    for i in range(EPISODES):
        if len(found) >= count:
            return found[:count]
        keeping = Keeping(tracker.reduce)
        _play(scenario, replace(tracker, reduce=keeping), np.random.SeedSequence(seed, spawn_key=(i,)))
        there = [p for p in keeping.entered if more_than < len(p.w) <= most]
        chosen = np.random.default_rng([seed, i]).permutation(len(there))[:A_EPISODE]
        found += [normalised(there[scan]) for scan in np.sort(chosen)]
    raise ValueError(
        f"{EPISODES} episodes have {len(found)} of {count} mixtures of more than {more_than} components and "
        f"at most {most}"
    )


def _play(scenario: Scenario | MultiTargetScenario, tracker: Any, seed: np.random.SeedSequence) -> None:
    if isinstance(scenario, MultiTargetScenario):
        run_multi_target_once(scenario, tracker, seed)
    else:
        run_once(scenario, tracker, seed)
