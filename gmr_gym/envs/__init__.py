"""Gymnasium environments; their ids are data, and listing them imports nothing heavy."""

import gymnasium as gym

ENVIRONMENTS = {
    "gmr_gym/TurningTarget-v0": "gmr_gym.scenarios.dortenzio:turning_target",
    "gmr_gym/RecordedFlight-v0": "gmr_gym.scenarios.recorded:recorded_flight",
    "gmr_gym/AgileFlight-v0": "gmr_gym.scenarios.maybeck:agile_flight",
    "gmr_gym/JumpMarkov-v0": "gmr_gym.scenarios.zhang:jump_markov",
    "gmr_gym/AirborneRadar-v0": "gmr_gym.scenarios.li:airborne_radar",
}


def register_envs() -> None:
    """Make every id known to `gymnasium.make`; harmless when done twice."""
    for env_id, scenario in ENVIRONMENTS.items():
        if env_id not in gym.registry:
            gym.register(env_id, "gmr_gym.envs.tracking:TrackingEnv", kwargs={"scenario": scenario})
