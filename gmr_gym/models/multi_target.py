"""The filter model of several targets.

An intensity is a density whose integral is an expected number; its weights are never normalised.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.checks import check_covariance, check_density, check_probability
from gmr_gym.deprecated import warn_renamed
from gmr_gym.mixture import Mixture, checked
from gmr_gym.models.clutter import Clutter, no_components
from gmr_gym.models.kalman import Motion, Sensor
from gmr_gym.models.model import check_modes
from gmr_gym.models.radar import Radar
from gmr_gym.models.sensing import MeasurementModel


class MultiTargetModel(NamedTuple):
    """Filter model of several targets: all that a tracker knows before the first scan.
    `multi_target_model` makes a checked one.

    Attributes
    ----------
    motions : tuple of Motion
        Motion models, one for each mode of a target; a single one for most scenarios.
    sensor : MeasurementModel
    detection_probability : float or callable
        P_D, or a function of states (n, d) that returns it (n,).
    survival_probability : float
        P_S, of a target from scan to scan.
    births : Mixture
        Intensity of the targets born in a scan.
    spawn_weight : float
        Expected number of targets that each target spawns in a scan.
    spawn_covariance : ndarray (d, d)
        Covariance of a spawned target about the prediction of its parent.
    clutter : Clutter
        Intensity of the false alarms.
    initial : Mixture
        Intensity of the targets that are there one period before the first scan.
    switching : ndarray (r, r)
        Transition matrix of the modes; column p holds the probabilities of each mode after mode p.
    mode_prior : ndarray (r,)
        Probability of each mode of a target that is new.
    """

    motions: tuple[Motion, ...]
    sensor: Any  # trackers that take one kind alone say so when they are made, see `check_plain`
    detection_probability: Any
    survival_probability: float
    births: Mixture
    spawn_weight: float
    spawn_covariance: np.ndarray
    clutter: Clutter
    initial: Mixture
    switching: np.ndarray
    mode_prior: np.ndarray

    @property
    def motion(self) -> Motion:
        """The motion model, for trackers without modes; ValueError where there are several."""
        if len(self.motions) > 1:
            raise ValueError(
                f"this tracker knows one motion and the model has {len(self.motions)}: choose one with "
                "modes, such as jipda or pmb"
            )
        return self.motions[0]

    def detected(self, x: np.ndarray) -> np.ndarray:
        """P_D (n,) of targets in states x (n, d).

        Raises
        ------
        ValueError
            Where a function that was given for it returns anything but probabilities (n,).
        """
        given = self.detection_probability
        if not callable(given):
            return np.full(len(x), given)
        out = np.asarray(given(x), float)
        if out.shape != (len(x),) or not ((out >= 0) & (out <= 1)).all():
            raise ValueError(
                f"detection_probability must return {len(x)} probabilities for as many states, got {out}"
            )
        return out


def multi_target_model(
    motion: Motion | tuple[Motion, ...],
    sensor: MeasurementModel,
    detection_probability: float | Callable[[np.ndarray], np.ndarray],
    survival_probability: float,
    births: Mixture,
    clutter: Clutter,
    spawn_weight: float = 0.0,
    spawn_covariance=None,
    *,
    initial: Mixture | None = None,
    switching=None,
    mode_prior=None,
) -> MultiTargetModel:
    """Checked MultiTargetModel.

    Parameters
    ----------
    motion : Motion or tuple of Motion
        Motion model, or one for each mode of a target.
    sensor : Sensor or Radar
        The trackers that take a radar say so.
    detection_probability : float or callable
        P_D, in (0, 1], or a function of states (n, d) that returns it (n,), for the trackers that take one.
    survival_probability : float
        P_S, in (0, 1].
    births : Mixture
        Intensity of the targets born in a scan.
    clutter : Clutter
        Intensity of the false alarms, with a positive uniform part over a finite box.
    spawn_weight : float
        Expected number of targets that each target spawns in a scan.
    spawn_covariance : array_like (d, d), optional
        Covariance of a spawned target about the prediction of its parent; by default the identity.
    initial : Mixture, optional
        Intensity of the targets that are there one period before the first scan; by default there are none.
    switching : array_like (r, r), optional
        Transition matrix of the modes, column-stochastic; optional for one motion model only.
    mode_prior : array_like (r,), optional
        Probability of each mode of a target that is new; by default all are equal.

    Raises
    ------
    ValueError
        Naming the argument, for a probability outside (0, 1], a shape that does not fit, an invalid
        intensity, clutter without a uniform part or a finite box, or a switching matrix whose columns are not
        distributions.
    """
    motions = (motion,) if isinstance(motion, Motion) else tuple(motion)
    if not isinstance(sensor, Sensor | Radar):
        raise ValueError(f"sensor must be a Sensor or a Radar, got a {type(sensor).__name__}")
    d = sensor.H.shape[1]
    for one in motions:
        if len(one.F) != d:
            raise ValueError(f"sensor.H has {d} columns, but the motion has {len(one.F)} states")
    switching, mode_prior = check_modes(len(motions), switching, mode_prior)
    if not callable(detection_probability):
        check_probability("detection_probability", detection_probability)
        detection_probability = float(detection_probability)
    check_probability("survival_probability", survival_probability)
    births = checked(births, "births.")
    initial = no_components(d) if initial is None else checked(initial, "initial.")
    for name, intensity in (("births", births), ("initial", initial)):
        if intensity.m.shape[1] != d:
            raise ValueError(f"{name} have {intensity.m.shape[1]} states, but the motion has {d}")
    if not 0 <= spawn_weight < np.inf:
        raise ValueError(f"spawn_weight must be non-negative and finite, got {spawn_weight}")
    spread = np.eye(d) if spawn_covariance is None else np.array(spawn_covariance, float)
    if spread.shape != (d, d):
        raise ValueError(f"spawn_covariance must have shape {(d, d)}, got {spread.shape}")
    check_covariance("spawn_covariance", spread)
    finite = np.isfinite(clutter.low).all() and np.isfinite(clutter.high).all()
    if len(clutter.low) != len(sensor.H) or not (finite and (clutter.low < clutter.high).all()):
        raise ValueError(
            f"clutter must be over a finite box of {len(sensor.H)} sides, got {clutter.low} to {clutter.high}"
        )
    clutter = clutter._replace(
        gaussians=checked(clutter.gaussians, "clutter.gaussians."),
        ellipses=checked(clutter.ellipses, "clutter.ellipses."),
    )
    if not 0 < clutter.uniform < np.inf:
        raise ValueError(
            "clutter.uniform must be positive and finite, got "
            f"{clutter.uniform}: a detection far from all targets must have a density as a false alarm"
        )
    with np.errstate(all="ignore"):
        density = clutter.uniform / clutter.volume
    check_density("clutter.uniform over the volume of its box", density)
    return MultiTargetModel(
        motions, sensor, detection_probability, float(survival_probability), births,
        float(spawn_weight), spread, clutter, initial, switching, mode_prior,
    )  # fmt: skip


def is_plain(model: MultiTargetModel) -> bool:
    """Whether the model has one motion, a linear sensor and a constant P_D."""
    linear, varying = isinstance(model.sensor, Sensor), callable(model.detection_probability)
    return len(model.motions) == 1 and linear and not varying


def check_plain(model: MultiTargetModel, tracker: str) -> None:
    """Raise ValueError unless the model has one motion, a linear sensor and a constant P_D, for trackers that
    take no other."""
    model.motion  # noqa: B018, a ValueError where there are several
    check_linear(model, tracker)
    if callable(model.detection_probability):
        raise ValueError(f"{tracker} needs a constant detection_probability, got a function of the state")


def check_linear(model: MultiTargetModel, tracker: str) -> None:
    """Raise ValueError unless the model has a linear sensor, for trackers that take no radar."""
    if not isinstance(model.sensor, Sensor):
        raise ValueError(f"{tracker} needs a linear sensor, a Sensor of positions, got a Radar")


def __getattr__(name: str):
    former = {"population": "multi_target_model", "Population": "MultiTargetModel"}
    if name in former:
        warn_renamed(name, former[name])
        return globals()[former[name]]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
