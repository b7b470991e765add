"""What Zhang and Liu say of their curves in section 6.4, each sentence as a number with an interval."""

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from gmr_gym.evaluation.curves import Curves, Errors, curves
from gmr_gym.evaluation.metrics import nees
from gmr_gym.evaluation.summary import not_lost
from gmr_gym.experiments.claims import Asked, Claim
from gmr_gym.experiments.evidence import Evidence, Quantities, error, squared_position, squared_velocity
from gmr_gym.scenarios.zhang import SWITCHES

BEFORE, AFTER = 5, 5  # scans before a switch, and from it on, that a peak is looked for in
PEAK = 0.1  # of what is on either side, what a peak must rise above it
MOST, CONSTANTLY = 0.5, 0.9  # shares of the scans
MUCH = 1.0  # dB


ROLES = ("mmg", "imm_mht", "imm_pda")  # the first trackers of a table
QUANTITIES: Quantities = {  # what curves are made of, and the runs that were not lost
    "error": error,
    "claimed": lambda scenario, runs: nees(error(scenario, runs), runs.P),
    "position": squared_position,
    "velocity": squared_velocity,
    "kept": not_lost,
}


class Trio(NamedTuple):
    """The curves of the three trackers over some runs."""

    mmg: Curves
    imm_mht: Curves
    imm_pda: Curves

    @property
    def rivals(self) -> tuple[Curves, Curves]:
        return self.imm_mht, self.imm_pda


def _errors(one: Evidence) -> Errors:
    return Errors(one.error, one.claimed, one.position, one.velocity)


def trios(weight: np.ndarray, *tables: Mapping[str, Evidence]) -> tuple[Trio, ...]:
    """The curves of each table's trackers over the runs as they are drawn."""
    return tuple(Trio(*(curves(_errors(table[role]), weight) for role in ROLES)) for table in tables)


def _lead(field: str, trio: Trio) -> float:
    """By how much the better rival's average over the scans exceeds MMG's."""
    own, *others = (getattr(one, field).mean() for one in trio)
    return min(others) - own


def _lowest(field: str, trio: Trio) -> float:
    """Share of the scans at which MMG's curve is the lowest."""
    own, *others = (getattr(one, field) for one in trio)
    return float((own < np.minimum(*others)).mean())


def _peak(field: str, one: Curves, switch: int) -> float:
    """By what share the curve (its mean over `AFTER` scans from a switch on) exceeds both sides: its mean
    over the scans before, and over the last ones before the next switch or the end."""
    curve = getattr(one, field)
    first = switch - 1  # scans are counted from 1
    last = min((later - 1 for later in SWITCHES if later > switch), default=len(curve))
    sides = curve[first - BEFORE : first].mean(), curve[last - BEFORE : last].mean()
    return curve[first : first + AFTER].mean() / max(sides) - 1


def _peaks(field: str, trio: Trio) -> float:
    return min(_peak(field, trio.mmg, switch) for switch in SWITCHES)


def _flat(field: str, trio: Trio) -> float:
    return PEAK - max(_peak(field, one, SWITCHES[0]) for one in trio.rivals)


def _calmer(field: str, trio: Trio) -> float:
    return _peak(field, trio.mmg, SWITCHES[0]) - max(_peak(field, one, SWITCHES[0]) for one in trio.rivals)


def _beaten_after_switches(field: str, trio: Trio) -> float:
    """Share of the scans from a switch on at which MMG's curve is not the lowest."""
    after = np.concatenate([np.arange(first - 1, first - 1 + AFTER) for first in SWITCHES])
    own, *others = (getattr(one, field)[after] for one in trio)
    return float((own > np.minimum(*others)).mean())


def _pessimistic(trio: Trio) -> float:
    """Share of the scans, those after the start and the switches apart, with inclination below 0."""
    steady = np.ones(len(trio.mmg.inclination), bool)
    for first in (1, *SWITCHES):
        steady[first - 1 : first - 1 + AFTER] = False
    return float((trio.mmg.inclination[steady] < 0).mean())


def _optimistic(one: Curves) -> float:
    return float((one.inclination > 0).mean())


def _worse_pda(field: str, trio: Trio) -> float:
    mmg, mht, pda = (np.abs(getattr(one, field)).mean() for one in trio)
    return pda - max(mmg, mht)


def _rise(field: str, first: Curves, second: Curves) -> float:
    """Average magnitude in case 2 less that in case 1."""
    return np.abs(getattr(second, field)).mean() - np.abs(getattr(first, field)).mean()


def _sensitive_pda(field: str, first: Trio, second: Trio) -> float:
    mmg, mht, pda = (_rise(field, a, b) for a, b in zip(first, second, strict=True))
    return pda - max(mmg, mht)


def _least_rise(field: str, first: Trio, second: Trio) -> float:
    return min(_rise(field, a, b) for a, b in zip(first, second, strict=True))


