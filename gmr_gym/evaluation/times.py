"""Moments and durations as they are given from outside, in seconds."""

from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from gmr_gym.points import check_unmasked

DECIMALS = {"s": 0, "ms": 3, "us": 6, "ns": 9, "ps": 12, "fs": 15, "as": 18}
EPOCH, MICROSECOND = datetime(1970, 1, 1, tzinfo=UTC), timedelta(microseconds=1)


def seconds(times, name: str = "times") -> np.ndarray:
    """Times of any shape as floats of their own: numbers are seconds; of datetimes, datetime64 of any unit or
    datetime.datetime, the seconds since 1970 in UTC, for which one without a time zone is taken; of time
    differences their length. What is the same moment is the same float.

    ValueError naming the argument for anything else, for what is not a time, and for datetimes of which some
    have a time zone and some have none."""
    check_unmasked(name, times)
    array = np.asarray(times)
    if array.dtype.kind in "mM":
        return _counted(array, name)
    try:
        if array.dtype.kind == "O":
            return _told(array, name)
        return array.astype(float, casting="same_kind")
    except (TypeError, OverflowError):
        raise ValueError(
            f"{name} must be seconds or datetimes (datetime64, datetime.datetime), got {times!r:.80}"
        ) from None


def duration(value, name: str) -> float:
    """One length of time, a number of seconds or a time difference, in seconds; ValueError naming the
    argument for anything else."""
    if isinstance(value, datetime | np.datetime64):
        raise ValueError(f"{name} must be seconds or a time difference, got the moment {value}")
    return float(seconds(value, name))


def _counted(array: np.ndarray, name: str) -> np.ndarray:
    """Of datetime64 or timedelta64."""
    for i in np.flatnonzero(np.isnat(array))[:1]:
        raise ValueError(f"{name} must be given in full, but number {i} is NaT, not a time")
    if np.datetime_data(array.dtype)[0] not in DECIMALS:
        try:
            array = array.astype(f"{array.dtype.kind}8[s]", casting="safe")
        except TypeError:
            raise ValueError(f"{name} in {array.dtype} have no length in seconds") from None
    unit, step = np.datetime_data(array.dtype)
    scale = 10 ** DECIMALS[unit]
    # a quotient of whole numbers is rounded once, whatever the unit
    found = [count * step / scale for count in array.astype(np.int64).ravel().tolist()]
    return np.array(found, float).reshape(array.shape)


def _told(array: np.ndarray, name: str) -> np.ndarray:
    """Of objects, datetimes or numbers; TypeError for others."""
    values = array.ravel().tolist()
    moments = [value for value in values if isinstance(value, datetime)]
    if len({value.tzinfo is None for value in moments}) > 1:
        raise ValueError(f"{name} must all have a time zone, or none")
    return np.array([_one(value, name) for value in values], float).reshape(array.shape)


def _one(value: Any, name: str) -> float:
    if isinstance(value, np.datetime64 | np.timedelta64):
        return float(_counted(np.asarray(value), name))
    if isinstance(value, datetime):
        value = (value if value.tzinfo else value.replace(tzinfo=UTC)) - EPOCH
    if isinstance(value, timedelta):
        # those of pandas know nanoseconds besides
        return (value // MICROSECOND * 1000 + getattr(value, "nanoseconds", 0)) / 10**9
    if not isinstance(value, int | float | np.number):
        raise TypeError
    return float(value)
