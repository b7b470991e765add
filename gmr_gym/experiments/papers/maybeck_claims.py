"""What Maybeck, Kozak and Smith say of their trackers in section V, each sentence as a number with an
interval."""

from itertools import product
from typing import Any

from gmr_gym.experiments.claims import Asked, ByTracker, Claim, in_first, in_last, number
from gmr_gym.experiments.papers.maybeck_numbers import (
    ERRORS,
    JINKS,
    LEVEL,
    POSITION,
    SPANS,
    TURNS,
    UNITS,
    VELOCITY,
    WHOLE,
    agreeing,
    claimed,
    flow,
    hovering,
    lost,
    lost_between,
    offset,
    saved,
    scatter,
    slower_back,
    told_apart,
)
from gmr_gym.experiments.tables import printed_in

PRINTED = printed_in("maybeck")  # by table and by what a tracker is, as in NAMES
NAMES = {
    "aggressive": "MHT of aggressive filters", "benign": "MHT of benign filters",
    "mmae": "MHT of MMAEs", "imm": "MHT of IMMs", "mmae_of": "MMAE of MHTs", "imm_of": "IMM of MHTs",
}  # fmt: skip
ALONE = {"aggressive": "aggressive filter", "mmae": "MMAE", "imm": "IMM"}  # without clutter
ADAPTIVE = ("mmae", "imm")
SINGLE = ("aggressive", *ADAPTIVE)  # one MHT
AS_MANY = 0.05  # of the runs, within which two trackers lose "essentially the same number"
ALIKE = 10  # per cent, within which two errors are "about the same"
NEAR_HALF = 0.1  # of 50 %, where a probability "hovers"
UNIMPEDED = 0.8  # of the flow without clutter, above which clutter "does not impede" it


def _beats(better: str, worse: str) -> list[Claim]:
    """In clutter, in both errors and over both spans, as Table I has them."""
    claims = []
    for quantity, span in product(UNITS, SPANS):
        row, other = (PRINTED["1"][who][f"{ERRORS[quantity, span]}_own"] for who in (better, worse))
        claims.append(Claim(
            f"{NAMES[better]} against {NAMES[worse]}: {quantity}, {span}",
            f"error saved, % (printed {100 * (1 - row / other):.0f})", 0.0,
            saved(better, worse, quantity, SPANS[span]),
        ))  # fmt: skip
    return claims


