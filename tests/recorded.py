"""Runs, reductions, episodes and actions whose results are kept: what changes them has to say so.

`python tests/recorded.py` writes `recorded.json` again. Each entry holds a digest of every bit and one number
made of all of them. The bits are those of the processor and the libraries named there: others round
differently, and there the numbers are compared.
"""

import hashlib
import json
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import gymnasium as gym
import llvmlite.binding as llvm
import numba
import numpy as np
import scipy

import gmr_gym
from gmr_gym.baselines.learned import SHIPPED
from gmr_gym.envs.registry import MULTI_TARGET, TRACKING
from gmr_gym.evaluation.montecarlo import run_once
from gmr_gym.evaluation.multi_target_runs import run_multi_target_once
from gmr_gym.filters.registry import MULTI_TARGET_GROUP, trackers
from gmr_gym.mixture import Mixture, mixture, moments
from gmr_gym.reduction.distances import integral_squared_difference
from gmr_gym.reduction.properties import PROPERTIES
from gmr_gym.reduction.pruning import prune, prune_and_cap, prune_density
from gmr_gym.reduction.registry import REDUCERS
from gmr_gym.reduction.runnalls import adaptive
from gmr_gym.tuning.features import FEATURES
from gmr_gym.tuning.network import forward, load
from gmr_gym.tuning.thresholds import Thresholds

FILE = Path(__file__).with_suffix(".json")
SCANS = 12
OF_SEVERAL_MOTIONS = "gmr_gym/JumpMarkov-v0"
WORLDS = {  # where it is not the turning target
    **dict.fromkeys(
        ["b-best", "gpb1", "gpb2", "imm", "imm-mht", "imm-of-mhts", "imm-pda", "mmae", "mmae-mht",
         "mmae-of-mhts", "mmae-pda", "mmg", "one-motion"],
        OF_SEVERAL_MOTIONS,
    ),
    **dict.fromkeys(["imm-dcm-pda", "imm-dcm-pda-printed", "imm-ekf-pda"], "gmr_gym/AirborneRadar-v0"),
}  # fmt: skip


def machine() -> str:
    """What decides how results are rounded."""
    features = sorted(name for name, there in llvm.get_host_cpu_features().items() if there)
    versions = [module.__version__ for module in (np, scipy, numba)]
    return hashlib.sha256(json.dumps([llvm.get_host_cpu_name(), features, versions]).encode()).hexdigest()[
        :16
    ]


def examples() -> Iterator[tuple[str, Mixture]]:
    """Mixtures of unlike weights in one, two, four and six dimensions."""
    for n, d in ((12, 1), (40, 2), (60, 4), (30, 6)):
        rng = np.random.default_rng(100 * n + d)
        A = rng.standard_normal((n, d, d))
        P = A @ A.transpose(0, 2, 1) + 0.3 * np.eye(d)
        yield f"{n}x{d}", mixture(rng.dirichlet(np.full(n, 0.4)), 3.0 * rng.standard_normal((n, d)), P)


def reductions() -> Iterator[tuple[str, Callable[[], list]]]:
    own = {
        "adaptive-0.01": partial(adaptive, loss_bound=0.01),
        "prune": partial(prune, weight=1e-2),
        "prune-density": partial(prune_density, density=1e-3),
        "heaviest": partial(prune_and_cap, weight=1e-3, max_components=7),
    }
    known = [name for name in REDUCERS if PROPERTIES[name].most is None]
    named = {name: partial(REDUCERS[name], components=5) for name in known}
    for label, p in examples():
        for name, reduce in {**named, **own}.items():
            yield f"reduction {name} {label}", partial(reduced, reduce, p)


def reduced(reduce, p: Mixture) -> list:
    q, origin = reduce(p)
    return [*q, origin, *moments(q), integral_squared_difference(p, q)]


def runs() -> Iterator[tuple[str, Callable[[], list]]]:
    for name in trackers():
        world = WORLDS.get(name, "gmr_gym/TurningTarget-v0")
        for seed in (1, 2):
            yield f"run {name} {seed}", partial(run, world, name, seed)
    for env_id in TRACKING:
        for name in ("clairvoyant", "imm-pda", "one-motion"):
            yield f"run {name} in {env_id}", partial(run, env_id, name, 3)
    for name in trackers(MULTI_TARGET_GROUP):
        yield f"run {name}", partial(run_many, name, 1)


