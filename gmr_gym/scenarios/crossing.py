"""Targets that fly straight and cross in the middle, as close as asked for: who is who afterwards?"""

from collections.abc import Sequence
from functools import partial

import numpy as np

from gmr_gym.models.motions import constant_velocity
from gmr_gym.scenarios.square import PERIOD, SIDE, Assumed, Seen, check_number, in_square
from gmr_gym.simulation.multi_target import MultiTargetScenario

SCANS, MIDDLE = 61, 30  # the targets cross at scan 30, from 0
PROCESS = 0.3  # m/s^2, that trackers assume: the targets fly straight
BORN = 0.01  # expected number of births a scan


def crossing_targets(
    n: int = 4,
    spacing: float = 0.0,
    angle: float = 0.35,
    *,
    speed: float = 10.0,
    detection_probability: float = 0.9,
    clutter_rate: float = 20.0,
    sensor_deviation: float = 5.0,
    shadows: Sequence = (),
    hot_spots: Sequence = (),
    told: str | bool = "uniform",
    trajectory: np.ndarray | Sequence | None = None,
    horizon: int | None = None,
) -> MultiTargetScenario:
    """Targets at constant velocity whose paths cross in the middle of a square of 1 km.

    At the scan in the middle they are one behind the other along their mean course, which is drawn. For two
    targets their distance there is the least that they ever have.

    Parameters
    ----------
    n : int
        Number of targets.
    spacing : float
        Distance of neighbours at the scan in the middle, m.
    angle : float
        Between the courses of neighbours, rad; 0 for a convoy.
    speed : float
        m/s.
    detection_probability : float
        P_D, of the truth outside shadows, and of the filter model.
    clutter_rate : float
        False alarms per scan that are uniform.
    sensor_deviation : float
        Standard deviation of a detection on each axis, m.
    shadows : sequence of ((x, y), radius, P_D)
        Circles, m, in which targets are detected with another probability.
    hot_spots : sequence of (false alarms per scan, (x, y), deviation)
        Gaussian clutter, m, beside the uniform.
    told : {"uniform", "true"}
        What trackers assume: no shadows, and as much clutter spread evenly, or what is true.
    trajectory : array_like (T, m, 4), optional
        States [x, y, vx, vy] of other targets, m and s; nan or masked where a target is absent.
    horizon : int, optional
        Number of scans; all by default.

    Returns
    -------
    MultiTargetScenario

    Raises
    ------
    ValueError
        Naming the argument that is invalid.
    """
    check_number(n)
    for name, value, most in (("spacing", spacing, SIDE), ("angle", angle, np.pi), ("speed", speed, SIDE)):
        if not 0 <= value <= most:
            raise ValueError(f"{name} must lie between 0 and {most:.4g}, got {value}")
    reach = speed * PERIOD * MIDDLE + spacing * (n - 1) / 2
    if trajectory is None and reach > SIDE / 2:
        raise ValueError(
            f"spacing and speed must keep {n} targets within {SIDE / 2:g} m of the middle, which they leave "
            f"by {reach - SIDE / 2:g} m"
        )
    return in_square(
        Assumed((constant_velocity(PERIOD, PROCESS),), max(speed, 1.0), BORN, float(n)),
        Seen(detection_probability, clutter_rate, sensor_deviation, shadows, hot_spots, told),
        partial(_paths, n, spacing, angle, speed), n, SCANS, trajectory, horizon,
    )  # fmt: skip


def _paths(n: int, spacing: float, angle: float, speed: float, rng: np.random.Generator) -> np.ndarray:
    """States (61, n, 4)."""
    course = rng.uniform(0, 2 * np.pi)
    rank = np.arange(n) - (n - 1) / 2
    behind = rank[:, None] * spacing * _towards(course)
    velocity = speed * _towards(course + rank * angle)
    time = (np.arange(SCANS) - MIDDLE) * PERIOD
    at = behind + time[:, None, None] * velocity
    return np.concatenate([at, np.broadcast_to(velocity, at.shape)], axis=2)


def _towards(course: np.ndarray | float) -> np.ndarray:
    """Unit vectors (..., 2)."""
    return np.stack([np.cos(course), np.sin(course)], axis=-1)
