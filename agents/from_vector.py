"""stable-baselines3's vector environment from Gymnasium's."""

from collections.abc import Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from stable_baselines3.common.vec_env import VecEnv

WORK = 300.0  # of a scan, in which its price costs about as much as else is lost


class FromVector(VecEnv):
    """Environments of one process under stable-baselines3's interface, which asks for the last observation of
    an episode as `terminal_observation` and for `TimeLimit.truncated` where it ended by time alone.

    With `horizon_ends` nothing is expected after the last scan: an end by time is reported as an end.
    Without, a learner adds what its critic says of the last observation, as if the episode had gone on.

    Where the price of work is drawn, the rewards of an episode are divided by 1 + WORK times its price: what
    is best at a price stays best, and no price outweighs the others.

    Raises ValueError unless `envs` resets in the step that ends an episode (AutoresetMode.SAME_STEP).
    """

    def __init__(self, envs: gym.vector.VectorEnv, horizon_ends: bool = False):
        mode = envs.metadata.get("autoreset_mode")
        if mode is not AutoresetMode.SAME_STEP:
            raise ValueError(f"envs must have autoreset_mode AutoresetMode.SAME_STEP, got {mode}")
        self.horizon_ends = horizon_ends
        self.envs = envs  # before what asks it for attributes
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)
        self._actions: Any = None

    def reset(self):
        """Observations (n, k) of new episodes; after `seed(s)` they are those of seeds s, s + 1, ..."""
        # a seed of one environment settles those of the rest
        observations, told = self.envs.reset(seed=self._seeds[0], options=self._options[0] or None)
        self._price = told.get("price", 0.0)
        self._reset_seeds()
        self._reset_options()
        return observations.copy()

    def step_async(self, actions: np.ndarray) -> None:
        self._actions = actions

    def step_wait(self):
        observations, rewards, terminated, truncated, told = self.envs.step(self._actions)
        if "price" in told:
            rewards = rewards / (1 + WORK * self._price)
            self._price = told["price"]
        over = terminated | truncated
        late = truncated & ~terminated & (not self.horizon_ends)
        infos: list[dict[str, Any]] = [{"TimeLimit.truncated": bool(late[i])} for i in range(self.num_envs)]
        for i in np.flatnonzero(over):
            infos[i]["terminal_observation"] = told["final_obs"][i]
        return observations.copy(), rewards.astype(np.float32), over, infos

    def close(self) -> None:
        self.envs.close()

    def get_attr(self, attr_name: str, indices=None) -> list[Any]:
        return [getattr(self.envs, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices=None) -> None:
        raise NotImplementedError("an environment is changed by making another")

    def env_method(self, method_name: str, *args, indices=None, **kwargs) -> list[Any]:
        raise NotImplementedError("environments that are stepped as one have no methods of their own")

    def env_is_wrapped(self, wrapper_class, indices: Sequence[int] | None = None) -> list[bool]:
        return [False] * len(list(self._get_indices(indices)))
