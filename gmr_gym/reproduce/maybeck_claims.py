"""What Maybeck, Kozak and Smith say of their trackers in section V, each sentence as a number with an
interval."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np

from gmr_gym.curves import resampled
from gmr_gym.reproduce import Claim, judged
from gmr_gym.reproduce.maybeck_numbers import (
    JINKS,
    LEVEL,
    PRINTED,
    QUANTITIES,
    SPANS,
    TURNS,
    Table,
    agreeing,
    average,
    flow,
    lost,
    lost_between,
    offset,
    saved,
    scatter,
    slower_back,
)

NAMES = {
    "aggressive": "MHT of aggressive filters", "benign": "MHT of benign filters",
    "mmae": "MHT of MMAEs", "imm": "MHT of IMMs", "mmae_of": "MMAE of MHTs", "imm_of": "IMM of MHTs",
}  # fmt: skip
ALONE = {"aggressive": "aggressive filter", "mmae": "MMAE", "imm": "IMM"}  # without clutter
AS_MANY = 0.05  # of the runs, within which two trackers lose "essentially the same number"
NEAR_HALF = 0.1  # of 50 %, where a probability "hovers"
HARDLY = 0.8  # of the flow without clutter, above which clutter "does not impede" it


class Sentence(NamedTuple):
    """A claim whose number is taken of one or more tables, over the runs as they are weighed (runs,)."""

    claim: Claim
    value: Callable[..., float]  # of the weight and the tables


def claims(tables: Mapping[str, Table]) -> list[dict]:
    """Every sentence that the tables run can speak to, as plain data. Two trackers are compared over the runs
    that both kept."""
    records = []
    for name, table in tables.items():
        if "imm_of" in table:
            records += _judged(name, ARCHITECTURES, table)
        elif "benign" in table:
            records += _judged(name, FAILING, table)
        else:
            records += _judged(name, CLEAR if name.startswith("clear") else RIVALS, table)
    if "clear" in tables and "1" in tables:
        records += _judged("1 against clear", CLUTTER, tables["1"], tables["clear"])
    return records


def _judged(name: str, sentences: Sequence[Sentence], *tables: Table) -> list[dict]:
    everything = np.ones(len(next(iter(tables[0].values())).kept), bool)

    def values(weight):
        return np.array([value(weight, *tables) for _, value in sentences])

    return [
        judged(sentence.claim, figure, table=name, runs=f"of {len(everything)}")
        for sentence, figure in zip(sentences, resampled(values, everything), strict=True)
    ]


def _comparison(better: str, worse: str, clutter: bool = True) -> list[Sentence]:
    """That one beats another, in both errors and over both spans; Table I is of what happens in clutter."""
    sentences = []
    for quantity, (i, span) in product(QUANTITIES, enumerate(SPANS)):
        names = NAMES if clutter else ALONE
        share = 1 - PRINTED[better][quantity][i] / PRINTED[worse][quantity][i]
        claim = Claim(
            f"{names[better]} against {names[worse]}: {quantity}, {span}",
            "error saved, %" + (f" (printed {100 * share:.0f})" if clutter else ""), 0.0, float,
        )  # fmt: skip
        sentences.append(Sentence(claim, partial(saved, better, worse, quantity, SPANS[span])))
    return sentences


def _sentence(text: str, measure: str, threshold: float, value: Callable[..., float]) -> Sentence:
    return Sentence(Claim(text, measure, threshold, float), value)


MULTIPLE = ("mmae", "imm", "mmae_of", "imm_of")
FLOW = "probability of the aggressive motion, jinking less level"
HOVERING = _sentence(
    "the IMM's probabilities hover around 50 % in level flight",
    f"{NEAR_HALF:g} less the distance of the mean from 0.5", 0.0,
    lambda weight, table: NEAR_HALF - abs(
        average(table["imm"].aggressive, table["imm"], weight)[LEVEL].mean() - 0.5
    ),
)  # fmt: skip
DISTINGUISHING = _sentence(
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
    *RIVALS,
    *(
        _sentence(
            f"{NAMES[who]} loses as many tracks as the {NAMES['aggressive']}",
            f"{AS_MANY:g} less the difference of the shares", 0.0,
            lambda weight, table, who=who: AS_MANY - abs(
                lost(who, weight, table) - lost("aggressive", weight, table)
            ),
        )
        for who in MULTIPLE
    ),
    *(
        _sentence(
            f"{NAMES[who]}: the jinking leaves an offset in the mean error that the turns do not",
            "mean position error, jinking less turns, m", 0.0,
            lambda weight, table, who=who: offset(who, JINKS, weight, table)
            - offset(who, TURNS, weight, table),
        )
        for who in ("aggressive", "mmae", "imm")
    ),
    *(
        _sentence(
            f"{NAMES[who]}: actual and computed deviations agree for most of the time",
            "share of scans and states", 0.5, partial(agreeing, who),
        )
        for who in ("aggressive", "mmae", "imm")
    ),
    *(
        _sentence(
            f"{NAMES[who]} makes the errors of deferred decisions greater",
            f"position error added to that of the {NAMES['aggressive']} while jinking, %", 0.0,
            lambda weight, table, who=who: -saved(who, "aggressive", "position", JINKS, weight, table),
        )
        for who in ("mmae", "imm")
    ),
    _sentence("the MMAE's probability flows with the manoeuvres", FLOW, 0.0, partial(flow, "mmae")),
    _sentence(
        "it flows rapidly to the aggressive filter and slowly back", "scans half the way back less there",
        0.0, slower_back,
    ),
)  # fmt: skip
FAILING = (
    _sentence("the benign filter loses over 90 % of the runs", "share lost", 0.9, partial(lost, "benign")),
    _sentence(
        "it loses them between epochs 100 and 180", "share of the lost", 0.9, partial(lost_between, 100, 180)
    ),
)
CLUTTER = (
    _sentence(
        "clutter does not significantly impede the flow of probability",
        f"flow in clutter less {HARDLY:g} of that without", 0.0,
        lambda weight, table, clear: flow("mmae", weight, table) - HARDLY * flow("mmae", weight, clear),
    ),
    _sentence(
        "clutter shows as a higher variance of the probability",
        "deviation over runs in level flight, in clutter less without", 0.0,
        lambda weight, table, clear: scatter(weight, table) - scatter(weight, clear),
    ),
    *(
        _sentence(
            f"the benefit of the benign filters is reduced in clutter ({quantity})",
            "error saved in level flight against aggressive filters alone, without clutter less in it, %",
            0.0,
            lambda weight, table, clear, quantity=quantity: saved(
                "mmae", "aggressive", quantity, LEVEL, weight, clear
            ) - saved("mmae", "aggressive", quantity, LEVEL, weight, table),
        )
        for quantity in QUANTITIES
    ),
    _sentence(
        "the offset while jinking does not exist without clutter",
        "mean position error while jinking, in clutter less without, m", 0.0,
        lambda weight, table, clear: offset("mmae", JINKS, weight, table)
        - offset("mmae", JINKS, weight, clear),
    ),
)  # fmt: skip
