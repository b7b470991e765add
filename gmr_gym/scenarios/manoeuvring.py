"""Targets that fly straight, turn left and turn right, each as a Markov chain of its own has it."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from gmr_gym.checks import check_flag
from gmr_gym.models.motions import constant_velocity, coordinated_turn
from gmr_gym.models.switching import sticky_switching
from gmr_gym.scenarios.dense import halfway
from gmr_gym.scenarios.paths import both_ways
from gmr_gym.scenarios.square import PERIOD, Assumed, Seen, check_number, in_square, inside
from gmr_gym.simulation.multi_target import MultiTargetScenario

SCANS, MIDDLE = 100, 50  # all targets are there at scan 50, from 0
PROCESS = 0.1  # m/s^2
LOOSE = 1.0  # m/s^2, of trackers without modes
SPEED = 10.0  # m/s, standard deviation of the velocity on each axis halfway
THERE, BORN = 0.7, 0.004  # expected before the first scan, and a scan, of each target that ever appears


def manoeuvring_targets(
    n: int = 5,
    turn_rate: float = 0.15,
    stay: float = 0.95,
    *,
    modes: bool = True,
    detection_probability: float = 0.9,
    clutter_rate: float = 20.0,
    sensor_deviation: float = 5.0,
    shadows: Sequence = (),
    hot_spots: Sequence = (),
    told: str | bool = "uniform",
    trajectory: np.ndarray | Sequence | None = None,
    horizon: int | None = None,
) -> MultiTargetScenario:
    """Targets that switch between straight flight and turns, in a square of 1 km.

    Halfway each is anywhere in the square, and it is there as long as it does not leave it.

    Parameters
    ----------
    n : int
        Number of targets.
    turn_rate : float
        Of the turns, rad/s.
    stay : float
        Probability that a target keeps its motion from scan to scan; else either other follows.
    modes : bool
        Whether the filter model has the three motions and how they follow one another. Otherwise it has
        nearly constant velocity, with an acceleration of 1 m/s^2.
    detection_probability : float
        P_D, of the truth outside shadows, and of the filter model.
    clutter_rate : float
        False alarms per scan that are uniform.
    sensor_deviation : float
        Standard deviation of a detection on each axis, m.
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
    if not 0 < turn_rate <= 1:
        raise ValueError(f"turn_rate must be positive and at most 1 rad/s, got {turn_rate}")
    if not 0 <= stay <= 1:
        raise ValueError(f"stay must be a probability, got {stay}")
    motions = [coordinated_turn(PERIOD, rate, PROCESS) for rate in (0.0, turn_rate, -turn_rate)]
    check_flag("modes", modes)
    switching = sticky_switching(stay, len(motions))
    loose = constant_velocity(PERIOD, LOOSE)
    F, Q = np.array([motion.F for motion in motions]), motions[0].Q
    return in_square(
        Assumed(
            tuple(motions) if modes else (loose,), SPEED, BORN * n, THERE * n, switching if modes else None
        ),
        Seen(detection_probability, clutter_rate, sensor_deviation, shadows, hot_spots, told),
        partial(_paths, n, F, Q, switching), n, SCANS, trajectory, horizon,
    )  # fmt: skip


def _paths(
    n: int, F: np.ndarray, Q: np.ndarray, switching: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """States (100, n, 4), nan where a target is outside."""
    middle = halfway(n, SPEED, rng)
    noise = rng.multivariate_normal(np.zeros(4), Q, (SCANS, n), "ignore", method="eigh")
    draws, mode = rng.random((SCANS, n)), np.zeros((SCANS, n), int)
    mode[0] = rng.integers(len(F), size=n)
    for t in range(1, SCANS):
        passed = draws[t, :, None] >= np.cumsum(switching, axis=0).T[mode[t - 1]]
        mode[t] = np.minimum(passed.sum(axis=1), len(F) - 1)
    return inside(both_ways(middle, MIDDLE, F[mode], noise), MIDDLE)
