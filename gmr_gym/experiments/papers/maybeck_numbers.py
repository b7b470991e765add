"""What Maybeck's sentences need of the runs, and the numbers that they are."""

from collections.abc import Mapping

import numpy as np

from gmr_gym.evaluation.metrics import lost_at
from gmr_gym.evaluation.summary import not_lost
from gmr_gym.experiments.evidence import Evidence, Quantities, error, squared_position, squared_velocity
from gmr_gym.simulation.single_target import Scenario

WHOLE = slice(None)
LEVEL = slice(119, 199)  # epochs 120 to 199, straight and level: the "benign" part
TURNS, JINKS = slice(44, 100), slice(199, 250)  # epochs 45 to 100, and 200 to 250
SPANS = {"whole": WHOLE, "level": LEVEL}
UNITS = {"position": "m", "velocity": "m/s"}
# Table I: rms errors of position (m) and velocity (m/s), over the whole flight and over its benign part
PRINTED = {
    "aggressive": {"position": (22.9, 18.1), "velocity": (17.5, 15.4)},
    "mmae": {"position": (18.6, 11.9), "velocity": (13.1, 7.8)},
    "imm": {"position": (20.9, 15.1), "velocity": (14.4, 11.6)},
    "mmae_of": {"position": (22.7, 16.1), "velocity": (16.7, 13.4)},
    "imm_of": {"position": (26.6, 15.6), "velocity": (15.4, 12.4)},
}
HARDLY = 0.1  # flow of probability that is none
TUNED = 1.25  # times the claimed deviation, or its inverse, within which the actual one agrees


Table = Mapping[str, Evidence]  # by what a tracker is, as in NAMES


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


def saved(better: str, worse: str, quantity: str, span: slice, weight, table: Table) -> float:
    """By how many per cent the error of one is smaller than that of another."""
    both = weight * table[better].kept * table[worse].kept
    with np.errstate(invalid="ignore"):
        return 100 * (1 - rms(table[better], quantity, span, both) / rms(table[worse], quantity, span, both))


def lost(who: str, weight, table: Table) -> float:
    return float(weight @ ~table[who].kept / weight.sum())


def average(values: np.ndarray, one: Evidence, weight=1.0) -> np.ndarray:
    """Over the runs kept (T, ...); nan where there are none."""
    own = weight * one.kept
    return np.tensordot(own / own.sum(), values, 1) if own.any() else np.full(values.shape[1:], np.nan)


def flow(who: str, weight, table: Table) -> float:
    """Probability of the aggressive motion while it jinks, less that in level flight."""
    chances = average(table[who].aggressive, table[who], weight)
    return float(chances[JINKS].mean() - chances[LEVEL].mean())


def offset(who: str, span: slice, weight, table: Table) -> float:
    """Length of the mean position error, m, its root mean square over a span, less what so few runs scatter:
    negative where the mean is less than chance would make it of errors without one."""
    one, error = table[who], table[who].error[:, span, :2]
    mean = average(error, one, weight)
    spare = (weight * one.kept).sum() - 1
    noise = average((error - mean) ** 2, one, weight) / spare if spare > 0 else np.nan
    square = (mean**2 - noise).sum(axis=-1).mean()
    return float(np.sign(square) * np.sqrt(abs(square)))


def claimed(who: str, states: slice, span: slice, weight, table: Table) -> float:
    """Deviation that a tracker claims for some of [north, up, their velocities], its root mean square."""
    variance = average(table[who].claimed[:, span, states], table[who], weight)
    return float(np.sqrt(variance.sum(axis=-1).mean()))


def hovering(who: str, weight, table: Table) -> float:
    """Distance of the aggressive motion's mean probability from one half, over all epochs."""
    return float(np.abs(average(table[who].aggressive, table[who], weight) - 0.5).mean())


def told_apart(who: str, weight, table: Table) -> float:
    """Probability of the motion that fits, the least over level flight, turns and jinking."""
    chances = average(table[who].aggressive, table[who], weight)
    return float(min(1 - chances[LEVEL].mean(), chances[TURNS].mean(), chances[JINKS].mean()))


def agreeing(who: str, weight, table: Table) -> float:
    """Share of scans and states at which the error's deviation is about the claimed one."""
    one = table[who]
    mean = average(one.error, one, weight)
    ratio = np.sqrt(average((one.error - mean) ** 2, one, weight) / average(one.claimed, one, weight))
    return float(((1 / TUNED < ratio) & (ratio < TUNED)).mean()) if np.isfinite(ratio).all() else np.nan


def slower_back(weight, table: Table) -> float:
    """Scans that the probability needs to come half the way back after the jinking, all that are left if it
    never does, less those it needs to go half the way there; not a number where it hardly flows."""
    chances = average(table["mmae"].aggressive, table["mmae"], weight)
    if not flow("mmae", weight, table) > HARDLY:
        return np.nan
    half = (chances[JINKS].max() + chances[LEVEL].mean()) / 2
    there, back = chances[JINKS] >= half, np.append(chances[JINKS.stop :] < half, True)
    return float(back.argmax() - there.argmax())


def scatter(span: slice, weight, table: Table) -> float:
    """Deviation over the runs of the aggressive motion's probability, over a span."""
    one = table["mmae"]
    chances = one.aggressive[:, span]
    return float(np.sqrt(average((chances - average(chances, one, weight)) ** 2, one, weight)).mean())


def lost_between(first: int, last: int, weight, table: Table) -> float:
    """Share of all runs."""
    at = table["benign"].lost_at + 1  # epochs are counted from 1
    return float(weight @ ((first <= at) & (at <= last)) / weight.sum())
