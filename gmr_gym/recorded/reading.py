"""Files of detections, read: columns to roles, units to SI, places to local coordinates, rows in order."""

from collections.abc import Mapping, Sequence
from datetime import date
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.checks import check_choice
from gmr_gym.evaluation.csv_columns import Columns
from gmr_gym.recorded.columns import ROLES, Layout, condition, kept_rows, layouts, option, unit_of
from gmr_gym.recorded.configuration import SensorSettings
from gmr_gym.recorded.detections import CARTESIAN, POLAR, Detections, SensorSpec, chosen, named, objects
from gmr_gym.recorded.formats import TextForm, columns_of
from gmr_gym.recorded.geodesy import to_local
from gmr_gym.recorded.measured import COMPASS, Positions, azimuths, read_positions, to_axes
from gmr_gym.recorded.plausibility import check_speeds
from gmr_gym.recorded.times import Times, read_times
from gmr_gym.recorded.units import did_you_mean, unit_in_name

Layouts = Mapping[str | None, Layout]
Reference = Any  # latitude deg, longitude deg, altitude m; None for none
TEXTS = ("scan", "sensor", "id", "truth")


class _Rows(NamedTuple):
    """Rows of a table that are of one sensor."""

    name: str
    at: np.ndarray  # (k,) indices
    layout: Layout
    times: Times
    positions: Positions
    settings: SensorSettings


def read(
    source: Any,
    columns: Mapping[str, str | Sequence[str]] | None = None,
    *,
    sensors: Sequence[SensorSettings] = (),
    where: Sequence[str] = (),
    keep: Sequence[str] | None = None,
    delimiter: str | None = None,
    decimal: str = ".",
    encoding: str = "utf-8",
    header: bool = True,
    day: date | None = None,
    order: str = "sort",
    drop_repeats: bool = True,
    reference: Reference = None,
    azimuth_convention: str = COMPASS,
) -> Detections:
    """Read detections from a file, a data frame or a mapping of arrays.

    Parameters
    ----------
    source : Path, str, data frame or mapping of arrays
        A file is text with columns, or JSON, either of them compressed with gzip or not.
    columns : mapping, optional
        By role, `time`, `x`, `y`, `lat`, ... as in `columns.ROLES`, `COLUMN:UNIT`; see `columns.layouts`.
        Without a position in it, columns are found by their names.
    sensors : sequence of SensorSettings
    where : sequence of str
        Conditions that rows fulfil, such as `snr>10`.
    keep : sequence of str, optional
        Columns kept as metadata; all without a role unless given.
    delimiter, decimal, encoding, header
        Of a text file, see `formats.TextForm`.
    day : date, optional
        Day of the first row, where times are seconds of the day.
    order : str
        `sort` puts rows in order of time; `strict` refuses rows that are not.
    drop_repeats : bool
        Whether a row that repeats another is dropped: same time, sensor, identity and measurement.
    reference : tuple of 3 floats, optional
        Latitude deg, longitude deg and altitude m of the origin of local coordinates; by default those of the
        first sensor, or else latitude and longitude of the first row.
    azimuth_convention : str
        `compass`, clockwise from north, or `math`, counter-clockwise from the x axis.

    Returns
    -------
    Detections

    Raises
    ------
    ValueError
        Naming file, line and column, and the option to give.
    """
    check_choice("order", order, ("sort", "strict"))
    found: dict[str | None, Layout] = {}
    names: list[str] = []

    def choose(header_at: str, there: Sequence[str]) -> dict[str, bool]:
        names.extend(there)
        found.update(layouts(header_at, there, columns or {}))
        return _wanted(header_at, there, found, where, keep)

    def kept(record: Mapping[str, str]) -> bool:
        tested = {name: [record[name]] for name in (condition(text, names)[0] for text in where)}
        return bool(kept_rows(where, names, tested, 1)[0])

    table = columns_of(source, choose, TextForm(delimiter, decimal, encoding, header), kept)
    table = _filtered(table, where)
    rows = _by_sensor(table, found, sensors, day, decimal)
    if len({each.times.absolute for each in rows}) > 1:
        raise ValueError(f"{table.where}: times of one sensor are absolute and those of another are not")
    return _assembled(table, rows, found, reference, azimuth_convention, order == "strict", drop_repeats)


