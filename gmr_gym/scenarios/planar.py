"""One target on a given path in the plane, its position measured, tracked with nearly constant velocity."""

from functools import partial

import numpy as np

from gmr_gym.checks import check_probability
from gmr_gym.mixture import gaussian
from gmr_gym.models.kalman import position_sensor
from gmr_gym.models.model import model
from gmr_gym.models.motions import constant_velocity
from gmr_gym.scenarios.paths import states_given
from gmr_gym.simulation.loss import truth_outside_gates
from gmr_gym.simulation.single_target import Scenario, Window, scripted


def along(
    x: np.ndarray,
    start: np.ndarray,
    window: Window,
    *,
    period: float,
    clutter_rate: float | None,
    clutter_density: float | None,
    detection_probability: float,
    sensor_deviation: float,
    told_sensor_deviation: float,
    told_acceleration_deviation: float,
) -> Scenario:
    """Scenario of a given path.

    The tracker starts from the true state with unit covariance. The filter model has the true clutter density
    and P_D, and noise of its own. A track is lost when the true position lies outside every gate.

    Parameters
    ----------
    x : ndarray (T, 4)
        True states [px, py, vx, vy], m and m/s.
    start : ndarray (4,)
        True state one period before the first scan.
    window : Window
        Where clutter falls.
    period : float
        Time between scans, s.
    clutter_rate : float or None
        False alarms per scan.
    clutter_density : float or None
        False alarms per m^2 and scan. Exactly one of the two is given.
    detection_probability : float
        P_D, of the truth and of the filter model.
    sensor_deviation : float
        Standard deviation of the true measurement noise, m.
    told_sensor_deviation, told_acceleration_deviation : float
        Standard deviations of the measurement noise, m, and the process noise, m/s^2, that the filter
        assumes.

    Returns
    -------
    Scenario

    Raises
    ------
    ValueError
        Naming the argument that is invalid.
    """
    if clutter_rate is not None and clutter_density is None:
        rate = clutter_rate
    elif clutter_density is not None and clutter_rate is None:
        rate = clutter_density * window.volume
    else:
        raise ValueError("give either clutter_rate (per scan) or clutter_density (per m^2)")
    if not 0 <= rate <= 1e6:
        raise ValueError(f"clutter must be between 0 and a million false alarms per scan, got {rate:g}")
    check_probability("detection_probability", detection_probability)
    for name, value in (
        ("sensor_deviation", sensor_deviation),
        ("told_sensor_deviation", told_sensor_deviation),
        ("told_acceleration_deviation", told_acceleration_deviation),
        ("period", period),
    ):
        if not 0 < value < np.inf:
            raise ValueError(f"{name} must be positive and finite, got {value}")
    assumed = model(
        constant_velocity(period, told_acceleration_deviation),
        position_sensor(told_sensor_deviation),
        detection_probability,
        gate_probability=0.999,
        # a filter model without clutter could not explain a second detection
        clutter_density=max(rate / window.volume, np.finfo(float).tiny),
        prior=gaussian(start, np.eye(4)),
    )
    return Scenario(
        model=assumed,
        truth=partial(scripted, x),
        sensor=position_sensor(sensor_deviation),
        detection_probability=detection_probability,
        clutter_rate=float(rate),
        window=window,
        horizon=len(x),
        period=period,
        position=(0, 1),
        velocity=(2, 3),
        loss_rule=partial(truth_outside_gates, assumed.sensor.H),
        patience=1,
        cutoff=100.0,
    )


def path(trajectory, period: float) -> tuple[np.ndarray, np.ndarray]:
    """States of a path, and the state one period before it.

    Parameters
    ----------
    trajectory : array_like (T, 2) or (T, 4)
        Positions, or positions and velocities, m and m/s. Missing velocities are central differences.
    period : float
        Time between rows, s.

    Returns
    -------
    x : ndarray (T, 4)
    start : ndarray (4,)

    Raises
    ------
    ValueError
        For another shape, fewer than three points, or a number that is not finite.
    """
    x = states_given("trajectory", trajectory, (2, 4), least=3)
    if x.shape[1] == 2:
        x = np.hstack([x, np.gradient(x, period, axis=0)])
    return x, np.concatenate((x[0, :2] - period * x[0, 2:], x[0, 2:]))


def fixed_box(low, high) -> Window:
    """A window that is fixed on the ground.

    Parameters
    ----------
    low, high : array_like (2,)
        Opposite corners, m, the lower one first.

    Returns
    -------
    Window

    Raises
    ------
    ValueError
        If the corners are not finite, or the lower one is not first.
    """
    low, high = np.array(low, float), np.array(high, float)
    if low.shape != (2,) or high.shape != (2,) or not (np.isfinite(low) & np.isfinite(high)).all():
        raise ValueError(f"box must be two finite corners ((x, y), (x, y)), got {low}, {high}")
    if not (low < high).all():
        raise ValueError(f"box must have its lower corner first, got {low}, {high}")
    return Window(low, high, follows=False)


def bounding_box(points: np.ndarray) -> Window:
    """The smallest window on the ground that holds the points (n, 2), with sides of at least 100 m."""
    low, high = points.min(axis=0), points.max(axis=0)
    widening = np.maximum(100.0 - (high - low), 0.0) / 2
    # detections of a target on the edge may fall outside and are reported all the same, about one in twenty
    # on the printed path: the paper's field of view is no larger
    return fixed_box(low - widening, high + widening)._replace(limits_view=False)


def following_box(sides) -> Window:
    """A window centred on the predicted estimate.

    Parameters
    ----------
    sides : array_like (2,)
        Width and height, m.

    Returns
    -------
    Window

    Raises
    ------
    ValueError
        If the sides are not two positive lengths.
    """
    try:
        sides = np.array(sides, float)
    except (TypeError, ValueError):
        sides = np.array(sides, object)
    if sides.dtype == object or sides.shape != (2,) or not ((sides > 0) & (sides <= 1e6)).all():
        raise ValueError(f"window must be two positive lengths (width, height) up to 1e6 m, got {sides}")
    return Window(-sides / 2, sides / 2, follows=True)
