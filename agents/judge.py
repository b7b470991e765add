"""Policies played over instances on the same episodes: what every comparison is made of."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import deepcopy
from functools import cache
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import gymnasium as gym
import joblib
import numpy as np
from threadpoolctl import threadpool_limits
from tracked import scans_of

import gmr_gym
from gmr_gym.envs.tuning import PRICE
from gmr_gym.evaluation import archive
from gmr_gym.evaluation.source import is_hashed
from gmr_gym.tuning.instances import Instance, instances, world

ENV_ID = "gmr_gym/ReductionTuning-v1"
# arguments that make it `ReductionTuning-v0`
V0 = {"parameters": ("alpha", "prune"), "reducer": "adaptive", "features": "posterior", "price": 1e-4}
# policy(features (k,), t) -> action (j,). It is asked about the episodes of an instance side by side, and of
# them all in one call where it has a method `many`. One with a method `watching` is handed the environment
# instead and asked for the policy proper: that is for what remembers, or knows more than a policy may, see
# hindsight.py. One with a method `tracking` is a tracker, see tracked.py
Policy = Callable[[np.ndarray, int], np.ndarray]


class Episodes(NamedTuple):
    """One policy's episodes, by instance and run: means over the scans of an episode."""

    reward: np.ndarray  # (instances, runs), sum over scans; as trained for
    error: np.ndarray  # (instances, runs), m, of the scans before a loss and of the loss itself
    lost: np.ndarray  # (instances, runs), 1 for an episode that a loss ended
    work: np.ndarray  # (instances, runs), of a scan
    components: np.ndarray  # (instances, runs)
    capped: np.ndarray  # (instances, runs), m, error at most the cutoff, which scans after a loss count as
    scans: np.ndarray  # (instances, runs), played
    # (instances, runs), of a scan of the instance's first run, played alone on one thread, median: policy,
    # reduction, next scan and its features
    seconds: np.ndarray


