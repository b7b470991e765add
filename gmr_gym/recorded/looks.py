"""Scans as they come, checked before a tracker sees them."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gmr_gym.models.positions import Look
from gmr_gym.recorded.model import TrackingModel, polar


def checked_look(
    model: TrackingModel,
    last: float,
    time: float,
    z: Any,
    range_rate: ArrayLike | None,
    times: ArrayLike | None,
    sensor: int,
    origin: ArrayLike | None,
) -> Look:
    """The look of a scan after that of the time `last`; all else as in `LiveTracker.update`."""
    if sensor not in range(len(model.sensors)):
        raise ValueError(f"sensor must be an index in 0..{len(model.sensors) - 1}, got {sensor}")
    spec, p, k = model.sensors[sensor], model.axes, len(z)
    z = np.array(z, float) if k else np.empty((0, p))
    if z.shape != (k, p) or not np.isfinite(z).all():
        raise ValueError(f"z must be finite with shape (k, {p}), got shape {z.shape}")
    if not last <= time < np.inf:
        raise ValueError(f"time must be finite and not go back: got {time} after {last}")
    at = _of_each("times", np.full(k, float(time)) if times is None else times, k)
    rate = _of_each("range_rate", np.full(k, np.nan) if range_rate is None else range_rate, k)
    if not np.isfinite(at).all():
        raise ValueError("times must be finite")
    if not (spec.range_rate_deviation > 0 or np.isnan(rate).all()):
        raise ValueError(f"sensor {spec.name!r} needs a range_rate_deviation for range rates")
    place = np.array(spec.position if origin is None else origin, float)
    if place.shape not in ((3,), (k, 3)) or not np.isfinite(place).all():
        raise ValueError(f"origin must be finite with shape (3,) or ({k}, 3), got shape {place.shape}")
    deviation = np.array([*spec.deviation, spec.range_rate_deviation])
    return Look(float(time), at, z, rate, np.broadcast_to(place, (k, 3)).copy(), deviation, polar(spec))


def _of_each(name: str, values: ArrayLike, k: int) -> np.ndarray:
    """A number of each detection."""
    column = np.array(values, float)
    if column.shape != (k,):
        raise ValueError(f"{name} must have shape ({k},), one for each detection, got {column.shape}")
    return column
