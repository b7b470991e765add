"""PPO of stable-baselines3 with features of sets: `python agents/estimating/ppo_stable_baselines3.py`."""

import gymnasium as gym
import numpy as np
import torch
import typer
from quiet import ENV_ID, FRAME, QUIET, errors, tracker_errors
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

from gmr_gym.learning import RelativeTracking
from gmr_gym.learning.set_features import SetFeatures


def train(steps: int, envs: int = 8, rollout: int = 512, pool: str = "attention", **world) -> PPO:
    """The agent after so many steps of all environments together."""
    made = make_vec_env(lambda: RelativeTracking(gym.make(ENV_ID, **QUIET | world), **FRAME), envs, seed=0)
    features = {"features_extractor_class": SetFeatures, "features_extractor_kwargs": {"pool": pool}}
    agent = PPO(
        "MultiInputPolicy", made, n_steps=rollout, batch_size=min(512, envs * rollout), n_epochs=4,
        gamma=0.9, gae_lambda=0.9, learning_rate=1e-3, policy_kwargs=features | {"log_std_init": -2.5},
        seed=0, device="cpu",
    )  # fmt: skip
    return agent.learn(steps)


def main(steps: int = 400_000, episodes: int = 100) -> None:
    """Train, and compare with PDA."""
    torch.set_num_threads(1)  # small networks run no faster on more
    seeds = range(1_000_000, 1_000_000 + episodes)
    print(f"pda: {tracker_errors('pda', seeds).mean():.2f} m")
    agent = train(steps)

    def act(observation: dict[str, np.ndarray]) -> np.ndarray:
        return agent.predict(observation, deterministic=True)[0]

    print(f"agent: {errors(act, seeds).mean():.2f} m")


if __name__ == "__main__":
    typer.run(main)