FLOW = "probability of the aggressive motion, jinking less level"
HOVERING = Claim(
    "the IMM's probabilities hover around 50 %",
    f"{NEAR_HALF:g} less the mean distance from 0.5", 0.0, NEAR_HALF - hovering("imm"),
)  # fmt: skip
DISTINGUISHING = Claim(
    "the MMAE tells the models better apart than the IMM",
    f"{FLOW}, the MMAE's less the IMM's", 0.0, flow("mmae") - flow("imm"),
)  # fmt: skip
RIVALS = (*_beats("mmae", "imm"), HOVERING, DISTINGUISHING)
CLEAR = (
    *(Claim(f"{ALONE['mmae']} against {ALONE['imm']}: {quantity}, {span}",
            "error saved, %", 0.0, saved("mmae", "imm", quantity, SPANS[span]))
      for quantity, span in product(UNITS, SPANS)),
    HOVERING,
    DISTINGUISHING,
)  # fmt: skip
ARCHITECTURES = (
    *_beats("mmae", "aggressive"),
    *_beats("imm", "aggressive"),
    *_beats("mmae_of", "aggressive"),
    *_beats("imm_of", "aggressive"),
    *_beats("mmae", "mmae_of"),
    *_beats("imm", "imm_of"),
    *_beats("mmae_of", "imm_of"),
    *_beats("mmae", "imm_of"),
    *RIVALS,
    *(Claim(f"{NAMES[who]} loses no more tracks than the MHT of aggressive filters",
            f"{AS_MANY:g} less its share lost more", 0.0, AS_MANY - lost(who) + lost("aggressive"))
      for who in ("mmae", "imm", "mmae_of", "imm_of")),
    *(Claim(f"{NAMES[who]} does about as well as the MHT of aggressive filters in the {span}",
            f"{ALIKE} less the size of the position error saved, %", 0.0,
            ALIKE - abs(saved(who, "aggressive", "position", part)))
      for who, (span, part) in product(ADAPTIVE, (("turns", TURNS), ("jinking", JINKS)))),
    *(Claim(f"{NAMES[who]} improves level flight more than the whole ({quantity})",
            "error saved against the MHT of aggressive filters, level less whole, %", 0.0,
            saved(who, "aggressive", quantity, LEVEL) - saved(who, "aggressive", quantity, WHOLE))
      for who, quantity in product(ADAPTIVE, UNITS)),
    *(Claim(f"{NAMES[who]}: the turns are tracked with zero-mean error",
            "half the claimed position deviation less the mean error, m", 0.0,
            0.5 * claimed(who, POSITION, TURNS) - offset(who, TURNS))
      for who in SINGLE),
    *(Claim(f"{NAMES[who]}: the jinking leaves an offset in the mean error that the turns do not",
            "mean position error, jinking less turns, m", 0.0, offset(who, JINKS) - offset(who, TURNS))
      for who in SINGLE),
    *(Claim(f"{NAMES[who]}: actual and computed deviations agree for most of the time",
            "share of scans and states", 0.5, agreeing(who))
      for who in SINGLE),
    *(Claim(f"{NAMES[who]} makes the errors of deferred decisions greater",
            "position error added to that of the MHT of aggressive filters while jinking, %", 0.0,
            -saved(who, "aggressive", "position", JINKS))
      for who in ADAPTIVE),
    Claim("the MMAE's claimed velocity deviations neck down in level flight and the IMM's do not",
          "claimed by the MHT of IMMs less by the MHT of MMAEs, m/s", 0.0,
          claimed("imm", VELOCITY, LEVEL) - claimed("mmae", VELOCITY, LEVEL)),
    Claim("the MMAE's probability flows with the manoeuvres", FLOW, 0.0, flow("mmae")),
    Claim("the MMAE finds the motion that fits",
          "its probability, least of level, turns and jinking", 0.5, told_apart("mmae")),
    Claim("clutter corrupts the probabilities in level flight and not in the jinking",
          "deviation over runs, level less jinking", 0.0, scatter(LEVEL) - scatter(JINKS)),
    Claim("it flows rapidly to the aggressive filter and slowly back",
          "scans half the way back less there", 0.0, slower_back),
)  # fmt: skip
FAILING = (
    Claim("the benign filter loses over 90 % of the runs", "share lost", 0.9, lost("benign")),
    Claim("it loses over 90 % of the runs between epochs 100 and 180",
          "share of all runs", 0.9, lost_between(100, 180)),
)  # fmt: skip
CLUTTER = (  # first in clutter, last without
    Claim("clutter does not significantly impede the flow of probability",
          f"flow in clutter less {UNIMPEDED:g} of that without", 0.0,
          in_first(flow("mmae")) - UNIMPEDED * in_last(flow("mmae"))),
    Claim("clutter shows as a higher variance of the probability",
          "deviation over runs in level flight, in clutter less without", 0.0,
          in_first(scatter(LEVEL)) - in_last(scatter(LEVEL))),
    *(Claim(f"the benefit of the benign filters is reduced in clutter ({quantity})",
            "error saved in level flight against aggressive filters alone, without clutter less in it, %",
            0.0, in_last(benefit) - in_first(benefit))
      for quantity in UNITS for benefit in [saved("mmae", "aggressive", quantity, LEVEL)]),
    Claim("the offset while jinking does not exist without clutter",
          "mean position error while jinking, half of that in clutter less that without, m", 0.0,
          0.5 * in_first(offset("mmae", JINKS)) - in_last(offset("mmae", JINKS))),
)  # fmt: skip


@number
def imm_saves(quantity: str, span: slice, weight: Any, table: ByTracker, stickier: ByTracker) -> Any:
    """By how many per cent its error is smaller than that of the other table's IMM."""
    pair = {"imm": table["imm"], "stickier": stickier["imm"]}
    return saved("imm", "stickier", quantity, span)(weight, pair)


TUNING = tuple(
    Claim(f"the IMM's matrix is the best achievable: {quantity}, {span}",
          "error saved against one that stays with 0.98, %", 0.0, imm_saves(quantity, SPANS[span]))
    for quantity, span in product(UNITS, SPANS)
)  # fmt: skip
# two trackers are compared over the runs that both kept
ASKED = tuple(
    Asked(claims, tables, "of {}")
    for claims, tables in (
        (ARCHITECTURES, ("1",)),
        (FAILING, ("benign",)),
        (CLEAR, ("clear",)),
        (ARCHITECTURES, ("1-runnalls",)),
        (RIVALS, ("switching",)),
        (CLEAR, ("clear-switching",)),
        (ARCHITECTURES, ("missed",)),
        (CLUTTER, ("1", "clear")),
        (TUNING, ("1", "switching")),
        (TUNING, ("clear", "clear-switching")),
    )
)
