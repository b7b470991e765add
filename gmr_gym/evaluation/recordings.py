"""Recorded detections: a file of scans is read and tracked, and a file of its track written.

A file of scans is CSV in seconds and metres: a header such as `time,x,y`, then one row such as
`0.5,12.5,-3.0` for each detection. Rows of equal time make one scan, and `1.0,,` is a scan without
detections. A radar's columns are `time,range_m,azimuth_rad,elevation_rad`.
"""

import csv
from collections.abc import Callable, Iterable, Sequence
from decimal import Context
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import _check_positive
from gmr_gym.evaluation.csv_columns import Convert, numbers, read_columns, texts
from gmr_gym.evaluation.times import duration, seconds
from gmr_gym.evaluation.writing import whole
from gmr_gym.filters.tracker import Tracker
from gmr_gym.mixture import moments
from gmr_gym.points import check_points, present

RESOLUTION = 9  # decimals of a second to which intervals are resolved, at most
ANY = float(np.finfo(float).max)  # no limit on the coordinates of a file: the tracker has one
OFF_GRID = 0.1  # of a period, how far from its multiples a scan may lie
MOST_FILLED = 1_000_000  # scans; only a period far too short makes more
LATEST = 2.0**53  # s; floats beyond it do not tell seconds apart


class Scans(NamedTuple):
    """Detections by scan."""

    times: np.ndarray  # (T,), s, increasing; or datetimes, see `times.seconds`
    z: list[np.ndarray]  # T arrays (k, p), m and rad; (0, p) where nothing was detected
    coordinates: tuple[str, ...]  # p names


class Track(NamedTuple):
    """Estimates of a tracker, by scan."""

    times: np.ndarray  # (T,), s
    x: np.ndarray  # (T, d), estimates
    P: np.ndarray  # (T, d, d), covariances of the estimates
    components: np.ndarray  # (T,), hypotheses kept
    alive: np.ndarray  # (T,), False once the tracker has given the track up and only predicts


def read_scans(path: Path | str, *, farthest: float = ANY) -> Scans:
    """Read scans from a CSV file in UTF-8, whose rows are in order of time; it may be compressed with gzip.

    Blank lines and lines that start with # are ignored.

    Parameters
    ----------
    path : Path or str
    farthest : float
        Limit of the absolute value of a coordinate, m or rad.

    Returns
    -------
    Scans

    Raises
    ------
    ValueError
        Naming file, line and column of an invalid cell, of a coordinate beyond +-`farthest`, and of a time
        with more digits than a float has, such as nanoseconds since 1970.
    """
    table = read_columns(path, partial(_chosen, partial(_within, farthest)))
    time, *coordinates = table.names
    if not len(table.line):
        raise ValueError(f"{table.where}, column {time}: no rows follow the header")

    def at(i: int, name: str) -> str:
        return f"{path}, line {table.line[i]}, column {name}"

    written = table.values[time]
    times = numbers(written, lambda i: at(i, time), absent=frozenset())
    z = np.column_stack([table.values[name] for name in coordinates])
    given = np.isfinite(z)
    empty = ~given.any(axis=1)
    for i, j in np.argwhere(~given & ~empty[:, None])[:1]:
        raise ValueError(f"{at(i, coordinates[j])}: '' is not a finite number")
    gaps = np.diff(times)
    for i in np.flatnonzero(gaps < 0)[:1] + 1:
        raise ValueError(f"{at(i, time)}: {times[i]} comes after {times[i - 1]}; sort the rows by time")
    same = np.flatnonzero(gaps == 0) + 1
    for i in same[empty[same] | empty[same - 1]][:1]:
        raise ValueError(f"{at(i, coordinates[0])}: an empty scan must be the only row of its time")
    far = np.flatnonzero(np.abs(times) >= LATEST).tolist()
    for i in [*far, *(i for i in same.tolist() if not _same_number(written[i], written[i - 1]))][:1]:
        more = f"{written[i]} has more digits than a float holds"
        raise ValueError(f"{at(i, time)}: {more}; give seconds, counted from the first row")
    starts = np.flatnonzero(np.append(True, gaps > 0))
    ends = np.where(empty[starts], starts, np.append(starts[1:], len(z))).tolist()
    scans = [z[start:end] for start, end in zip(starts.tolist(), ends, strict=True)]
    return Scans(times[starts], scans, tuple(coordinates))


def check_positions(path: Path | str, scans: Scans) -> None:
    """Check that the coordinates of scans are positions.

    Parameters
    ----------
    path : Path or str
        The file, for the message.
    scans : Scans

    Raises
    ------
    ValueError
        Naming the file and a column that ends in _rad or _deg: an angle.
    """
    for name in scans.coordinates:
        if name.endswith(("_rad", "_deg")):
            raise ValueError(
                f"{path}, column {name}: an angle, but only positions in metres are tracked; convert them "
                "with gmr_gym.models.radar.cartesian, or track it from Python with a sensor of "
                "gmr_gym.models.radar.radar"
            )