SHARE = "share of scans"
WORSE = "average less the worse of the others', dB"
ERRORS = {"rmse": "position", "velocity_rmse": "velocity"}
CREDIBILITY = {"nci": "NCI", "inclination": "inclination"}


def _each(
    names: Mapping[str, str], sentence: str, measure: str, threshold: float, value: Callable[..., float]
) -> Iterator[Claim]:
    """The same of several curves: value(field, *trios)."""
    for field, name in names.items():
        yield Claim(sentence.format(name), measure.format(name), threshold, partial(value, field))


def _rise_of_pda(field: str, first: Trio, second: Trio) -> float:
    return _rise(field, first.imm_pda, second.imm_pda)


ABSENT = tuple(_each(
    ERRORS, "the IMM based methods have no peak at the first switch ({})",
    f"{PEAK:g} less the rivals' greater rise of {{}} RMSE at the first switch", 0.0, _flat,
))  # fmt: skip
CALMER = tuple(_each(
    ERRORS, "the IMM based methods are more robust to the first switch ({})",
    "MMG's rise of {} RMSE at the first switch less the rivals' greater rise", 0.0, _calmer,
))  # fmt: skip
AT_FIRST_SWITCH = (ABSENT[0], CALMER[0], ABSENT[1], CALMER[1])
LOWEST = tuple(_each(ERRORS, "MMG has the lowest {} RMSE for most of the time", SHARE, MOST, _lowest))
CASE_1 = (
    Claim(
        "MMG has the best position RMSE", "better rival's average less MMG's, m", 0.0, partial(_lead, "rmse")
    ),
    Claim(
        "MMG has the best velocity RMSE", "better rival's average less MMG's, m/s", 0.0,
        partial(_lead, "velocity_rmse"),
    ),
    *LOWEST,
    *_each(
        ERRORS, "except right after a switch, where MMG has not the lowest {} RMSE",
        "share of five scans from each switch", MOST, _beaten_after_switches,
    ),
    *_each(
        ERRORS, "two peaks of MMG are the two switches ({})",
        "rise of MMG's {} RMSE over both sides of a switch, the lesser switch", PEAK, _peaks,
    ),
    *AT_FIRST_SWITCH,
    Claim("MMG has the lowest NCI for most of the time", SHARE, MOST, partial(_lowest, "nci")),
    Claim(
        "MMG is constantly pessimistic except at the transients",
        "share of scans away from start and switches", CONSTANTLY, _pessimistic,
    ),
    Claim("IMM+PDA is constantly optimistic", SHARE, CONSTANTLY, lambda trio: _optimistic(trio.imm_pda)),
    Claim(
        "IMM+MHT shows no consistent pattern of inclination",
        "share of scans on the rarer side of 0", 1 - CONSTANTLY,
        lambda trio: min(_optimistic(trio.imm_mht), 1 - _optimistic(trio.imm_mht)),
    ),
)  # fmt: skip
CASE_2 = (
    *LOWEST,
    *AT_FIRST_SWITCH,
    Claim(
        "the NCI of IMM+PDA is much worse than that of the other two", WORSE, MUCH,
        partial(_worse_pda, "nci"),
    ),
    Claim(
        "the inclination of IMM+PDA is much worse than that of the other two", f"magnitude's {WORSE}", MUCH,
        partial(_worse_pda, "inclination"),
    ),
)  # fmt: skip
BOTH = (
    *_each(
        ERRORS, "all filters have larger {} errors than in case 1",
        "average in case 2 less case 1, the least of the three", 0.0, _least_rise,
    ),
    *_each(
        CREDIBILITY, "the {} of IMM+PDA is much worse than in case 1",
        "average magnitude in case 2 less case 1, dB", MUCH, _rise_of_pda,
    ),
    *_each(
        CREDIBILITY, "PDA is more sensitive to the clutter density ({})",
        "IMM+PDA's rise from case 1 less the greater of the others', dB", 0.0, _sensitive_pda,
    ),
)  # fmt: skip


def _asked(claims: tuple[Claim, ...], tables: tuple[str, ...], table: str = "") -> tuple[Asked, ...]:
    """Over all runs, and over those that all three kept in each table; curves differ from run to run."""
    claims = tuple(claim._replace(widened=False) for claim in claims)
    about = (("all {}", False), ("kept {}", True))
    return tuple(Asked(claims, tables, runs, table, kept=kept, prepare=trios) for runs, kept in about)


# a sentence on both cases needs both tables at the same process noise
ASKED = tuple(
    asked
    for noise in ("", "-quiet")
    for asked in (
        *_asked(CASE_1, (f"1{noise}",)),
        *_asked(CASE_2, (f"2{noise}",)),
        *_asked(BOTH, (f"1{noise}", f"2{noise}"), f"2{noise} against 1{noise}"),
    )
)
