"""Ids of the Gymnasium environments, as data; listing them imports nothing heavy."""

from typing import Any

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
    "gmr_gym/MeetingTargets-v0": "gmr_gym.scenarios.williams:meeting_targets",
    "gmr_gym/CrossingTargets-v0": "gmr_gym.scenarios.crossing:crossing_targets",
    "gmr_gym/DenseTargets-v0": "gmr_gym.scenarios.dense:dense_targets",
    "gmr_gym/ManoeuvringTargets-v0": "gmr_gym.scenarios.manoeuvring:manoeuvring_targets",
}
ROWS = {"gmr_gym/DenseTargets-v0": 100}  # of an action, where not the usual number
# likewise, of detections in files: nothing of them is shipped, and their `folder` has to be given
RECORDED = {
    "gmr_gym/RecordedRadar-v0": "gmr_gym.recorded.radar:recorded_radar",
}
# thresholds of a tracker, by version
TUNINGS: dict[str, dict[str, Any]] = {
    "gmr_gym/ReductionTuning-v0": {},
    "gmr_gym/ReductionTuning-v1": {
        "parameters": ("history", "prune", "components", "process_noise", "coasting_noise", "fading"),
        "reducer": "n-scan", "features": "all", "instances": "wide-train", "price": (1e-5, 1e-2),
    },
}  # fmt: skip
TUNING, *_ = TUNINGS
READY = (*TRACKING, *MULTI_TARGET)  # in which trackers run without an argument
RANKED = tuple(env_id for env_id in READY if env_id not in ROWS)  # where runs of every tracker take minutes
TRACKED = (*READY, *RECORDED)
ENVIRONMENTS = (*TRACKED, *TUNINGS)
# a sentence on each, as `gmr-gym list` shows it
ABOUT = {
    "gmr_gym/TurningTarget-v0": "One target turns twice in heavy clutter (D'Ortenzio, section 4).",
    "gmr_gym/RecordedFlight-v0": "A real aircraft's recorded path in clutter.",
    "gmr_gym/AgileFlight-v0": "An F-16 flies level, turns at 4 g and jinks in clutter (Maybeck, section V).",
    "gmr_gym/JumpMarkov-v0": "A target switches between accelerations in clutter (Zhang, section 6.1).",
    "gmr_gym/AirborneRadar-v0": "A target that turns hard, seen by an airborne radar (Li, section 4).",
    "gmr_gym/UnknownClutter-v0": "Three targets in clutter of unknown density (Lv, section 7.1).",
    "gmr_gym/MeetingTargets-v0": "Four targets meet within a metre and part (Williams).",
    "gmr_gym/CrossingTargets-v0": "Targets on straight courses cross, as close as asked for.",
    "gmr_gym/DenseTargets-v0": "Fifty targets cross a square among two hundred false alarms a scan.",
    "gmr_gym/ManoeuvringTargets-v0": "Targets that fly straight and turn, each by a Markov chain of its own.",
    "gmr_gym/RecordedRadar-v0": "Real radar detections with known targets, from files of yours: folder=PATH.",
    TUNING: "A policy sets the thresholds of a tracker's mixture reduction, scan by scan.",
    "gmr_gym/ReductionTuning-v1": "The same, with the process noise that the tracker assumes.",
}


def register_envs() -> None:
    """Register every id with Gymnasium. Calling it twice does no harm."""
    for scenarios, one, many in (
        (TRACKING, "tracking:TrackingEnv", "vector:TrackingVectorEnv"),
        (MULTI_TARGET | RECORDED, "multi_target:MultiTargetEnv", "multi_target_vector:MultiTargetVectorEnv"),
    ):
        for env_id, scenario in scenarios.items():
            if env_id not in gym.registry:
                gym.register(
                    env_id,
                    f"gmr_gym.envs.{one}",
                    kwargs={"scenario": scenario} | ({"targets": ROWS[env_id]} if env_id in ROWS else {}),
                    vector_entry_point=f"gmr_gym.envs.{many}",
                )
    for env_id, arguments in TUNINGS.items():
        if env_id not in gym.registry:
            gym.register(
                env_id, "gmr_gym.envs.tuning:ReductionTuningEnv", kwargs=arguments,
                vector_entry_point="gmr_gym.envs.tuning_vector:ReductionTuningVectorEnv",
            )  # fmt: skip
