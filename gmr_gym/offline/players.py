"""What plays the episodes: trackers by name, and policies for `ReductionTuning`."""

from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.envs.episodic import EpisodicEnv
from gmr_gym.envs.lookup import parsed, tracker_of
from gmr_gym.envs.multi_target import MultiTargetEnv
from gmr_gym.envs.policy import MultiTargetPolicy, Policy
from gmr_gym.envs.tuning import ReductionTuningEnv
from gmr_gym.tuning.network import load
from gmr_gym.tuning.policies import ByNetwork, Constant, Random
from gmr_gym.tuning.thresholds import DORTENZIO, to_action

# by reducer, in data/policies
SHIPPED = {"adaptive": "thresholds.npz", "n-scan": "n-scan.npz", "cluster": "cluster.npz"}


class Player(NamedTuple):
    """What plays the episodes of an environment, by name.

    Attributes
    ----------
    name : str
    begin : callable
        begin(seed) is the policy for the episode of a seed: policy(observation, t) -> action, t the scan from
        0.
    """

    name: str
    begin: Callable[[int], Callable[[Any, int], np.ndarray]]


def players_of(specs: Sequence[str], env: Any) -> list[Player]:
    """Players by what a user types.

    Parameters
    ----------
    specs : sequence of str
        NAME:key=value,key=value. NAME is that of a tracker; in `ReductionTuning` one of `POLICIES`:

        - "learned", the network shipped for the environment's reducer, or `policy`, a file of another;
        - "constant", with the thresholds and factors that the action sets, those of D'Ortenzio where they are
          not given;
        - "random", drawn uniformly from the box of actions, anew `every` 10 scans.
    env : gymnasium.Env
        The environment itself, without wrappers.

    Returns
    -------
    list of Player

    Raises
    ------
    ValueError
        For an unknown name or parameter, a value out of range, a network of other features or parameters, and
        an environment of another kind.
    """
    if isinstance(env, ReductionTuningEnv):
        return [_policy(spec, env) for spec in specs]
    if not isinstance(env, EpisodicEnv):
        raise ValueError(f"env must be an environment of this package, which trackers play; got {env}")
    return [_tracker(spec, env) for spec in specs]


def _tracker(spec: str, env: Any) -> Player:
    tracker, actions = tracker_of(spec, env.scenario), env.action_space

    def begin(seed: int) -> Callable[[Any, int], np.ndarray]:
        if isinstance(env, MultiTargetEnv):
            policy: Policy = MultiTargetPolicy(tracker, len(actions.low), env.labels)
        else:
            policy = Policy(tracker)
        return lambda observation, t: policy(observation)

    return Player(spec, begin)


def _policy(spec: str, env: ReductionTuningEnv) -> Player:
    name, given = parsed(spec)
    if name not in POLICIES:
        near = get_close_matches(name, POLICIES, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise ValueError(
            f"unknown policy {name!r}; {hint}ReductionTuning is played by {', '.join(POLICIES)}, and not by "
            "trackers"
        )
    make, takes = POLICIES[name]
    for key in given:
        if key not in (takes or env.parameters):
            known = ", ".join(takes or env.parameters)
            raise ValueError(f"policy {name} has no parameter {key!r}; it takes {known}")
    return Player(spec, make(env, given))


def _learned(env: ReductionTuningEnv, given: Mapping[str, Any]) -> Callable[[int], ByNetwork]:
    shipped = files("gmr_gym.data") / "policies" / SHIPPED[env.reducer]
    file = Path(str(given.get("policy", shipped)))
    network = load(file, env.features, env.parameters)
    if network.parameters != env.parameters:
        raise ValueError(
            f"{file} sets {', '.join(network.parameters)}, and an action here {', '.join(env.parameters)}"
        )
    policy = ByNetwork(network)
    return lambda seed: policy


def _constant(env: ReductionTuningEnv, given: Mapping[str, Any]) -> Callable[[int], Constant]:
    for key, value in given.items():
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise ValueError(f"{key} must be a number, got {value!r}")
    policy = Constant(to_action(DORTENZIO._replace(**given), env.parameters))
    return lambda seed: policy


def _random(env: ReductionTuningEnv, given: Mapping[str, Any]) -> Callable[[int], Random]:
    size, every = len(env.parameters), given.get("every", 10)
    Random(size, every, np.random.default_rng(0))  # a wrong number is refused before any episode
    return lambda seed: Random(size, every, np.random.default_rng(seed))


# by name: what makes its policies, and the parameters that it takes; without any, those that an action sets
POLICIES: dict[str, tuple[Callable[..., Callable[[int], Any]], tuple[str, ...]]] = {
    "learned": (_learned, ("policy",)),
    "constant": (_constant, ()),
    "random": (_random, ("every",)),
}
