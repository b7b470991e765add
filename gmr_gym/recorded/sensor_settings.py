"""What is said of a sensor, from the keys of a file of settings or from options."""

import math
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

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


def sensor(where: str, table: Mapping[str, Any]) -> SensorSettings:
    """Settings of a sensor from its keys; a quantity is a number in SI or text such as "0.07 deg"."""
    position, clutter = table.get("position", {}), table.get("clutter", {})
    check_keys(f"{where}, position", position, ("lat", "lon", "alt", "x", "y", "z"))
    check_keys(f"{where}, clutter", clutter, ("density", "per_scan", "learn"))
    check_type(f"{where}, clutter, learn", clutter.get("learn", False), bool)
    if {"density", "per_scan"} <= {key for key, value in clutter.items() if value != AUTO}:
        raise ValueError(f"{where}, clutter: density and per_scan both say it; give one of them")
    geodetic = place = None
    if "lat" in position or "lon" in position:
        geodetic = geodetic_in(f"{where}, position", position)
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


def geodetic_in(where: str, table: Mapping[str, Any]) -> tuple[float, float, float]:
    """As `geodetic_of`, of a table with lat, lon and perhaps alt."""
    check_keys(where, table, ("lat", "lon", "alt"))
    return geodetic_of(where, [table.get("lat"), table.get("lon"), table.get("alt", 0.0)])


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


def check_type(where: str, value: Any, kind: type) -> None:
    """ValueError for a value of another type."""
    fits = isinstance(value, int | float if kind is float else kind)
    if not fits or (kind is float and isinstance(value, bool)):
        raise ValueError(f"{where}: must be of type {kind.__name__}, got {value!r}")


def check_keys(where: str, table: Mapping[str, Any], known: Sequence[str] | Mapping) -> None:
    """ValueError for what is no table, or has another key than these."""
    if not isinstance(table, Mapping):
        raise ValueError(f"{where}: must be a table, got {table!r}")
    for key in table:
        if key not in known:
            raise ValueError(
                f"{where}: unknown key {key!r}{did_you_mean(key, known)}; choose from {', '.join(known)}"
            )
