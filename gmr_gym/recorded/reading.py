"""Files of detections, read: columns to roles, units to SI, places to local coordinates, rows in order."""

from collections.abc import Mapping, Sequence
from datetime import date
from functools import partial
from typing import Any

import numpy as np

from gmr_gym.checks import check_choice
from gmr_gym.evaluation.csv_columns import Columns
from gmr_gym.recorded.assembly import TEXTS, Layouts, Reference, SensorRows, assembled, row_name, source_of
from gmr_gym.recorded.columns import layouts
from gmr_gym.recorded.conditions import condition, kept_rows
from gmr_gym.recorded.detections import Detections
from gmr_gym.recorded.formats import TextForm, columns_of
from gmr_gym.recorded.measured import COMPASS, MATH, read_positions
from gmr_gym.recorded.roles import ROLES, Layout, family_of, unit_of
from gmr_gym.recorded.sensor_settings import SensorSettings
from gmr_gym.recorded.times import on_one_day, read_times
from gmr_gym.recorded.units import did_you_mean, unit_in_name


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
        A file is text with columns, JSON, Parquet, AIS sentences with times of reception, or ASTERIX, each of
        them compressed with gzip or not: `formats.form_of` knows it by its beginning.
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
    check_choice("decimal", decimal, (".", ","))
    _check_encoding(encoding)
    check_choice("azimuth_convention", azimuth_convention, (COMPASS, MATH))
    found: dict[str | None, Layout] = {}
    names: list[str] = []

    def choose(header_at: str, there: Sequence[str], usual: Mapping[str, str]) -> dict[str, bool]:
        names.extend(there)
        found.update(layouts(header_at, there, {**usual, **(columns or {})}))
        return _wanted(header_at, there, found, where, keep)

    def kept(record: Mapping[str, str]) -> bool:
        tested = {name: [record[name]] for name in (condition(text, names)[0] for text in where)}
        return bool(kept_rows(where, names, tested, 1, decimal)[0])

    table = columns_of(source, choose, TextForm(delimiter, decimal, encoding, header), kept)
    table = _filtered(table, where, decimal)
    rows = _by_sensor(table, found, sensors, day, decimal)
    if len({each.times.absolute for each in rows}) > 1:
        raise ValueError(f"{table.where}: times of one sensor are absolute and those of another are not")
    return assembled(table, rows, found, reference, azimuth_convention, order == "strict", drop_repeats)


def _check_encoding(encoding: str) -> None:
    try:
        "".encode(encoding)
    except LookupError:
        raise ValueError(f"encoding must be one of text, such as utf-8 or cp1252, got {encoding!r}") from None


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


def _filtered(table: Columns, conditions: Sequence[str], decimal: str) -> Columns:
    n = len(table.line)
    if not n:
        raise ValueError(
            f"{table.where}: no rows follow" + (", or none fulfils --where" if conditions else "")
        )
    if not conditions:
        return table
    mask = kept_rows(conditions, table.names, table.values, n, decimal)
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
) -> list[SensorRows]:
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
    unit, source = row_name(table), source_of(table)
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
        if time is None or not family_of(layout):
            raise ValueError(
                f"{table.where}: sensor {name!r} has no columns; give --time {name}=COLUMN:UNIT and others"
            )
        form = time.unit or unit_in_name(time.name)
        times = read_times(values[time.name], form, partial(at, time.name), day, decimal)
        positions = read_positions(layout, values, table.where, at, decimal)
        said = [s for s in settings if s.name == name] or [
            s for s in settings if s.name is None or not column
        ]
        rows.append(SensorRows(name, indices, layout, times, positions, (said or [SensorSettings()])[0]))
    if day is None:
        return rows
    moved = on_one_day([each.times for each in rows])
    return [each._replace(times=times) for each, times in zip(rows, moved, strict=True)]
