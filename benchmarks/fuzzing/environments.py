"""Every environment that is registered, alone and many at once, under hostile actions."""

import atexit
from collections.abc import Iterator
from functools import cache, partial
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp
from typing import Any

import gymnasium as gym
import numpy as np

from fuzzing import checks
from fuzzing.cases import Finding, Spoilt, Target
from fuzzing.inputs import LAYOUTS, Rng, decades, in_layout, spoilt_array
from gmr_gym.envs.registry import ENVIRONMENTS, MULTI_TARGET, RECORDED

STEPS = 6
MANY = 3  # environments at once
CROWDED = MULTI_TARGET | RECORDED


def environment_targets() -> Iterator[Target]:
    """Every id, and its environment of many."""
    for name in ENVIRONMENTS:
        for many in (0, MANY) if name not in CROWDED else (0,):
            kind = "vector" if many else "environment"
            yield Target(
                f"{kind}/{name.removeprefix('gmr_gym/')}",
                partial(_draw, name, many),
                _play,
                _check,
                _spoil,
                share=0.5,
                patience=3.0,
            )


@cache
def _made(name: str, many: int) -> Any:
    if many:
        return gym.make_vec(name, num_envs=many, vectorization_mode="vector_entry_point")
    files = {"folder": _recording()} if name in RECORDED else {}
    return gym.make(name, disable_env_checker=True, **files).unwrapped


def _recording() -> str:
    """A folder with a recording of ten scans of a target, some of which miss it."""
    folder = Path(mkdtemp())
    atexit.register(rmtree, folder, ignore_errors=True)
    header, times = "time_s,x_m,y_m\n", range(10)
    (folder / "plots.csv").write_text(header + "".join(f"{t},{9 * t},{t**3 % 7}\n" for t in times if t % 4))
    (folder / "truth.csv").write_text(header + "".join(f"{t},{9 * t},0\n" for t in times))
    return str(folder)


def _draw(name: str, many: int, rng: Rng) -> tuple:
    space = _made(name, many).action_space
    plain, given = [], []
    for _ in range(rng.integers(1, STEPS)):
        action = _action(rng, space)
        layout = LAYOUTS[rng.integers(len(LAYOUTS))] if rng.random() < 0.2 else None
        given.append(action if layout is None else in_layout(action, layout))
        plain.append(
            action if layout is None else np.clip(np.array(given[-1], space.dtype), space.low, space.high)
        )
        if layout == "float32":  # rounding may have stepped over the edge
            given[-1] = np.array(plain[-1], np.float32)
            plain[-1] = given[-1].astype(space.dtype)
    seed = int(rng.integers(2**31)) if rng.random() < 0.9 else int(rng.choice([0, 2**32, 2**63 - 1]))
    return name, many, seed, given, plain


def _action(rng: Rng, space) -> np.ndarray:
    """Within the space: its corners, its middle, or anywhere."""
    kind = rng.integers(4)
    if kind == 0:
        return np.where(rng.random(space.shape) < 0.5, space.low, space.high)
    if kind == 1:
        return np.clip(np.zeros(space.shape, space.dtype), space.low, space.high)
    where = rng.uniform(-1, 1, space.shape) * decades(rng, -9, 0)
    return np.clip(where * space.high, space.low, space.high).astype(space.dtype)


def _spoil(rng: Rng, arguments: tuple) -> Spoilt:
    name, many, seed, _given, plain = arguments
    space = _made(name, many).action_space
    kind = rng.integers(3)
    if kind == 0:
        bad, what = plain[-1].copy(), "out of bounds"
        at = tuple(rng.integers(side) for side in space.shape)
        bad[at] = 2 * space.high[at] + 1
    elif kind == 1:
        bad, what = plain[-1][..., :-1], "too short"
    else:
        bad, what = spoilt_array(rng, plain[-1])
        while np.ma.isMaskedArray(bad) and name in CROWDED:
            bad, what = spoilt_array(rng, plain[-1])  # there a masked row is an absent estimate
    actions = [*plain[:-1], bad]
    return Spoilt(
        (name, many, seed, actions, actions), ("action", "actions", "existence"), f"an action {what}"
    )


def _play(name: str, many: int, seed: int, given: list, plain: list) -> list:
    env = _made(name, many)
    seen = [env.reset(seed=seed)]
    for action in given:
        seen.append(env.step(action))
        if not many and (seen[-1][2] or seen[-1][3]):
            break
    return [_copied(part) for part in seen]


def _copied(value):
    if isinstance(value, dict):
        return {key: _copied(part) for key, part in value.items()}
    if isinstance(value, tuple):
        return tuple(map(_copied, value))
    return value.copy() if isinstance(value, np.ndarray) else value


def _check(arguments: tuple, seen: list) -> None:
    name, many, seed, given, plain = arguments
    env = _made(name, many)
    for observation, *rest in seen:
        if not env.observation_space.contains(observation):
            raise Finding("shape", f"an observation is not of its space: {observation}"[:300])
        if len(rest) > 1:
            reward, _terminated, _truncated, info = rest
            checks.finite("reward", reward)
            checks.finite("error", info.get("error", 0.0))
            if np.any(np.asarray(reward) > 0):
                raise Finding("value", f"a reward of {reward}")
    if not all(one is other for one, other in zip(given, plain, strict=True)) or seed % 16 == 0:
        again = _play(name, many, seed, plain, plain)
        _same([part[:4] for part in seen], [part[:4] for part in again])


def _same(one, other) -> None:
    if isinstance(one, dict):
        one, other = ([part[key] for key in sorted(one)] for part in (one, other))
    if isinstance(one, list | tuple):
        for a, b in zip(one, other, strict=True):
            _same(a, b)
    elif isinstance(one, np.ndarray | float | int | bool):
        checks.same("variant", "the same seed and actions", one, other)
