"""Motion models, sensors and filter models, as Stone Soup has them and as trackers here take them.

A state of Stone Soup may have any order. It is kept for linear sensors; for a radar positions come first, and
`state_order` says which of its states each is.
"""

from collections.abc import Sequence
from datetime import timedelta
from typing import Any

import numpy as np
from stonesoup.models.base import GaussianModel, LinearModel
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.measurement.nonlinear import CartesianToElevationBearingRange
from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel

from gmr_gym.mixture import Mixture
from gmr_gym.models.kalman import Motion, Sensor, motion, sensor
from gmr_gym.models.model import Model, model
from gmr_gym.models.radar import Radar, radar
from gmr_gym.models.sensing import MeasurementModel
from gmr_gym.models.switching import check_switching
from gmr_gym.stonesoup.mixtures import mixture_of

SENSORS = "LinearGaussian and CartesianToElevationBearingRange"


def motion_of(transition_model: Any, interval: timedelta | None) -> Motion:
    """A linear transition model over an interval.

    Parameters
    ----------
    transition_model : LinearGaussianTransitionModel or CombinedLinearGaussianTransitionModel
    interval : timedelta or None
        None for a model that does not vary with time.

    Returns
    -------
    Motion

    Raises
    ------
    ValueError
        For a model that is not linear and Gaussian, and as `gmr_gym.models.motion`.
    """
    if not (isinstance(transition_model, LinearModel) and isinstance(transition_model, GaussianModel)):
        raise ValueError(
            f"transition_model must be linear and Gaussian, got {type(transition_model).__name__}; there are "
            "LinearGaussianTransitionModel and CombinedLinearGaussianTransitionModel, such as of "
            "ConstantVelocity, Singer and KnownTurnRate"
        )
    F = transition_model.matrix(time_interval=interval)
    return motion(F, transition_model.covar(time_interval=interval))


def transition_model_of(motion: Motion) -> LinearGaussianTimeInvariantTransitionModel:
    """A motion model as Stone Soup has it, of the motion's own period whatever the interval.

    Raises
    ------
    ValueError
        For a motion with an offset, which is a control model there.
    """
    if motion.offset.any():
        raise ValueError(
            f"motion must have no offset, got {motion.offset.tolist()}: a transition model of Stone Soup has "
            "none; give its predictor a LinearControlModel"
        )
    return LinearGaussianTimeInvariantTransitionModel(transition_matrix=motion.F, covariance_matrix=motion.Q)


def sensor_of(measurement_model: Any, update: str = "debiased") -> Sensor | Radar:
    """A measurement model as a sensor, of states in the order of `state_order`.

    Parameters
    ----------
    measurement_model : LinearGaussian or CartesianToElevationBearingRange
    update : str
        Measurement update of a radar, one of `gmr_gym.models.radar.UPDATES`; "extended" is that of Stone
        Soup's extended Kalman filter.

    Returns
    -------
    Sensor or Radar

    Raises
    ------
    ValueError
        For another measurement model, with those that there are; for a radar that is turned or stands
        elsewhere than in the origin, or whose noise is correlated.
    """
    for state in getattr(measurement_model, "mapping", ()):
        if state is not None and not 0 <= state < measurement_model.ndim_state:
            raise ValueError(
                f"mapping of measurement_model must be of its {measurement_model.ndim_state} states, got "
                f"{tuple(measurement_model.mapping)}"
            )
    if isinstance(measurement_model, LinearGaussian):
        return sensor(measurement_model.matrix(), measurement_model.covar())
    if not isinstance(measurement_model, CartesianToElevationBearingRange):
        raise ValueError(
            f"measurement_model {type(measurement_model).__name__} has no sensor here; there are {SENSORS}; "
            "of other polar detections `recording_of` makes a recording, which `gmr_gym.recorded` tracks"
        )
    for name in ("translation_offset", "rotation_offset"):
        offset = np.asarray(getattr(measurement_model, name), float).ravel()
        if offset.any():
            raise ValueError(
                f"{name} of measurement_model must be zero, got {offset.tolist()}: the radar is the origin "
                "of the states"
            )
    R = np.asarray(measurement_model.covar(), float)
    if np.count_nonzero(R - np.diag(np.diag(R))):
        raise ValueError(f"noise_covar of measurement_model must be diagonal for a radar, got {R.tolist()}")
    return radar(np.sqrt(np.diag(R))[::-1], measurement_model.ndim_state, update)


def linear_sensor(measurement_model: Any) -> Sensor:
    """The sensor of a linear measurement model; ValueError for one that is not linear."""
    found = sensor_of(measurement_model)
    if not isinstance(found, Sensor):
        raise ValueError(
            f"measurement_model must be linear here, got {type(measurement_model).__name__}; a radar is for "
            "SingleTargetTracker"
        )
    return found


