"""A file of settings (TOML) for reading and tracking a file of detections; options override its keys."""

import tomllib
from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from gmr_gym.recorded.roles import ROLES
from gmr_gym.recorded.sensor_settings import SensorSettings, check_keys, check_type, geodetic_in, sensor

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
    check_keys(f"{path}", found, KEYS)
    for section, keys in KEYS.items():
        tables = found.get(section, [] if section == "sensor" else {})
        if not isinstance(tables, list if section == "sensor" else dict):
            form = "[[sensor]]" if section == "sensor" else f"[{section}]"
            raise ValueError(f"{path}: {section} must be a table, {form}")
        for table in tables if isinstance(tables, list) else [tables]:
            check_keys(f"{path}, [{section}]", table, keys)
            for key, kind in keys.items() if isinstance(keys, Mapping) else ():
                if key in table:
                    check_type(f"{path}, [{section}], {key}", table[key], kind)
    for mode in found.get("target", {}).get("modes", []):
        where = f"{path}, [target], modes"
        check_keys(where, mode, ("motion", "acceleration_deviation"))
        check_type(f"{where}, acceleration_deviation", mode.get("acceleration_deviation"), float)
    columns, reading = _input(f"{path}, [input]", found.get("input", {}))
    sensors = tuple(sensor(f"{path}, [[sensor]]", table) for table in found.get("sensor", []))
    sections = {name: found.get(name, {}) for name in ("target", "tracks", "output")}
    return Configuration(columns, reading, sensors, **sections)


def _input(where: str, table: Mapping[str, Any]) -> tuple[dict[str, list[str]], dict[str, Any]]:
    """Columns by role, and other arguments of `read`."""
    columns: dict[str, list[str]] = {}
    reading: dict[str, Any] = {}
    for key, value in table.items():
        if key in ROLES:
            entries = value if isinstance(value, list) else [value]
            columns[key] = [_column(f"{where}, {key}", key, entry, reading) for entry in entries]
            continue
        check_type(f"{where}, {key}", value, READING[key])
        reading[key] = geodetic_in(f"{where}, reference", value) if key == "reference" else value
    return columns, reading


def _column(where: str, role: str, entry: Any, reading: dict[str, Any]) -> str:
    """`SENSOR=COLUMN:UNIT` of a text or of a table with column, unit, format, sensor."""
    if not isinstance(entry, Mapping):
        return str(entry)
    check_keys(where, entry, ("column", "unit", "sensor", *OF_ROLE.get(role, ())))
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
