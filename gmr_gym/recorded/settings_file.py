"""Settings written as the file (TOML) that `configuration.read_configuration` reads."""

import json
import math
from collections.abc import Mapping, Sequence
from datetime import date
from pathlib import Path
from typing import Any

from gmr_gym.evaluation.writing import whole
from gmr_gym.recorded.configuration import Configuration
from gmr_gym.recorded.sensor_settings import MEASURED, SensorSettings
from gmr_gym.recorded.units import ANGLE, LENGTH

SENSOR_NUMBERS = ("rotation_period", "detection_probability")


def write_configuration(path: Path | str, settings: Configuration, comments: Sequence[str] = ()) -> None:
    """Write settings to a file.

    Parameters
    ----------
    path : Path or str
    settings : Configuration
    comments : sequence of str
        Lines that come first, after a `#`.

    Raises
    ------
    OSError
        Naming the file.
    """
    lines = [f"# {line}".rstrip() for line in comments]
    reading = dict(settings.reading)
    if "reference" in reading:
        reading["reference"] = _geodetic(reading["reference"])
    columns = {role: list(names) for role, names in settings.columns.items()}
    sections = [("[input]", columns | reading)]
    sections += [("[[sensor]]", _sensor(one)) for one in settings.sensors]
    sections += [(f"[{name}]", getattr(settings, name)) for name in ("target", "tracks", "output")]
    for title, table in sections:
        if table:
            lines += ["", title, *(f"{key} = {_value(value)}" for key, value in table.items())]
    with whole(Path(path)) as partial:
        partial.write_text("\n".join(lines).lstrip() + "\n", encoding="utf-8")


def _sensor(one: SensorSettings) -> dict[str, Any]:
    """The keys of a sensor, of what is known."""
    table: dict[str, Any] = {} if one.name is None else {"name": one.name}
    if one.geodetic is not None:
        table["position"] = _geodetic(one.geodetic)
    elif one.position is not None:
        table["position"] = dict(zip("xyz", one.position, strict=False))
    if one.north_offset:
        table["north_offset"] = f"{one.north_offset!r} rad"
    table |= {name: getattr(one, name) for name in SENSOR_NUMBERS if not math.isnan(getattr(one, name))}
    deviation = {role: value for role, value in one.deviation.items() if not math.isnan(value)}
    if deviation:
        table["deviation"] = {role: _quantity(role, value) for role, value in deviation.items() if role}
        if "" in deviation:
            table["deviation"] = deviation[""]
    clutter = {"per_scan": one.clutter_per_scan, "density": one.clutter_density}
    held: dict[str, Any] = {name: value for name, value in clutter.items() if not math.isnan(value)}
    if one.learn_clutter:
        held["learn"] = True
    return table | ({"clutter": held} if held else {})


def _quantity(role: str, value: float) -> str:
    """A deviation with its unit."""
    quantity = MEASURED[role]
    if quantity == ANGLE:
        return f"{math.degrees(value):.6g} deg"
    return f"{value:.6g} {'m' if quantity == LENGTH else 'm/s'}"


def _geodetic(place: Sequence[float]) -> dict[str, float]:
    return dict(zip(("lat", "lon", "alt"), map(float, place), strict=False))


def _value(value: Any) -> str:
    """A value as TOML has it."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {_value(one)}" for key, one in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_value, value)) + "]"
    if isinstance(value, date):
        return value.isoformat()
    return json.dumps(value, ensure_ascii=False)
