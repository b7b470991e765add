"""Four targets that meet and part, on which trackers of many targets are compared (Williams 2015).

As in Garcia-Fernandez, Williams, Granstrom and Svensson (2018), section VI: all of them are drawn at the scan
in the middle, within a metre, and run forward and backward from there.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np

from gmr_gym.checks import _check_positive, check_probability
from gmr_gym.mixture import Mixture
from gmr_gym.models.clutter import uniform_clutter
from gmr_gym.models.kalman import Motion, motion, position_sensor
from gmr_gym.models.multi_target import multi_target_model
from gmr_gym.scenarios.paths import both_ways, many_given, shortened, unvaried
from gmr_gym.scenarios.square import constant_clutter
from gmr_gym.simulation.multi_target import MultiTargetScenario

SIDE = 300.0  # m, of the region
SCANS, MIDDLE = 81, 41  # the targets meet at scan 41, counted from 1
PERIOD = 1.0  # s
TARGETS = 4
PROCESS = 0.02  # m^2/s^3, power of the acceleration
SURVIVAL = 0.99  # P_S
MEETING = 0.1, 0.25  # m^2 and m^2/s^2, variance where they meet: all born at once, or one after another
FIRST = 1, 11, 21, 31  # scans (from 1) of birth where they are born one after another
BORN, THERE = 0.005, 3.0  # expected number of births a scan, and of targets before the first
PLACE = 100.0  # m, centre of births on both axes
SPREAD = 150.0, 1.0  # m and m/s, standard deviations of births


def meeting_targets(
    detection_probability: float = 0.9,
    clutter_rate: float = 10.0,
    sensor_deviation: float = 1.0,
    *,
    staggered: bool = False,
    truth_seed: int | None = None,
    trajectory: np.ndarray | Sequence | None = None,
    horizon: int | None = None,
) -> MultiTargetScenario:
    """Four targets in a square of 300 m that meet within a metre, one of which disappears there.

    Parameters
    ----------
    detection_probability : float
        P_D.
    clutter_rate : float
        False alarms per scan, uniform.
    sensor_deviation : float
        Standard deviation of a detection on each axis, m.
    staggered : bool
        Whether targets are born one after another, at scans 1, 11, 21 and 31, rather than all at scan 1.
    truth_seed : int, optional
        Seed of the paths, for episodes that differ in their detections alone; by default every episode has
        paths of its own.
    trajectory : array_like (T, m, 4), optional
        States [x, y, vx, vy] of other targets, m and s; nan or masked where a target is absent.
    horizon : int, optional
        Number of scans; all by default, 81 of the paper's paths.

    Returns
    -------
    MultiTargetScenario

    Raises
    ------
    ValueError
        Naming the argument that is invalid.

    Notes
    -----
    Departs: the targets that are there before the first scan are predicted to it, as all others; the paper
    has the same intensity at the first scan. Their variance on an axis is then 22 501 m^2, not 22 500.

    References
    ----------
    Williams 2015; Garcia-Fernandez et al. 2018, section VI.
    """
    check_probability("detection_probability", detection_probability)
    if not 0 < clutter_rate <= 1e4:
        raise ValueError(f"clutter_rate must be positive and at most 1e4 per scan, got {clutter_rate}")
    _check_positive(sensor_deviation=sensor_deviation)
    if truth_seed is not None and not (isinstance(truth_seed, int) and truth_seed >= 0):
        raise ValueError(f"truth_seed must be a whole number, at least 0, got {truth_seed!r}")
    moving, sensor = _motion(), position_sensor(sensor_deviation)
    if trajectory is None:
        scans, targets = len(shortened(np.empty(SCANS), horizon)), TARGETS
        truth = partial(_paths, moving, staggered, truth_seed, scans)
    else:
        if staggered or truth_seed is not None:
            raise ValueError(
                "staggered and truth_seed are of the paper's paths: give neither with trajectory"
            )
        x = shortened(many_given("trajectory", trajectory, (4,)), horizon)
        scans, targets = x.shape[:2]
        truth = partial(unvaried, x)
    where = np.array([[PLACE, PLACE, 0.0, 0.0]]), np.diag(np.repeat(SPREAD, 2) ** 2)[None]
    clutter = uniform_clutter(np.zeros(2), np.full(2, SIDE), clutter_rate)
    return MultiTargetScenario(
        model=multi_target_model(
            moving, sensor, detection_probability, SURVIVAL, Mixture(np.array([BORN]), *where), clutter,
            initial=Mixture(np.array([THERE]), *where),
        ),
        truth=truth,
        targets=targets,
        sensor=sensor,
        detection_probability=float(detection_probability),
        clutter=partial(constant_clutter, clutter),
        horizon=scans,
        period=PERIOD,
        position=(0, 1),
        velocity=(2, 3),
        cutoff=10.0,
        order=2.0,
    )  # fmt: skip


def _motion() -> Motion:
    """Constant velocity with the paper's noise: a white acceleration in continuous time."""
    T, one = PERIOD, np.eye(2)
    F = np.block([[one, T * one], [0 * one, one]])
    Q = PROCESS * np.block([[T**3 / 3 * one, T**2 / 2 * one], [T**2 / 2 * one, T * one]])
    return motion(F, Q)


def _paths(
    moving: Motion, staggered: bool, truth_seed: int | None, scans: int, rng: np.random.Generator
) -> np.ndarray:
    """States (scans, 4, 4), nan where a target is absent."""
    rng = rng if truth_seed is None else np.random.default_rng(truth_seed)
    noise = rng.standard_normal((SCANS, TARGETS, 4)) @ np.linalg.cholesky(moving.Q).T
    meeting = rng.standard_normal((TARGETS, 4)) * np.sqrt(MEETING[staggered])
    middle = meeting + np.array([SIDE / 2, SIDE / 2, 0.0, 0.0])
    x = both_ways(middle, MIDDLE - 1, moving.F[None, None], noise)
    x[MIDDLE - 1 :, 0] = np.nan
    if staggered:
        for i, first in enumerate(FIRST):
            x[: first - 1, i] = np.nan
    return x[:scans]
