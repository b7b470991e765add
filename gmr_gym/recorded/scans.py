"""Detections cut into scans: by equal times, a column, the turns of an antenna, reports, or a window."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import _check_positive, check_choice
from gmr_gym.recorded.detections import POLAR, Detections, SensorSpec, named

TIMES, COLUMN, TURNS, REPORTS, WINDOW = WAYS = ("times", "column", "turns", "reports", "window")
TURN = 2 * np.pi
FOLLOWED = 0.05  # share of each row's phase error by which the antenna's phase is corrected
SPREAD = 0.1  # of a turn: phases that spread more are not of an antenna of this period
SPARSE = 1000  # turns a row: more are of a period that is mistaken
SINGLE = 1.5  # rows a time, on average, below which rows with identities are reports of their own


class Scan(NamedTuple):
    """Detections of one look of one sensor over what it covers."""

    time: float  # s, of the whole scan: its last row
    first: float  # s, of its first row
    last: float  # s, of its last row
    rows: np.ndarray  # (k,) int, indices into `Detections`, in order of time
    sensor: int
    azimuths: tuple[float, float] | None = None  # rad, from and to, of a sensor that turns


def cut(found: Detections, by: str | None = None, window: float | None = None) -> list[Scan]:
    """Scans of detections, of all sensors, in order of time.

    Parameters
    ----------
    found : Detections
    by : str, optional
        `times`: rows of one time are a scan. `column`: the scan column. `turns`: a turn of the antenna, by
        the sensor's rotation period. `reports`: every row by itself. `window`: rows within `window` of the
        first.
        By default the first that there is of scan column, window, rotation period, and identities at times
        of their own; else equal times.
    window : float, optional
        s.

    Returns
    -------
    list of Scan
        Looks that detected nothing are scans without rows. A turn in which nothing was detected is one too.

    Raises
    ------
    ValueError
        For a way to which the detections give nothing.

    Examples
    --------
    >>> from gmr_gym.recorded.detections import from_arrays
    >>> [scan.rows.tolist() for scan in cut(from_arrays([0, 0, 1.5], [[1, 2], [3, 4], [5, 6]]))]
    [[0, 1], [2]]
    """
    if by is not None:
        check_choice("by", by, WAYS)
    if window is not None:
        _check_positive(window=window)
    if by == WINDOW and window is None:
        raise ValueError("scans by a window need its length; give --scan-window SECONDS")
    scans: list[Scan] = []
    for i, spec in enumerate(found.sensors):
        rows = np.flatnonzero(found.sensor == i)
        way = by or _usual(found, rows, spec, window)
        scans += _scans(found, rows, i, spec, way, window)
        looks = found.empty_time[found.empty_sensor == i].tolist()
        scans += [Scan(time, time, time, np.empty(0, int), i) for time in looks]
    return sorted(scans, key=lambda scan: (scan.time, scan.sensor))


def equal_times(found: Detections, scans: list[Scan]) -> tuple[np.ndarray, list[np.ndarray]]:
    """Times (T,) of scans, s, and their detections, T arrays (k, p): what a tracker of scans takes."""
    return np.array([scan.time for scan in scans]), [found.z[scan.rows] for scan in scans]


def _usual(found: Detections, rows: np.ndarray, spec: SensorSpec, window: float | None) -> str:
    numbered = found.scan[rows] >= 0
    if numbered.any():
        if not numbered.all():
            raise ValueError(
                f"{(~numbered).sum()} of {len(rows)} rows of sensor {spec.name!r} have no scan; leave them "
                "out with --where, or --scan"
            )
        return COLUMN
    if window is not None:
        return WINDOW
    if spec.rotation_period > 0:
        return TURNS
    single = len(rows) < SINGLE * len(np.unique(found.time[rows]))
    return REPORTS if single and named(found.identity[rows]).any() else TIMES


def _scans(
    found: Detections, rows: np.ndarray, sensor: int, spec: SensorSpec, way: str, window: float | None
) -> Iterator[Scan]:
    time = found.time[rows]
    azimuths = None
    if way == COLUMN:
        if (found.scan[rows] < 0).any():
            raise ValueError("scans by a column need it; give --scan COLUMN")
        number = found.scan[rows]
    elif way == REPORTS:
        for i, at in enumerate(time.tolist()):
            yield Scan(at, at, at, rows[i : i + 1], sensor)
        return
    elif way == WINDOW:
        number = _windows(time, window or 0.0)
    elif way == TURNS:
        if not spec.rotation_period > 0:
            raise ValueError(
                f"scans by turns need the period of sensor {spec.name!r}; give --rotation-period S"
            )
        azimuth = found.z[rows, 1]
        if spec.kind != POLAR:
            x, y = (found.z[rows, :2] - found.origin[rows, :2]).T
            azimuth = np.arctan2(y, x)
        number, azimuths = turns(time, azimuth, spec.rotation_period)
        if len(number) and number.max() > SPARSE * len(number):
            raise ValueError(
                f"a rotation period of {spec.rotation_period:g} s makes {number.max() + 1} turns of "
                f"{len(number)} rows; another unit?"
            )
    else:
        number = np.cumsum(np.diff(time, prepend=time[:1]) > 0)
    yield from _grouped(
        rows, time, number, sensor, azimuths, spec.rotation_period if way == TURNS else np.inf
    )


def _grouped(
    rows: np.ndarray,
    time: np.ndarray,
    number: np.ndarray,
    sensor: int,
    azimuths: tuple[float, float] | None,
    period: float,
) -> Iterator[Scan]:
    """A scan for each number; between turns that are further apart than one, empty ones."""
    order = np.argsort(number, kind="stable")
    starts = np.flatnonzero(np.diff(number[order], prepend=-1) != 0)
    before = None
    for held in np.split(order, starts[1:]):
        if not len(held):
            continue
        held = np.sort(held)
        if before is not None and period < np.inf:
            for missed in range(int(number[before[-1]]) + 1, int(number[held[0]])):
                at = time[before[-1]] + (missed - number[before[-1]]) * period
                yield Scan(at, at, at, np.empty(0, int), sensor, azimuths)
        before = held
        yield Scan(
            float(time[held[-1]]), float(time[held[0]]), float(time[held[-1]]), rows[held], sensor, azimuths
        )


def _windows(time: np.ndarray, window: float) -> np.ndarray:
    """Number (n,) of the window of each row; a window begins with a row."""
    starts = []
    i = 0
    while i < len(time):
        starts.append(i)
        i = int(np.searchsorted(time, time[i] + window, side="right"))
    number = np.zeros(len(time), int)
    number[starts[1:]] = 1
    return np.cumsum(number)


def turns(
    time: np.ndarray, azimuth: np.ndarray, period: float
) -> tuple[np.ndarray, tuple[float, float] | None]:
    """Turns of an antenna.

    Parameters
    ----------
    time : ndarray (n,)
        s, not decreasing.
    azimuth : ndarray (n,)
        rad.
    period : float
        s; its error may add up, for the antenna's phase is followed.

    Returns
    -------
    number : ndarray (n,) of int
        Turn of each row, from 0. Turns are cut in the middle of the widest sector without detections; a row
        beside the cut is of the turn that its time says.
    azimuths : tuple of 2 floats or None
        From and to, in the direction that the antenna turns; None where azimuths do not go with time as those
        of an antenna, and a turn is one period of time.
    """
    if not len(time):
        return np.zeros(0, int), None
    elapsed = (time - time[0]) / period
    ways = {way: np.mod(elapsed - way * azimuth / TURN, 1.0) for way in (-1, 1)}
    way = max(ways, key=lambda key: _together(ways[key]))
    phase, k = float(ways[way][0]), np.empty(len(time), int)
    errors = np.empty(len(time))
    swept = way * azimuth / TURN
    for i, (turned, at) in enumerate(zip(elapsed.tolist(), swept.tolist(), strict=True)):
        lag = turned - at - phase
        k[i] = round(lag)
        errors[i] = lag - k[i]
        phase += FOLLOWED * errors[i]
    if np.abs(errors).mean() > SPREAD:
        return np.floor(elapsed + 1e-9).astype(int), None
    total = k + swept  # turns and azimuth together: how far the antenna has turned
    at = np.sort(total % 1.0)
    gaps = np.diff(at, append=at[0] + 1.0)
    start = at[gaps.argmax()] + gaps.max() / 2
    number = np.floor(total - start).astype(int)
    return number - number.min(), (float(way * start * TURN), float(way * (start + 1) * TURN))


def _together(phase: np.ndarray) -> float:
    """How well phases, in turns, agree from each row to the next: 1 where they do."""
    return float(np.cos(TURN * np.diff(phase)).mean()) if len(phase) > 1 else 1.0
