"""What grows: the work at each size, and the time and memory that it cannot do without."""

from collections.abc import Callable, Mapping, Sequence
from functools import cache
from itertools import cycle
from typing import NamedTuple

import gymnasium as gym
import numpy as np
import plain
from problems import drawn
from timing import timed

from gmr_gym.evaluation.loop import play
from gmr_gym.filters.registry import make_tracker
from gmr_gym.kernels import ZERO, kernel
from gmr_gym.reduction.ise import integral_squared_error
from gmr_gym.reduction.merge_cost import components_last, cost_row
from gmr_gym.reduction.runnalls import runnalls
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.simulation.philox import buffer_for, points_into
from gmr_gym.simulation.single_target import draw, scan

SCAN = 20  # of the episode, by which the track is acquired
STEPS = 4  # of the environments in a turn

Work = Callable[[int], Callable[[], object]]  # at x, ready to be done once
Limit = Callable[[int], tuple[float, float]]  # at x, seconds and MB that cannot be done without


class Panel(NamedTuple):
    x: str
    points: Sequence[int]
    works: Mapping[str, tuple[Work, int]]  # and into how many parts its time is divided
    limits: Mapping[str, Limit]


def scan_step(name: str) -> Work:
    """A scan of an acquired track, at the scenario's density in a window as large as it takes."""

    def at(k: int) -> Callable[[], object]:
        scenario = turning_target()
        tracker = make_tracker(name, scenario.model)
        belief = tracker.init()
        for played in play(scenario, tracker, draw(scenario, 0)):
            if played.t == SCAN:
                break
            belief, _ = tracker.step(belief, played.scan.z)
        z = one_scan(k)().z
        return lambda: tracker.step(belief, z)

    return at


def one_scan(k: int) -> Callable[[], object]:
    side = np.sqrt(k / turning_target().model.clutter_density)
    scenario = turning_target(clutter_rate=k, window=(side, side))
    episode = draw(scenario, 0)
    return lambda: scan(scenario, episode, SCAN, episode.x[SCAN, :2])


def reduced(form: Callable, n: int = 0, d: int = 4) -> Work:
    """Of x components or, where n is given, of n in x dimensions, to a fifth."""

    def at(x: int) -> Callable[[], object]:
        p = drawn(n or x, x if n else d, 1)[0]
        return lambda: form(p, len(p.w) // 5)

    return at


def side_by_side(n: int) -> Callable[[], object]:
    """Steps of n turning targets, the truth submitted."""
    envs = gym.make_vec(
        "gmr_gym/TurningTarget-v0", n, vectorization_mode="vector_entry_point", copy=False, threads=1
    )
    x = draw(envs.unwrapped.scenario, 0).x  # scripted: the same in all of them
    following = cycle([*x, x[0]])  # after the last one the next episodes begin, whatever is submitted
    envs.reset(seed=0)

    def steps() -> None:
        for _ in range(STEPS):
            envs.step(np.tile(next(following), (n, 1)))

    return steps


@cache
def copying() -> float:
    """Seconds a byte, of 64 MB."""
    source, copy = np.ones(1 << 23), np.empty(1 << 23)
    return _fastest(lambda: np.copyto(copy, source)) / source.nbytes


@cache
def drawing_a_point() -> float:
    """Seconds for two uniform numbers of Philox, of a block of points that stays in the cache."""
    z, buffer, zero = np.empty((4096, 2)), buffer_for(4096), np.zeros(2)
    key, at = np.zeros(2, np.uint32), (0, 0, 0)
    return _fastest(lambda: points_into(z, zero, zero + 1.0, zero, key, 0, at, buffer)) / len(z)


@cache
def pair_cost(d: int) -> float:
    """Seconds of Runnalls' cost of one pair, of a thousand components."""
    p = drawn(1000, d, 1)[0]
    return _fastest(lambda: _all_costs(*p)) / (1000 * 999 / 2)


@kernel
def _all_costs(w, m, P):
    columns, room = components_last(w, m, P)
    row = np.empty(len(w))
    for i in range(1, len(w)):
        cost_row(i, ZERO, i, columns, room, row)


def _fastest(call: Callable[[], object]) -> float:
    call()  # compiles, and touches every page
    watch = timed(call)
    return min(watch() for _ in range(30))


def bytes_limit(numbers: float) -> Limit:
    """Of writing so many floats for each x."""
    return lambda x: (8 * numbers * x * copying(), 8 * numbers * x / 1e6)


def draws_limit(points: float) -> Limit:
    return lambda x: (points * x * drawing_a_point(), np.nan)


def costs_limit(n: int, d: int) -> tuple[float, float]:
    """Of the first cost of every pair, and of a table that holds them."""
    pairs = n * (n - 1) / 2
    return pairs * pair_cost(d), 8 * pairs / 1e6


REDUCTIONS = {
    "Runnalls": runnalls, "Runnalls, plain": plain.runnalls_compiled, "Williams' ISE": integral_squared_error,
}  # fmt: skip
RATE = int(turning_target().clutter_rate)
COSTS = "the first costs of all pairs"
PANELS = (
    Panel(
        "detections a scan",
        (100, 316, 1000, 3162, 10_000, 31_623, 100_000),
        {name: (scan_step(name), 1) for name in ("pda", "runnalls-30")} | {"the scan drawn": (one_scan, 1)},
        {"copying the scan": bytes_limit(2), "drawing it": draws_limit(1)},
    ),
    Panel(
        "components, to a fifth, 4-D",
        (100, 215, 464, 1000, 2154, 4642, 10_000),
        {name: (reduced(form), 1) for name, form in REDUCTIONS.items()},
        {COSTS: lambda n: costs_limit(n, 4)},
    ),
    Panel(
        "dimension, 200 components to 40",
        (2, 3, 4, 6, 9, 12),
        {name: (reduced(form, n=200), 1) for name, form in REDUCTIONS.items()},
        {COSTS: lambda d: costs_limit(200, d)},
    ),
    Panel(
        "environments side by side, a step of all",
        (1, 10, 100, 1000, 10_000, 100_000),
        {"TurningTarget": (side_by_side, STEPS)},
        {"copying the scans": bytes_limit(2 * RATE), "drawing them": draws_limit(RATE)},
    ),
)
