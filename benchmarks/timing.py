"""Timing alternatives in turn, and one line of the table."""

from collections.abc import Callable, Mapping, Sequence
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np

Stopwatch = Callable[[int], Any]  # does item i of the work; the seconds it took, or those of its parts

TURN = 0.1  # s, a short alternative is timed again and again for that long before the next one


class Plan(NamedTuple):
    quick: bool  # fewer and shorter repeats
    clock: Callable[[], float]  # s, for what runs in this process alone


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


def interleaved(alternatives: Mapping[str, Stopwatch], items: int, rounds: int) -> dict[str, Timing]:
    """Every alternative with every item in each round, one after another, so that a busy machine
    slows all alike. What has to be compiled must have been called before."""
    taken: dict[str, list[list]] = {name: [[] for _ in range(items)] for name in alternatives}
    for _ in range(rounds):
        for item in range(items):
            for name, stopwatch in alternatives.items():
                until = perf_counter() + TURN
                taken[name][item].append(stopwatch(item))
                while perf_counter() < until:
                    taken[name][item].append(stopwatch(item))
    return {name: summary(repeats) for name, repeats in taken.items()}


def summary(taken: Sequence[Sequence]) -> Timing:
    """Median and best over the repeats of each item or part of it; of those, the median item."""
    medians = np.concatenate([np.atleast_1d(np.median(repeats, axis=0)) for repeats in taken])
    bests = np.concatenate([np.atleast_1d(np.min(repeats, axis=0)) for repeats in taken])
    return Timing(float(np.median(medians)), float(np.median(bests)))


def timed(function: Callable[..., object], *items: Any, clock=perf_counter) -> Stopwatch:
    """Seconds for one call: function(items[i]), or function() where there are none."""

    def stopwatch(i: int) -> float:
        given = items[i : i + 1]
        started = clock()
        function(*given)
        return clock() - started

    return stopwatch
