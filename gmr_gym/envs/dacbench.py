"""`ReductionTuning` as a benchmark of DACBench: algorithm configuration, scan by scan, over instances.

Needs the extra `dacbench`.
"""

from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import numpy as np

from gmr_gym.envs.lookup import spec_of
from gmr_gym.envs.registry import TUNINGS
from gmr_gym.tuning.instances import SCANS, Instance, instances

try:
    from ConfigSpace import ConfigurationSpace, UniformFloatHyperparameter
    from dacbench import AbstractBenchmark, AbstractEnv
    from dacbench.abstract_benchmark import objdict
except ImportError as error:
    if error.name == "torchvision":  # of DACBench 0.5.6, where there is torch
        raise ImportError(
            "this DACBench imports torchvision where torch is installed: pip install torchvision"
        ) from None
    raise ImportError(
        "gmr_gym.envs.dacbench needs the extra `dacbench`: pip install 'gmr-gym[dacbench]'"
    ) from None

DEFAULTS: dict[str, Any] = {
    "environment": "gmr_gym/ReductionTuning-v1",
    "instance_set_path": "wide-train",  # a name of gmr_gym.tuning.instances, or a CSV file
    "test_set_path": "wide-test",
    "cutoff": SCANS,
    "reward_range": (-float(SCANS), 0.0),
    "seed": 0,
}
INFO = {
    "identifier": "ReductionTuning",
    "name": "Thresholds of Gaussian mixture reduction in target tracking",
    "reward": "minus the error of a scan, at most 1, and minus the price of its work",
}


class ReductionTuningEnv(AbstractEnv):
    """A `ReductionTuning` environment under DACBench's rules: it says which instance comes next.

    Observations, actions, rewards and infos are those of the environment itself; see
    `gmr_gym.envs.tuning.ReductionTuningEnv`.

    Parameters
    ----------
    config : objdict
        As `ReductionTuningBenchmark` makes it.
    """

    def __init__(self, config: Any):
        super().__init__(config)
        self._env: Any = _made(config["environment"])

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode of the next instance.

        Parameters
        ----------
        seed : int, optional
            Decides the episode of an instance, as in the environment itself. Without one it is drawn by
            `config.seed`.
        options : dict, optional
            DACBench's: "instance", "instance_id", "scheme".

        Returns
        -------
        observation : ndarray (k,)
        info : dict
        """
        self.reset_(seed, options)
        drawn = int(self.np_random.integers(2**63)) if seed is None else seed
        name = self.instance.instance_id
        self._env.instances[name] = Instance(**vars(self.instance))
        observation, info = self._env.reset(seed=drawn, options={"instance_id": name})
        return observation, info

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict]:
        """One scan under the thresholds of an action; what the environment itself returns."""
        stopped = self.step_()
        observation, reward, terminated, truncated, info = self._env.step(action)
        return observation, reward, terminated, truncated or stopped, info


class ReductionTuningBenchmark(AbstractBenchmark):
    """The benchmark, by default of the 96 instances of "wide-train" and the 48 held out of "wide-test".

    Hyperparameters are the environment's `parameters`, each on a logarithmic scale from -1 to 1 over its
    range in `gmr_gym.tuning.thresholds.RANGES`; their names begin with their place in an action, since
    ConfigSpace sorts them.

    Parameters
    ----------
    config_path : str, optional
        A file that `save_config` wrote.
    config : objdict, optional
        What differs from `DEFAULTS`.

    Raises
    ------
    ValueError
        For an environment that is no `ReductionTuning`.

    """

    def __init__(self, config_path: str | None = None, config: Any = None):
        super().__init__(config_path, config)
        given = objdict() if self.config is None else self.config
        self.config: Any = objdict({**DEFAULTS, **given})
        self._describe()

    def get_environment(self) -> Any:
        """The environment, in the wrappers that are registered."""
        if "instance_set" not in self.config:
            self.read_instance_set()
        if "test_set" not in self.config:
            self.read_instance_set(test=True)
        env: Any = ReductionTuningEnv(self.config)
        for wrap in self.wrap_funcs:
            env = wrap(env)
        return env

    def read_instance_set(self, test: bool = False) -> None:
        """Read the instances to train on, or those held out, by their place in the table.

        Each has the fields of `gmr_gym.tuning.Instance`; wrappers of DACBench read its `__dict__`.
        """
        name = "test_set" if test else "instance_set"
        rows = instances(self.config[f"{name}_path"]).values()
        self.config[name] = {place: SimpleNamespace(**row._asdict()) for place, row in enumerate(rows)}

    def get_benchmark(self, seed: int = 0) -> Any:
        """The environment as it is compared on, by a seed."""
        self.config = objdict(DEFAULTS)
        self._describe()
        self.set_seed(seed)
        return self.get_environment()

    def serialize_config(self) -> dict[str, Any]:
        """What `to_json` and `save_config` write: all but the instances, which are read again."""
        written: dict[str, Any] = super().serialize_config()
        written.pop("test_set", None)
        return written

    def _describe(self) -> None:
        """Spaces, and what their numbers are called."""
        env = _made(self.config["environment"])
        space = ConfigurationSpace()
        for i, name in enumerate(env.parameters):
            space.add(UniformFloatHyperparameter(f"{i}_{name}", lower=-1.0, upper=1.0))
        self.config |= {
            "config_space": space,
            "observation_space": env.observation_space,
            "benchmark_info": INFO
            | {"state_description": [*env.features], "action_description": [*env.parameters]},
        }


def _made(env_id: str) -> Any:
    """The `ReductionTuning` environment of an id."""
    if env_id not in TUNINGS:
        raise ValueError(f"environment must be one of {', '.join(TUNINGS)}, got {env_id!r}")
    return gym.make(spec_of(env_id), disable_env_checker=True).unwrapped
