"""The first state of a target, given or found from the first scan."""

import numpy as np

from gmr_gym.checks import _check_positive
from gmr_gym.mixture import Mixture, gaussian, mixture
from gmr_gym.models.kalman import position_sensor
from gmr_gym.models.model import Model, model
from gmr_gym.models.motions import constant_velocity
from gmr_gym.points import check_unmasked, present

MOST_STARTS = 500  # detections; each may meet each of the next scan, at 200 bytes a pair


def constant_velocity_model(
    dt: float,  # s, between scans
    prior: Mixture,
    *,
    axes: int,
    acceleration_deviation: float,  # m/s^2
    sensor_deviation: float,  # m
    detection_probability: float,
    gate_probability: float = 0.999,
    clutter_density: float,  # m^-axes
) -> Model:
    """Model of a target seen in position; its state is [positions, velocities]."""
    _check_positive(dt=dt, axes=axes, sensor_deviation=sensor_deviation)
    _check_positive(acceleration_deviation=acceleration_deviation)
    motion = constant_velocity(dt, acceleration_deviation, axes)
    sensor = position_sensor(sensor_deviation, axes)
    return model(motion, sensor, detection_probability, gate_probability, clutter_density, prior)


def prior_given(mean, deviations) -> Mixture:
    """The Gaussian of that mean (d,) and those standard deviations (d,), uncorrelated."""
    check_unmasked("mean", mean)
    check_unmasked("deviations", deviations)
    mean, deviations = np.array(mean, float), np.array(deviations, float)
    if mean.ndim != 1 or len(mean) == 0 or not np.isfinite(mean).all():
        raise ValueError(f"mean must be finite numbers (d,), got {mean.tolist()}")
    if deviations.shape != mean.shape or not ((deviations > 0) & (deviations < np.inf)).all():
        raise ValueError(f"deviations must be {len(mean)} positive numbers, got {deviations.tolist()}")
    return gaussian(mean, np.diag(deviations**2))


def prior_from_first_scan(z, sensor_deviation: float, speed_deviation: float) -> Mixture:
    """Prior of the time of the scan z (k, p), k >= 1: the target's detection is any of them alike, its
    velocity zero give or take `speed_deviation` (m/s) along each axis (single-point initiation)."""
    z = np.asarray(present(z), float)
    if z.ndim != 2 or z.size == 0 or len(z) > MOST_STARTS or not np.isfinite(z).all():
        raise ValueError(f"z must be 1 to {MOST_STARTS} finite detections (k, p), got shape {z.shape}")
    _check_positive(sensor_deviation=sensor_deviation, speed_deviation=speed_deviation)
    k, p = z.shape
    variances = np.repeat([sensor_deviation**2, speed_deviation**2], p)
    return mixture(np.full(k, 1 / k), np.hstack([z, np.zeros_like(z)]), [np.diag(variances)] * k)
