"""What columns of a file may be: time, position, sensor, identity; what they are called, and their units."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gmr_gym.recorded.times import LATEST as AFTER
from gmr_gym.recorded.units import ANGLE, LENGTH, SPEED, TIME, UNITS, base_of, unit_in_name

# quantity of each role; None: text
ROLES = {
    "time": TIME, "x": LENGTH, "y": LENGTH, "z": LENGTH, "lat": ANGLE, "lon": ANGLE, "alt": LENGTH,
    "range": LENGTH, "azimuth": ANGLE, "elevation": ANGLE, "range_rate": SPEED,
    "own_x": LENGTH, "own_y": LENGTH, "own_z": LENGTH, "own_lat": ANGLE, "own_lon": ANGLE, "own_alt": LENGTH,
    "scan": None, "sensor": None, "id": None, "truth": None,
}  # fmt: skip
# coordinates that make a position; the last is optional
FAMILIES = (("x", "y", "z"), ("lat", "lon", "alt"), ("range", "azimuth", "elevation"))
GEODETIC = ("lat", "lon", "own_lat", "own_lon")  # in degrees unless something else is said
OWN = (("own_x", "own_y", "own_z"), ("own_lat", "own_lon", "own_alt"))  # likewise, of a moving sensor
NEEDS = {
    "range_rate": "range", "own_x": "own_y", "own_y": "own_x", "own_z": "own_x", "own_lat": "own_lon",
    "own_lon": "own_lat", "own_alt": "own_lat",
}  # fmt: skip
# what columns are called, without their unit, where no option says so
NAMED = {
    "time": ("time", "time_utc", "utc", "datetime", "timestamp", "time_of_day", "tod", "t"),
    "x": ("x", "east", "easting"), "y": ("y", "north", "northing"), "z": ("z", "up"),
    "lat": ("lat", "latitude"), "lon": ("lon", "long", "lng", "longitude"),
    "alt": ("alt", "altitude", "height"), "range": ("range", "slant_range"), "azimuth": ("azimuth",),
    "elevation": ("elevation",), "range_rate": ("range_rate",),
}  # fmt: skip
# columns of a file that has positions in metres and nothing else
PLAIN = {
    "x", "y", "z", "east", "north", "up", "easting", "northing", "e", "n", "u", "px", "py", "pz",
    "pos_x", "pos_y", "pos_z",
}  # fmt: skip


class Column(NamedTuple):
    """A column and how it is read."""

    name: str
    unit: str | None  # of a time also `iso` or a format


Layout = dict[str, Column]  # by role


def option(role: str) -> str:
    """The command-line option of a role."""
    return f"--{role.replace('_', '-')}"


def family_of(layout: Layout, families: Sequence[tuple[str, ...]] = FAMILIES) -> tuple[str, ...]:
    """The coordinates of a layout; of `OWN` those of where the sensor is."""
    return next(
        (tuple(role for role in family if role in layout) for family in families if family[0] in layout), ()
    )


def unit_of(where: str, role: str, column: Column) -> str:
    """The unit of a column, from the option or from its name.

    Raises
    ------
    ValueError
        Naming the option to give, where neither says it or where they say different ones.
    """
    named, quantity = unit_in_name(column.name), ROLES[role]
    if column.unit is None and named is None:
        if role in GEODETIC:
            return "deg"
        first, *others = UNITS[quantity or LENGTH]
        raise ValueError(
            f"{where}, column {column.name}: no unit in its name; give {option(role)} {column.name}:{first} "
            f"(or {', '.join(others)})"
        )
    if (
        column.unit
        and named
        and quantity
        and named in UNITS[quantity]
        and column.unit in UNITS[quantity]
        and named != column.unit
    ):
        raise ValueError(
            f"{where}, column {column.name}: {named} by its name, but {column.unit} by {option(role)}; "
            f"rename the column, or give {option(role)} {column.name}:{named}"
        )
    return column.unit or named or ""


def check_plain(where: str, coordinates: Sequence[str], times: np.ndarray) -> None:
    """Check that columns are positions in metres by their names, and times seconds.

    Parameters
    ----------
    where : str
        The file, for the message.
    coordinates : sequence of str
        All columns but the time.
    times : ndarray (T,)

    Raises
    ------
    ValueError
        Naming the column, and the options that say what it is.
    """
    for name in coordinates:
        unit = unit_in_name(name)
        if unit not in (None, "m"):
            raise ValueError(
                f"{where}, column {name}: in {unit}, not in metres; say what the columns are, such as "
                f"--x {name} --y COLUMN, or --lat and --lon, or --range and --azimuth"
            )
        if unit is None and base_of(name) not in PLAIN and "," not in name:
            raise ValueError(
                f"{where}, column {name}: no position in metres by its name; say which are, such as "
                "--x COLUMN:m --y COLUMN:m: the other columns are then kept beside them"
            )
    if np.abs(times).max() > AFTER:
        raise ValueError(
            f"{where}: {np.abs(times).max():.16g} s is {np.abs(times).max() / 31_557_600:.3g} years; say "
            "what times are, such as --time COLUMN:us, and --x COLUMN:m --y COLUMN:m"
        )
