"""Detections of a file or of arrays: the records that reading makes and tracking takes, in SI units."""

from collections.abc import Sequence
from datetime import datetime
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

CARTESIAN, POLAR = "cartesian", "polar"


class SensorSpec(NamedTuple):
    """A sensor of a file; NaN is not known."""

    name: str
    kind: str = CARTESIAN  # or polar
    position: tuple[float, ...] = (0.0, 0.0, 0.0)  # m, local; of one that moves see `Detections.origin`
    deviation: tuple[float, ...] = (np.nan, np.nan)  # (p,) of what it measures: m, or m, rad[, rad]
    range_rate_deviation: float = np.nan  # m/s
    detection_probability: float = np.nan
    clutter_per_scan: float = np.nan
    rotation_period: float = np.nan  # s
    clutter_density: float = np.nan  # false alarms a scan per m^2 (m^3 in space), where given instead

    @property
    def p(self) -> int:
        """How many coordinates it measures, without the range rate."""
        return len(self.deviation)


class Detections(NamedTuple):
    """Detections in order of time, and the looks that detected nothing.

    Local coordinates are x east, y north, z up, m. An azimuth is counted from the x axis, counter-clockwise.
    Sensors of a file may be of different kinds: of a row only the first `p` columns of `z` are measured, in
    the coordinates of its sensor, and the others are NaN.
    """

    time: np.ndarray  # (n,) s since the first row
    z: np.ndarray  # (n, p) m in local coordinates, or range m, azimuth rad[, elevation rad] from the sensor
    range_rate: np.ndarray  # (n,) m/s, NaN where not measured
    origin: np.ndarray  # (n, 3) m, where the sensor was; Cartesian `z` is absolute all the same
    sensor: np.ndarray  # (n,) int, index into `sensors`
    scan: np.ndarray  # (n,) int, number of the scan where the file says it, else -1
    identity: np.ndarray  # (n,) object, str or None
    truth: np.ndarray  # (n,) object, str or None: the target it is of, for evaluation only
    row: np.ndarray  # (n,) int, line or record of the input, from 1
    metadata: dict[str, list]  # columns without a role, n entries each, as they stand in the file
    empty_time: np.ndarray  # (e,) s, looks that detected nothing
    empty_sensor: np.ndarray  # (e,) int
    sensors: tuple[SensorSpec, ...]
    coordinates: tuple[str, ...]  # names of the columns of `z`, as in the input
    start: datetime | None = None  # UTC, of time 0
    reference: tuple[float, float, float] | None = None  # of the origin: deg, deg, m
    zero: float = 0.0  # s, of time 0 in the input's own count
    remarks: tuple[str, ...] = ()  # what was dropped, sorted, converted, assumed

    @property
    def kind(self) -> str:
        """What all sensors measure, `cartesian` or `polar`; `mixed` where they differ."""
        kinds = {spec.kind for spec in self.sensors}
        return kinds.pop() if len(kinds) == 1 else "mixed"


def from_arrays(
    time: ArrayLike,
    z: ArrayLike,
    *,
    range_rate: ArrayLike | None = None,
    sensor: ArrayLike | None = None,
    identity: Sequence | None = None,
    sensors: Sequence[SensorSpec] | None = None,
    **fields: Any,
) -> Detections:
    """Detections from arrays, with what is not given absent.

    Parameters
    ----------
    time : array_like (n,)
        s, not decreasing.
    z : array_like (n, p)
        m, or range m, azimuth rad[, elevation rad].
    range_rate : array_like (n,), optional
        m/s.
    sensor : array_like (n,) of int, optional
        Index into `sensors`; 0 unless given.
    identity : sequence of n str or None, optional
    sensors : sequence of SensorSpec, optional
        One Cartesian sensor unless given.
    **fields
        Other fields of `Detections`.

    Returns
    -------
    Detections

    Raises
    ------
    ValueError
        Naming the argument whose length differs from that of `time`, or a time that goes back.

    Examples
    --------
    >>> seen = from_arrays([0.0, 0.0, 1.5], [[1, 2], [3, 4], [5, 6]])
    >>> seen.kind, seen.row.tolist()
    ('cartesian', [1, 2, 3])
    """
    time, z = np.array(time, float), np.array(z, float)
    n = len(time)
    if z.ndim != 2 or len(z) != n:
        raise ValueError(f"z must have shape ({n}, p), a row for each time, got {z.shape}")
    for i in np.flatnonzero(np.diff(time) < 0)[:1]:
        raise ValueError(f"time must not decrease, but {time[i + 1]} follows {time[i]}")
    specs = tuple(sensors or [SensorSpec("", deviation=(np.nan,) * z.shape[1])])
    which = np.zeros(n, int) if sensor is None else np.array(sensor, int)
    given = {
        "range_rate": np.full(n, np.nan) if range_rate is None else np.array(range_rate, float),
        "origin": np.array([spec.position for spec in specs], float)[which],
        "sensor": which,
        "scan": np.full(n, -1),
        "identity": objects(identity or [None] * n),
        "truth": objects([None] * n),
        "row": np.arange(1, n + 1),
        "metadata": {},
        "empty_time": np.empty(0),
        "empty_sensor": np.empty(0, int),
        "coordinates": tuple("xyz"[: z.shape[1]]),
    } | fields
    for name in ("range_rate", "origin", "sensor", "scan", "identity", "truth", "row"):
        given[name] = np.asarray(given[name])
        if len(given[name]) != n:
            raise ValueError(f"{name} must have {n} entries, one for each time, got {len(given[name])}")
    return Detections(time=time, z=z, sensors=specs, **given)


def chosen(found: Detections, rows: np.ndarray) -> Detections:
    """The detections of these rows, indices or a mask (n,), in their order."""
    rows = np.arange(len(found.time))[rows]
    each = ("time", "z", "range_rate", "origin", "sensor", "scan", "identity", "truth", "row")
    kept = {name: [column[i] for i in rows.tolist()] for name, column in found.metadata.items()}
    return found._replace(**{name: getattr(found, name)[rows] for name in each}, metadata=kept)


def named(values: np.ndarray) -> np.ndarray:
    """Mask (n,) of the identities that are there."""
    return np.array(values != np.array(None), bool)


def numbered(values: np.ndarray) -> np.ndarray:
    """Numbers (n,) of identities in order of their first row, -1 for none."""
    cells = values.tolist()
    kinds = [kind for kind in dict.fromkeys(cells) if kind is not None]
    numbers = {None: -1} | {kind: number for number, kind in enumerate(kinds)}
    return np.fromiter(map(numbers.__getitem__, cells), int, len(cells))


def objects(values: Sequence) -> np.ndarray:
    """A one-dimensional array of objects."""
    array = np.empty(len(values), object)
    array[:] = values
    return array
