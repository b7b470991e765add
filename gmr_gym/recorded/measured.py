"""Positions of rows in SI units, from whatever columns and units they have."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gmr_gym.checks import check_choice
from gmr_gym.evaluation.csv_columns import numbers
from gmr_gym.recorded.formats import ABSENT
from gmr_gym.recorded.geodesy import axes_at
from gmr_gym.recorded.roles import GEODETIC, OWN, ROLES, Layout, family_of, option, unit_of
from gmr_gym.recorded.units import scale_of

COMPASS, MATH = "compass", "math"  # azimuths clockwise from north, or counter-clockwise from x
FARTHEST = 1e9  # m, of any position: beyond it a unit is mistaken
TURN = 2 * np.pi
Place = Callable[[str, int], str]  # where the cell of a column and a row stands


class Positions(NamedTuple):
    """What rows of one layout measure, NaN where a row has no position."""

    family: tuple[str, ...]  # roles of the coordinates
    z: np.ndarray  # (n, p); latitude and longitude in degrees
    range_rate: np.ndarray  # (n,) m/s
    own: np.ndarray  # (n, 3) where the sensor says it is: m, or deg, deg, m; NaN where it does not


def read_positions(
    layout: Layout, values: Mapping[str, Sequence], where: str, at: Place, decimal: str
) -> Positions:
    """Positions of the rows whose cells are `values`.

    Raises
    ------
    ValueError
        Naming file, line and column of half a position and of one that cannot be.
    """

    def si(role: str) -> np.ndarray:
        column = layout[role]
        unit = unit_of(where, role, column)
        scale = scale_of(unit, ROLES[role] or "", f"{where}, column {column.name}")
        cells: Any = values[column.name]
        if not isinstance(cells, np.ndarray):
            cells = numbers(cells, partial(at, column.name), ABSENT, decimal)
        if role in GEODETIC:
            return cells if unit == "deg" else np.degrees(cells * scale)
        return cells * scale

    family = family_of(layout)
    z = np.column_stack([si(role) for role in family])
    n = len(z)
    if n and np.isnan(z).all(axis=0).any():
        role = family[int(np.isnan(z).all(axis=0).argmax())]
        raise ValueError(
            f"{where}, column {layout[role].name}: empty in all {n} rows; leave {option(role)} out or "
            "name another column"
        )
    some, all_there = ~np.isnan(z).all(axis=1), ~np.isnan(z).any(axis=1)
    for i in np.flatnonzero(some & ~all_there)[:1].tolist():
        lacking, other = (layout[family[int(f(np.isnan(z[i])))]].name for f in (np.argmax, np.argmin))
        raise ValueError(f"{at(lacking, i)}: no value, though {other} has one")
    names = [layout[role].name for role in family]
    _check(family, z, lambda i, j: at(names[j], i))
    rate = si("range_rate") if "range_rate" in layout else np.full(n, np.nan)
    own = np.full((n, 3), np.nan)
    if known := family_of(layout, OWN):
        own[:] = 0.0
        own[:, : len(known)] = np.column_stack([si(role) for role in known])
        places = [layout[role].name for role in known]
        for i, j in np.argwhere(np.isnan(own) & all_there[:, None])[:1].tolist():
            raise ValueError(f"{at(places[j], i)}: no value, though {names[0]} has one")
        _check([role.removeprefix("own_") for role in known], own, lambda i, j: at(places[j], i))
    return Positions(family, z, rate, own)


def azimuths(measured: np.ndarray, convention: str, north_offset: float = 0.0) -> np.ndarray:
    """Azimuths from the x axis, counter-clockwise, in (-pi, pi].

    Parameters
    ----------
    measured : ndarray (n,)
        rad, clockwise from north (`compass`) or counter-clockwise from x (`math`).
    convention : str
    north_offset : float
        rad, from true north to the sensor's, clockwise.
    """
    check_choice("azimuth_convention", convention, (COMPASS, MATH))
    turned = np.pi / 2 - measured if convention == COMPASS else measured
    return -np.mod(-(turned - north_offset) + np.pi, TURN) + np.pi


def to_axes(z: np.ndarray, geodetic: ArrayLike, reference: ArrayLike) -> np.ndarray:
    """Range, azimuth[, elevation] (n, p), from the axes of a sensor at `geodetic` (3,), or (n, 3) where it
    moves, to those of the reference: meridians converge, and the horizon falls."""
    azimuth, elevation = z[:, 1], z[:, 2] if z.shape[1] > 2 else np.zeros(len(z))
    along = np.cos(elevation)
    unit = np.column_stack([along * np.cos(azimuth), along * np.sin(azimuth), np.sin(elevation)])
    east, north, up = turned_to(unit, geodetic, reference).T
    turned = [z[:, 0], np.arctan2(north, east), np.arctan2(up, np.hypot(east, north))]
    return np.column_stack(turned[: z.shape[1]])


def turned_to(points: np.ndarray, geodetic: ArrayLike, reference: ArrayLike) -> np.ndarray:
    """Directions (n, 3) along the axes of a sensor, along those of the reference; see `to_axes`."""
    axes = axes_at(geodetic)
    global_ones = points @ axes if axes.ndim == 2 else np.einsum("ni,nij->nj", points, axes)
    return global_ones @ axes_at(reference).T


def _check(family: Sequence[str], z: np.ndarray, at: Callable[[int, int], str]) -> None:
    """Refuse coordinates that no place has."""

    def refuse(column: int, wrong: np.ndarray, text: str, scale: float = 1.0) -> None:
        for i in np.flatnonzero(wrong)[:1].tolist():
            raise ValueError(f"{at(i, column)}: {z[i, column] / scale:g} {text}")

    if family[0] == "lat":
        refuse(
            0, np.abs(z[:, 0]) > 90, "is no latitude in degrees: give another unit, or swap --lat and --lon"
        )
        refuse(1, np.abs(z[:, 1]) > 360, "is no longitude in degrees")
    elif family[0] == "range":
        refuse(0, z[:, 0] < 0, "m is a negative range: leave such rows out with --where")
        many = np.abs(z[:, 1]) > TURN * 1.001
        else_out = "COLUMN:deg, or leave such rows out with --where"
        refuse(1, many, f"rad is more than a turn: degrees? give --azimuth {else_out}")
        if len(family) > 2:
            above = np.abs(z[:, 2]) > np.pi / 2 * 1.001
            refuse(2, above, f"rad is above the zenith: degrees? give --elevation {else_out}")
    lengths = [j for j, role in enumerate(family) if role in ("x", "y", "z", "alt", "range")]
    for j in lengths:
        refuse(j, np.abs(z[:, j]) > FARTHEST, "m is beyond 1e9 m: another unit?")