def write_scans(
    path: Path | str, times, z: Sequence, coordinates: Sequence[str], *, time: str = "time"
) -> None:
    """Write scans as CSV, so that `read_scans` returns every bit.

    Parameters
    ----------
    path : Path or str
    times : array_like (T,)
        s, increasing, or datetimes.
    z : sequence of T array_like (k, p)
        Detections, m and rad; masked rows are absent.
    coordinates : sequence of p str
        Names of the columns.
    time : str
        Name of the column of times.

    Raises
    ------
    ValueError
        Naming the argument that is invalid.
    """
    scans = _checked(Scans(times, list(z), tuple(coordinates)))
    nothing = [[""] * len(scans.coordinates)]
    each = zip(scans.times.tolist(), scans.z, strict=True)
    rows = ([at, *point] for at, points in each for point in points.tolist() or nothing)
    _write(path, [time, *scans.coordinates], rows)


def write_track(path: Path | str, track: Track, names: Sequence[str]) -> None:
    """Write a track as CSV.

    The columns are time, the states, the upper triangle of their covariance (var_a, cov_a_b, ...),
    components, and alive, 1 or 0.

    Parameters
    ----------
    path : Path or str
    track : Track
    names : sequence of d str
        Names of the states.

    Raises
    ------
    ValueError
        If there are not d names.
    """
    d = track.x.shape[1]
    if len(names) != d:
        raise ValueError(f"names must name the {d} states of the track, got {len(names)}")
    upper = [(i, j) for i in range(d) for j in range(i, d)]
    entries = [f"var_{names[i]}" if i == j else f"cov_{names[i]}_{names[j]}" for i, j in upper]
    each = zip(*(column.tolist() for column in track), strict=True)
    rows = ([time, *x, *(P[i][j] for i, j in upper), n, int(alive)] for time, x, P, n, alive in each)
    _write(path, ["time", *names, *entries, "components", "alive"], rows)


def track(
    scans: Scans,
    build: Callable[[float], Tracker],
    period: float | None = None,
    prior_time: float | None = None,
) -> Track:
    """Run a tracker over recorded scans.

    Parameters
    ----------
    scans : Scans
    build : callable
        Makes the tracker for an interval, s; all of them have one prior.
    period : float or timedelta, optional
        Period, s, of a sensor whose file has no row where nothing was detected; see `filled`.
    prior_time : float or datetime, optional
        Time that the prior describes, s. By default one period, or else the median interval, before the first
        scan. A prior at the time of the first scan includes that scan already: the first estimate is then the
        mean and covariance of the prior.

    Returns
    -------
    Track

    Raises
    ------
    ValueError
        Naming the argument that is invalid.
    """
    scans, intervals, built = prepared(scans, build, period, prior_time)
    tracker = next(iter(built.values()))
    belief, prior = tracker.init(), tracker.model.prior
    rows = [] if intervals[0] else [(*moments(prior), len(prior.w), True)]
    for t in range(len(rows), len(intervals)):
        belief, report = built[intervals[t]].step(belief, scans.z[t])
        rows.append((report.x[0], report.P[0], len(report.mixture.w), report.alive))
    return Track(scans.times, *map(np.array, zip(*rows, strict=True)))


def prepared(
    scans: Scans, build: Callable[[float], Tracker], period: float | None, prior_time: float | None
) -> tuple[Scans, list[float], dict[float, Tracker]]:
    """The scans to be tracked, the interval before each, s, and a tracker for each interval but 0; as
    `track` takes them."""
    if period is not None:
        period = duration(period, "period")
    if prior_time is not None:
        prior_time = float(seconds(prior_time, "prior_time"))
    scans = _checked(scans) if period is None else filled(scans, period)
    intervals = _intervals(scans.times, period, prior_time).tolist()
    built = {interval: build(interval) for interval in dict.fromkeys(intervals) if interval}
    tracker = next(iter(built.values()))
    if (p := len(tracker.model.sensor.H)) != len(scans.coordinates):
        raise ValueError(f"scans have {len(scans.coordinates)} coordinates, but the tracker's sensor {p}")
    return scans, intervals, built