def _wanted(
    where: str, names: Sequence[str], found: Layouts, conditions: Sequence[str], keep: Sequence[str] | None
) -> dict[str, bool]:
    """Columns that are read, True for numbers."""
    wanted = {condition(text, names)[0]: False for text in conditions}
    numeric: dict[str, bool] = {}
    for layout in found.values():
        for role, column in layout.items():
            text = role == "time" or ROLES[role] is None or column.name in wanted
            numeric[column.name] = not text and numeric.get(column.name, True)
            if role not in ("time", *TEXTS):
                unit_of(where, role, column)
    for name in keep or ():
        if name not in names:
            raise ValueError(
                f"{where}: no column {name!r} to keep{did_you_mean(name, names)}; "
                f"there are {', '.join(names)}"
            )
    rest = [n for n in names if (n and not n.endswith("]")) or unit_in_name(n)] if keep is None else keep
    return dict.fromkeys(rest, False) | wanted | numeric


def _filtered(table: Columns, conditions: Sequence[str]) -> Columns:
    n = len(table.line)
    if not n:
        raise ValueError(
            f"{table.where}: no rows follow" + (", or none fulfils --where" if conditions else "")
        )
    if not conditions:
        return table
    mask = kept_rows(conditions, table.names, table.values, n)
    if not mask.any():
        raise ValueError(f"{table.where}: none of {n} rows fulfils --where {' '.join(conditions)}")
    return table._replace(values={k: _taken(v, mask) for k, v in table.values.items()}, line=table.line[mask])


def _taken(values: Any, rows: np.ndarray) -> Any:
    """Entries of an array or a list, by a mask or indices."""
    if isinstance(values, np.ndarray):
        return values[rows]
    return [values[i] for i in np.arange(len(values))[rows].tolist()]


def _by_sensor(
    table: Columns, found: Layouts, settings: Sequence[SensorSettings], day: date | None, decimal: str
) -> list[_Rows]:
    """Rows of each sensor, read by its own columns."""
    column = next((layout["sensor"].name for layout in found.values() if "sensor" in layout), None)
    own = [name for name in found if name is not None]
    if column is None and own:
        raise ValueError(f"{table.where}: {own[0]}=COLUMN is of one sensor; give --sensor COLUMN as well")
    n = len(table.line)
    there, first, code = np.array([""]), np.zeros(1, int), np.zeros(n, int)
    if column:
        of_row = np.array(table.values[column], str)
        there, first, code = np.unique(of_row, return_index=True, return_inverse=True)
    for name in [*own, *(s.name for s in settings if s.name is not None and column)]:
        if name not in there:
            hint = did_you_mean(name, there.tolist())
            raise ValueError(
                f"{table.where}: no row is of sensor {name!r}{hint}; there are {', '.join(there[:9])}"
            )
    unit = "line" if ", line " in table.where else "record"
    source = table.where.rpartition(", line ")[0] or table.where
    rows = []
    for i in np.argsort(first).tolist():
        name, indices = str(there[i]), np.flatnonzero(code == i)
        layout = found.get(name, found[None])
        cells = {each.name: table.values[each.name] for each in layout.values()}
        values = cells if len(indices) == n else {name: _taken(some, indices) for name, some in cells.items()}
        lines = table.line[indices]

        def at(cell: str, k: int, lines: np.ndarray = lines) -> str:
            return f"{source}, {unit} {lines[k]}, column {cell}"

        time = layout.get("time")
        if time is None:
            raise ValueError(
                f"{table.where}: sensor {name!r} has no columns; give --time {name}=COLUMN:UNIT and others"
            )
        form = time.unit or unit_in_name(time.name)
        times = read_times(values[time.name], form, partial(at, time.name), day)
        positions = read_positions(layout, values, table.where, at, decimal)
        said = [s for s in settings if s.name == name] or [
            s for s in settings if s.name is None or not column
        ]
        rows.append(_Rows(name, indices, layout, times, positions, (said or [SensorSettings()])[0]))
    return rows


