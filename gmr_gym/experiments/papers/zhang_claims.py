"""What Zhang and Liu say of their curves in section 6.4, each sentence as a number with an interval."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from gmr_gym.evaluation.curves import Curves, curves, errors_of
from gmr_gym.evaluation.summary import not_lost
from gmr_gym.experiments.claims import Asked, Claim, Number, greatest, in_first, in_last, least, number
from gmr_gym.experiments.evidence import Evidence, Quantities
from gmr_gym.scenarios.zhang import SWITCHES

BEFORE, AFTER = 5, 5  # scans before a switch, and from it on, that a peak is looked for in
PEAK = 0.1  # of what is on either side, what a peak must rise above it
MOST, CONSTANTLY = 0.5, 0.9  # shares of the scans
MUCH = 1.0  # dB
RIVALS = ("imm_mht", "imm_pda")
ROLES = ("mmg", *RIVALS)  # the first trackers of a table
QUANTITIES: Quantities = {"errors": errors_of, "kept": not_lost}  # what curves are made of, and of which runs


class Trio(NamedTuple):
    """The curves of the three trackers over some runs."""

    mmg: Curves
    imm_mht: Curves
    imm_pda: Curves


def trios(weight: np.ndarray, *tables: Mapping[str, Evidence]) -> tuple[Trio, ...]:
    """The curves of each table's trackers over the runs as they are drawn."""
    return tuple(Trio(*(curves(table[role].errors, weight) for role in ROLES)) for table in tables)


# numbers of a field of a tracker's curves


@number
def size(role: str, field: str, trio: Trio) -> float:
    """Average magnitude over the scans; of errors their average."""
    return np.abs(getattr(getattr(trio, role), field)).mean()


def rise(role: str, field: str) -> Number:
    """From case 1 to case 2."""
    return in_last(size(role, field)) - in_first(size(role, field))


def pda_beyond(numbers: Callable[[str, str], Number], field: str) -> Number:
    """By how much IMM+PDA's exceeds both others'."""
    return numbers("imm_pda", field) - greatest(numbers("mmg", field), numbers("imm_mht", field))


@number
def peak(role: str, field: str, switch: int, trio: Trio) -> float:
    """By what share the curve (its mean over `AFTER` scans from a switch on) exceeds both sides: its mean
    over the scans before, and over the last ones before the next switch or the end."""
    curve = getattr(getattr(trio, role), field)
    first = switch - 1  # scans are counted from 1
    last = min((later - 1 for later in SWITCHES if later > switch), default=len(curve))
    sides = curve[first - BEFORE : first].mean(), curve[last - BEFORE : last].mean()
    return curve[first : first + AFTER].mean() / max(sides) - 1


def rivals_peak(field: str) -> Number:
    """The greater one at the first switch."""
    return greatest(*(peak(role, field, SWITCHES[0]) for role in RIVALS))


def lead(field: str) -> Number:
    """By how much the better rival's average exceeds MMG's."""
    return least(*(size(role, field) for role in RIVALS)) - size("mmg", field)


@number
def lowest(field: str, trio: Trio) -> float:
    """Share of the scans at which MMG's curve is the lowest."""
    own, *others = (getattr(one, field) for one in trio)
    return float((own < np.minimum(*others)).mean())


def _from(*scans: int) -> np.ndarray:
    """The indices of `AFTER` scans from each of these on."""
    return np.concatenate([np.arange(first - 1, first - 1 + AFTER) for first in scans])


@number
def beaten_after_switches(field: str, trio: Trio) -> float:
    """Share of the scans from a switch on at which MMG's curve is not the lowest."""
    own, *others = (getattr(one, field)[_from(*SWITCHES)] for one in trio)
    return float((own > np.minimum(*others)).mean())


def pessimistic(trio: Trio) -> float:
    """Share of the scans, those after the start and the switches apart, with MMG's inclination below 0."""
    return float((np.delete(trio.mmg.inclination, _from(1, *SWITCHES)) < 0).mean())


@number
def optimistic(role: str, trio: Trio) -> float:
    """Share of the scans with inclination above 0."""
    return float((getattr(trio, role).inclination > 0).mean())


# the sentences, in both errors or both measures of credibility

SHARE = "share of scans"
ERRORS = {"rmse": "position", "velocity_rmse": "velocity"}.items()
CREDIBILITY = {"nci": "NCI", "inclination": "inclination"}.items()
LOWEST = tuple(
    Claim(f"MMG has the lowest {name} RMSE for most of the time", SHARE, MOST, lowest(field))
    for field, name in ERRORS
)
AT_FIRST_SWITCH = tuple(
    claim for field, name in ERRORS for claim in (
        Claim(f"the IMM based methods have no peak at the first switch ({name})",
              f"{PEAK:g} less the rivals' greater rise of {name} RMSE at the first switch", 0.0,
              PEAK - rivals_peak(field)),
        Claim(f"the IMM based methods are more robust to the first switch ({name})",
              f"MMG's rise of {name} RMSE at the first switch less the rivals' greater rise", 0.0,
              peak("mmg", field, SWITCHES[0]) - rivals_peak(field)),
    )
)  # fmt: skip
CASE_1 = (
    Claim("MMG has the best position RMSE", "better rival's average less MMG's, m", 0.0, lead("rmse")),
    Claim("MMG has the best velocity RMSE",
          "better rival's average less MMG's, m/s", 0.0, lead("velocity_rmse")),
    *LOWEST,
    *(Claim(f"except right after a switch, where MMG has not the lowest {name} RMSE",
            "share of five scans from each switch", MOST, beaten_after_switches(field))
      for field, name in ERRORS),
    *(Claim(f"two peaks of MMG are the two switches ({name})",
            f"rise of MMG's {name} RMSE over both sides of a switch, the lesser switch", PEAK,
            least(*(peak("mmg", field, switch) for switch in SWITCHES)))
      for field, name in ERRORS),
    *AT_FIRST_SWITCH,
    Claim("MMG has the lowest NCI for most of the time", SHARE, MOST, lowest("nci")),
    Claim("MMG is constantly pessimistic except at the transients",
          "share of scans away from start and switches", CONSTANTLY, pessimistic),
    Claim("IMM+PDA is constantly optimistic", SHARE, CONSTANTLY, optimistic("imm_pda")),
    Claim("IMM+MHT shows no consistent pattern of inclination",
          "share of scans on the rarer side of 0", 1 - CONSTANTLY,
          least(optimistic("imm_mht"), 1 - optimistic("imm_mht"))),
)  # fmt: skip
CASE_2 = (
    *LOWEST,
    *AT_FIRST_SWITCH,
    Claim("the NCI of IMM+PDA is much worse than that of the other two",
          "average less the worse of the others', dB", MUCH, pda_beyond(size, "nci")),
    Claim("the inclination of IMM+PDA is much worse than that of the other two",
          "magnitude's average less the worse of the others', dB", MUCH, pda_beyond(size, "inclination")),
)  # fmt: skip
BOTH = (
    *(Claim(f"all filters have larger {name} errors than in case 1",
            "average in case 2 less case 1, the least of the three", 0.0,
            least(*(rise(role, field) for role in ROLES)))
      for field, name in ERRORS),
    *(Claim(f"the {name} of IMM+PDA is much worse than in case 1",
            "average magnitude in case 2 less case 1, dB", MUCH, rise("imm_pda", field))
      for field, name in CREDIBILITY),
    *(Claim(f"PDA is more sensitive to the clutter density ({name})",
            "IMM+PDA's rise from case 1 less the greater of the others', dB", 0.0, pda_beyond(rise, field))
      for field, name in CREDIBILITY),
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
