"""The filter model: what a tracker assumes about target, sensor and clutter."""

from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_density, check_probability
from gmr_gym.mixture import Mixture
from gmr_gym.models.kalman import Motion
from gmr_gym.models.radar import Radar, radar
from gmr_gym.models.sensing import MeasurementModel
from gmr_gym.models.switching import check_switching


class Model(NamedTuple):
    """Filter model: all that a tracker knows before the first scan. `model` makes a checked one.

    Attributes
    ----------
    motions : tuple of Motion
        Motion models, one for each mode of the target; a single one for most scenarios.
    sensor : MeasurementModel
    detection_probability : float
        P_D.
    gate_probability : float
        P_G.
    clutter_density : float
        Expected false alarms per scan and unit volume of the sensor's space.
    prior : Mixture
        Of the state one period before the first scan.
    switching : ndarray (r, r)
        Transition matrix of the modes; column p holds the probabilities of each mode after mode p.
    mode_prior : ndarray (r,)
        Probability of each mode one period before the first scan.
    """

    motions: tuple[Motion, ...]
    sensor: MeasurementModel
    detection_probability: float
    gate_probability: float
    clutter_density: float
    prior: Mixture
    switching: np.ndarray
    mode_prior: np.ndarray

    @property
    def motion(self) -> Motion:
        """The motion model, for trackers without modes; ValueError where there are several."""
        check_one_motion(self)
        return self.motions[0]


def model(
    motions: tuple[Motion, ...] | Motion,
    sensor: MeasurementModel,
    detection_probability: float,
    gate_probability: float,
    clutter_density: float,
    prior: Mixture,
    switching=None,
    mode_prior=None,
) -> Model:
    """Checked Model.

    Parameters
    ----------
    motions : Motion or tuple of Motion
        Motion models, one for each mode.
    sensor : MeasurementModel
    detection_probability : float
        P_D, in (0, 1].
    gate_probability : float
        P_G, in (0, 1].
    clutter_density : float
        Expected false alarms per scan and unit volume of the sensor's space, positive.
    prior : Mixture
        Of the state one period before the first scan; the weights sum to 1.
    switching : array_like (r, r), optional
        Transition matrix of the modes, column-stochastic; optional for one motion model only.
    mode_prior : array_like (r,), optional
        Probability of each mode one period before the first scan; by default all are equal.

    Raises
    ------
    ValueError
        Naming the argument, for a probability outside (0, 1], a clutter density that is not positive, a
        motion, sensor and prior of different dimensions, a prior that does not sum to 1, or a switching
        matrix whose columns are not distributions.

    Examples
    --------
    >>> import numpy as np
    >>> from gmr_gym.mixture import gaussian
    >>> from gmr_gym.models import constant_velocity, position_sensor
    >>> prior = gaussian([0.0, 0.0, 1.0, 0.0], np.eye(4))
    >>> m = model(constant_velocity(1.0, 0.5), position_sensor(10.0), 0.9, 0.99, 1e-4, prior)
    >>> len(m.motions), m.mode_prior.tolist()
    (1, [1.0])
    """
    motions = (motions,) if isinstance(motions, Motion) else tuple(motions)
    d = sensor.H.shape[1]
    for i, motion in enumerate(motions):
        if len(motion.F) != d:
            raise ValueError(f"motions[{i}] has {len(motion.F)} states, but sensor.H has {d} columns")
    if prior.m.shape[1] != d:
        raise ValueError(f"prior has {prior.m.shape[1]} states, but sensor.H has {d} columns")
    if abs(prior.w.sum() - 1) > 1e-9:
        raise ValueError(f"prior weights sum to {prior.w.sum():.6g}; pass normalised(prior)")
    check_probability("detection_probability", detection_probability)
    check_probability("gate_probability", gate_probability)
    check_density("clutter_density", clutter_density)
    return Model(
        motions, sensor, float(detection_probability), float(gate_probability), float(clutter_density), prior,
        *check_modes(len(motions), switching, mode_prior),
    )  # fmt: skip


def with_radar_update(model: Model, update: str) -> Model:
    """The model with another measurement update of its radar.

    Parameters
    ----------
    model : Model
    update : str
        One of `gmr_gym.models.radar.UPDATES`.

    Raises
    ------
    ValueError
        For an unknown update, and for a sensor that is not a radar.
    """
    sensor = model.sensor
    if not isinstance(sensor, Radar):
        raise ValueError(f"update {update!r} needs a radar; the model's sensor is linear and has one update")
    return model._replace(sensor=radar(sensor.deviations, sensor.H.shape[1], update))


def check_one_motion(model: Model) -> None:
    """Raise ValueError if there are several motion models, for trackers without modes."""
    if len(model.motions) > 1:
        raise ValueError(
            f"this tracker knows one motion and the model has {len(model.motions)}: choose one with modes, "
            "such as imm-pda, imm-mht or mmg"
        )


def check_modes(modes: int, switching, mode_prior) -> tuple[np.ndarray, np.ndarray]:
    """Transition matrix (r, r) and prior probabilities (r,) of the modes of a model, equal by default;
    ValueError where they do not fit."""
    if modes < 1:
        raise ValueError("motions must hold at least one Motion")
    if switching is None and modes > 1:
        raise ValueError(f"switching must be given for {modes} motions")
    switching = check_switching([[1.0]] if switching is None else switching, modes)
    if mode_prior is None:
        return switching, np.full(modes, 1 / modes)
    mode_prior = np.array(mode_prior, float)
    if mode_prior.shape != (modes,) or not (mode_prior >= 0).all() or abs(mode_prior.sum() - 1) > 1e-9:
        raise ValueError(f"mode_prior must be {modes} probabilities that sum to 1, got {mode_prior.tolist()}")
    return switching, mode_prior