def _assembled(
    table: Columns,
    rows: list[_Rows],
    found: Layouts,
    reference: Reference,
    convention: str,
    strict: bool,
    drop_repeats: bool,
) -> Detections:
    """Rows of all sensors in order of time, without those that repeat others or have no position."""
    n, p = len(table.line), max(each.positions.z.shape[1] for each in rows)
    reference = reference or _reference(rows)
    ns, sensor, origin = np.zeros(n, np.int64), np.zeros(n, int), np.zeros((n, 3))
    z, rate = np.full((n, p), np.nan), np.full(n, np.nan)
    specs = []
    for i, each in enumerate(rows):
        place = _place(each, reference)
        own = np.where(np.isnan(each.positions.own), place, each.positions.own)
        measured = _measured(each, own, reference, convention)
        ns[each.at], sensor[each.at], origin[each.at] = each.times.ns, i, own
        z[each.at, : measured.shape[1]], rate[each.at] = measured, each.positions.range_rate
        specs.append(_spec(each, place))
    order, remarks = _order(table, ns, strict)
    text = {role: _text(table, found, role) for role in TEXTS}
    taken = {column.name for layout in found.values() for column in layout.values()}
    metadata = {name: list(values) for name, values in table.values.items() if name not in taken}
    start = rows[0].times._replace(ns=ns).start
    seen = Detections(
        (ns - ns.min()) / 1e9, z, rate, origin, sensor, _scans(text["scan"]), text["id"], text["truth"],
        table.line, metadata, np.empty(0), np.empty(0, int), tuple(specs), _coordinates(rows), start,
        reference, ns.min() / 1e9,
    )  # fmt: skip
    seen = chosen(seen, order) if remarks else seen
    blank = np.isnan(seen.z[:, 0])
    looks = seen.time[blank], seen.sensor[blank]
    seen = chosen(seen, ~blank) if blank.any() else seen
    if drop_repeats and (repeated := _repeats(seen)).any():
        seen = chosen(seen, ~repeated)
        remarks.append(f"{repeated.sum()} repeats of other rows dropped")
    seen, unplaced = _with_empty(seen, *looks)
    remarks += [f"{unplaced} rows without a position dropped"] if unplaced else []
    fast = check_speeds(_source(table), seen)
    return seen._replace(remarks=(*_as_read(rows, convention), *remarks, *([fast] if fast else [])))


def _source(table: Columns) -> str:
    return table.where.rpartition(", line ")[0] or table.where


def _reference(rows: list[_Rows]) -> Reference:
    """Where the first sensor is, or else latitude and longitude of the first row, at height 0."""
    for each in rows:
        if each.settings.geodetic is not None:
            return each.settings.geodetic
    for each in rows:
        there = each.positions.z[~np.isnan(each.positions.z[:, 0])]
        if each.positions.family[0] == "lat" and len(there):
            return float(there[0, 0]), float(there[0, 1]), 0.0
    return None


def _place(each: _Rows, reference: Reference) -> np.ndarray:
    """Where the sensor is (3,), m."""
    if each.settings.geodetic is not None:
        return to_local(each.settings.geodetic, reference)
    return np.array(each.settings.position or (0.0, 0.0, 0.0))


def _measured(each: _Rows, own: np.ndarray, reference: Reference, convention: str) -> np.ndarray:
    """Measurements (k, p) in local coordinates or polar ones, from what the file has."""
    z, p = each.positions.z, each.positions.z.shape[1]
    if each.positions.family[0] == "lat":
        heights = z[:, 2] if p > 2 else np.zeros(len(z))
        return to_local(np.column_stack([z[:, :2], heights]), reference)[:, :p]
    if each.positions.family[0] == "range":
        z = z.copy()
        z[:, 1] = azimuths(z[:, 1], convention, each.settings.north_offset)
        there = each.settings.geodetic
        return z if there is None or there == reference else to_axes(z, there, reference)
    moving = "own_x" in each.layout  # what it measures is relative to itself
    return z + own[:, :p] if moving else z


def _spec(each: _Rows, place: np.ndarray) -> SensorSpec:
    said, family = each.settings, each.positions.family
    polar = family[0] == "range"
    if polar and said.deviation.get("", 0.0) > 0:
        raise ValueError(
            "the deviation of a sensor in range and azimuth has two units; give --sensor-deviation "
            f"range={said.deviation['']:g},azimuth=0.1deg"
        )
    names = ("x", "y", "z") if family[0] == "lat" else family
    deviation = tuple(
        said.deviation.get(role, said.deviation.get("", np.nan)) for role in names[: len(family)]
    )
    return SensorSpec(
        each.name, POLAR if polar else CARTESIAN, tuple(place.tolist()), deviation,
        said.deviation.get("range_rate", np.nan), said.detection_probability, said.clutter_per_scan,
        said.rotation_period, said.clutter_density,
    )  # fmt: skip


