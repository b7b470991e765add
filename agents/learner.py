"""A training run: its settings, its environments, and its state between chapters.

A run is a sequence of chapters. Each begins with all environments reset by seeds of its own and with the
generators of torch and NumPy seeded likewise, and ends with everything on disk: so a run that was stopped
goes on as if it had not been, to the last bit.

stable-baselines3 keeps models and what they replay as pickles, which run what is written in them: take up, or
export from, no folder of a stranger's. What is made to be handed on is the .npz, see
`gmr_gym.tuning.network`."""

import json
from copy import deepcopy
from dataclasses import asdict, dataclass, field
from functools import partial
from inspect import signature
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
import yaml
from critics import OffPolicy, OnPolicy
from from_vector import FromVector
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm
from stable_baselines3.common.vec_env import VecNormalize

import gmr_gym  # noqa: F401  registers the environments
from gmr_gym.experiments.output import write_json
from gmr_gym.tuning.thresholds import Thresholds, to_action

ENV_ID = "gmr_gym/ReductionTuning-v1"
# what an untrained policy says, whatever it sees
START = Thresholds(prune=7e-4, components=30, process_noise=1.5, coasting_noise=1.5, fading=1.1)
ALGORITHMS: dict[str, Any] = {"ppo": PPO, "sac": SAC}
CRITICS = {"ppo": OnPolicy, "sac": OffPolicy}  # with hindsight; others' critics see what their actors see
RECURRENT = ("ppo_lstm",)
try:
    from sb3_contrib import TQC, RecurrentPPO
except ImportError:  # they come with a package of their own
    pass
else:
    ALGORITHMS |= {"tqc": TQC, "ppo_lstm": RecurrentPPO}


@dataclass(frozen=True)
class Settings:
    """What a run is, as its folder keeps it."""

    algorithm: str
    seed: int
    steps: int  # of environments, in all, a multiple of what the algorithm takes at once
    chapter: int  # of them in a chapter, likewise
    envs: int
    hyperparameters: dict[str, Any]
    normalise: dict[str, Any]
    hindsight: bool  # whether the critic is told what only a simulation knows
    env: dict[str, Any] = field(default_factory=dict)  # arguments of the environment


