"""Units of columns: what each is in metres, seconds, metres a second or radians, and where a name says it."""

import math
import re
from collections.abc import Iterable
from difflib import get_close_matches

LENGTH, TIME, SPEED, ANGLE = "length", "time", "speed", "angle"
# what one of a unit is in SI; the first of a quantity is the SI unit itself
UNITS = {
    LENGTH: {"m": 1.0, "km": 1000.0, "ft": 0.3048, "nmi": 1852.0, "FL": 30.48},
    TIME: {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0},
    SPEED: {"m/s": 1.0, "km/h": 1 / 3.6, "kn": 1852 / 3600, "ft/s": 0.3048},
    ANGLE: {"rad": 1.0, "deg": math.pi / 180, "mrad": 1e-3},
}
SPELLINGS = {
    "metres": "m", "meters": "m", "metre": "m", "meter": "m", "kilometres": "km", "kilometers": "km",
    "feet": "ft", "foot": "ft", "nm": "nmi", "fl": "FL", "flight_level": "FL",
    "seconds": "s", "sec": "s", "secs": "s", "milliseconds": "ms", "microseconds": "us",
    "µs": "us", "μs": "us", "nanoseconds": "ns", "minutes": "min", "hours": "h",
    "mps": "m/s", "kmh": "km/h", "kph": "km/h", "kt": "kn", "kts": "kn", "knots": "kn", "fps": "ft/s",
    "degrees": "deg", "degree": "deg", "°": "deg", "radians": "rad",
}  # fmt: skip
QUANTITY = {unit: quantity for quantity, units in UNITS.items() for unit in units}
ENDING = re.compile(r"^(?P<base>.*?)[ _]*[_ (\[](?P<unit>[^ _()\[\]]+)[)\]]?$")


def unit_named(text: str) -> str | None:
    """The unit of the table that a spelling stands for, or None."""
    text = text.strip()
    return next((u for u in (text, SPELLINGS.get(text.lower(), ""), text.lower()) if u in QUANTITY), None)


def unit_in_name(name: str) -> str | None:
    """The unit that a column's name ends in, after a blank, an underscore or in brackets.

    Examples
    --------
    >>> [unit_in_name(name) for name in ("range_nmi", "altitude (m)", "SOG_knots", "Vx m/s", "snr", "m")]
    ['nmi', 'm', 'kn', 'm/s', None, None]
    """
    found = ENDING.match(name.strip().replace(",", " "))
    return unit_named(found["unit"]) if found else None


def base_of(name: str) -> str:
    """The name without the unit it ends in, in lower case.

    Examples
    --------
    >>> [base_of(name) for name in ("Range_nmi", "altitude (m)", "range rate")]
    ['range', 'altitude', 'range_rate']
    """
    found = ENDING.match(name.strip().replace(",", " ")) if unit_in_name(name) else None
    return re.sub(r"[ _.-]+", "_", (found["base"] if found else name).strip(" _").lower())


def scale_of(unit: str, quantity: str, where: str) -> float:
    """What one of a unit is in SI.

    Parameters
    ----------
    unit : str
        As in `UNITS`, or another spelling of one of them.
    quantity : str
        The key of `UNITS` that it must be of.
    where : str
        What the error begins with.

    Returns
    -------
    float

    Raises
    ------
    ValueError
        For a unit that is not known, with the nearest one, and for one of another quantity.
    """
    named = unit_named(unit)
    if named is None:
        near = did_you_mean(
            unit, [*UNITS[quantity], *(s for s in SPELLINGS if SPELLINGS[s] in UNITS[quantity])]
        )
        raise ValueError(
            f"{where}: unknown unit {unit!r}{near}; a {quantity} is in {', '.join(UNITS[quantity])}"
        )
    if QUANTITY[named] != quantity:
        known = ", ".join(UNITS[quantity])
        raise ValueError(
            f"{where}: {unit} is a unit of {QUANTITY[named]}, but a {quantity} is needed: {known}"
        )
    return UNITS[quantity][named]


def quantity_typed(text: str | float, quantity: str, where: str) -> float:
    """A number with a unit behind it, such as "50 m" or "0.1deg", in SI; without a unit it is in SI."""
    found = re.fullmatch(r"\s*([-+]?[0-9.]+(?:[eE][-+]?[0-9]+)?)\s*(.*?)\s*", str(text))
    try:
        number = float(found[1]) if found else math.nan
    except ValueError:
        number = math.nan
    if not (found and math.isfinite(number)):
        unit = next(iter(UNITS[quantity]))
        raise ValueError(f"{where}: {text!r} is not a number with a unit, such as 5{unit}")
    return number * scale_of(found[2], quantity, where) if found[2] else number


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """`, did you mean 'x'?` for the nearest of the known words, or nothing."""
    near = get_close_matches(word, list(known), 1) or get_close_matches(word.lower(), list(known), 1)
    return f", did you mean {near[0]!r}?" if near else ""
