"""Rows of all sensors of a file put together: in local coordinates, in order of time, without repeats."""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.evaluation.csv_columns import Columns
from gmr_gym.recorded.detections import CARTESIAN, POLAR, Detections, SensorSpec, chosen, numbered, objects
from gmr_gym.recorded.geodesy import to_local
from gmr_gym.recorded.measured import COMPASS, Positions, azimuths, to_axes, turned_to
from gmr_gym.recorded.plausibility import check_speeds
from gmr_gym.recorded.roles import OWN, Layout, family_of, option, unit_of
from gmr_gym.recorded.sensor_settings import SensorSettings
from gmr_gym.recorded.times import Times

Layouts = Mapping[str | None, Layout]
Reference = Any  # latitude deg, longitude deg, altitude m; None for none
MIXED = np.uint64(0x9E3779B97F4A7C15)  # what bits of a row are spread with: odd
TEXTS = ("scan", "sensor", "id", "truth")


class SensorRows(NamedTuple):
    """Rows of a table that are of one sensor."""

    name: str
    at: np.ndarray  # (k,) indices
    layout: Layout
    times: Times
    positions: Positions
    settings: SensorSettings


def assembled(
    table: Columns,
    rows: list[SensorRows],
    found: Layouts,
    reference: Reference,
    convention: str,
    strict: bool,
    drop_repeats: bool,
) -> Detections:
    """Rows of all sensors in order of time, without those that repeat others or have no position."""
    turned = any(each.settings.north_offset for each in rows)
    if turned and not any(each.positions.family[0] == "range" for each in rows):
        raise ValueError(f"{source_of(table)}: no azimuths for a north offset to turn; leave it out")
    n, p = len(table.line), max(each.positions.z.shape[1] for each in rows)
    reference = reference or _reference(rows)
    ns, sensor, origin = np.zeros(n, np.int64), np.zeros(n, int), np.zeros((n, 3))
    z, rate = np.full((n, p), np.nan), np.full(n, np.nan)
    specs = []
    for i, each in enumerate(rows):
        place = _place(each, reference)
        own = _own(each, place, reference)
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
        (ns - ns.min()) / 1e9, z, rate, origin, sensor, numbered(text["scan"]), text["id"], text["truth"],
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
    fast = check_speeds(source_of(table), seen)
    return seen._replace(
        remarks=(*_as_read(rows, convention), *table.remarks, *remarks, *([fast] if fast else []))
    )


def row_name(table: Columns) -> str:
    """What a row of the input is called: JSON and arrays have no lines."""
    return "line" if ", line " in table.where else "record"


def source_of(table: Columns) -> str:
    return table.where.rpartition(", line ")[0] or table.where


def _reference(rows: list[SensorRows]) -> Reference:
    """Where the first sensor is, or else latitude and longitude of the first row that has one of a moving
    sensor or of a detection, at height 0."""
    for each in rows:
        if each.settings.geodetic is not None:
            return each.settings.geodetic
    for each in rows:
        places = each.positions.own if "own_lat" in each.layout else each.positions.z
        there = places[~np.isnan(places[:, 0])]
        if len(there) and ("own_lat" in each.layout or each.positions.family[0] == "lat"):
            return float(there[0, 0]), float(there[0, 1]), 0.0
    return None


def _place(each: SensorRows, reference: Reference) -> np.ndarray:
    """Where the sensor is (3,), m."""
    if each.settings.geodetic is not None:
        return to_local(each.settings.geodetic, reference)
    return np.array(each.settings.position or (0.0, 0.0, 0.0))


def _own(each: SensorRows, place: np.ndarray, reference: Reference) -> np.ndarray:
    """Where the sensor is at each row (k, 3), m."""
    own = each.positions.own
    own = to_local(own, reference) if "own_lat" in each.layout else own
    return np.where(np.isnan(own), place, own)


def _measured(each: SensorRows, own: np.ndarray, reference: Reference, convention: str) -> np.ndarray:
    """Measurements (k, p) in local coordinates or polar ones, from what the file has."""
    z, p = each.positions.z, each.positions.z.shape[1]
    if each.positions.family[0] == "lat":
        heights = z[:, 2] if p > 2 else np.zeros(len(z))
        return to_local(np.column_stack([z[:, :2], heights]), reference)[:, :p]
    if each.positions.family[0] == "range":
        z = z.copy()
        z[:, 1] = azimuths(z[:, 1], convention, each.settings.north_offset)
        if "own_lat" in each.layout:
            return to_axes(z, each.positions.own, reference)
        there = each.settings.geodetic
        return z if there is None or there == reference else to_axes(z, there, reference)
    if "own_lat" in each.layout:  # what it measures is relative to itself
        z = turned_to(np.column_stack([z, np.zeros((len(z), 3 - p))]), each.positions.own, reference)[:, :p]
    return z + own[:, :p] if family_of(each.layout, OWN) else z


def _spec(each: SensorRows, place: np.ndarray) -> SensorSpec:
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
        back = (ns[i - 1] - ns[i]) / 1e9
        raise ValueError(
            f"{source_of(table)}, {row_name(table)} {table.line[i]}: time runs back by {back:g} s; "
            "sort the rows, or leave --order strict out"
        )
    return np.argsort(ns, kind="stable"), [f"{late.sum()} rows sorted by time"] if late.any() else []


def _repeats(seen: Detections) -> np.ndarray:
    """Mask (n,) of the rows that repeat an earlier one."""
    repeated = np.zeros(len(seen.time), bool)
    each = [seen.time, seen.sensor, numbered(seen.identity), numbered(seen.truth), seen.range_rate, *seen.z.T]
    digest = np.zeros(len(seen.time), np.uint64)
    for column in each:
        digest = (digest ^ column.astype(float).view(np.uint64)) * MIXED
        digest ^= digest >> np.uint64(32)
    order = np.argsort(digest, kind="stable")
    same = digest[order[1:]] == digest[order[:-1]]
    known: set = set()
    for i in np.unique(np.append(order[:-1][same], order[1:][same])).tolist():
        entry = tuple(column[i].tobytes() for column in each)
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


def _coordinates(rows: list[SensorRows]) -> tuple[str, ...]:
    """Names of the columns of the first layout with the most coordinates."""
    widest = max(rows, key=lambda each: len(each.positions.family))
    return tuple(widest.layout[role].name for role in widest.positions.family)


def _as_read(rows: list[SensorRows], convention: str) -> list[str]:
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
