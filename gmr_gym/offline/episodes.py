"""Episodes as arrays: every observation, action, reward and info, one after the other."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.envs.tuning import ReductionTuningEnv
from gmr_gym.offline.players import Player

ABSENT = {"f": np.nan, "i": -2, "b": False}  # in infos, by kind of number, where a scan has nothing to say


class PlayedEpisode(NamedTuple):
    """An episode of T steps.

    Attributes
    ----------
    player : int
        Place of its player among all of them.
    seed : int
        `env.reset(seed=seed, options=options)` begins it again.
    options : dict or None
    observations : ndarray (T + 1, ...), or dict of them
    actions : ndarray (T, ...)
    rewards : ndarray (T,)
    terminations, truncations : ndarray of bool (T,)
    infos : dict of ndarray (T + 1, ...)
        That of `reset` first. Where a scan has no such entry it is nan, -2 or False.
    """

    player: int
    seed: int
    options: dict[str, Any] | None
    observations: Any
    actions: np.ndarray
    rewards: np.ndarray
    terminations: np.ndarray
    truncations: np.ndarray
    infos: dict[str, Any]


def seed_of(seed: int, i: int) -> int:
    """The seed of episode i."""
    return int(np.random.SeedSequence((seed, i)).generate_state(1, np.uint64)[0] >> 1)


def played(env: Any, players: Sequence[Player], episodes: int, seed: int) -> Iterator[PlayedEpisode]:
    """Play the same episodes by each of the players, one episode by all before the next.

    Episode i depends on (seed, i) alone. Instances of `ReductionTuning` are taken in turn.

    Parameters
    ----------
    env : gymnasium.Env
        The environment itself, without wrappers.
    players : sequence of Player
    episodes : int
        Of each player.
    seed : int

    Yields
    ------
    PlayedEpisode
    """
    instances = [*env.instances] if isinstance(env, ReductionTuningEnv) else []
    for i in range(episodes):
        options = {"instance_id": instances[i % len(instances)]} if instances else None
        for place, player in enumerate(players):
            yield _played(env, place, player, seed_of(seed, i), options)


def _played(env: Any, place: int, player: Player, seed: int, options: dict[str, Any] | None) -> PlayedEpisode:
    policy = player.begin(seed)
    observation, info = env.reset(seed=seed, options=options)
    observations, infos, over = [observation], [info], False
    steps: list[tuple[Any, ...]] = []
    while not over:
        action = np.asarray(policy(observation, len(steps)), env.action_space.dtype)
        observation, reward, terminated, truncated, info = env.step(action)
        observations.append(observation)
        infos.append(info)
        steps.append((action, reward, terminated, truncated))
        over = terminated or truncated
    actions, rewards, terminations, truncations = map(np.array, zip(*steps, strict=True))
    plain = [{key: value for key, value in info.items() if key != "instance_id"} for info in infos]
    known = stacked(plain) | {"player": np.full(len(infos), place)}
    return PlayedEpisode(
        place, seed, options, _stacked_observations(observations), actions, rewards, terminations,
        truncations, known,
    )  # fmt: skip


def _stacked_observations(observations: Sequence[Any]) -> Any:
    if isinstance(observations[0], dict):
        return {key: np.array([one[key] for one in observations]) for key in observations[0]}
    return np.array(observations)


def stacked(infos: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Infos one after the other.

    Parameters
    ----------
    infos : sequence of n dict
        Of numbers, arrays, and dicts of them.

    Returns
    -------
    dict of ndarray (n, ...)
        Where an entry is missing it is nan, -2 or False.
    """
    found: dict[str, Any] = {}
    for key in dict.fromkeys(key for info in infos for key in info):
        example = next(info[key] for info in infos if key in info)
        if isinstance(example, dict):
            found[key] = stacked([info.get(key, {}) for info in infos])
        else:
            blank = np.full_like(example, ABSENT[np.asarray(example).dtype.kind])
            found[key] = np.array([info.get(key, blank) for info in infos])
    return found
