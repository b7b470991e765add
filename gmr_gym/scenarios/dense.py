"""Fifty targets on their ways through a square, among two hundred false alarms a scan."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from gmr_gym.models.kalman import Motion
from gmr_gym.models.motions import constant_velocity
from gmr_gym.scenarios.paths import both_ways
from gmr_gym.scenarios.square import PERIOD, SIDE, Assumed, Seen, check_number, in_square, inside
from gmr_gym.simulation.multi_target import MultiTargetScenario

SCANS, MIDDLE = 100, 50  # all targets are there at scan 50, from 0
PROCESS = 0.1  # m/s^2
THERE, BORN = 0.7, 0.004  # expected before the first scan, and a scan, of each target that ever appears


def dense_targets(
    n: int = 50,
    clutter_rate: float = 200.0,
    detection_probability: float = 0.9,
    sensor_deviation: float = 5.0,
    *,
    speed: float = 5.0,
    shadows: Sequence = (),
    hot_spots: Sequence = (),
    told: str | bool = "uniform",
    trajectory: np.ndarray | Sequence | None = None,
    horizon: int | None = None,
) -> MultiTargetScenario:
    """Many targets at nearly constant velocity in a square of 1 km, which they enter and leave.

    Halfway each is anywhere in the square, and it is there as long as it does not leave it.

    Parameters
    ----------
    n : int
        Number of targets.
    clutter_rate : float
        False alarms per scan that are uniform.
    detection_probability : float
        P_D, of the truth outside shadows, and of the filter model.
    sensor_deviation : float
        Standard deviation of a detection on each axis, m.
    speed : float
        Standard deviation of the velocity on each axis halfway, m/s.
    shadows, hot_spots, told, trajectory, horizon
        As for `gmr_gym.scenarios.crossing.crossing_targets`.

    Returns
    -------
    MultiTargetScenario

    Raises
    ------
    ValueError
        Naming the argument that is invalid.
    """
    check_number(n)
    if not 0 < speed <= SIDE:
        raise ValueError(f"speed must be positive and at most {SIDE:g} m/s, got {speed}")
    moving = constant_velocity(PERIOD, PROCESS)
    return in_square(
        Assumed((moving,), speed, BORN * n, THERE * n),
        Seen(detection_probability, clutter_rate, sensor_deviation, shadows, hot_spots, told),
        partial(_paths, n, speed, moving), n, SCANS, trajectory, horizon,
    )  # fmt: skip


def halfway(n: int, speed: float, rng: np.random.Generator) -> np.ndarray:
    """States (n, 4) anywhere in the square."""
    position = rng.uniform(-SIDE / 2, SIDE / 2, (n, 2))
    return np.hstack([position, speed * rng.standard_normal((n, 2))])


def _paths(n: int, speed: float, moving: Motion, rng: np.random.Generator) -> np.ndarray:
    """States (100, n, 4), nan where a target is outside."""
    middle = halfway(n, speed, rng)
    noise = rng.multivariate_normal(np.zeros(4), moving.Q, (SCANS, n), "ignore", method="eigh")
    return inside(both_ways(middle, MIDDLE, moving.F[None, None], noise), MIDDLE)
