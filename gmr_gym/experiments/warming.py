"""Kernels compiled before anybody waits for them: for images, class rooms and continuous integration."""

from collections.abc import Callable, Collection
from typing import Any

import gymnasium as gym

from gmr_gym.catalogue import GROUP, MULTI_TARGET_GROUP, described
from gmr_gym.envs.policy import MultiTargetPolicy, Policy
from gmr_gym.envs.registry import MULTI_TARGET, TUNING
from gmr_gym.evaluation.workers import check_workers, results
from gmr_gym.experiments.specs import tracker_of

SCANS = 3  # from the second on there are several hypotheses


def warm(
    env_ids: Collection[str], trackers: Collection[str], jobs: int, tell: Callable[[int, int], None]
) -> int:
    """Compile what the environments and the trackers need, by playing a few scans of each pair.

    Parameters
    ----------
    env_ids : collection of str
        Ids of `gmr_gym.envs.registry.ENVIRONMENTS`.
    trackers : collection of str
        NAME or NAME:key=value,key=value; if empty, all that fit.
    jobs : int
        Number of processes, as in `gmr_gym.evaluation.workers.results`. A kernel is compiled by one of them.
    tell : callable
        Called with the numbers of pairs done and of all.

    Returns
    -------
    int
        Pairs of an environment and a tracker that fit each other.

    Raises
    ------
    ValueError
        For a tracker that fits none of the environments, and for 0 jobs.
    """
    check_workers(jobs, "loky", None)
    names = trackers or [*described(GROUP), *described(MULTI_TARGET_GROUP)]
    calls: dict[tuple[str, str], tuple] = {(env_id, ""): (_step_all, env_id) for env_id in env_ids}
    tracked = [env_id for env_id in env_ids if env_id != TUNING]
    calls |= {(env_id, name): (_play, env_id, name) for env_id in tracked for name in names}
    fitting, reasons = [], {}
    for done, ((_, name), reason) in enumerate(results(calls, jobs), start=1):
        if reason:
            reasons[name] = reason
        elif name:
            fitting.append(name)
        tell(done, len(calls))
    for name in trackers:
        if name not in fitting:
            reason = reasons.get(name, "no tracker runs there")
            raise ValueError(f"tracker {name!r} fits none of {', '.join(env_ids)}: {reason}")
    return len(fitting)


def _step_all(env_id: str) -> str:
    """Steps the environment alone and, where there is a compiled form for many, two side by side."""
    env = gym.make(env_id)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    if env_id not in MULTI_TARGET:
        envs = gym.make_vec(env_id, num_envs=2)
        envs.reset(seed=0)
        envs.step(envs.action_space.sample())
    return ""


def _play(env_id: str, name: str) -> str:
    """Plays the tracker in the environment; returns why it does not fit, if so."""
    env: Any = gym.make(env_id)
    try:
        tracker = tracker_of(name, env.unwrapped.scenario)
    except ValueError as error:
        return str(error)
    policy = (MultiTargetPolicy if env_id in MULTI_TARGET else Policy)(tracker)
    observation, _ = env.reset(seed=0)
    for _ in range(SCANS):
        observation, *_ = env.step(policy(observation))
    return ""
