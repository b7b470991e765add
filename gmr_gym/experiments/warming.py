"""Kernels compiled before anybody waits for them: for images, class rooms and continuous integration."""

from collections.abc import Callable, Collection
from typing import Any

import gymnasium as gym
import numpy as np

from gmr_gym.catalogue import GROUP, MULTI_TARGET_GROUP, described
from gmr_gym.envs.lookup import scenario_of, tracker_of
from gmr_gym.envs.policy import MultiTargetPolicy, Policy
from gmr_gym.envs.registry import MULTI_TARGET, TUNING
from gmr_gym.evaluation.batch import can_batch, run_batch
from gmr_gym.evaluation.montecarlo import run_once
from gmr_gym.evaluation.workers import check_workers, results
from gmr_gym.first_calls import compiled_at_once
from gmr_gym.recorded import SensorSpec, cut, from_arrays, smooth, track, tracking_model
from gmr_gym.simulation.single_target import draw

SCANS = 3  # from the second on there are several hypotheses


def warm(
    env_ids: Collection[str],
    trackers: Collection[str],
    jobs: int,
    tell: Callable[[int, int], None],
    files: bool = False,
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
    files : bool
        Whether what tracks files of detections is compiled, too.

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
    scenarios = {env_id: scenario_of(env_id, {}) for env_id in env_ids if env_id != TUNING}
    calls: dict[tuple[str, str], tuple] = {("", ""): (_track,)} if files else {}
    calls |= {(env_id, ""): (_step_all, env_id) for env_id in env_ids}
    for name in trackers or [*described(GROUP), *described(MULTI_TARGET_GROUP)]:
        fits, reason = False, "no tracker runs there"
        for env_id, scenario in scenarios.items():
            try:
                tracker_of(name, scenario)
            except ValueError as error:
                reason = str(error)
            else:
                fits, calls[env_id, name] = True, (_play, env_id, name)
        if name in trackers and not fits:
            raise ValueError(f"tracker {name!r} fits none of {', '.join(env_ids)}: {reason}")
    with compiled_at_once():
        for done, _ in enumerate(results(calls, jobs), start=1):
            tell(done, len(calls))
    return sum(name != "" for _, name in calls)


def _track() -> None:
    """Tracks two targets and smooths their tracks, as of a file."""
    radar = SensorSpec("", "polar", deviation=(5.0, 0.01), detection_probability=0.9, clutter_per_scan=0.1)
    times, z = np.repeat(np.arange(4.0), 2), np.tile([[100.0, 0.5], [700.0, 2.5]], (4, 1))
    found = from_arrays(times, z, sensors=[radar])
    model = tracking_model([radar], (-1e3, -1e3), (1e3, 1e3), learn_clutter=True)
    smooth(track(found, cut(found), model), found, model)


def _step_all(env_id: str) -> None:
    """Steps the environment alone, and two side by side."""
    env = gym.make(env_id)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    envs = gym.make_vec(env_id, num_envs=2)
    envs.reset(seed=0)
    envs.step(envs.action_space.sample())


def _play(env_id: str, name: str) -> None:
    """Plays the tracker in the environment, as a policy and in runs."""
    env: Any = gym.make(env_id)
    scenario = env.unwrapped.scenario
    tracker = tracker_of(name, scenario)
    many = env_id in MULTI_TARGET
    policy = MultiTargetPolicy(tracker, len(env.action_space.low)) if many else Policy(tracker)
    observation, _ = env.reset(seed=0)
    for _ in range(SCANS):
        observation, *_ = env.step(policy(observation))
    if many:
        return
    run_once(scenario, tracker, 0, scans=SCANS)
    if can_batch(scenario, tracker):
        run_batch(scenario, tracker, [draw(scenario, 0)], SCANS)
