"""The prior of a target's state, given or from the first scan."""

import numpy as np

from gmr_gym.checks import _check_positive
from gmr_gym.mixture import Mixture, gaussian, mixture
from gmr_gym.models.kalman import position_sensor
from gmr_gym.models.model import Model, model
from gmr_gym.models.motions import constant_velocity
from gmr_gym.points import check_points, check_unmasked, present

MOST_STARTS = 500  # detections; each is paired with each of the next scan, at 200 bytes a pair


def constant_velocity_model(
    dt: float,
    prior: Mixture,
    *,
    axes: int,
    acceleration_deviation: float,
    sensor_deviation: float,
    detection_probability: float,
    gate_probability: float = 0.999,
    clutter_density: float,
) -> Model:
    """Model of a nearly constant velocity and a sensor of the position; the state is [positions,
    velocities].

    Parameters
    ----------
    dt : float
        Time between scans, s.
    prior : Mixture
        Of the state one period before the first scan.
    axes : int
    acceleration_deviation : float
        Standard deviation of the acceleration, m/s^2.
    sensor_deviation : float
        Standard deviation of the measurement noise, m.
    detection_probability : float
        P_D.
    gate_probability : float
        P_G.
    clutter_density : float
        Expected false alarms per scan, per m^axes.

    Examples
    --------
    >>> m = constant_velocity_model(
    ...     1.0, prior_given([0.0, 10.0], [5.0, 2.0]), axes=1, acceleration_deviation=0.5,
    ...     sensor_deviation=5.0, detection_probability=0.9, clutter_density=1e-3,
    ... )
    >>> m.sensor.R.tolist()
    [[25.0]]
    """
    _check_positive(dt=dt, axes=axes, sensor_deviation=sensor_deviation)
    _check_positive(acceleration_deviation=acceleration_deviation)
    motion = constant_velocity(dt, acceleration_deviation, axes)
    sensor = position_sensor(sensor_deviation, axes)
    return model(motion, sensor, detection_probability, gate_probability, clutter_density, prior)


def prior_given(mean, deviations) -> Mixture:
    """Uncorrelated Gaussian prior.

    Parameters
    ----------
    mean : array_like (d,)
    deviations : array_like (d,)
        Standard deviations, positive.
    """
    check_unmasked("mean", mean)
    check_unmasked("deviations", deviations)
    mean, deviations = np.array(mean, float), np.array(deviations, float)
    if mean.ndim != 1 or len(mean) == 0 or not np.isfinite(mean).all():
        raise ValueError(f"mean must be finite numbers (d,), got {mean.tolist()}")
    if deviations.shape != mean.shape or not ((deviations > 0) & (deviations < np.inf)).all():
        raise ValueError(f"deviations must be {len(mean)} positive numbers, got {deviations.tolist()}")
    return gaussian(mean, np.diag(deviations**2))


def prior_from_first_scan(z, sensor_deviation: float, speed_deviation: float) -> Mixture:
    """Prior at the time of the first scan, by single-point initiation.

    One component of equal weight for each detection, with mean velocity zero.

    Parameters
    ----------
    z : array_like (k, p)
        The scan, k >= 1.
    sensor_deviation : float
        Standard deviation of the measurement noise, m.
    speed_deviation : float
        Standard deviation of the velocity along each axis, m/s.

    Examples
    --------
    >>> p = prior_from_first_scan([[0.0, 0.0], [50.0, 20.0]], sensor_deviation=10.0, speed_deviation=30.0)
    >>> p.w.tolist(), p.m[1].tolist()
    ([0.5, 0.5], [50.0, 20.0, 0.0, 0.0])
    """
    z = np.asarray(present(z), float)
    if z.ndim != 2 or z.size == 0 or len(z) > MOST_STARTS or not np.isfinite(z).all():
        raise ValueError(f"z must be 1 to {MOST_STARTS} finite detections (k, p), got shape {z.shape}")
    z = check_points(z, z.shape[1])
    _check_positive(sensor_deviation=sensor_deviation, speed_deviation=speed_deviation)
    k, p = z.shape
    variances = np.repeat([sensor_deviation**2, speed_deviation**2], p)
    return mixture(np.full(k, 1 / k), np.hstack([z, np.zeros_like(z)]), [np.diag(variances)] * k)
