"""A file of settings (TOML) for reading and tracking a file of detections; options override its keys."""

import math
import tomllib
from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from gmr_gym.recorded.columns import ROLES
from gmr_gym.recorded.units import ANGLE, LENGTH, SPEED, TIME, did_you_mean, quantity_typed

MEASURED = {
    "range": LENGTH,
    "azimuth": ANGLE,
    "elevation": ANGLE,
    "range_rate": SPEED,
    "x": LENGTH,
    "y": LENGTH,
    "z": LENGTH,
}
READING: dict[str, Any] = {
    "keep": list, "where": list, "delimiter": str, "decimal": str, "encoding": str, "header": bool,
    "day": date, "drop_repeats": bool, "order": str, "reference": dict, "azimuth_convention": str,
}  # fmt: skip
KEYS: dict[str, Sequence[str] | Mapping[str, type]] = {  # of each section, with the types of their values
    "input": (*ROLES, *READING),
    "sensor": (
        "name", "position", "north_offset", "rotation_period", "deviation",
        "detection_probability", "clutter",
    ),
    "target": {
        "motion": str, "modes": list, "acceleration_deviation": object, "stay_probability": float,
        "survival_probability": float, "max_speed": float,
    },
    "tracks": {
        "targets": str, "tracker": str, "confirm": str, "confirm_existence": float, "delete": str,
        "delete_existence": float, "max_coast": float, "gate_probability": float, "min_speed": float,
    },
    "output": {
        "out": str, "geojson": str, "html": str, "report": str, "mot": str, "labelled": str, "smooth": bool,
        "only": str, "overwrite": bool,
    },
}  # fmt: skip
OF_ROLE = {"time": ("format", "day"), "azimuth": ("from", "turning")}  # keys of one role alone
AUTO = "auto"


class SensorSettings(NamedTuple):
    """What is said of a sensor; NaN is nothing."""

    name: str | None = None  # None: of every sensor of the file
    geodetic: tuple[float, ...] | None = None  # latitude deg, longitude deg, altitude m
    position: tuple[float, ...] | None = None  # m, in local coordinates, where it is not geodetic
    north_offset: float = 0.0  # rad, from true north to its own, clockwise
    rotation_period: float = math.nan  # s
    deviation: Mapping[str, float] = MappingProxyType({})  # by role; of "" in every length; NaN: proposed
    detection_probability: float = math.nan
    clutter_per_scan: float = math.nan
    clutter_density: float = math.nan
    learn_clutter: bool = False


class Configuration(NamedTuple):
    """Settings by section."""

    columns: Mapping[str, list[str]] = MappingProxyType({})  # role -> COLUMN:UNIT, as `read` takes it
    reading: Mapping[str, Any] = MappingProxyType({})  # other arguments of `read`
    sensors: tuple[SensorSettings, ...] = ()
    target: Mapping[str, Any] = MappingProxyType({})
    tracks: Mapping[str, Any] = MappingProxyType({})
    output: Mapping[str, Any] = MappingProxyType({})


def read_configuration(path: Path | str) -> Configuration:
    """Settings of a TOML file.

    Parameters
    ----------
    path : Path or str

    Returns
    -------
    Configuration

    Raises
    ------
    ValueError
        Naming file and key, with the nearest key that is known.
    """
    try:
        found = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except ValueError as error:
        raise ValueError(f"{path}: not TOML: {error}") from None
    _check_keys(f"{path}", found, KEYS)
    for section, keys in KEYS.items():
        tables = found.get(section, [] if section == "sensor" else {})
        if not isinstance(tables, list if section == "sensor" else dict):
            form = "[[sensor]]" if section == "sensor" else f"[{section}]"
            raise ValueError(f"{path}: {section} must be a table, {form}")
        for table in tables if isinstance(tables, list) else [tables]:
            _check_keys(f"{path}, [{section}]", table, keys)
            for key, kind in keys.items() if isinstance(keys, Mapping) else ():
                if key in table:
                    _check_type(f"{path}, [{section}], {key}", table[key], kind)
    for mode in found.get("target", {}).get("modes", []):
        where = f"{path}, [target], modes"
        _check_keys(where, mode, ("motion", "acceleration_deviation"))
        _check_type(f"{where}, acceleration_deviation", mode.get("acceleration_deviation"), float)
    columns, reading = _input(f"{path}, [input]", found.get("input", {}))
    sensors = tuple(sensor(f"{path}, [[sensor]]", table) for table in found.get("sensor", []))
    sections = {name: found.get(name, {}) for name in ("target", "tracks", "output")}
    return Configuration(columns, reading, sensors, **sections)


def sensor(where: str, table: Mapping[str, Any]) -> SensorSettings:
    """Settings of a sensor from its keys; a quantity is a number in SI or text such as "0.07 deg"."""
    position, clutter = table.get("position", {}), table.get("clutter", {})
    _check_keys(f"{where}, position", position, ("lat", "lon", "alt", "x", "y", "z"))
    _check_keys(f"{where}, clutter", clutter, ("density", "per_scan", "learn"))
    _check_type(f"{where}, clutter, learn", clutter.get("learn", False), bool)
    if {"density", "per_scan"} <= {key for key, value in clutter.items() if value != AUTO}:
        raise ValueError(f"{where}, clutter: density and per_scan both say it; give one of them")
    geodetic = place = None
    if "lat" in position or "lon" in position:
        geodetic = _geodetic(f"{where}, position", position)
    elif position:
        place = tuple(
            quantity_typed(position.get(axis, 0.0), LENGTH, f"{where}, position {axis}") for axis in "xyz"
        )
    name = table.get("name")
    return SensorSettings(
        None if name is None else str(name),
        geodetic,
        place,
        quantity_typed(table.get("north_offset", 0.0), ANGLE, f"{where}, north_offset"),
        _number(where, table, "rotation_period", TIME),
        deviations(f"{where}, deviation", table.get("deviation", {})),
        _number(where, table, "detection_probability", None),
        _number(f"{where}, clutter", clutter, "per_scan", None),
        _number(f"{where}, clutter", clutter, "density", None),
        clutter.get("learn", False),
    )


