"""Times and durations in many forms, as seconds."""

from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np

from gmr_gym.points import check_unmasked

DECIMALS = {"s": 0, "ms": 3, "us": 6, "ns": 9, "ps": 12, "fs": 15, "as": 18}
EPOCH, MICROSECOND = datetime(1970, 1, 1, tzinfo=UTC), timedelta(microseconds=1)


def seconds(times, name: str = "times") -> np.ndarray:
    """Times as seconds.

    Parameters
    ----------
    times : array_like
        Numbers are seconds. Datetimes, datetime64 of any unit or datetime.datetime, become seconds since 1970
        in UTC; one without a time zone is taken as UTC. Time differences become their length.
    name : str
        Name of the argument, for messages.

    Returns
    -------
    ndarray of float
        A new array of the same shape. Equal times give equal floats, whatever their form.

    Raises
    ------
    ValueError
        Naming the argument, for anything else, for NaT, and for datetimes of which only some have a time
        zone.

    Examples
    --------
    >>> import numpy as np
    >>> from gmr_gym.evaluation.times import seconds
    >>> seconds(np.array(["1970-01-01T00:00:01.5"], "datetime64[ms]")).tolist()
    [1.5]
    """
    check_unmasked(name, times)
    array = np.asarray(times)
    if array.dtype.kind in "mM":
        return _counted(array, name)
    try:
        if array.dtype.kind == "O":
            return _of_objects(array, name)
        return array.astype(float, casting="same_kind")
    except (TypeError, OverflowError):
        raise ValueError(
            f"{name} must be seconds or datetimes (datetime64, datetime.datetime), got {times!r:.80}"
        ) from None


def duration(value, name: str) -> float:
    """A duration in seconds.

    Parameters
    ----------
    value : float, timedelta or timedelta64
        A number is in seconds.
    name : str
        Name of the argument, for messages.

    Returns
    -------
    float

    Raises
    ------
    ValueError
        Naming the argument, for anything else.
    """
    if isinstance(value, datetime | np.datetime64):
        raise ValueError(f"{name} must be seconds or a time difference, got the moment {value}")
    return float(seconds(value, name))


def _counted(array: np.ndarray, name: str) -> np.ndarray:
    """Seconds of datetime64 or timedelta64."""
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


def _of_objects(array: np.ndarray, name: str) -> np.ndarray:
    """Seconds of objects, datetimes or numbers; TypeError for others."""
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
        # those of pandas have nanoseconds as well
        return (value // MICROSECOND * 1000 + getattr(value, "nanoseconds", 0)) / 10**9
    if not isinstance(value, int | float | np.number):
        raise TypeError
    return float(value)
