"""Ids of the Gymnasium environments, as data; listing them imports nothing heavy."""

import gymnasium as gym

# one target to estimate
TRACKING = {
    "gmr_gym/TurningTarget-v0": "gmr_gym.scenarios.dortenzio:turning_target",
    "gmr_gym/RecordedFlight-v0": "gmr_gym.scenarios.recorded:recorded_flight",
    "gmr_gym/AgileFlight-v0": "gmr_gym.scenarios.maybeck:agile_flight",
    "gmr_gym/JumpMarkov-v0": "gmr_gym.scenarios.zhang:jump_markov",
    "gmr_gym/AirborneRadar-v0": "gmr_gym.scenarios.li:airborne_radar",
}
# many targets, scored as a set
MULTI_TARGET = {
    "gmr_gym/UnknownClutter-v0": "gmr_gym.scenarios.lv:unknown_clutter",
}
TUNING = "gmr_gym/ReductionTuning-v0"  # thresholds of a tracker
ENVIRONMENTS = (*TRACKING, *MULTI_TARGET, TUNING)


def register_envs() -> None:
    """Register every id with Gymnasium. Calling it twice does no harm."""
    for scenarios, one, many in (
        (TRACKING, "tracking:TrackingEnv", "gmr_gym.envs.vector:TrackingVectorEnv"),
        (MULTI_TARGET, "multi_target:MultiTargetEnv", None),
    ):
        for env_id, scenario in scenarios.items():
            if env_id not in gym.registry:
                gym.register(
                    env_id,
                    f"gmr_gym.envs.{one}",
                    kwargs={"scenario": scenario},
                    vector_entry_point=many,
                )
    if TUNING not in gym.registry:
        gym.register(
            TUNING, "gmr_gym.envs.tuning:ReductionTuningEnv",
            vector_entry_point="gmr_gym.envs.tuning_vector:ReductionTuningVectorEnv",
        )  # fmt: skip
