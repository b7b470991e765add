"""What the columns of a file are: time, position, sensor, identity. A column without a role is metadata."""

from collections.abc import Mapping, Sequence

from gmr_gym.recorded.roles import FAMILIES, NAMED, NEEDS, ROLES, Column, Layout, option
from gmr_gym.recorded.units import base_of, did_you_mean


def layouts(
    where: str, names: Sequence[str], given: Mapping[str, str | Sequence[str]]
) -> dict[str | None, Layout]:
    """Columns by role, for each sensor that has its own.

    Parameters
    ----------
    where : str
        Where the names stand, for messages.
    names : sequence of str
        Columns of the file.
    given : mapping of str to str or sequence of str
        By role `COLUMN`, `COLUMN:UNIT`, or `SENSOR=COLUMN:UNIT` for the rows of one sensor; a time has `iso`
        or a format of strptime in place of a unit. Without any position among them, columns are found by
        their names.

    Returns
    -------
    dict
        Of None: what holds for all sensors; of the others: all that holds for them.

    Raises
    ------
    ValueError
        Naming the option to give or to change.
    """
    found: dict[str | None, Layout] = {None: {}}
    for role, typed in given.items():
        if role not in ROLES:
            raise ValueError(
                f"unknown role {role!r}{did_you_mean(role, ROLES)}; choose from {', '.join(ROLES)}"
            )
        for text in [typed] if isinstance(typed, str) else typed:
            sensor, column = _typed(where, names, role, text)
            if role in found.setdefault(sensor, {}):
                raise ValueError(f"{option(role)} is given twice: {found[sensor][role].name}, {column.name}")
            found[sensor][role] = column
    common = found[None]
    if "time" not in common and not all("time" in own for sensor, own in found.items() if sensor is not None):
        common |= _named(where, names, ["time"], common)
    if len(found) == 1 and "time" not in common:
        common |= _named(where, names, ["time"], common)
    if not any(role in layout for layout in found.values() for family in FAMILIES for role in family):
        common |= _positions_named(where, names, common)
    for sensor, own in found.items():
        found[sensor] = common | own
        if sensor is not None or len(found) == 1:
            _check(where, names, found[sensor], sensor)
    return found


def _typed(where: str, names: Sequence[str], role: str, text: str) -> tuple[str | None, Column]:
    """Sensor and column of `[SENSOR=]COLUMN[:UNIT]`; a column's name may hold either sign."""
    sensor: str | None = None
    name, unit = _split(names, text)
    if name is None and "=" in text:
        sensor, _, text = text.partition("=")
        name, unit = _split(names, text)
    if name is None:
        typed = text.partition(":")[0]
        hint = did_you_mean(typed, names)
        raise ValueError(
            f"{where}: no column {typed!r} for {option(role)}{hint}; there are {', '.join(names)}"
        )
    return sensor, Column(name, unit)


def _split(names: Sequence[str], text: str) -> tuple[str | None, str | None]:
    """The column that a text begins with, the longest, and what follows its colon."""
    if text in names:
        return text, None
    for i in range(len(text) - 1, 0, -1):
        if text[i] == ":" and text[:i] in names:
            return text[:i], text[i + 1 :]
    return None, None


def _named(where: str, names: Sequence[str], roles: Sequence[str], layout: Layout) -> Layout:
    """Columns found by their names."""
    taken = {column.name for column in layout.values()}
    found = {}
    for role in roles:
        for alias in NAMED[role]:
            fits = [name for name in names if base_of(name) == alias and name not in taken]
            if len(fits) > 1:
                raise ValueError(
                    f"{where}: columns {' and '.join(fits)} may both be {role}; say which by "
                    f"{option(role)} {fits[0]}"
                )
            if fits:
                found[role] = Column(fits[0], None)
                break
    return found


def _positions_named(where: str, names: Sequence[str], layout: Layout) -> Layout:
    families = []
    for family in FAMILIES:
        extra = ["range_rate"] if family[0] == "range" else []
        found = _named(where, names, [*family, *extra], layout)
        if family[0] in found and family[1] in found:
            families.append(found)
    if len(families) == 1:
        return families[0]
    ways = "--x COLUMN --y COLUMN, or --lat and --lon, or --range and --azimuth"
    if not families:
        raise ValueError(f"{where}: which columns are positions? give {ways}; there are {', '.join(names)}")
    several = " and ".join(", ".join(c.name for c in found.values()) for found in families)
    raise ValueError(f"{where}: {several} are positions; say which by {ways}")


def _check(where: str, names: Sequence[str], layout: Layout, sensor: str | None) -> None:
    """Refuse a layout without a time, with half a position or two, and a column of two roles."""
    of = f" of sensor {sensor}" if sensor else ""
    if "time" not in layout:
        raise ValueError(
            f"{where}: which column{of} is the time? give --time COLUMN; there are {', '.join(names)}"
        )
    present = [family for family in FAMILIES if any(role in layout for role in family)]
    if len(present) != 1:
        two = " and ".join("/".join(family[:2]) for family in present) or "no column"
        raise ValueError(
            f"{where}: {two} are given as the position{of}; give one of x/y, lat/lon, range/azimuth"
        )
    for role in present[0][:2]:
        if role not in layout:
            other = next(r for r in present[0] if r in layout)
            raise ValueError(f"{where}: {option(other)}{of} needs {option(role)} COLUMN as well")
    for role, needed in NEEDS.items():
        if role in layout and needed not in layout:
            raise ValueError(f"{where}: {option(role)}{of} needs {option(needed)} COLUMN as well")
    if "own_x" in layout and "own_lat" in layout:
        raise ValueError(f"{where}: --own-x and --own-lat are given{of}; give one of own-x/y, own-lat/lon")
    roles: dict[str, str] = {}
    for role, column in layout.items():
        if column.name in roles:
            raise ValueError(
                f"{where}, column {column.name}: given as {option(roles[column.name])} and as "
                f"{option(role)}; a column has one role"
            )
        roles[column.name] = role
