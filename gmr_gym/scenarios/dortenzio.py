"""D'Ortenzio, Manes and Orguner, "Adaptive mixture approximation for target tracking in clutter", section 4.

One turning target, a fixed field of view, and a filter model that differs a little from the truth.
"""

import numpy as np

from gmr_gym.models.motions import constant_velocity
from gmr_gym.scenarios.paths import shortened
from gmr_gym.scenarios.planar import along, bounding_box, fixed_box, following_box, path
from gmr_gym.simulation.single_target import Scenario

PERIOD = 1.0  # s
START = (0.0, 0.0, 10.0, -10.0)  # [px, py, vx, vy], m and m/s
# Departs: eq. 20 prints u2 = [0, 2], whose path spans 1316 x 3521 m and leaves the stated field of
# view of about 700 x 1300 m; with the lost minus sign it spans 1316.5 x 662.5 m.
ACCELERATIONS = ((50, (0.2, 0.6)), (25, (0.0, -2.0)), (25, (-3.0, 1.0)))  # scans, m/s^2


def turning_target(
    clutter_rate: float | None = None,
    clutter_density: float | None = None,
    detection_probability: float = 0.9,
    *,
    sensor_deviation: float = 60**0.5,
    told_sensor_deviation: float = 70**0.5,
    told_acceleration_deviation: float = 3.0,
    horizon: int | None = None,
    box=None,
    window=None,
    trajectory=None,
) -> Scenario:
    """The paper's scenario: 150 false alarms per scan; every number can be changed.

    Parameters
    ----------
    clutter_rate : float, optional
        False alarms per scan. 150 when neither it nor `clutter_density` is given.
    clutter_density : float, optional
        False alarms per m^2 and scan, instead of `clutter_rate`.
    detection_probability : float
        P_D, of the truth and of the filter model.
    sensor_deviation : float
        Standard deviation of the true measurement noise, m.
    told_sensor_deviation : float
        Standard deviation of the measurement noise that the filter assumes, m.
    told_acceleration_deviation : float
        Standard deviation of the process noise that the filter assumes, m/s^2.
    horizon : int, optional
        Number of scans; all of the path by default.
    box : ((x, y), (x, y)), optional
        Field of view on the ground, m; by default the bounding box of the path.
    window : (width, height), optional
        Field of view, m, that follows the submitted estimate, instead of `box`.
    trajectory : array_like (T, 2) or (T, 4), optional
        Another truth, one scan per second: positions, or positions and velocities, m and m/s.

    Returns
    -------
    Scenario

    Raises
    ------
    ValueError
        Naming the argument that is invalid, or if both `box` and `window` are given.

    References
    ----------
    D'Ortenzio, Manes and Orguner, section 4 and Table 1.

    Examples
    --------
    >>> from gmr_gym.scenarios.dortenzio import turning_target
    >>> scenario = turning_target(clutter_rate=20, horizon=50)
    >>> scenario.horizon, scenario.clutter_rate, scenario.cutoff
    (50, 20.0, 100.0)
    >>> scenario.window.follows
    False
    """
    if trajectory is None:
        x, start = printed_path(), np.array(START)
    else:
        x, start = path(trajectory, PERIOD)
    if box is not None and window is not None:
        raise ValueError("give either box (fixed on the ground) or window (following the estimate)")
    if window is not None:
        view = following_box(window)
    elif box is not None:
        view = fixed_box(*box)
    else:
        view = bounding_box(np.vstack([start, x])[:, :2])
    if clutter_rate is None and clutter_density is None:
        clutter_rate = 150.0
    return along(
        shortened(x, horizon),  # after the box: a shorter episode keeps the density of the clutter
        start,
        view,
        period=PERIOD,
        clutter_rate=clutter_rate,
        clutter_density=clutter_density,
        detection_probability=detection_probability,
        sensor_deviation=sensor_deviation,
        told_sensor_deviation=told_sensor_deviation,
        told_acceleration_deviation=told_acceleration_deviation,
    )


def printed_path() -> np.ndarray:
    """States (100, 4) of eq. 20. The truth has no process noise."""
    F = constant_velocity(PERIOD, 1.0).F
    x, states = np.array(START), []
    for scans, acceleration in ACCELERATIONS:
        u = np.array(acceleration)
        for _ in range(scans):
            x = F @ x + np.concatenate((PERIOD**2 / 2 * u, PERIOD * u))
            states.append(x)
    return np.array(states)
