"""What Maybeck's sentences need of the runs, and the numbers that they are."""

from typing import Any

import numpy as np

from gmr_gym.evaluation.metrics import lost_at
from gmr_gym.evaluation.summary import not_lost
from gmr_gym.experiments.claims import ByTracker, Number, least, number
from gmr_gym.experiments.evidence import (
    Evidence,
    Quantities,
    error,
    mean,
    squared_position,
    squared_velocity,
)
from gmr_gym.simulation.single_target import Scenario

WHOLE = slice(None)
LEVEL = slice(119, 199)  # epochs 120 to 199, straight and level: the "benign" part
TURNS, JINKS = slice(44, 100), slice(199, 250)  # epochs 45 to 100, and 200 to 250
SPANS = {"whole": WHOLE, "level": LEVEL}
UNITS = {"position": "m", "velocity": "m/s"}
# of the errors by quantity and span, in the order of the paper's Table I
ERRORS = {
    ("position", "whole"): "rmse", ("velocity", "whole"): "velocity_rmse",
    ("position", "level"): "level_rmse", ("velocity", "level"): "level_velocity_rmse",
}  # fmt: skip
POSITION, VELOCITY = slice(0, 2), slice(2, 4)  # of [north, up, their velocities]
HARDLY = 0.1  # flow of probability that is none
TUNED = 1.25  # times the claimed deviation, or its inverse, within which the actual one agrees


def _states(scenario: Scenario) -> list[int]:
    return [*scenario.position, *scenario.velocity]


QUANTITIES: Quantities = {
    "position": squared_position,
    "velocity": squared_velocity,
    # (runs, T, 4), of position and velocity, and the variances claimed for them
    "error": lambda scenario, runs: error(scenario, runs)[..., _states(scenario)],
    "claimed": lambda scenario, runs: np.diagonal(runs.P, axis1=-2, axis2=-1)[..., _states(scenario)],
    "aggressive": lambda scenario, runs: runs.modes[..., -1],  # (runs, T), probability of the last motion
    "kept": not_lost,
    # (runs,), scan, counted from 0, -1 for never
    "lost_at": lambda scenario, runs: lost_at(runs.off_target, scenario.patience),
}


def rms(one: Evidence, quantity: str, span: slice, weight: np.ndarray) -> float:
    """Temporally averaged rms error, as in Table I: over the runs scan by scan, then averaged over the
    span; not a number where no run has weight."""
    if not weight.any():
        return np.nan
    return float(np.sqrt(weight / weight.sum() @ getattr(one, quantity)[:, span]).mean())


@number
def saved(better: str, worse: str, quantity: str, span: slice, weight: np.ndarray, table: ByTracker) -> float:
    """By how many per cent the error of one is smaller than that of another."""
    both = weight * table[better].kept * table[worse].kept
    with np.errstate(invalid="ignore"):
        return 100 * (1 - rms(table[better], quantity, span, both) / rms(table[worse], quantity, span, both))


@number
def lost(who: str, weight: np.ndarray, table: ByTracker) -> float:
    return mean(weight, ~table[who].kept)


def average(values: np.ndarray, one: Evidence, weight: Any = 1.0) -> np.ndarray:
    """Over the runs kept (T, ...); nan where there are none."""
    own = weight * one.kept
    return np.tensordot(own / own.sum(), values, 1) if own.any() else np.full(values.shape[1:], np.nan)


def _aggressive(who: str, weight: np.ndarray, table: ByTracker) -> np.ndarray:
    """Mean probability of the aggressive motion (T,)."""
    return average(table[who].aggressive, table[who], weight)


@number
def chance(who: str, span: slice, weight: np.ndarray, table: ByTracker) -> float:
    """Mean probability of the aggressive motion over a span."""
    return float(_aggressive(who, weight, table)[span].mean())


def flow(who: str) -> Number:
    """Probability of the aggressive motion while it jinks, less that in level flight."""
    return chance(who, JINKS) - chance(who, LEVEL)


def told_apart(who: str) -> Number:
    """Probability of the motion that fits, the least over level flight, turns and jinking."""
    return least(1 - chance(who, LEVEL), chance(who, TURNS), chance(who, JINKS))


@number
def offset(who: str, span: slice, weight: np.ndarray, table: ByTracker) -> float:
    """Length of the mean position error, m, its root mean square over a span, less what so few runs scatter:
    negative where the mean is less than chance would make it of errors without one."""
    one, off = table[who], table[who].error[:, span, POSITION]
    middle = average(off, one, weight)
    spare = (weight * one.kept).sum() - 1
    noise = average((off - middle) ** 2, one, weight) / spare if spare > 0 else np.nan
    square = (middle**2 - noise).sum(axis=-1).mean()
    return float(np.sign(square) * np.sqrt(abs(square)))


@number
def claimed(who: str, states: slice, span: slice, weight: np.ndarray, table: ByTracker) -> float:
    """Deviation that a tracker claims for some of [north, up, their velocities], its root mean square."""
    variance = average(table[who].claimed[:, span, states], table[who], weight)
    return float(np.sqrt(variance.sum(axis=-1).mean()))


@number
def hovering(who: str, weight: np.ndarray, table: ByTracker) -> float:
    """Distance of the aggressive motion's mean probability from one half, over all epochs."""
    return float(np.abs(_aggressive(who, weight, table) - 0.5).mean())


@number
def agreeing(who: str, weight: np.ndarray, table: ByTracker) -> float:
    """Share of scans and states at which the error's deviation is about the claimed one."""
    one = table[who]
    middle = average(one.error, one, weight)
    ratio = np.sqrt(average((one.error - middle) ** 2, one, weight) / average(one.claimed, one, weight))
    return float(((1 / TUNED < ratio) & (ratio < TUNED)).mean()) if np.isfinite(ratio).all() else np.nan


def slower_back(weight: np.ndarray, table: ByTracker) -> float:
    """Scans that the probability needs to come half the way back after the jinking, all that are left if it
    never does, less those it needs to go half the way there; not a number where it hardly flows."""
    chances = _aggressive("mmae", weight, table)
    if not flow("mmae")(weight, table) > HARDLY:
        return np.nan
    half = (chances[JINKS].max() + chances[LEVEL].mean()) / 2
    there, back = chances[JINKS] >= half, np.append(chances[JINKS.stop :] < half, True)
    return float(back.argmax() - there.argmax())


@number
def scatter(span: slice, weight: np.ndarray, table: ByTracker) -> float:
    """Deviation over the runs of the aggressive motion's probability, over a span."""
    one = table["mmae"]
    chances = one.aggressive[:, span]
    return float(np.sqrt(average((chances - average(chances, one, weight)) ** 2, one, weight)).mean())


@number
def lost_between(first: int, last: int, weight: np.ndarray, table: ByTracker) -> float:
    """Share of all runs."""
    at = table["benign"].lost_at + 1  # epochs are counted from 1
    return mean(weight, (first <= at) & (at <= last))