def played(
    policies: Mapping[Any, Policy],
    table: str,
    runs: int,
    seed: int = 0,
    *,
    env: Mapping[str, Any] | None = None,
    jobs: int = -1,
    only: Sequence[str] = (),
    folder: Path | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict[Any, Episodes]:
    """Every policy's episodes over a table of instances, or `only` over some: run i of an instance is the
    same for all of them, however many runs or instances there are, and on any number of workers.

    With a `folder`, what a policy did is kept there, found again by the content of policy, instances,
    settings and source code, and not played a second time. progress(done, total) counts instances.
    """
    whole = instances(table)
    places = {name: place for place, name in enumerate(whole) if not only or name in only}
    rows = [whole[name] for name in places]
    said = {**(env or {}), "instances": table}
    settings = tuple(sorted((k, tuple(v) if isinstance(v, list) else v) for k, v in said.items()))
    found, files = {}, {}
    for name, policy in policies.items():
        if folder is not None:
            key = joblib.hash((policy, rows, settings, runs, seed, code()))
            files[name] = folder / f"{Path(table).stem}-{str(name).replace(' ', '-')}-{key}.npz"
            if files[name].exists():
                found[name] = _load(files[name])
    total, done = len(policies) * len(rows), len(found) * len(rows)
    for name, policy in policies.items():
        if name in found:
            continue
        calls = (
            joblib.delayed(_of_instance)(policy, settings, row, place, runs, seed)
            for row, place in zip(rows, places.values(), strict=True)
        )
        parts = []
        for part in joblib.Parallel(n_jobs=jobs, return_as="generator")(calls):
            parts.append(part)
            done += 1
            if progress:
                progress(done, total)
        found[name] = Episodes(*(np.array(part) for part in zip(*parts, strict=True)))
        if name in files:
            archive.save(files[name], found[name]._asdict(), of=files[name].name)
    return {name: found[name] for name in policies}


@cache
def code() -> str:
    """Digest of the source that an episode depends on, so that nothing is found that other code left."""
    package, here = Path(gmr_gym.__file__).parent, Path(__file__)
    files = [file for file in package.rglob("*.py") if is_hashed(file.relative_to(package))]
    files += [
        package / "envs" / "tracking.py",
        package / "envs" / "tuning.py",
        package / "envs" / "tuning_vector.py",
        here,
        here.with_name("hindsight.py"),
        here.with_name("tracked.py"),
        *here.parent.parent.glob("baselines/*.py"),
    ]
    return joblib.hash([file.read_bytes() for file in sorted(files)])


def seeds_of(seed: int, place: int, runs: int) -> list[int]:
    """Seeds of the episodes of the instance in that place of its table."""
    keys = [np.random.SeedSequence((seed, place, run)).generate_state(2) for run in range(runs)]
    return [int(key[0]) << 31 | int(key[1]) >> 1 for key in keys]


def _of_instance(policy, settings, row: Instance, place: int, runs: int, seed: int) -> np.ndarray:
    """The fields of Episodes (f, runs) of an instance's episodes."""
    scenario = world(row)
    policy = deepcopy(policy)  # one with a stream of its own begins it anew, whoever played before
    seeds = seeds_of(seed, place, runs)
    play = _side_by_side
    if hasattr(policy, "watching"):
        play = _one_by_one
    elif hasattr(policy, "tracking"):
        play = _tracked
    out = np.empty((len(Episodes._fields), runs))
    with threadpool_limits(1):  # small matrices are slower on several threads
        for run, (scans, lost) in enumerate(play(policy, settings, row.instance_id, seeds)):
            reward, error, work, components, seconds = np.array(scans).T
            after = scenario.cutoff * (scenario.horizon - len(scans))
            capped = (np.minimum(error, scenario.cutoff).sum() + after) / scenario.horizon
            out[:, run] = (
                reward.sum(), error.mean(), lost, work.mean(), components.mean(), capped, len(scans),
                np.median(seconds),
            )  # fmt: skip
        if play is _side_by_side and runs > 1:
            alone, _ = next(_one_by_one(policy, settings, row.instance_id, seeds[:1]))
            out[-1] = np.median([scan[-1] for scan in alone])
    return out


def _one_by_one(policy, settings, name: str, seeds: list[int]) -> Iterator[tuple[list[tuple], bool]]:
    """Reward, error, work, components and seconds, scan by scan, of the episode of each seed, and whether a
    loss ended it."""
    env = _environment(settings)
    act = policy.watching(env) if hasattr(policy, "watching") else policy
    for seed in seeds:
        observation, _ = env.reset(seed=seed, options={"instance_id": name})
        scans: list[tuple] = []
        over = lost = False
        while not over:
            started = perf_counter()
            observation, reward, lost, late, info = env.step(act(observation, len(scans)))
            seconds = perf_counter() - started
            scans.append((reward, info["error"], info["work"], info["components"], seconds))
            over = lost or late
        yield scans, lost


def _tracked(policy, settings, name: str, seeds: list[int]) -> Iterator[tuple[list[tuple], bool]]:
    """As `_one_by_one`, of a tracker."""
    said = dict(settings)
    return scans_of(policy, world(instances(said["instances"])[name]), seeds, said.get("price", PRICE))


def _side_by_side(policy, settings, name: str, seeds: list[int]) -> Iterator[tuple[list[tuple], bool]]:
    """As `_one_by_one`, all at once; the seconds are those of the whole step."""
    envs = _environments(settings, len(seeds))
    observations, _ = envs.reset(seed=seeds, options={"instance_id": name})
    scans: list[list[tuple]] = [[] for _ in seeds]
    lost, running, t = np.zeros(len(seeds), bool), np.ones(len(seeds), bool), 0
    actions = np.zeros(envs.action_space.shape)
    while running.any():
        started = perf_counter()
        there = np.flatnonzero(running)
        if hasattr(policy, "many"):
            actions[there] = policy.many(observations[there], t)
        else:
            for i in there:
                actions[i] = policy(observations[i], t)
        observations, rewards, terminated, truncated, infos = envs.step(actions)
        seconds = perf_counter() - started
        told = (infos[field].tolist() for field in ("error", "work", "components"))
        rows = list(zip(rewards.tolist(), *told, strict=True))
        for i in there.tolist():
            scans[i].append((*rows[i], seconds))
        lost |= terminated
        running &= ~(terminated | truncated)
        t += 1
    yield from zip(scans, lost, strict=True)


# a worker plays many instances, and reading a table takes as long as an episode
@cache
def _environment(settings: tuple) -> Any:
    return gym.make(ENV_ID, **dict(settings)).unwrapped


@cache
def _environments(settings: tuple, n: int) -> Any:
    how = {"vectorization_mode": "vector_entry_point", "autoreset_mode": "Disabled"}
    return gym.make_vec(ENV_ID, n, **how, **dict(settings))


def _load(file: Path) -> Episodes:
    try:
        stored = archive.load(file, of=file.name)
        return Episodes(*(stored[field] for field in Episodes._fields))
    except (ValueError, KeyError) as error:
        raise ValueError(f"{file} holds no episodes ({error}); delete it to have them played again") from None
