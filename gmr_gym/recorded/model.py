"""What tracking assumes of targets, sensors and tracks: one record of numbers and names."""

import json
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.checks import check_choice
from gmr_gym.models.intervals import Mode, Modes, modes, stay_or_switch
from gmr_gym.recorded.detections import POLAR, SensorSpec

TRACKERS = ("pmb", "pda", "gnn", "mht", "phd")  # of the rows that all files of detections allow
Rule = float | tuple[int, int]  # an existence, or M of N


class TrackingModel(NamedTuple):
    """What tracking assumes; `tracking_model` makes a checked one.

    Attributes
    ----------
    sensors : tuple of SensorSpec
    low, high : tuple of float (p,)
        Corners of the box in which targets and clutter are, m.
    modes : tuple of Mode
        Motion models.
    stay_probability : float
        Probability that a target keeps its motion model for one second.
    max_speed : float
        Largest speed of a new target, m/s.
    survival_probability : float
        Probability that a target is there one second later.
    birth_rate : float
        Expected number of targets that appear in the box in one second.
    undetected : float
        Expected number of targets in the box before the first scan.
    gate_probability : float
        Probability that a target's detection is in its gate.
    confirm : float or tuple of int
        A track is confirmed when it exists with this probability, or when M of its last N looks had a
        detection.
    delete : float or tuple of int
        A confirmed track is deleted when it exists with less probability, or when M of its last N looks
        missed it.
    prune_existence : float
        A tentative track is deleted when it exists with less probability.
    max_coast : float
        A track is deleted when it has had no detection for so many seconds.
    min_speed : float
        A track is confirmed only when it has moved, and at least at this speed on average, m/s; 0 for all.
    max_tracks : int
        Most tracks; those of least existence are deleted.
    merge_distance : float
        Of two tracks within so many standard deviations of their difference, in position and velocity, the
        later one is deleted.
    learn_clutter : bool
        Whether the clutter is estimated from the detections of no track.
    tracker : str
        How detections are associated, a name of `TRACKERS`.
    """

    sensors: tuple[SensorSpec, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    modes: tuple[Mode, ...]
    stay_probability: float
    max_speed: float
    survival_probability: float
    birth_rate: float
    undetected: float
    gate_probability: float
    confirm: Rule
    delete: Rule
    prune_existence: float
    max_coast: float
    min_speed: float
    max_tracks: int
    merge_distance: float
    learn_clutter: bool
    tracker: str = "pmb"

    @property
    def axes(self) -> int:
        """Number of coordinates of a position."""
        return len(self.low)

    @property
    def volume(self) -> float:
        """Volume of the box, m^p."""
        return float(np.prod(np.subtract(self.high, self.low)))

    def bank(self) -> Modes:
        """The motion models for kernels."""
        return modes(self.modes, stay_or_switch(len(self.modes), self.stay_probability))


def tracking_model(
    sensors: Sequence[SensorSpec],
    low: Sequence[float],
    high: Sequence[float],
    *,
    motion: str | Sequence[Mode] = "imm",
    acceleration_deviation: float | tuple[float, ...] = (0.1, 3.0),
    stay_probability: float = 0.95,
    max_speed: float = 350.0,
    survival_probability: float = 0.999,
    birth_rate: float = 0.02,
    undetected: float = 1.0,
    gate_probability: float = 0.9999,
    confirm: Rule = 0.9,
    delete: Rule = (5, 5),
    prune_existence: float = 1e-5,
    max_coast: float = 60.0,
    min_speed: float = 0.0,
    max_tracks: int = 2000,
    merge_distance: float = 1.0,
    learn_clutter: bool = False,
    tracker: str = "pmb",
) -> TrackingModel:
    """Make a checked model of what is tracked.

    Parameters
    ----------
    sensors : sequence of SensorSpec
        Where a detection probability is NaN 0.9 is taken, for a number of false alarms one in a scan.
    low, high : sequence of float (p,)
        Corners of the box in which targets and clutter are, m; p is 2 or 3, as the sensors measure.
    motion : str or sequence of Mode
        `imm`: constant velocity of each `acceleration_deviation`. Otherwise a name of `intervals.MOTIONS`, of
        one deviation.
    acceleration_deviation : float or tuple of float
        What white noise adds to the velocity in one second, m/s.
    stay_probability, max_speed, survival_probability, birth_rate, undetected, gate_probability
        As in `TrackingModel`.
    confirm, delete, prune_existence, max_coast, min_speed, max_tracks, merge_distance, learn_clutter, tracker
        As in `TrackingModel`.

    Returns
    -------
    TrackingModel

    Raises
    ------
    ValueError
        Naming the parameter that is out of range.
    """
    if isinstance(motion, str):
        deviations = np.atleast_1d(np.asarray(acceleration_deviation, float)).tolist()
        name = "constant-velocity" if motion == "imm" else motion
        motion = [Mode(name, deviation) for deviation in (deviations if motion == "imm" else deviations[:1])]
    model = TrackingModel(
        tuple(_completed(spec, len(low)) for spec in sensors),
        tuple(map(float, low)), tuple(map(float, high)), tuple(Mode(*mode) for mode in motion),
        float(stay_probability), float(max_speed), float(survival_probability), float(birth_rate),
        float(undetected), float(gate_probability), _rule("confirm", confirm), _rule("delete", delete),
        float(prune_existence), float(max_coast), float(min_speed), int(max_tracks), float(merge_distance),
        bool(learn_clutter), tracker,
    )  # fmt: skip
    _check(model)
    model.bank()
    return model


def _completed(spec: SensorSpec, axes: int) -> SensorSpec:
    """The sensor with numbers for what is not known."""
    if spec.p != axes:
        raise ValueError(f"sensor {spec.name!r} measures {spec.p} coordinates, but the box has {axes}")
    if not all(0 < deviation < np.inf for deviation in spec.deviation):
        raise ValueError(f"deviation of sensor {spec.name!r} must be positive, got {spec.deviation}")
    probability = 0.9 if np.isnan(spec.detection_probability) else spec.detection_probability
    clutter = 1.0 if np.isnan(spec.clutter_per_scan) else spec.clutter_per_scan
    if not 0 < probability <= 1:
        raise ValueError(
            f"detection_probability of sensor {spec.name!r} must be in (0, 1], got {probability}"
        )
    if not 0 <= clutter < np.inf:
        raise ValueError(f"clutter_per_scan of sensor {spec.name!r} must be at least 0, got {clutter}")
    return spec._replace(
        position=tuple(map(float, spec.position)),
        deviation=tuple(map(float, spec.deviation)),
        detection_probability=float(probability),
        clutter_per_scan=float(clutter),
    )


def _rule(name: str, rule: Rule) -> Rule:
    """The checked rule: an existence, or M of N."""
    if isinstance(rule, (tuple, list)):
        m, n = rule
        if not 1 <= m <= n or m != int(m) or n != int(n):
            raise ValueError(f"{name} must be M of N with 1 <= M <= N, got {m} of {n}")
        return int(m), int(n)
    if not 0 < rule < 1:
        raise ValueError(f"{name} must be a probability of existence or (M, N), got {rule}")
    return float(rule)


def _check(model: TrackingModel) -> None:
    """ValueError for a number out of range."""
    check_choice("tracker", model.tracker, TRACKERS)
    for name in ("sensors", "modes"):
        if not getattr(model, name):
            raise ValueError(f"{name} must be at least one")
    if not np.less(model.low, model.high).all():
        raise ValueError(f"low must be less than high, got {model.low} and {model.high}")
    for name in ("stay_probability", "survival_probability", "gate_probability"):
        if not 0 < getattr(model, name) <= 1:
            raise ValueError(f"{name} must be in (0, 1], got {getattr(model, name)}")
    for name in ("max_speed", "max_coast", "max_tracks", "merge_distance"):
        if not getattr(model, name) > 0:
            raise ValueError(f"{name} must be positive, got {getattr(model, name)}")
    for name in ("birth_rate", "undetected", "prune_existence", "min_speed"):
        if not 0 <= getattr(model, name) < np.inf:
            raise ValueError(f"{name} must be at least 0, got {getattr(model, name)}")


def polar(spec: SensorSpec) -> bool:
    """Whether the sensor measures range and azimuth."""
    return spec.kind == POLAR


def as_text(model: TrackingModel) -> str:
    """The model as JSON."""
    return json.dumps(model)


def from_text(text: str) -> TrackingModel:
    """The model of `as_text`."""
    fields = TrackingModel(*(_tuples(value) for value in json.loads(text)))
    return fields._replace(
        sensors=tuple(SensorSpec(*spec) for spec in fields.sensors),
        modes=tuple(Mode(*mode) for mode in fields.modes),
    )


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value
