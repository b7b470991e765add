"""Policies played over instances on the same episodes: what every comparison is made of."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import gymnasium as gym
import joblib
import numpy as np
from threadpoolctl import threadpool_limits

import gmr_gym  # noqa: F401  registers the environments
from gmr_gym.instances import instances

ENV_ID = "gmr_gym/ReductionTuning-v0"


class Episodes(NamedTuple):
    """One policy's episodes, by instance and run: means over the scans of an episode."""

    reward: np.ndarray  # (instances, runs), sum over scans; as trained for
    error: np.ndarray  # (instances, runs), m, of the scans before a loss and of the loss itself
    lost: np.ndarray  # (instances, runs), 1 for an episode that a loss ended
    work: np.ndarray  # (instances, runs), of a scan
    components: np.ndarray  # (instances, runs)


def played(
    policies: Mapping[str, Callable[[np.ndarray, int], np.ndarray]],
    table: str,
    runs: int,
    seed: int = 0,
    *,
    env: Mapping[str, Any] | None = None,
    jobs: int = -1,
) -> dict[str, Episodes]:
    """Every policy's episodes over a table of instances: run i of an instance is the same for all of them,
    and on any number of workers."""
    names = list(instances(table))
    settings = {**(env or {}), "instances": table}
    calls = (
        joblib.delayed(_of_instance)(policy, settings, name, i, runs, seed)
        for policy in policies.values()
        for i, name in enumerate(names)
    )
    rows = joblib.Parallel(n_jobs=jobs)(calls)
    found = {}
    for k, policy in enumerate(policies):
        own = rows[k * len(names) : (k + 1) * len(names)]
        found[policy] = Episodes(*(np.array(part) for part in zip(*own, strict=True)))
    return found


def _of_instance(policy, settings, name: str, place: int, runs: int, seed: int) -> np.ndarray:
    """Reward, error, loss, work and hypotheses (5, runs) of an instance's episodes."""
    env = gym.make(ENV_ID, **settings).unwrapped
    out = np.empty((5, runs))
    with threadpool_limits(1):  # small matrices are slower on several threads
        for run in range(runs):
            key = np.random.SeedSequence((seed, place, run)).generate_state(2)
            observation, _ = env.reset(
                seed=int(key[0]) << 31 | int(key[1]) >> 1, options={"instance_id": name}
            )
            rows, over, t = [], False, 0
            while not over:
                observation, reward, lost, late, info = env.step(policy(observation, t))
                rows.append((reward, info["error"], info["work"], info["components"]))
                over, t = lost or late, t + 1
            reward, error, work, components = np.array(rows).T
            out[:, run] = reward.sum(), error.mean(), lost, work.mean(), components.mean()
    return out
