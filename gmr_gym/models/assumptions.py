"""What a tracker assumes of target, sensor and clutter, changed number by number."""

from collections.abc import Callable, Mapping
from numbers import Real
from typing import Any

import numpy as np

from gmr_gym.checks import check_probability
from gmr_gym.models.kalman import Sensor
from gmr_gym.models.model import Model
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.models.radar import radar

PREFIX = "assumed_"
LEAST, MOST = 1e-12, 1e12  # factors, whose squares neither vanish nor overflow
AnyModel = Model | MultiTargetModel


def with_assumptions(model: AnyModel, assumed: Mapping[str, Any]) -> Any:
    """The filter model with other numbers.

    Parameters
    ----------
    model : Model or MultiTargetModel
    assumed : mapping of str to float
        `assumed_process_noise` and `assumed_measurement_noise`, factors on the standard deviations of the
        noise; `assumed_clutter`, a factor on the clutter density; `assumed_detection_probability`;
        `assumed_gate_probability` of one target, `assumed_survival_probability` of many; `assumed_stay`, of
        several motions, the probability that a mode lasts from scan to scan: the others keep their ratios.

    Returns
    -------
    Model or MultiTargetModel

    Raises
    ------
    ValueError
        Naming what the model has not, and a number out of range.

    Examples
    --------
    >>> from gmr_gym.scenarios.dortenzio import turning_target
    >>> model = turning_target().model
    >>> doubled = with_assumptions(model, {"assumed_process_noise": 2.0})
    >>> float(doubled.motion.Q[0, 0] / model.motion.Q[0, 0])
    4.0
    """
    known = assumptions(model)
    for name, value in assumed.items():
        if name not in known:
            raise ValueError(f"the filter model has no {name}; it has {', '.join(known)}")
        if isinstance(value, bool) or not isinstance(value, Real):
            raise ValueError(f"{name} must be a number, got {value!r}")
        model = CHANGES[name](model, float(value))
    return model


def assumptions(model: AnyModel) -> dict[str, float]:
    """What `with_assumptions` can change of a filter model, by name, as it is: 1 of factors.

    Parameters
    ----------
    model : Model or MultiTargetModel

    Returns
    -------
    dict of str to float
    """
    found = {f"{PREFIX}process_noise": 1.0, f"{PREFIX}measurement_noise": 1.0, f"{PREFIX}clutter": 1.0}
    for field in ("detection_probability", "gate_probability", "survival_probability"):
        value = getattr(model, field, None)
        if isinstance(value, Real):  # of many targets P_D may be a function
            found[f"{PREFIX}{field}"] = float(value)
    if len(model.motions) > 1:
        found[f"{PREFIX}stay"] = float(np.diag(model.switching).mean())
    return found


def _process_noise(model: AnyModel, factor: float) -> AnyModel:
    _check_factor("process_noise", factor)
    return model._replace(motions=tuple(one._replace(Q=factor**2 * one.Q) for one in model.motions))


def _measurement_noise(model: AnyModel, factor: float) -> AnyModel:
    _check_factor("measurement_noise", factor)
    sensor: Any = model.sensor
    if isinstance(sensor, Sensor):
        return model._replace(sensor=sensor._replace(R=factor**2 * sensor.R))
    return model._replace(sensor=radar(factor * sensor.deviations, sensor.H.shape[1], sensor.update))


def _clutter(model: AnyModel, factor: float) -> AnyModel:
    _check_factor("clutter", factor)
    if isinstance(model, Model):
        return model._replace(clutter_density=factor * model.clutter_density)
    parts = {field: getattr(model.clutter, field) for field in ("gaussians", "ellipses")}
    thicker = {field: part._replace(w=factor * part.w) for field, part in parts.items()}
    return model._replace(clutter=model.clutter._replace(uniform=factor * model.clutter.uniform, **thicker))


def _probability(field: str) -> Callable[[AnyModel, float], AnyModel]:
    def changed(model: Any, value: float) -> AnyModel:
        check_probability(f"{PREFIX}{field}", value)
        return model._replace(**{field: value})

    return changed


def _stay(model: AnyModel, probability: float) -> AnyModel:
    if not 0 <= probability < 1:
        raise ValueError(f"{PREFIX}stay must lie in [0, 1), got {probability}")
    leaving = model.switching * (1 - np.eye(len(model.motions)))
    total = leaving.sum(axis=0)
    equal = (1 - np.eye(len(total))) / (len(total) - 1)  # where a mode was never left
    leaving = np.where(total > 0, leaving / np.where(total > 0, total, 1), equal)
    return model._replace(switching=probability * np.eye(len(total)) + (1 - probability) * leaving)


def _check_factor(name: str, factor: float) -> None:
    if not LEAST <= factor <= MOST:
        raise ValueError(
            f"{PREFIX}{name}, a factor, must be positive, from {LEAST:g} to {MOST:g}, got {factor}"
        )


CHANGES: dict[str, Callable[[Any, float], Any]] = {
    f"{PREFIX}process_noise": _process_noise,
    f"{PREFIX}measurement_noise": _measurement_noise,
    f"{PREFIX}clutter": _clutter,
    f"{PREFIX}stay": _stay,
    **{f"{PREFIX}{field}": _probability(field)
       for field in ("detection_probability", "gate_probability", "survival_probability")},
}  # fmt: skip
