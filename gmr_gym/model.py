"""What a tracker is told of the world, and nothing else."""

from typing import NamedTuple

from gmr_gym.kalman import Motion, Sensor
from gmr_gym.mixture import Mixture


class Model(NamedTuple):
    """All that a tracker may know before the first scan; `model` checks one."""

    motions: tuple[Motion, ...]  # the modes the target may move in; one for most scenarios
    sensor: Sensor
    detection_probability: float  # P_D
    gate_probability: float  # P_G
    clutter_density: float  # expected false detections per unit volume of the sensor's space
    prior: Mixture  # one period before the first scan


def model(
    motions: tuple[Motion, ...] | Motion,
    sensor: Sensor,
    detection_probability: float,
    gate_probability: float,
    clutter_density: float,
    prior: Mixture,
) -> Model:
    """Checked Model. Raises ValueError naming the argument for a probability outside (0, 1], a
    clutter density that is not positive, or motions, sensor and prior of unlike dimension."""
    motions = (motions,) if isinstance(motions, Motion) else tuple(motions)
    if not motions:
        raise ValueError("motions must hold at least one Motion")
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
    if not 0 < clutter_density < float("inf"):
        raise ValueError(
            f"clutter_density must be positive and finite, got {clutter_density}; where there is no "
            "clutter pass a very small density, so that a second detection has an explanation"
        )
    return Model(
        motions, sensor, float(detection_probability), float(gate_probability),
        float(clutter_density), prior,
    )  # fmt: skip


def check_probability(name: str, value: float) -> None:
    """Raise ValueError naming the argument unless value lies in (0, 1]."""
    if not 0 < value <= 1:
        raise ValueError(f"{name} must lie in (0, 1], got {value}")
