"""Data sets of Minari: written whole or not at all, and read with a check of what they were recorded in."""

import platform
import re
import shutil
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import gymnasium as gym

from gmr_gym.checks import check_count
from gmr_gym.envs.tuning import ReductionTuningEnv
from gmr_gym.offline.episodes import PlayedEpisode, played
from gmr_gym.offline.players import Player
from gmr_gym.recorded.extras import module_of
from gmr_gym.version import __version__

KEY = "gmr_gym"  # of the metadata that only this package reads
VERSIONS = ("numpy", "numba", "gymnasium", "minari", "h5py")
DATA, METADATA = "data", "metadata.json"  # as Minari has them
NAME = re.compile(r"[-\w]+-v\d+")
DESCRIPTION = (
    "Episodes of {env_id}, each played by {players}. Scans have a fixed number of rows, zeros after the last "
    "detection, and a mask. Infos have one entry more than steps, that of reset first; where a scan has no "
    "such entry it is nan, -2 or False. `player` in infos is the place of who played among the `players` of "
    "these metadata. `reset` with the seed and options of an episode's metadata begins it again."
)


def write(
    out: Path | str,
    env: gym.Env,
    players: Sequence[Player],
    episodes: int,
    seed: int = 0,
    *,
    overwrite: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> Path:
    """Play episodes and write them as a data set of Minari.

    Every player plays the same episodes. Each episode's metadata have its `seed`, its `options` and its
    `player`; the same arguments give the same data.

    Parameters
    ----------
    out : Path or str
        Folder of the data set; its last part is the data set's id and ends in -v and a number.
    env : gymnasium.Env
        As `gymnasium.make` made it.
    players : sequence of Player
        As `players_of` makes them.
    episodes : int
        Of each player.
    seed : int
    overwrite : bool
        Whether a data set that is there is replaced.
    progress : callable, optional
        progress(done, total) counts episodes.

    Returns
    -------
    Path
        `out`.

    Raises
    ------
    ImportError
        Without the extra `minari`.
    ValueError
        For a name that is none of a data set, what is there already, no players or episodes.
    """
    out, total = Path(out), check_count(episodes, "episodes") * len(players)
    if not players:
        raise ValueError("players must be at least one, got none")
    check_out(out, overwrite)
    with whole_folder(out) as folder:
        storage = _storage(folder / DATA, out.name, env, players, episodes, seed)
        for done, episode in enumerate(played(env.unwrapped, players, episodes, seed), start=1):
            _add(storage, done - 1, episode, players[episode.player].name)
            if progress:
                progress(done, total)
    return out


def check_out(out: Path, overwrite: bool = False) -> None:
    """Check, before any work, that a data set can be written.

    Parameters
    ----------
    out : Path
        Its folder.
    overwrite : bool
        Whether it may replace another.

    Raises
    ------
    ImportError
        Without the extra `minari`.
    ValueError
        For a name that is none of a data set, a data set that is there, or a folder that is none.
    """
    for name in ("minari", "h5py"):
        module_of("minari", name, "writing a data set")
    if not NAME.fullmatch(out.name):
        raise ValueError(
            "--out must end in a name of letters, digits, - and _ with a version, as turning-pda-v0, since "
            f"Minari names data sets so; got {out.name!r}"
        )
    if out.exists() and not (out / DATA / METADATA).is_file():
        raise ValueError(f"--out: {out} is there and is no data set; give another name")
    if out.exists() and not overwrite:
        raise ValueError(f"--out: {out} is there already; give --overwrite, or another name")


def load(dataset: Path | str | Any, env_id: str | None = None) -> Any:
    """Read a data set, and check that this version has the environment it was recorded in.

    Parameters
    ----------
    dataset : Path, str or MinariDataset
        Its folder, as `write` took it, or what `minari.load_dataset` returned.
    env_id : str, optional
        The environment that it must be of.

    Returns
    -------
    MinariDataset

    Raises
    ------
    ImportError
        Without the extra `minari`.
    ValueError
        For what is no data set of this package, another environment, and observations, features or actions
        that the environment no longer has.

    Warns
    -----
    UserWarning
        For a data set of another version of this package.
    """
    minari = module_of("minari", "minari", "reading a data set")
    if isinstance(dataset, Path | str):
        folder = Path(dataset)
        if not (folder / DATA / METADATA).is_file():
            raise ValueError(f"{folder} is no data set: it has no {DATA}/{METADATA}")
        dataset = minari.MinariDataset(folder / DATA)
    record = dataset.storage.metadata.get(KEY)
    if record is None:
        raise ValueError(f"{dataset.id} was not written by `gmr-gym episodes`: its metadata have no {KEY!r}")
    if env_id is not None and record["environment"] != env_id:
        raise ValueError(f"{dataset.id} is of {record['environment']}, and {env_id} is asked for")
    _check_environment(dataset, record)
    if record["versions"][KEY] != __version__:
        warnings.warn(
            f"{dataset.id} was recorded by gmr_gym {record['versions'][KEY]}, and this is {__version__}: the "
            "same seeds may give other episodes",
            stacklevel=2,
        )
    return dataset


def _check_environment(dataset: Any, record: dict[str, Any]) -> None:
    if record["environment"] not in gym.registry:
        raise ValueError(f"{dataset.id} is of {record['environment']}, which this version does not have")
    env = gym.make(dataset.env_spec).unwrapped
    now = {
        "observation space": (dataset.observation_space, env.observation_space),
        "action space": (dataset.action_space, env.action_space),
        **{name: (record[name], said) for name, said in _meaning(env).items()},
    }
    for name, (then, is_now) in now.items():
        if then != is_now:
            raise ValueError(
                f"{dataset.id} was recorded in another version of {record['environment']}, of which the "
                f"{name} was {then}, and is {is_now}"
            )


def _meaning(env: Any) -> dict[str, list[str]]:
    """What the numbers of observations and actions stand for, where the spaces have no names for them."""
    if not isinstance(env, ReductionTuningEnv):
        return {}
    return {"features": [*env.features], "parameters": [*env.parameters]}


def _storage(
    folder: Path, name: str, env: gym.Env, players: Sequence[Player], episodes: int, seed: int
) -> Any:
    from minari.dataset.minari_storage import MinariStorage

    spec, bare = env.unwrapped.spec, env.unwrapped
    if spec is None:
        raise ValueError("env must be made by gymnasium.make, so that it can be made again; it has no spec")
    names = [player.name for player in players]
    versions = {KEY: __version__, "python": platform.python_version(), **{n: version(n) for n in VERSIONS}}
    storage = MinariStorage.new(folder, bare.observation_space, bare.action_space, spec)
    storage.update_metadata({
        "dataset_id": name,
        "minari_version": versions["minari"],
        "algorithm_name": ", ".join(names),
        "description": DESCRIPTION.format(env_id=spec.id, players=" and ".join(names)),
        "requirements": [f"gmr-gym=={__version__}"],
        KEY: {
            "environment": spec.id, "players": names, "episodes": episodes, "seed": seed,
            "versions": versions, **_meaning(bare),
        },
    })  # fmt: skip
    return storage


def _add(storage: Any, place: int, episode: PlayedEpisode, player: str) -> None:
    from minari.data_collector.episode_buffer import EpisodeBuffer

    fields = episode._asdict()
    del fields["player"]
    storage.update_episodes([EpisodeBuffer(id=place, **fields)])
    total = float(episode.rewards.sum())
    storage.update_episode_metadata([{"player": player, "rewards_sum": total}], [place])


@contextmanager
def whole_folder(out: Path) -> Iterator[Path]:
    """A hidden folder beside `out`, which takes its place when the block ends and is deleted if it raises."""
    out = out.resolve()  # Minari takes no relative path
    out.parent.mkdir(parents=True, exist_ok=True)
    partial = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
    try:
        new = partial / out.name
        new.mkdir()
        yield new
        if out.exists():
            out.rename(partial / "former")
        new.rename(out)
    finally:
        shutil.rmtree(partial)
