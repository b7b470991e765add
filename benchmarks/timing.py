"""Timing alternatives in turn, and one line of the table."""

from collections.abc import Callable, Mapping, Sequence
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

Stopwatch = Callable[[int], float]  # does the work of that round; wall seconds for one item of it

TURN = 0.1  # s, a short alternative is timed again and again for that long before the next one


class Timing(NamedTuple):
    median: float
    best: float


class Row(NamedTuple):
    """What was measured, here and in the named alternative."""

    what: str
    ours: Timing
    against: str
    theirs: Timing | None  # None where there is no alternative to measure
    note: str = ""
    unit: str = "s"  # or "MB"


def interleaved(alternatives: Mapping[str, Stopwatch], rounds: int) -> dict[str, Timing]:
    """Every alternative in each round, one after another, so that a busy machine slows all alike.
    What has to be compiled must have been called before."""
    samples: dict[str, list[float]] = {name: [] for name in alternatives}
    for i in range(rounds):
        for name, stopwatch in alternatives.items():
            until = perf_counter() + TURN
            samples[name].append(stopwatch(i))
            while perf_counter() < until:
                samples[name].append(stopwatch(i))
    return {name: Timing(float(np.median(taken)), min(taken)) for name, taken in samples.items()}


def each(function: Callable[[Any], Any], problems: Sequence[Any]) -> Stopwatch:
    """Seconds for one problem, the mean over all of them."""

    def stopwatch(_: int) -> float:
        started = perf_counter()
        for problem in problems:
            function(problem)
        return (perf_counter() - started) / len(problems)

    return stopwatch


def timed(function: Callable[[], Any]) -> Stopwatch:
    """Seconds for one call."""
    return each(lambda _: function(), [None])