def filled(scans: Scans, period: float) -> Scans:
    """Add an empty scan at each multiple of the period that has none.

    Parameters
    ----------
    scans : Scans
    period : float or timedelta
        s, counted from the first scan.

    Returns
    -------
    Scans

    Raises
    ------
    ValueError
        If a time is further than a tenth of a period from every multiple.
    """
    times, z, coordinates = _checked(scans)
    period = duration(period, "period")
    _check_positive(period=period)
    elapsed = (times - times[0]) / period
    at = np.rint(elapsed).astype(int)
    misfit = (np.abs(elapsed - at) > OFF_GRID) | (np.diff(at, prepend=-1) < 1) | (at >= MOST_FILLED)
    for i in np.flatnonzero(misfit)[:1]:
        raise ValueError(f"period {period} does not fit time {times[i]}: it makes scan {elapsed[i] + 1:.6g}")
    all_times = times[0] + period * np.arange(at[-1] + 1)
    all_times[at], found = times, dict(zip(at.tolist(), z, strict=True))
    nothing = np.empty((0, len(coordinates)))
    return Scans(all_times, [found.get(i, nothing) for i in range(len(all_times))], coordinates)


def from_first_detection(scans: Scans) -> Scans:
    """Drop the empty scans before the first detection.

    Parameters
    ----------
    scans : Scans

    Returns
    -------
    Scans

    Raises
    ------
    ValueError
        If there is no detection.
    """
    held = [i for i, points in enumerate(scans.z) if len(present(points))]
    if not held:
        raise ValueError(f"scans hold no detection: all {len(scans.z)} are empty")
    return Scans(scans.times[held[0] :], scans.z[held[0] :], scans.coordinates)


def _chosen(convert: Convert, where: str, names: list[str]) -> dict[str, Convert]:
    """How a file of scans is read: all columns are numbers, but times are compared as they are written."""
    time, *coordinates = _checked_header(where, names)
    return {time: texts, **dict.fromkeys(coordinates, convert)}


def _within(farthest: float, cells: Sequence[str], at: Callable[[int], str]) -> np.ndarray:
    found = numbers(cells, at)
    for i in np.flatnonzero(np.abs(found) > farthest)[:1].tolist():
        raise ValueError(f"{at(i)}: {cells[i].strip()} lies beyond +-{farthest:g}, farther than tracked")
    return found


def _checked_header(where: str, names: Sequence[str]) -> tuple[str, ...]:
    if not names[0].startswith("time") or len(names) < 2:
        raise ValueError(f"{where}, column 1: a header is time,x,... with commas, got {','.join(names)!r}")
    for i, name in enumerate(names):
        if not name or name != name.strip() or not name.isprintable() or name in names[:i]:
            raise ValueError(f"{where}, column {i + 1}: {name!r} is not a name, or is used twice")
    return tuple(names)


def _same_number(one: str, other: str) -> bool:
    """Whether two numbers are equal as they are written, before they are floats."""
    exactly = Context(prec=100, traps=[]).create_decimal
    return one == other or exactly(one) == exactly(other)


def _write(path: Path | str, header: list[str], rows: Iterable[list]) -> None:
    _checked_header("names", header)
    with whole(path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([header, *rows])


def _checked(scans: Scans) -> Scans:
    times, T = seconds(scans.times), len(scans.z)
    if times.shape != (T,) or T == 0 or not np.isfinite(times).all():
        raise ValueError(f"times must be finite, one for each of the {T} scans in z")
    if (latest := np.abs(times).max()) >= LATEST:
        raise ValueError(f"times must lie within +-{LATEST:.3g} s, got {latest:g}; count them from the first")
    for i in np.flatnonzero(_resolved(np.diff(times), times) <= 0)[:1]:
        before, after = np.asarray(scans.times)[i : i + 2]
        raise ValueError(f"times must increase, but {after} follows {before}")
    p = len(scans.coordinates)
    return Scans(times, [check_points(z, p, ANY) for z in scans.z], scans.coordinates)


def _intervals(times: np.ndarray, period: float | None, prior_time: float | None) -> np.ndarray:
    """Intervals (T,), s: from the prior to the first scan, then from scan to scan."""
    gaps = np.diff(times)
    if prior_time is None:
        usual = np.quantile(gaps, 0.5, method="lower") if len(gaps) else 0.0
        prior_time = times[0] - (usual if period is None else period)
    intervals = _resolved(np.append(times[0] - prior_time, gaps), times)
    if not (0 <= intervals[0] < np.inf and intervals.any()):
        raise ValueError(f"give a period, or a prior_time before {times[0]} (at it if a second scan follows)")
    return intervals


def _resolved(gaps: np.ndarray, times: np.ndarray) -> np.ndarray:
    """The gaps, s, rounded to the decimals that such times resolve: seconds since 1970 have six."""
    between = 4 * np.spacing(np.abs(times).max())
    return gaps.round(min(RESOLUTION, int(-np.log10(between) // 1)))
