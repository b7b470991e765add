"""Episodes written as a data set, and what is said of them."""

from collections.abc import Callable, Sequence
from pathlib import Path

import gymnasium as gym

from gmr_gym.envs.lookup import spec_of
from gmr_gym.experiments.specs import check_once
from gmr_gym.literals import key_values
from gmr_gym.offline.dataset import check_out, write
from gmr_gym.offline.players import players_of


def write_episodes(
    env_id: str,
    settings: Sequence[str],
    trackers: Sequence[str],
    episodes: int,
    seed: int,
    out: Path,
    overwrite: bool,
    *,
    progress: Callable[[int, int], None],
) -> list[str]:
    """The data set of `gmr_gym.offline.write`, of what was typed; gives lines that say how it is read."""
    check_once("--tracker", trackers)
    check_out(out, overwrite)
    env = gym.make(spec_of(env_id), **key_values(settings), disable_env_checker=True)
    players = players_of(trackers, env.unwrapped)
    write(out, env, players, episodes, seed, overwrite=overwrite, progress=progress)
    return [
        f"{episodes * len(players)} episodes written to {out}",
        f"read: gmr_gym.offline.load({str(out)!r}), or MINARI_DATASETS_PATH={out.parent} "
        f"and minari.load_dataset({out.name!r})",
    ]
