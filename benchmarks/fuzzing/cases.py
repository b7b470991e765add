"""What a target is, and one case of it: drawn from (seed, target, number), called, judged."""

import re
import warnings
from collections.abc import Callable
from traceback import format_exc
from typing import Any, NamedTuple
from zlib import crc32

import numpy as np

ILLEGAL = 0.2  # of the cases of a target whose input can be spoilt
DOOR = (ValueError, TypeError)  # what a public door may raise
# what may come of a case: the first two are as it should be; "unjudged" is an error of what draws or judges
# it, and "hang" and "crash" only a parent sees
OUTCOMES = (
    "ok", "refused", "error", "warning", "not finite", "moments", "origin", "shape", "indefinite", "variant",
    "value", "accepted", "unnamed", "memory", "unjudged", "hang", "crash",
)  # fmt: skip
FINE = ("ok", "refused")


class Finding(Exception):
    """Something that should hold and does not: one of OUTCOMES, and what was seen."""

    def __init__(self, outcome: str, message: str):
        super().__init__(message)
        self.outcome, self.message = outcome, message


class Spoilt(NamedTuple):
    """Illegal input, and the words of which one at least has to be in the message that refuses it."""

    arguments: tuple
    names: tuple[str, ...]
    what: str  # is wrong with it


class Target(NamedTuple):
    """A public door: how to draw what goes in, and what has to hold of what comes out."""

    name: str
    draw: Callable[[np.random.Generator], tuple]  # legal arguments
    call: Callable[..., Any]
    check: Callable[[tuple, Any], None]  # of the arguments and the result; raises Finding
    spoil: Callable[[np.random.Generator, tuple], Spoilt] | None = None
    share: float = 1.0  # of all calls, beside those of the others
    refuses: str = "$^"  # pattern of the messages by which even legal input may be refused
    patience: float = 1.0  # times the seconds that a call may take


class Outcome(NamedTuple):
    outcome: str  # one of OUTCOMES
    legal: bool
    message: str
    size: int  # numbers in the input


def drawn(target: Target, seed: int, number: int) -> tuple[tuple, Spoilt | None]:
    """The input of a case, and what is wrong with it where it is illegal."""
    rng = np.random.default_rng([seed, crc32(target.name.encode()), number])
    illegal = target.spoil is not None and rng.random() < ILLEGAL
    arguments = target.draw(rng)
    if not illegal:
        return arguments, None
    spoilt = target.spoil(rng, arguments)
    return spoilt.arguments, spoilt


def judged(target: Target, seed: int, number: int) -> Outcome:
    """What came of a case."""
    arguments, spoilt = (), None
    try:
        arguments, spoilt = drawn(target, seed, number)
        outcome, message = _refused(target, spoilt) if spoilt is not None else _held(target, arguments)
    except MemoryError as error:
        outcome, message = "memory", repr(error)
    except Exception:
        outcome, message = "unjudged", format_exc(limit=-3)
    return Outcome(outcome, spoilt is None, message, numbers_in(arguments))


def _held(target: Target, arguments: tuple) -> tuple[str, str]:
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        try:
            result = target.call(*arguments)
        except RuntimeWarning as error:
            return "warning", f"RuntimeWarning: {error}"
        except MemoryError:
            raise
        except Finding as finding:
            return finding.outcome, finding.message
        except Exception as error:
            allowed = isinstance(error, DOOR) and re.search(target.refuses, str(error))
            return "refused" if allowed else "error", _said(error)
    try:
        with np.errstate(all="ignore"):
            target.check(arguments, result)
    except Finding as finding:
        return finding.outcome, finding.message
    return "ok", ""


def _refused(target: Target, spoilt: Spoilt) -> tuple[str, str]:
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            result = target.call(*spoilt.arguments)
    except MemoryError:
        raise
    except Finding as finding:
        return "accepted", f"{spoilt.what}: accepted, and then {finding.message}"
    except Exception as error:
        named = any(re.search(rf"\b{re.escape(name)}\b", str(error)) for name in spoilt.names)
        if type(error) in (*DOOR, UnicodeDecodeError) and named:
            return "refused", _said(error)
        return "unnamed", f"{spoilt.what}: {_said(error)}"
    return "accepted", f"{spoilt.what}: accepted, gave {repr(result)[:200]}"


def numbers_in(value) -> int:
    """How many numbers an input is made of: the fewer, the better to look at."""
    if isinstance(value, np.ndarray):
        return value.size
    if isinstance(value, tuple | list):
        return sum(map(numbers_in, value))
    return len(value) if isinstance(value, bytes | str) else 1


def _said(error: Exception) -> str:
    return f"{type(error).__name__}: {str(error)[:300]}"
