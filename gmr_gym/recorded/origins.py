"""Where a detection of no track comes from: a target not detected before, or clutter."""

import numpy as np

from gmr_gym.filters.clutter_estimation import ClutterEstimate, options, update_estimate
from gmr_gym.filters.track_gates import positions_of
from gmr_gym.models.clutter import uniform_clutter
from gmr_gym.models.positions import Look
from gmr_gym.recorded.model import TrackingModel
from gmr_gym.recorded.track_state import State


def undetected_until(time: float, state: State, model: TrackingModel) -> float:
    r"""Expected number of targets in the box that no scan has detected.

    Parameters
    ----------
    time : float
        s.
    state : State
    model : TrackingModel

    Returns
    -------
    float

    Notes
    -----
    With b the birth rate, and the survival probability of a second :math:`e^{-\mu}`

    .. math:: \lambda \leftarrow \lambda e^{-\mu t} + \frac{b}{\mu} \left( 1 - e^{-\mu t} \right)
    """
    if state.time == -np.inf:
        return state.undetected
    dt, rate = time - state.time, -np.log(model.survival_probability)
    appeared = dt if rate == 0 else -np.expm1(-rate * dt) / rate
    return float(state.undetected * np.exp(-rate * dt) + model.birth_rate * appeared)


def densities(
    look: Look, state: State, model: TrackingModel, sensor: int, undetected: float
) -> tuple[np.ndarray, np.ndarray]:
    """Densities of clutter and of first detections of targets, at each detection (k,).

    Both are uniform in the box, or the clutter as estimated, and per unit of what the sensor measures; a
    clutter's range rate is uniform up to the largest speed both ways.

    Parameters
    ----------
    look : Look
    state : State
    model : TrackingModel
    sensor : int
    undetected : float
        Expected number of targets in the box.

    Returns
    -------
    clutter, new : ndarray (k,)
    """
    spec, k, p = model.sensors[sensor], len(look.at), model.axes
    kappa = np.full(k, spec.clutter_per_scan / model.volume)
    if state.clutter and k:
        kappa = state.clutter[sensor].clutter.density(positions_of(look)[0])
    rho = np.full(k, spec.detection_probability * undetected / model.volume)
    per_unit = np.ones(k)
    if look.polar:
        per_unit = look.z[:, 0] if p == 2 else look.z[:, 0] ** 2 * np.cos(look.z[:, 2])
    with_rate = np.isfinite(look.range_rate)
    if with_rate.any():
        variance = model.max_speed**2 / (p + 2) + spec.range_rate_deviation**2
        rate = look.range_rate[with_rate]
        kappa[with_rate] /= 2 * model.max_speed
        rho[with_rate] *= np.exp(-0.5 * rate**2 / variance) / np.sqrt(2 * np.pi * variance)
    return kappa * per_unit, rho * per_unit


def learned(
    look: Look, state: State, model: TrackingModel, sensor: int, p_clutter: np.ndarray
) -> tuple[ClutterEstimate, ...]:
    """Estimates of the clutter after a scan whose detections are clutter with probability p_clutter (k,)."""
    if not state.clutter:
        return ()
    spec = model.sensors[sensor]
    place, variance = positions_of(look)
    prior = uniform_clutter(model.low, model.high, max(spec.clutter_per_scan, 1e-3))
    widest = float(np.sqrt(variance.max(initial=max(spec.deviation) ** 2)))
    estimates = list(state.clutter)
    estimates[sensor] = update_estimate(prior, estimates[sensor], place, p_clutter, options(deviation=widest))
    return tuple(estimates)
