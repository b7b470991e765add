"""A target that weaves across a fixed field of view."""

import gymnasium as gym
import numpy as np

from gmr_gym.scenarios.planar import along, fixed_box, path
from gmr_gym.simulation.single_target import Scenario


def crossing(clutter_rate: float = 60.0, swing: float = 100.0) -> Scenario:
    """swing: m, how far the path strays to either side."""
    seconds = np.arange(1.0, 61.0)
    positions = np.column_stack([15 * seconds, swing * np.sin(2 * np.pi * seconds / 30)])
    x, start = path(positions, period=1.0)
    return along(
        x,
        start,
        fixed_box((-50.0, -300.0), (1000.0, 300.0)),
        period=1.0,  # s
        clutter_rate=clutter_rate,
        clutter_density=None,
        detection_probability=0.9,
        sensor_deviation=8.0,  # m
        told_sensor_deviation=8.0,  # m
        told_acceleration_deviation=3.0,  # m/s^2
    )


gym.register(
    "crossing/Crossing-v0", "gmr_gym.envs.tracking:TrackingEnv", kwargs={"scenario": f"{__name__}:crossing"}
)