def run(env_id: str, name: str, seed: int) -> list:
    scenario = gym.make(env_id).unwrapped.scenario
    tracker = gmr_gym.make_tracker(name, scenario.model)
    played = run_once(scenario, tracker, seed, SCANS)
    return [played.x, played.P, played.components, played.gate_volume, played.off_target, played.modes]


def run_many(name: str, seed: int) -> list:
    scenario = gym.make(next(iter(MULTI_TARGET))).unwrapped.scenario
    tracker = gmr_gym.make_tracker(name, scenario.model)
    played = run_multi_target_once(scenario, tracker, seed, SCANS)
    return [played.ospa, played.gospa, played.localisation, played.missed, played.components]


def episodes() -> Iterator[tuple[str, Callable[[], list]]]:
    for env_id in (*TRACKING, *MULTI_TARGET, "gmr_gym/ReductionTuning-v0"):
        for seed in (1, 2):
            yield f"episode {env_id} {seed}", partial(episode, env_id, seed)
    for env_id in (*TRACKING, "gmr_gym/ReductionTuning-v0"):
        yield f"episodes side by side {env_id}", partial(side_by_side, env_id)


def acts(space, observation, rng) -> np.ndarray:
    """An action near the prior's mean, or anywhere where there is none to see."""
    if isinstance(observation, dict) and "prior_mean" in observation:
        return observation["prior_mean"] + rng.normal(size=space.shape)
    low, high = np.maximum(space.low, -1e3), np.minimum(space.high, 1e3)
    return rng.uniform(low, high).astype(space.dtype)


def episode(env_id: str, seed: int) -> list:
    env, rng = gym.make(env_id), np.random.default_rng(seed)
    observation, _ = env.reset(seed=seed)
    seen = leaves(observation)
    for _ in range(SCANS):
        observation, reward, terminated, truncated, info = env.step(acts(env.action_space, observation, rng))
        seen += [*leaves(observation), reward, terminated, truncated, info["error"]]
        if terminated or truncated:
            break
    return seen


def side_by_side(env_id: str) -> list:
    envs, rng = gym.make_vec(env_id, num_envs=3), np.random.default_rng(5)
    observation, _ = envs.reset(seed=4)
    seen = leaves(observation)
    for _ in range(SCANS):
        observation, *judged, _ = envs.step(acts(envs.action_space, observation, rng))
        seen += [*leaves(observation), *judged]
    return seen


def leaves(observation) -> list:
    if isinstance(observation, dict):
        return [observation[key] for key in sorted(observation)]
    return [observation]


def actions() -> Iterator[tuple[str, Callable[[], list]]]:
    for seed in range(8):
        yield f"actions of the shipped policy {seed}", partial(policy_actions, seed)


def policy_actions(seed: int) -> list:
    network = load(SHIPPED, FEATURES, Thresholds._fields)
    features = np.random.default_rng(seed).uniform(-2, 2, (16, len(FEATURES)))
    return [forward(features, *network.packed())]


def everything() -> Iterator[tuple[str, Callable[[], list]]]:
    """Name and call of each record."""
    for kind in (reductions, runs, episodes, actions):
        yield from kind()


def recorded(call: Callable[[], list]) -> list:
    """Digest of every bit of what the call returns, and the sum of the sizes of its numbers."""
    digest, total = hashlib.sha256(), 0.0
    for value in call():
        array = np.ascontiguousarray(value)
        digest.update(f"{array.dtype.str}{array.shape}".encode() + array.tobytes())
        finite = array[np.isfinite(array)] if array.dtype.kind == "f" else array
        total += float(np.abs(finite.astype(float)).sum())
    return [digest.hexdigest()[:20], total]


if __name__ == "__main__":
    records = {}
    for name, call in everything():
        records[name] = recorded(call)
        print(name, *records[name], file=sys.stderr)
    FILE.write_text(json.dumps({"machine": machine(), "records": records}, indent=0) + "\n")
