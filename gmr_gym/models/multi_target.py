"""The filter model of several targets.

An intensity is a density whose integral is an expected number; its weights are never normalised.
"""

from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_covariance, check_density, check_probability
from gmr_gym.deprecated import warn_renamed
from gmr_gym.mixture import Mixture, checked
from gmr_gym.models.clutter import Clutter, no_components
from gmr_gym.models.kalman import Motion, Sensor


class MultiTargetModel(NamedTuple):
    """Filter model of several targets: all that a tracker knows before the first scan.
    `multi_target_model` makes a checked one.

    Attributes
    ----------
    motion : Motion
    sensor : Sensor
    detection_probability : float
        P_D.
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
    """

    motion: Motion
    sensor: Sensor
    detection_probability: float
    survival_probability: float
    births: Mixture
    spawn_weight: float
    spawn_covariance: np.ndarray
    clutter: Clutter
    initial: Mixture


def multi_target_model(
    motion: Motion,
    sensor: Sensor,
    detection_probability: float,
    survival_probability: float,
    births: Mixture,
    clutter: Clutter,
    spawn_weight: float = 0.0,
    spawn_covariance=None,
    *,
    initial: Mixture | None = None,
) -> MultiTargetModel:
    """Checked MultiTargetModel.

    Parameters
    ----------
    motion : Motion
    sensor : Sensor
        Linear.
    detection_probability : float
        P_D, in (0, 1].
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

    Raises
    ------
    ValueError
        Naming the argument, for a probability outside (0, 1], a shape that does not fit, an invalid
        intensity, or clutter without a uniform part or a finite box.
    """
    d = len(motion.F)
    if not isinstance(sensor, Sensor):
        raise ValueError(f"sensor must be linear, a Sensor of positions, got a {type(sensor).__name__}")
    if sensor.H.shape[1] != d:
        raise ValueError(f"sensor.H has {sensor.H.shape[1]} columns, but the motion has {d} states")
    check_probability("detection_probability", detection_probability)
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
        motion, sensor, float(detection_probability), float(survival_probability), births,
        float(spawn_weight), spread, clutter, initial,
    )  # fmt: skip


def __getattr__(name: str):
    former = {"population": "multi_target_model", "Population": "MultiTargetModel"}
    if name in former:
        warn_renamed(name, former[name])
        return globals()[former[name]]
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
