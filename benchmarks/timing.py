"""Timing two alternatives in pairs, and one line of the table."""

from collections.abc import Callable, Sequence
from time import perf_counter, process_time
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import binom

Stopwatch = Callable[[], float]  # does the work once; the seconds of one part of it

TURN = 0.02  # s, a short alternative is timed again and again for that long before the other one
FEWEST = 6  # pairs from which their range covers the median 97 times in a hundred
WITHIN = 0.05  # of the ratio, on either side


class Plan(NamedTuple):
    seconds: float  # that a row may take, but for what is under way
    everything: bool  # rows that take half a minute, too


class Row(NamedTuple):
    """What was measured, here and in the named alternative; None where there is no alternative to measure."""

    what: str
    against: str
    ours: float | None = None  # median of all repeats
    theirs: float | None = None
    ratio: float | None = None  # theirs to ours, median of the pairs
    low: float | None = None  # its 95 % interval, None with fewer than FEWEST pairs
    high: float | None = None
    pairs: int = 0
    note: str = ""
    unit: str = "s"  # or "MB"


def timed(
    function: Callable[..., object],
    given: Sequence[tuple] = ((),),
    parts: int | None = None,
    clock: Callable[[], float] = process_time,
    prepare: Callable[..., tuple] | None = None,
) -> Stopwatch:
    """Seconds of one of the calls function(*given[i]), or of one of the parts; what prepare(*given[i]) makes
    of the arguments is made anew each time, and not charged for."""
    parts = parts or len(given)

    def stopwatch() -> float:
        arguments: Sequence[tuple] = [prepare(*one) for one in given] if prepare else given
        started = clock()
        for one in arguments:
            function(*one)
        return (clock() - started) / parts

    return stopwatch


def compared(
    plan: Plan, what: str, ours: Stopwatch, against: str, theirs: Stopwatch, note: str = "", unit: str = "s"
) -> Row:
    """The two in turn, until the interval of their ratio is narrow or the seconds are over. What has to be
    compiled must have been called before."""
    taken: tuple[list[float], list[float]] = [], []
    until = perf_counter() + plan.seconds
    while True:
        for i in (0, 1) if len(taken[0]) % 2 else (1, 0):
            taken[i].append(_turn((ours, theirs)[i]))
        ratios = np.divide(taken[1], taken[0])
        low, high = interval(ratios)
        ratio = float(np.median(ratios))
        narrow = low is not None and max(high / ratio, ratio / low) <= 1 + WITHIN
        if narrow or perf_counter() >= until:
            ours_taken, theirs_taken = (float(np.median(one)) for one in taken)
            return Row(what, against, ours_taken, theirs_taken, ratio, low, high, len(ratios), note, unit)


def interval(x: Any) -> tuple[float, float] | tuple[None, None]:
    """The order statistics that enclose the median of what x (n,) is drawn from with 95 %, or none."""
    if len(x) < FEWEST:
        return None, None
    first = int(binom.ppf(0.025, len(x), 0.5))
    ordered = np.sort(x)
    return float(ordered[first - 1]), float(ordered[-first])


def _turn(stopwatch: Stopwatch) -> float:
    taken, until = [stopwatch()], perf_counter() + TURN
    while perf_counter() < until:
        taken.append(stopwatch())
    return float(np.median(taken))
