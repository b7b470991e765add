"""The parameters that are tuned, and between which values, as they are typed: parameter=low:high, or
parameter=one|another."""

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from math import floor, isfinite, log10
from typing import Any, NamedTuple

from gmr_gym.experiments.specs import complete
from gmr_gym.literals import key_value
from gmr_gym.models.assumptions import PREFIX, assumptions

DIGITS = 4  # of a number that is tried, so that it can be typed


class Interval(NamedTuple):
    """Numbers from low to high, whole where both are; `log` where ratios count."""

    low: float
    high: float
    log: bool
    whole: bool

    def __contains__(self, value: Any) -> bool:
        number = isinstance(value, int | float) and not isinstance(value, bool)
        return number and self.low <= value <= self.high and (value % 1 == 0 or not self.whole)

    def rounded(self, value: float) -> float:
        """The number as it is typed, within the interval; one below 1, a probability, stays there."""
        if self.whole:
            return value
        digits = max(DIGITS, 1 - floor(log10(1 - value))) if 0 < value < 1 else DIGITS
        return min(max(float(f"{value:.{digits}g}"), self.low), self.high)


class Choices(NamedTuple):
    """Any of some values."""

    values: tuple[Any, ...]

    def __contains__(self, value: Any) -> bool:
        return value in self.values

    def rounded(self, value: Any) -> Any:
        """The value."""
        return value


Space = Mapping[str, Interval | Choices]


def usual(spec: str, scenario: Any) -> dict[str, Any]:
    """All that can be tuned of a tracker NAME:key=value,key=value, as it is by default or as it is given: its
    own parameters, and what its filter model assumes, that of a scenario or of another tracker."""
    own = complete(spec, scenario)
    return {key: value for key, value in own.items() if not key.startswith(PREFIX)} | {
        key: own.get(key, value) for key, value in assumptions(scenario.model).items()
    }


def space_of(texts: Iterable[str], spec: str, known: Mapping[str, Any], fixed: Iterable[str]) -> Space:
    """What is typed to be tuned of the tracker `spec` that has the parameters `known`, of which the user gave
    some, `fixed`. Raises ValueError for nothing, and for a parameter or a range that is none."""
    there = ", ".join(f"{key}={_short(value)}" for key, value in known.items())
    found: dict[str, Interval | Choices] = {}
    for text in texts:
        name, sign, values = text.partition("=")
        if not sign or not name or not values:
            raise ValueError(f"--over must be parameter=low:high or parameter=one|another, got {text!r}")
        if name not in known:
            near = get_close_matches(name, known, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise ValueError(f"--over: tracker {spec!r} has no parameter {name!r}{hint} (it has {there})")
        if name in found:
            raise ValueError(f"--over: {name} is given twice")
        if name in fixed:
            raise ValueError(f"--over: {name} is given by --tracker {spec} already; leave it out there")
        found[name] = _choices(name, values) if "|" in values else _interval(name, values, known[name])
    if not found:
        raise ValueError(
            f"nothing is tuned: give --over parameter=low:high or parameter=one|another; {spec} has {there}"
        )
    return dict(sorted(found.items()))


def _short(value: Any) -> str:
    text = f"{value:.4g}" if isinstance(value, float) else f"{value}"
    return text if len(text) <= 30 else f"{text[:27]}..."


def _choices(name: str, text: str) -> Choices:
    values: list[Any] = []
    for part in text.split("|"):
        if not part or "," in part:
            raise ValueError(f"--over: {name} must be values with | between and no commas, got {text!r}")
        _, value = key_value(f"{name}={part}")
        if not isinstance(value, bool | int | float | str | None):
            raise ValueError(f"--over: {name} must be numbers or words with | between, got {part!r}")
        if any(value == other and type(value) is type(other) for other in values):
            raise ValueError(f"--over: {name} has the value {part} twice")
        values.append(value)
    return Choices(tuple(values))


def _interval(name: str, text: str, default: Any) -> Interval:
    form = f"--over: {name} must be low:high or low:high:log, numbers"
    ends, log = text.removesuffix(":log"), text.endswith(":log")
    bounds: list[Any] = [key_value(f"{name}={part}")[1] if part else "" for part in ends.split(":")]
    if len(bounds) != 2 or any(not isinstance(end, int | float) or isinstance(end, bool) for end in bounds):
        raise ValueError(f"{form}, or one|another, got {text!r}")
    low, high = bounds
    if not (isfinite(low) and isfinite(high)):
        raise ValueError(f"{form} that are finite, got {text!r}")
    if low >= high:
        raise ValueError(f"{form} with low below high, got {text!r}")
    if log and low <= 0:
        raise ValueError(f"{form}; log needs a low end above 0, got {text!r}")
    whole = isinstance(low, int) and isinstance(high, int) and not isinstance(default, float)
    return Interval(low, high, log, whole) if whole else Interval(float(low), float(high), log, whole)
