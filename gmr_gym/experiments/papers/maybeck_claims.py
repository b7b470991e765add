"""What Maybeck, Kozak and Smith say of their trackers in section V, each sentence as a number with an
interval."""

from functools import partial
from itertools import product

from gmr_gym.experiments.claims import Asked, Claim
from gmr_gym.experiments.papers.maybeck_numbers import (
    JINKS,
    LEVEL,
    PRINTED,
    SPANS,
    TURNS,
    UNITS,
    WHOLE,
    Table,
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

NAMES = {
    "aggressive": "MHT of aggressive filters", "benign": "MHT of benign filters",
    "mmae": "MHT of MMAEs", "imm": "MHT of IMMs", "mmae_of": "MMAE of MHTs", "imm_of": "IMM of MHTs",
}  # fmt: skip
ALONE = {"aggressive": "aggressive filter", "mmae": "MMAE", "imm": "IMM"}  # without clutter
AS_MANY = 0.05  # of the runs, within which two trackers lose "essentially the same number"
ALIKE = 10  # per cent, within which two errors are "about the same"
NEAR_HALF = 0.1  # of 50 %, where a probability "hovers"
UNIMPEDED = 0.8  # of the flow without clutter, above which clutter "does not impede" it


def _comparison(better: str, worse: str, clutter: bool = True) -> list[Claim]:
    """That one beats another, in both errors and over both spans; Table I is of what happens in clutter."""
    sentences = []
    for quantity, (i, span) in product(UNITS, enumerate(SPANS)):
        names = NAMES if clutter else ALONE
        share = 1 - PRINTED[better][quantity][i] / PRINTED[worse][quantity][i]
        claim = Claim(
            f"{names[better]} against {names[worse]}: {quantity}, {span}",
            "error saved, %" + (f" (printed {100 * share:.0f})" if clutter else ""), 0.0,
            partial(saved, better, worse, quantity, SPANS[span]),
        )  # fmt: skip
        sentences.append(claim)
    return sentences


MULTIPLE = ("mmae", "imm", "mmae_of", "imm_of")
FLOW = "probability of the aggressive motion, jinking less level"
HOVERING = Claim(
    "the IMM's probabilities hover around 50 %",
    f"{NEAR_HALF:g} less the mean distance from 0.5", 0.0,
    lambda weight, table: NEAR_HALF - hovering("imm", weight, table),
)  # fmt: skip
DISTINGUISHING = Claim(
    "the MMAE tells the models better apart than the IMM", f"{FLOW}, the MMAE's less the IMM's", 0.0,
    lambda weight, table: flow("mmae", weight, table) - flow("imm", weight, table),
)  # fmt: skip
RIVALS = (*_comparison("mmae", "imm"), HOVERING, DISTINGUISHING)
CLEAR = (*_comparison("mmae", "imm", clutter=False), HOVERING, DISTINGUISHING)
ARCHITECTURES = (
    *(sentence for better in MULTIPLE for sentence in _comparison(better, "aggressive")),
    *_comparison("mmae", "mmae_of"),
    *_comparison("imm", "imm_of"),
    *_comparison("mmae_of", "imm_of"),
    *_comparison("mmae", "imm_of"),
    *RIVALS,
    *(
        Claim(
            f"{NAMES[who]} loses no more tracks than the {NAMES['aggressive']}",
            f"{AS_MANY:g} less its share lost more", 0.0,
            lambda weight, table, who=who: AS_MANY - lost(who, weight, table)
            + lost("aggressive", weight, table),
        )
        for who in MULTIPLE
    ),
    *(
        Claim(
            f"{NAMES[who]} does about as well as the {NAMES['aggressive']} in the {span}",
            f"{ALIKE} less the size of the position error saved, %", 0.0,
            lambda weight, table, who=who, part=part: ALIKE - abs(
                saved(who, "aggressive", "position", part, weight, table)
            ),
        )
        for who in ("mmae", "imm")
        for span, part in (("turns", TURNS), ("jinking", JINKS))
    ),
    *(
        Claim(
            f"{NAMES[who]} improves level flight more than the whole ({quantity})",
            f"error saved against the {NAMES['aggressive']}, level less whole, %", 0.0,
            lambda weight, table, who=who, quantity=quantity: saved(
                who, "aggressive", quantity, LEVEL, weight, table
            ) - saved(who, "aggressive", quantity, WHOLE, weight, table),
        )
        for who in ("mmae", "imm")
        for quantity in UNITS
    ),
    *(
        Claim(
            f"{NAMES[who]}: the turns are tracked with zero-mean error",
            "half the claimed position deviation less the mean error, m", 0.0,
            lambda weight, table, who=who: claimed(who, slice(0, 2), TURNS, weight, table) / 2
            - offset(who, TURNS, weight, table),
        )
        for who in ("aggressive", "mmae", "imm")
    ),
    *(
        Claim(
            f"{NAMES[who]}: the jinking leaves an offset in the mean error that the turns do not",
            "mean position error, jinking less turns, m", 0.0,
            lambda weight, table, who=who: offset(who, JINKS, weight, table)
            - offset(who, TURNS, weight, table),
        )
        for who in ("aggressive", "mmae", "imm")
    ),
    *(
        Claim(
            f"{NAMES[who]}: actual and computed deviations agree for most of the time",
            "share of scans and states", 0.5, partial(agreeing, who),
        )
        for who in ("aggressive", "mmae", "imm")
    ),
    *(
        Claim(
            f"{NAMES[who]} makes the errors of deferred decisions greater",
            f"position error added to that of the {NAMES['aggressive']} while jinking, %", 0.0,
            lambda weight, table, who=who: -saved(who, "aggressive", "position", JINKS, weight, table),
        )
        for who in ("mmae", "imm")
    ),
    Claim(
        "the MMAE's claimed velocity deviations neck down in level flight and the IMM's do not",
        "claimed by the MHT of IMMs less by the MHT of MMAEs, m/s", 0.0,
        lambda weight, table: claimed("imm", slice(2, 4), LEVEL, weight, table)
        - claimed("mmae", slice(2, 4), LEVEL, weight, table),
    ),
    Claim("the MMAE's probability flows with the manoeuvres", FLOW, 0.0, partial(flow, "mmae")),
    Claim(
        "the MMAE finds the motion that fits", "its probability, least of level, turns and jinking", 0.5,
        partial(told_apart, "mmae"),
    ),
    Claim(
        "clutter corrupts the probabilities in level flight and not in the jinking",
        "deviation over runs, level less jinking", 0.0,
        lambda weight, table: scatter(LEVEL, weight, table) - scatter(JINKS, weight, table),
    ),
    Claim(
        "it flows rapidly to the aggressive filter and slowly back", "scans half the way back less there",
        0.0, slower_back,
    ),
)  # fmt: skip
FAILING = (
    Claim("the benign filter loses over 90 % of the runs", "share lost", 0.9, partial(lost, "benign")),
    Claim(
        "it loses over 90 % of the runs between epochs 100 and 180",
        "share of all runs",
        0.9,
        partial(lost_between, 100, 180),
    ),
)
CLUTTER = (
    Claim(
        "clutter does not significantly impede the flow of probability",
        f"flow in clutter less {UNIMPEDED:g} of that without", 0.0,
        lambda weight, table, clear: flow("mmae", weight, table) - UNIMPEDED * flow("mmae", weight, clear),
    ),
    Claim(
        "clutter shows as a higher variance of the probability",
        "deviation over runs in level flight, in clutter less without", 0.0,
        lambda weight, table, clear: scatter(LEVEL, weight, table) - scatter(LEVEL, weight, clear),
    ),
    *(
        Claim(
            f"the benefit of the benign filters is reduced in clutter ({quantity})",
            "error saved in level flight against aggressive filters alone, without clutter less in it, %",
            0.0,
            lambda weight, table, clear, quantity=quantity: saved(
                "mmae", "aggressive", quantity, LEVEL, weight, clear
            ) - saved("mmae", "aggressive", quantity, LEVEL, weight, table),
        )
        for quantity in UNITS
    ),
    Claim(
        "the offset while jinking does not exist without clutter",
        "mean position error while jinking, half of that in clutter less that without, m", 0.0,
        lambda weight, table, clear: offset("mmae", JINKS, weight, table) / 2
        - offset("mmae", JINKS, weight, clear),
    ),
)  # fmt: skip


def _kept_in_both(quantity: str, span: slice, weight, table: Table, other: Table) -> float:
    return saved("imm", "stickier", quantity, span, weight, {**table, "stickier": other["imm"]})


TUNING = tuple(
    Claim(
        f"the IMM's matrix is the best achievable: {quantity}, {span}",
        "error saved against one that stays with 0.98, %",
        0.0,
        partial(_kept_in_both, quantity, SPANS[span]),
    )
    for quantity, span in product(UNITS, SPANS)
)
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