def _order(table: Columns, ns: np.ndarray, strict: bool) -> tuple[np.ndarray, list[str]]:
    """Order of time, rows of one time in that of the file."""
    late = ns < np.maximum.accumulate(ns)
    if strict and late.any():
        i = int(np.argmax(late))
        raise ValueError(
            f"{_source(table)}, line {table.line[i]}: time runs back by {(ns[i - 1] - ns[i]) / 1e9:g} s; "
            "sort the rows, or leave --order strict out"
        )
    return np.argsort(ns, kind="stable"), [f"{late.sum()} rows sorted by time"] if late.any() else []


def _repeats(seen: Detections) -> np.ndarray:
    """Mask (n,) of the rows that repeat an earlier one."""
    repeated = np.zeros(len(seen.time), bool)
    same = np.diff(seen.time) == 0
    rows = np.flatnonzero(np.append(same, False) | np.append(False, same))
    known: set = set()
    each = (seen.time, seen.sensor, seen.identity, seen.truth, seen.range_rate.astype(str))
    for i, *key in zip(rows.tolist(), *(column[rows].tolist() for column in each), strict=True):
        entry = (*key, seen.z[i].tobytes())
        repeated[i] = entry in known
        known.add(entry)
    return repeated


def _with_empty(seen: Detections, times: np.ndarray, sensors: np.ndarray) -> tuple[Detections, int]:
    """Rows without a position as looks that detected nothing; where others of their time and sensor have one,
    or rows are single reports with identities, they are only counted."""
    if not len(times):
        return seen, 0
    reports = any(value is not None for value in seen.identity[:1])
    there = set() if reports else set(zip(seen.time.tolist(), seen.sensor.tolist(), strict=True))
    looks = {key: None for key in zip(times.tolist(), sensors.tolist(), strict=True) if key not in there}
    held = [] if reports else list(looks)
    empty_time, empty_sensor = (
        np.array([look[i] for look in held], kind) for i, kind in ((0, float), (1, int))
    )
    return seen._replace(empty_time=empty_time, empty_sensor=empty_sensor), len(times) - len(held)


def _text(table: Columns, found: Layouts, role: str) -> np.ndarray:
    """Texts of a role, None where a cell is blank or no column has the role."""
    name = next((layout[role].name for layout in found.values() if role in layout), None)
    if name is None:
        return np.full(len(table.line), None)
    cells = list(map(str, table.values[name]))
    if not any(cells):
        raise ValueError(
            f"{table.where}, column {name}: empty in all {len(cells)} rows; leave {option(role)} out"
        )
    return objects([cell or None for cell in cells])


def _scans(cells: np.ndarray) -> np.ndarray:
    """Scans (n,), numbered in order of their first row; -1 where there are none."""
    if not named(cells).any():
        return np.full(len(cells), -1)
    numbers = {None: -1}
    return np.array([numbers.setdefault(cell, len(numbers) - 1) for cell in cells.tolist()], int)


def _coordinates(rows: list[_Rows]) -> tuple[str, ...]:
    """Names of the columns of the first layout with the most coordinates."""
    widest = max(rows, key=lambda each: len(each.positions.family))
    return tuple(widest.layout[role].name for role in widest.positions.family)


def _as_read(rows: list[_Rows], convention: str) -> list[str]:
    """How units, times and azimuths were taken."""
    remarks = []
    for each in rows:
        of = f" of sensor {each.name}" if len(rows) > 1 else ""
        units = [
            f"{role} from {column.name} in {unit_of('', role, column)}"
            for role, column in each.layout.items()
            if role not in ("time", *TEXTS)
        ]
        remarks.append(
            f"time{of} from {each.layout['time'].name} as {each.times.read_as}; {', '.join(units)}"
        )
    if any(each.positions.family[0] == "range" for each in rows):
        way = "clockwise from north" if convention == COMPASS else "counter-clockwise from the x axis"
        remarks.append(f"azimuths taken {way}; --azimuth-convention changes it")
    return remarks