def measurement_model_of(sensor: MeasurementModel) -> Any:
    """A sensor as Stone Soup's measurement model.

    Raises
    ------
    ValueError
        For a sensor whose H measures anything but single states.
    """
    d = sensor.H.shape[1]
    if isinstance(sensor, Radar):
        return CartesianToElevationBearingRange(d, (0, 1, 2), np.diag(sensor.deviations[::-1] ** 2))
    if not ((sensor.H == 1).sum(axis=1) == 1).all() or np.count_nonzero(sensor.H) != len(sensor.H):
        raise ValueError(
            f"sensor.H must measure one state in each row, as LinearGaussian does, got {sensor.H.tolist()}"
        )
    return LinearGaussian(d, tuple(sensor.H.argmax(axis=1).tolist()), sensor.R)


def state_order(measurement_model: Any) -> np.ndarray:
    """Which of Stone Soup's states (d,) each state here is.

    The same for linear sensors. For a radar first the positions, which `mapping` names, and then the others.
    """
    d = measurement_model.ndim_state
    if isinstance(measurement_model, LinearModel):
        return np.arange(d)
    first = [*measurement_model.mapping]
    return np.array([*first, *(i for i in range(d) if i not in first)])


def reordered(p: Mixture, order: np.ndarray) -> Mixture:
    """The mixture with state `order[i]` as state i."""
    return Mixture(p.w, p.m[:, order], p.P[:, order[:, None], order])


def model_of(
    transition_model: Any,
    measurement_model: Any,
    prior: Any,
    interval: timedelta,
    *,
    prob_detect: float,
    prob_gate: float,
    clutter_spatial_density: float,
    model_probs: Any = None,
    mode_prior: Any = None,
    update: str = "debiased",
) -> Model:
    """The filter model that models of Stone Soup come to.

    Parameters
    ----------
    transition_model : TransitionModel or sequence of r TransitionModel
        Linear; several are the modes of an IMM.
    measurement_model : LinearGaussian or CartesianToElevationBearingRange
    prior : GaussianState or GaussianMixture
        One interval before the first scan; the weights of a mixture sum to 1.
    interval : timedelta
        From scan to scan.
    prob_detect, prob_gate : float
    clutter_spatial_density : float
        False alarms per unit volume of the detections' space.
    model_probs : array_like (r, r), optional
        Transition matrix of several models, see `switching_of`.
    mode_prior : array_like (r,), optional
        Probability of each model one interval before the first scan; by default all are equal.
    update : str
        As of `sensor_of`.

    Returns
    -------
    Model
        Of states in the order of `state_order`.

    Raises
    ------
    ValueError
        Naming the argument that has no counterpart, or as `gmr_gym.model`.
    """
    each = transition_model if isinstance(transition_model, Sequence) else [transition_model]
    start, found, order = (
        mixture_of(prior),
        sensor_of(measurement_model, update),
        state_order(measurement_model),
    )
    if start.m.shape[1] != len(order):
        raise ValueError(f"prior has {start.m.shape[1]} states, but measurement_model has {len(order)}")
    motions = [motion_of(one, interval) for one in each]
    for one in motions:
        if len(one.F) != len(order):
            raise ValueError(
                f"transition_model has {len(one.F)} states, but measurement_model has {len(order)}"
            )
    return model(
        tuple(Motion(F[np.ix_(order, order)], Q[np.ix_(order, order)], offset) for F, Q, offset in motions),
        found, float(prob_detect), float(prob_gate), float(clutter_spatial_density), reordered(start, order),
        switching_of(model_probs, len(each)), mode_prior,
    )  # fmt: skip


def switching_of(model_probs: Any, modes: int) -> np.ndarray:
    """The transition matrix of modes here: the transpose of theirs.

    Parameters
    ----------
    model_probs : array_like (r, r), or None for one model
        Row i holds the probabilities of each model after model i, as of Stone Soup's simulators that switch.
    modes : int
        r.

    Returns
    -------
    ndarray (r, r)

    Raises
    ------
    ValueError
        For another shape, and rows that do not sum to 1.
    """
    probs = np.eye(1) if model_probs is None else np.array(model_probs, float)
    if probs.shape != (modes, modes) or not np.allclose(probs.sum(axis=1), 1, rtol=0, atol=1e-9):
        raise ValueError(
            f"model_probs must be {modes} rows of {modes} probabilities that sum to 1, row i those after "
            f"model i, got {None if model_probs is None else probs.tolist()}"
        )
    return check_switching(probs.T, modes)