def deviations(where: str, typed: str | float | Mapping[str, Any]) -> dict[str, float]:
    """Deviations by role, from a number, m, or `range=50,azimuth=0.1deg`, or a table; NaN for `auto`."""
    if isinstance(typed, str) and "=" in typed:
        pairs = [part.partition("=") for part in typed.split(",")]
        typed = {role.strip(): value for role, _, value in pairs}
        if len(typed) < len(pairs):
            raise ValueError(
                f"{where}: a coordinate is named twice: {', '.join(p[0].strip() for p in pairs)}"
            )
    if not isinstance(typed, Mapping):
        typed = {"": typed}
    found = {}
    for role, value in typed.items():
        if role and role not in MEASURED:
            raise ValueError(
                f"{where}: {role!r} is not measured{did_you_mean(role, MEASURED)}; "
                f"choose from {', '.join(MEASURED)}"
            )
        if value == AUTO:
            found[role] = math.nan
        else:
            found[role] = quantity_typed(value, MEASURED.get(role, LENGTH), f"{where} {role}".strip())
            if not found[role] > 0:
                raise ValueError(f"{where} {role}: must be positive, got {value}".replace(" :", ":"))
    return found


def geodetic_of(where: str, values: Sequence) -> tuple[float, float, float]:
    """Latitude deg, longitude deg and altitude m of a point on the Earth; the altitude may be left out."""
    try:
        latitude, longitude, altitude = map(float, [*values, 0.0] if len(values) == 2 else values)
    except (TypeError, ValueError):
        raise ValueError(
            f"{where}: must be LAT,LON or LAT,LON,ALT in degrees and metres, got {values}"
        ) from None
    if not (abs(latitude) <= 90 and abs(longitude) <= 360 and abs(altitude) < 1e8):
        raise ValueError(f"{where}: {latitude}, {longitude} is no latitude and longitude in degrees")
    return latitude, longitude, altitude


def _geodetic(where: str, table: Mapping[str, Any]) -> tuple[float, float, float]:
    """As `geodetic_of`, of a table with lat, lon and perhaps alt."""
    _check_keys(where, table, ("lat", "lon", "alt"))
    return geodetic_of(where, [table.get("lat"), table.get("lon"), table.get("alt", 0.0)])


def _input(where: str, table: Mapping[str, Any]) -> tuple[dict[str, list[str]], dict[str, Any]]:
    """Columns by role, and other arguments of `read`."""
    columns: dict[str, list[str]] = {}
    reading: dict[str, Any] = {}
    for key, value in table.items():
        if key in ROLES:
            entries = value if isinstance(value, list) else [value]
            columns[key] = [_column(f"{where}, {key}", key, entry, reading) for entry in entries]
            continue
        _check_type(f"{where}, {key}", value, READING[key])
        reading[key] = _geodetic(f"{where}, reference", value) if key == "reference" else value
    return columns, reading


def _column(where: str, role: str, entry: Any, reading: dict[str, Any]) -> str:
    """`SENSOR=COLUMN:UNIT` of a text or of a table with column, unit, format, sensor."""
    if not isinstance(entry, Mapping):
        return str(entry)
    _check_keys(where, entry, ("column", "unit", "sensor", *OF_ROLE.get(role, ())))
    if "column" not in entry:
        raise ValueError(f'{where}: needs a column, as in {{ column = "{role}_m" }}')
    if "day" in entry:
        reading["day"] = entry["day"]
    if "from" in entry or "turning" in entry:
        ways = {("north", "clockwise"): "compass", ("east", "counter-clockwise"): "math"}
        way = (
            entry.get("from", "north"),
            entry.get("turning", "clockwise" if entry.get("from") == "north" else ""),
        )
        if way not in ways:
            raise ValueError(
                f'{where}: must be from = "north", turning = "clockwise", or "east", "counter-clockwise"'
            )
        reading["azimuth_convention"] = ways[way]
    unit = entry.get("unit", entry.get("format"))
    before = f"{entry['sensor']}=" if "sensor" in entry else ""
    return f"{before}{entry['column']}" + (f":{unit}" if unit else "")


def _number(where: str, table: Mapping[str, Any], key: str, quantity: str | None) -> float:
    """A positive number, NaN where it is not given or `auto`."""
    value = table.get(key, AUTO)
    if value == AUTO:
        return math.nan
    if quantity is None and (isinstance(value, bool) or not isinstance(value, int | float)):
        raise ValueError(f'{where}, {key}: must be a number or "auto", got {value!r}')
    number = quantity_typed(value, quantity, f"{where}, {key}") if quantity else float(value)
    if not 0 < number < math.inf:
        raise ValueError(f"{where}, {key}: must be positive, got {value!r}")
    return number


def _check_type(where: str, value: Any, kind: type) -> None:
    fits = isinstance(value, int | float if kind is float else kind)
    if not fits or (kind is float and isinstance(value, bool)):
        raise ValueError(f"{where}: must be of type {kind.__name__}, got {value!r}")


def _check_keys(where: str, table: Mapping[str, Any], known: Sequence[str] | Mapping) -> None:
    if not isinstance(table, Mapping):
        raise ValueError(f"{where}: must be a table, got {table!r}")
    for key in table:
        if key not in known:
            raise ValueError(
                f"{where}: unknown key {key!r}{did_you_mean(key, known)}; choose from {', '.join(known)}"
            )