def settings(
    algorithm: str, seed: int, steps: int | None, chapter: int, env: dict[str, Any], file: Path | None,
    hindsight: bool = True,
) -> Settings:  # fmt: skip
    """Settings from a YAML file as rl_zoo3 reads it, the committed one of the algorithm unless given; without
    `hindsight` the critic sees what the actor sees, as those of tqc and ppo_lstm always do. Steps, and those
    of a chapter, are rounded up to a multiple of `collected`. Raises ValueError for an unknown algorithm, and
    for a file that cannot be read or is without the environment."""
    if algorithm not in ALGORITHMS:
        raise ValueError(f"unknown algorithm {algorithm!r}; choose from {', '.join(ALGORITHMS)}")
    file = file or Path(__file__).parent / "hyperparams" / f"{algorithm}.yml"
    if "hindsight" in env:
        raise ValueError("hindsight is a matter of the critic: see the option of that name")
    try:
        entries = yaml.safe_load(file.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ValueError(f"cannot read the hyperparameters {file}: {error}") from None
    if not isinstance(entries, dict) or ENV_ID not in entries:
        raise ValueError(f"{file} must have an entry {ENV_ID}")
    entry = dict(entries[ENV_ID])
    most, envs = steps or int(float(entry["n_timesteps"])), int(entry.pop("n_envs", 1))
    entry.pop("n_timesteps", None)
    unit = collected(algorithm, envs, entry)
    most, chapter = (-(-n // unit) * unit for n in (most, chapter))
    return Settings(
        algorithm, seed, most, chapter, envs, hyperparameters=entry,
        normalise=dict(entry.pop("normalize", {})), hindsight=hindsight and algorithm in CRITICS, env=env,
    )  # fmt: skip


def collected(algorithm: str, envs: int, hyperparameters: dict[str, Any]) -> int:
    """Steps of all environments that the algorithm takes before it learns from them."""
    maker = ALGORITHMS[algorithm]
    name = "train_freq" if issubclass(maker, OffPolicyAlgorithm) else "n_steps"
    each = hyperparameters.get(name, signature(maker).parameters[name].default)
    return envs * int(each)


def environments(said: Settings) -> VecNormalize:
    """The run's environments in one process, normalised as its settings say."""
    made = gym.make_vec(
        ENV_ID, said.envs, vectorization_mode="vector_entry_point", autoreset_mode="SameStep",
        hindsight=said.hindsight, **said.env,
    )  # fmt: skip
    # rewards are summed to the last scan and no further
    vector = FromVector(made, horizon_ends=True)
    return VecNormalize(vector, gamma=said.hyperparameters.get("gamma", 0.99), **said.normalise)


class Run:
    """A run in a folder: begun there, or taken up where its last whole chapter ended."""

    def __init__(self, folder: Path, said: Settings):
        self.folder, self.settings = folder, said
        self.venv = environments(said)
        self.chapter = 0
        if (folder / "run.json").exists():
            self._taken_up()
        else:
            folder.mkdir(parents=True, exist_ok=True)
            arguments = deepcopy(said.hyperparameters)  # the algorithms add to what they are given
            if said.hindsight:
                arguments["policy"] = CRITICS[said.algorithm]
            self.model = ALGORITHMS[said.algorithm](
                env=self.venv, seed=said.seed, device="cpu", tensorboard_log=str(folder / "tensorboard"),
                **arguments,
            )  # fmt: skip
            _begin_at(self.model, to_action(START, self.venv.get_attr("parameters")[0]))

    @property
    def over(self) -> bool:
        return self.model.num_timesteps >= self.settings.steps

    def learn(self, callback=None) -> None:
        """One chapter, kept on disk when it is whole. The learning rate falls with the steps left."""
        seed = int(np.random.SeedSequence((self.settings.seed, self.chapter)).generate_state(1)[0] // 2)
        self.model.set_random_seed(seed)
        self.venv.seed(seed)
        self.model.set_env(self.venv, force_reset=True)
        rate = self.model.learning_rate * (1 - self.model.num_timesteps / self.settings.steps)
        self.model.lr_schedule = partial(_constant, rate)
        self.model.learn(
            min(self.settings.chapter, self.settings.steps - self.model.num_timesteps), callback,
            reset_num_timesteps=False, tb_log_name="run",
        )  # fmt: skip
        self.chapter += 1
        self._kept()

    def _kept(self) -> None:
        stem = self.folder / f"chapter-{self.chapter:04d}"
        self.model.save(stem.with_suffix(".zip"))
        if isinstance(self.model, OffPolicyAlgorithm):
            self.model.save_replay_buffer(self._replay(self.chapter))
        moments = {"observations": self.venv.obs_rms, "returns": self.venv.ret_rms}
        with stem.with_suffix(".npz").open("wb") as stream:
            np.savez(stream, **{
                f"{name}_{field}": getattr(rms, field)
                for name, rms in moments.items()
                for field in ("mean", "var", "count")
            })  # fmt: skip
        # only now: what it names is whole
        write_json(self.folder / "run.json", {"settings": asdict(self.settings), "chapter": self.chapter})
        self._replay(self.chapter - 1).unlink(missing_ok=True)

    def _taken_up(self) -> None:
        kept = json.loads((self.folder / "run.json").read_text())
        own = json.loads(json.dumps(asdict(self.settings)))
        if differing := [name for name in own if name != "steps" and own[name] != kept["settings"].get(name)]:
            raise ValueError(
                f"{self.folder} holds a run of other {', '.join(differing)}; choose another folder"
            )
        self.chapter = kept["chapter"]
        self.model = restored(self.folder, self.chapter, self.settings, self.venv)
        if isinstance(self.model, OffPolicyAlgorithm):
            self.model.load_replay_buffer(self._replay(self.chapter))

    def _replay(self, chapter: int) -> Path:
        return self.folder / f"replay-{chapter:04d}.pkl"


def _constant(value: float, _left: float) -> float:
    return value


def _begin_at(model: Any, action: np.ndarray) -> None:
    """Lets the untrained policy say about the action (j,), whatever it sees."""
    if isinstance(model, OffPolicyAlgorithm):
        layer, action = model.policy.actor.mu, np.arctanh(np.clip(action, -0.99, 0.99))
    else:
        layer = model.policy.action_net
    with torch.no_grad():
        layer.weight.mul_(0.1)
        layer.bias.copy_(torch.as_tensor(action))


def restored(folder: Path, chapter: int, said: Settings, venv: VecNormalize) -> Any:
    """The model after a chapter; the moments of its normalisation are put into `venv`."""
    stem = folder / f"chapter-{chapter:04d}"
    with np.load(stem.with_suffix(".npz"), allow_pickle=False) as moments:
        for name, rms in (("observations", venv.obs_rms), ("returns", venv.ret_rms)):
            for part in ("mean", "var", "count"):
                value = moments[f"{name}_{part}"]
                setattr(rms, part, value if value.shape else float(value))
    return ALGORITHMS[said.algorithm].load(
        stem.with_suffix(".zip"), env=venv, device="cpu", tensorboard_log=str(folder / "tensorboard")
    )


def recorded(folder: Path) -> tuple[Settings, int]:
    """The settings of a run on disk and its last whole chapter. Raises ValueError where there is none."""
    file = folder / "run.json"
    if not file.exists():
        raise ValueError(f"{folder} holds no run: there is no {file.name}")
    kept = json.loads(file.read_text())
    return Settings(**kept["settings"]), kept["chapter"]
