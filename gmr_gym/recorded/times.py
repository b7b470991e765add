"""Times as files write them, in whole nanoseconds: numbers with a unit, ISO 8601, or a stated format."""

from collections.abc import Callable, Sequence
from datetime import UTC, date, datetime, timedelta
from decimal import Decimal
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.evaluation.csv_columns import numbers
from gmr_gym.recorded.units import TIME, UNITS, scale_of

SECOND, DAY = 10**9, 86_400 * 10**9  # ns
EARLIEST, LATEST = 946_684_800, 4_102_444_800  # s since 1970: 2000 and 2100, between which files are recorded
FLOATS = 1e6  # s; to here a float of decimal seconds is exact to a nanosecond
EPOCH, MICROSECOND = datetime(1970, 1, 1, tzinfo=UTC), timedelta(microseconds=1)
NANOSECONDS = {unit: round(scale * SECOND) for unit, scale in UNITS[TIME].items()}
ISO = "iso"
Cells = Any  # a sequence of str, or an array


class Times(NamedTuple):
    """Times of rows, in the order of the file."""

    ns: np.ndarray  # (n,) int64, since 1970 where they are absolute
    absolute: bool
    read_as: str  # how they were read, for the reader

    @property
    def start(self) -> datetime | None:
        """UTC of the earliest, where times are absolute."""
        return EPOCH + timedelta(microseconds=int(self.ns.min()) // 1000) if self.absolute else None


def read_times(
    cells: Cells, form: str | None, at: Callable[[int], str], day: date | None = None, decimal: str = "."
) -> Times:
    """Times of a column.

    Parameters
    ----------
    cells : sequence of n str, or ndarray (n,)
        Numbers and datetime64 are taken as they are.
    form : str or None
        A unit, `iso`, or a format of `datetime.strptime`; None is ISO 8601. Nothing is guessed about the
        order of day and month. A time without a zone is UTC.
    at : callable
        Where the cell of an index stands, for the message.
    day : date, optional
        Day on which seconds of the day begin; past midnight they go on.
    decimal : str
        What stands before the decimals of numbers.

    Returns
    -------
    Times

    Raises
    ------
    ValueError
        Naming file, line and column of what is no time, and what to give instead.
    """
    if isinstance(cells, np.ndarray) and cells.dtype.kind == "M":
        for i in np.flatnonzero(np.isnat(cells))[:1].tolist():
            raise ValueError(f"{at(i)}: no time; leave such rows out with --where, or give them one")
        return Times(cells.astype("datetime64[ns]").astype(np.int64), True, "datetimes")
    if form is not None and "%" not in form and form.lower() != ISO:
        scale_of(form, TIME, at(0))
        if decimal != "." and not isinstance(cells, np.ndarray):
            cells = [cell.replace(decimal, ".") for cell in cells]
        return _numeric(
            cells, next(u for u in UNITS[TIME] if UNITS[TIME][u] == scale_of(form, TIME, "")), at, day
        )
    if form is None or "%" not in form:
        return Times(_moments(cells, datetime.fromisoformat, _iso_advice, at), True, "ISO 8601")

    def parse(cell: str) -> datetime:
        return datetime.strptime(cell, form)

    ns = _moments(cells, parse, lambda cell: f"is not of the form {form!r}", at)
    if any(code in form for code in ("%Y", "%y", "%c", "%x", "%G")):
        return Times(ns, True, form)
    return _from_day(ns % DAY, day, at, form)


def on_one_day(several: Sequence[Times]) -> list[Times]:
    """Times of sensors that count seconds of the day, each from its own first row: brought to the days of the
    first sensor, to which they come nearest."""
    first, *others = several
    low, high = first.ns.min(), first.ns.max()
    found = [first]
    for each in others:
        away = [max(each.ns.min() + d * DAY - high, low - each.ns.max() - d * DAY, 0) for d in (0, 1, -1)]
        found.append(each._replace(ns=each.ns + (0, 1, -1)[int(np.argmin(away))] * DAY))
    return found


def is_number(cell: str) -> bool:
    """Whether a cell is written as a number."""
    try:
        return np.isfinite(float(cell.replace("_", "?"))).item()
    except ValueError:
        return False


def _numeric(cells: Cells, unit: str, at: Callable[[int], str], day: date | None) -> Times:
    counted = _counted(cells, unit, at)
    for i, count in (
        enumerate(counted) if max(map(abs, (min(counted), max(counted)))) > LATEST * SECOND else ()
    ):
        if abs(count) > LATEST * SECOND:
            raise ValueError(f"{at(i)}: {_too_late(int(count), unit)}")
    ns = np.array(counted, np.int64)
    if day is not None:
        return _from_day(ns, day, at, f"{unit} of the day")
    since_1970 = EARLIEST * SECOND <= ns
    if since_1970.any() and not since_1970.all():
        i = int(np.flatnonzero(since_1970 != since_1970[0])[0])
        raise ValueError(
            f"{at(i)}: {ns[i] / NANOSECONDS[unit]:.16g} {unit} follows "
            f"{ns[i - 1] / NANOSECONDS[unit]:.16g} {unit}: one is since 1970 and the other is "
            "not; leave one kind out with --where"
        )
    back = np.flatnonzero(np.diff(ns) < -DAY // 2)
    if len(back) and (ns >= 0).all() and (ns < DAY).all() and ns[back[0]] > DAY * 0.99:
        raise ValueError(
            f"{at(int(back[0]) + 1)}: time goes back from {ns[back[0]] / SECOND:g} s to "
            f"{ns[back[0] + 1] / SECOND:g} s, as seconds of the day do at midnight; give --day YYYY-MM-DD"
        )
    return Times(ns, bool(since_1970.all()), f"{unit} since 1970" if since_1970.all() else unit)


def _too_late(count: int, unit: str) -> str:
    value = count // NANOSECONDS[unit]
    for better in ("ms", "us", "ns"):
        if EARLIEST * SECOND <= value * NANOSECONDS[better] < LATEST * SECOND:
            way = f"it is a time since 1970 in {better}: give --time COLUMN:{better}"
            break
    else:
        way = "another unit?"
    return f"{value:.19g} {unit} is {count / DAY / 365.25:.3g} years; {way}"


def _counted(cells: Cells, unit: str, at: Callable[[int], str]) -> Sequence[int] | np.ndarray:
    """Numbers in a unit as whole nanoseconds, exactly as they are written."""
    scale = NANOSECONDS[unit]
    if isinstance(cells, np.ndarray):
        if cells.dtype.kind in "iu":
            return [int(cell) * scale for cell in cells.tolist()]
        found = cells.astype(float)
    else:
        found = numbers(cells, at)
    for i in np.flatnonzero(~np.isfinite(found))[:1].tolist():
        raise ValueError(f"{at(i)}: no time; leave such rows out with --where, or give them one")
    if np.abs(found).max(initial=0.0) < FLOATS * SECOND / scale:
        return np.rint(found * scale).astype(np.int64)
    written = found.tolist() if isinstance(cells, np.ndarray) else cells
    try:
        return (
            [int(cell) * scale for cell in written]
            if written is cells
            else [round(c * scale) for c in written]
        )
    except ValueError:
        return [round(Decimal(cell.strip()) * scale) for cell in written]


def _moments(
    cells: Cells, parse: Callable[[str], datetime], advice: Callable[[str], str], at: Callable[[int], str]
) -> np.ndarray:
    """Nanoseconds since 1970 of cells that are dates with times."""
    found: list[datetime] = []
    try:
        found.extend(map(parse, cells))
    except (ValueError, TypeError):
        cell = cells[len(found)]
        raise ValueError(f"{at(len(found))}: {cell!r} {advice(str(cell))}") from None
    zones = [moment.tzinfo is None for moment in found]
    if any(zones) and not all(zones):
        i = zones.index(not zones[0])
        raise ValueError(
            f"{at(i)}: {cells[i]!r}: some times have a zone and others none; give all of them one"
        )
    if zones[0]:
        epoch = EPOCH.replace(tzinfo=None)
        return np.array([(moment - epoch) // MICROSECOND for moment in found], np.int64) * 1000
    return np.array([(moment - EPOCH) // MICROSECOND for moment in found], np.int64) * 1000


def _iso_advice(cell: str) -> str:
    if is_number(cell):
        return "is a number; say of what by --time COLUMN:s (or ms, us, ns, min, h)"
    return "is no ISO 8601 time; give its form, such as --time 'COLUMN:%d/%m/%Y %H:%M:%S'"


def _from_day(ns: np.ndarray, day: date | None, at: Callable[[int], str], read_as: str) -> Times:
    """Times of the day, which go on past midnight."""
    for i in np.flatnonzero((ns < 0) | (ns >= DAY))[:1].tolist():
        raise ValueError(f"{at(i)}: {ns[i] / SECOND:g} s is no time of a day; leave --day out")
    step = np.diff(ns, prepend=ns[:1])
    days = np.cumsum((step < -DAY // 2).astype(np.int64) - (step > DAY // 2))
    first = (day - EPOCH.date()).days if day else 0
    return Times(ns + (days + first) * DAY, day is not None, read_as)
