"""A quiet TurningTarget for agents that learn to track by themselves, and the errors compared there.

Its turns are half as hard as the paper's, the target is detected in 98 scans of 100, and there are 20 false
alarms a scan in place of 150. What a tracker assumes fits: accelerations of 1.5 m/s^2.
"""

from collections.abc import Callable, Sequence

import gymnasium as gym
import numpy as np

import gmr_gym
from gmr_gym.learning import RelativeTrackingVector

ENV_ID = "gmr_gym/TurningTarget-v0"
TURNS = np.repeat([(0.1, 0.3), (0.0, -1.0), (-1.5, 0.5)], [50, 25, 25], axis=0)  # m/s^2, by scan
VELOCITY = np.array([10.0, -10.0]) + np.cumsum(TURNS, axis=0)
POSITION = np.cumsum(VELOCITY - TURNS / 2, axis=0)
QUIET = {
    "trajectory": np.hstack([POSITION, VELOCITY]).tolist(),
    "clutter_rate": 20, "detection_probability": 0.98, "told_acceleration_deviation": 1.5,
}  # fmt: skip
FRAME = {"nearest": 4, "reach": 50.0}  # what an agent sees and says, of `RelativeTracking`
HELD_OUT = range(1_000_000, 1_000_100)  # seeds that training does not meet


def vector(n: int, autoreset_mode: str = "SameStep", **world) -> RelativeTrackingVector:
    """So many quiet environments in the agent's frame."""
    envs = gym.make_vec(ENV_ID, n, autoreset_mode=autoreset_mode, threads=1, **QUIET | world)
    return RelativeTrackingVector(envs, **FRAME)


def errors(act: Callable, seeds: Sequence[int] = HELD_OUT, **world) -> np.ndarray:
    """Mean errors a scan (n,), m, of the episodes of n seeds, as rewards charge them: of a target given up
    the cutoff for every scan that is left. `act` makes actions (n, 2) of observations."""
    envs = vector(len(seeds), **world)
    observation, _ = envs.reset(seed=list(seeds))
    scenario, charged, running = envs.unwrapped.scenario, np.zeros(len(seeds)), np.ones(len(seeds), bool)
    while running.any():
        observation, rewards, terminated, truncated, _ = envs.step(act(observation))
        charged, running = charged - running * rewards, running & ~(terminated | truncated)
    return charged * scenario.cutoff / scenario.horizon


def tracker_errors(name: str, seeds: Sequence[int] = HELD_OUT, **world) -> np.ndarray:
    """The same of a tracker."""
    env, charged = gym.make(ENV_ID, **QUIET | world), np.zeros(len(seeds))
    policy = gmr_gym.Policy(gmr_gym.make_tracker(name, env.unwrapped.scenario.model))
    for i, seed in enumerate(seeds):
        (observation, _), over = env.reset(seed=seed), False
        while not over:
            observation, reward, terminated, truncated, _ = env.step(policy(observation))
            charged[i], over = charged[i] - reward, terminated or truncated
    return charged / env.unwrapped.scenario.horizon
