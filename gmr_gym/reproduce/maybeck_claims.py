"""What Maybeck, Kozak and Smith say of their trackers in section V, each sentence as a number with an
interval."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np

from gmr_gym.curves import resampled
from gmr_gym.metrics import lost_at
from gmr_gym.montecarlo import Runs
from gmr_gym.reproduce import Claim, judged
from gmr_gym.simulate import Scenario

WHOLE = slice(None)
LEVEL = slice(119, 199)  # epochs 120 to 199, straight and level: the "benign" part
TURNS, JINKS = slice(44, 100), slice(199, 250)  # epochs 45 to 100, and 200 to 250
SPANS = {"whole": WHOLE, "level": LEVEL}
QUANTITIES = {"position": "m", "velocity": "m/s"}
# Table I: rms errors of position (m) and velocity (m/s), over the whole flight and over its benign part
PRINTED = {
    "aggressive": {"position": (22.9, 18.1), "velocity": (17.5, 15.4)},
    "mmae": {"position": (18.6, 11.9), "velocity": (13.1, 7.8)},
    "imm": {"position": (20.9, 15.1), "velocity": (14.4, 11.6)},
    "mmae_of": {"position": (22.7, 16.1), "velocity": (16.7, 13.4)},
    "imm_of": {"position": (26.6, 15.6), "velocity": (15.4, 12.4)},
}
NAMES = {
    "aggressive": "MHT of aggressive filters", "benign": "MHT of benign filters",
    "mmae": "MHT of MMAEs", "imm": "MHT of IMMs", "mmae_of": "MMAE of MHTs", "imm_of": "IMM of MHTs",
}  # fmt: skip
AS_MANY = 0.05  # of the runs, within which two trackers lose "essentially the same number"
NEAR_HALF = 0.1  # of 50 %, where a probability "hovers"
TUNED = 1.25  # times the claimed deviation, or its inverse, within which the actual one agrees
HARDLY = 0.8  # of the flow without clutter, above which clutter "does not impede" it


class Tracked(NamedTuple):
    """What the sentences need of one tracker's runs."""

    position: np.ndarray  # (runs, T), squared error, m^2
    velocity: np.ndarray  # (runs, T), squared error, (m/s)^2
    error: np.ndarray  # (runs, T, 4), of position and velocity
    claimed: np.ndarray  # (runs, T, 4), the variances claimed for them
    aggressive: np.ndarray  # (runs, T), probability of the last motion, the aggressive one
    kept: np.ndarray  # (runs,)
    lost_at: np.ndarray  # (runs,), scan, counted from 0, -1 for never


Table = Mapping[str, Tracked]  # by what a tracker is, as in NAMES


class Sentence(NamedTuple):
    """A claim whose number is taken of one or more tables, over the runs as they are weighed (runs,)."""

    claim: Claim
    value: Callable[..., float]  # of the weight and the tables


def tracked(scenario: Scenario, runs: Runs) -> Tracked:
    """The runs of one tracker, as the sentences need them."""
    states = [*scenario.position, *scenario.velocity]
    error = (runs.x - runs.truth)[..., states]
    squared, k = error**2, len(scenario.position)
    lost = lost_at(runs.off_target, scenario.patience)
    return Tracked(
        squared[..., :k].sum(axis=-1), squared[..., k:].sum(axis=-1), error,
        np.diagonal(runs.P, axis1=-2, axis2=-1)[..., states], runs.modes[..., -1], lost < 0, lost,
    )  # fmt: skip


def evidence(roles: Sequence[str], scenario: Scenario, results: Mapping[str, Runs]) -> dict[str, Tracked]:
    """Evidence from a table's results, whose trackers are these, in this order."""
    return {role: tracked(scenario, runs) for role, runs in zip(roles, results.values(), strict=True)}


def rms(one: Tracked, quantity: str, span: slice, weight: np.ndarray) -> float:
    """Temporally averaged rms error, as in Table I: over the runs scan by scan, then averaged over the
    span; not a number where no run has weight."""
    if not weight.any():
        return np.nan
    return float(np.sqrt(weight / weight.sum() @ getattr(one, quantity)[:, span]).mean())


def claims(tables: Mapping[str, Table]) -> list[dict]:
    """Every sentence that the tables run can speak to, as plain data. Two trackers are compared over the runs
    that both kept."""
    records = []
    for name, table in tables.items():
        if "imm_of" in table:
            records += _judged(name, ARCHITECTURES, table)
        elif "benign" in table:
            records += _judged(name, FAILING, table)
        elif "mmae" in table:
            records += _judged(name, RIVALS, table)
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


def _saved(better: str, worse: str, quantity: str, span: slice, weight, table: Table) -> float:
    """By how many per cent the error of one is smaller than that of another."""
    both = weight * table[better].kept * table[worse].kept
    with np.errstate(invalid="ignore"):
        return 100 * (1 - rms(table[better], quantity, span, both) / rms(table[worse], quantity, span, both))


def _lost(who: str, weight, table: Table) -> float:
    return float(weight @ ~table[who].kept / weight.sum())


def _average(values: np.ndarray, one: Tracked, weight) -> np.ndarray:
    """Over the runs kept; nan where there are none."""
    own = weight * one.kept
    return np.tensordot(own / own.sum(), values, 1) if own.any() else np.full(values.shape[1:], np.nan)


def _flow(who: str, weight, table: Table) -> float:
    """Probability of the aggressive motion while it jinks, less that in level flight."""
    chances = _average(table[who].aggressive, table[who], weight)
    return float(chances[JINKS].mean() - chances[LEVEL].mean())


def _offset(who: str, span: slice, weight, table: Table) -> float:
    """Length of the mean position error, m, its root mean square over a span."""
    mean = _average(table[who].error[..., :2], table[who], weight)[span]
    return float(np.sqrt((mean**2).sum(axis=-1).mean()))


def _agreeing(who: str, weight, table: Table) -> float:
    """Share of scans and states at which the error's deviation is about the claimed one."""
    one = table[who]
    ratio = np.sqrt(_average(one.error**2, one, weight) / _average(one.claimed, one, weight))
    return float(((1 / TUNED < ratio) & (ratio < TUNED)).mean()) if np.isfinite(ratio).all() else np.nan


def _slower_back(weight, table: Table) -> float:
    """Scans that the probability needs to come half the way back after the jinking, less those it needs to
    go half the way there."""
    chances = _average(table["mmae"].aggressive, table["mmae"], weight)
    if not np.isfinite(chances).all():
        return np.nan
    half = (chances[JINKS].max() + chances[LEVEL].mean()) / 2
    there = int((chances[JINKS.start :] > half).argmax())
    back = int((chances[JINKS.stop :] < half).argmax())
    return float(back - there)


def _scatter(weight, table: Table) -> float:
    """Deviation over the runs of the aggressive motion's probability, in level flight."""
    one = table["mmae"]
    mean = _average(one.aggressive, one, weight)
    return float(np.sqrt(_average((one.aggressive - mean) ** 2, one, weight)[LEVEL]).mean())


def _lost_between(first: int, last: int, weight, table: Table) -> float:
    at = table["benign"].lost_at + 1  # epochs are counted from 1
    lost = weight * (at > 0)
    return float(lost @ ((first <= at) & (at <= last)) / lost.sum()) if lost.any() else np.nan


def _comparison(better: str, worse: str) -> list[Sentence]:
    """That one beats another, in both errors and over both spans."""
    sentences = []
    for quantity, (i, span) in product(QUANTITIES, enumerate(SPANS)):
        printed = 100 * (1 - PRINTED[better][quantity][i] / PRINTED[worse][quantity][i])
        claim = Claim(
            f"{NAMES[better]} against {NAMES[worse]}: {quantity}, {span}",
            f"error saved, % (printed {printed:.0f})", 0.0, float,
        )  # fmt: skip
        sentences.append(Sentence(claim, partial(_saved, better, worse, quantity, SPANS[span])))
    return sentences


def _sentence(text: str, measure: str, threshold: float, value: Callable[..., float]) -> Sentence:
    return Sentence(Claim(text, measure, threshold, float), value)


MULTIPLE = ("mmae", "imm", "mmae_of", "imm_of")
FLOW = "probability of the aggressive motion, jinking less level"
HOVERING = _sentence(
    "the IMM's probabilities hover around 50 % in level flight",
    f"{NEAR_HALF:g} less the distance of the mean from 0.5", 0.0,
    lambda weight, table: NEAR_HALF - abs(
        _average(table["imm"].aggressive, table["imm"], weight)[LEVEL].mean() - 0.5
    ),
)  # fmt: skip
DISTINGUISHING = _sentence(
    "the MMAE tells the models better apart than the IMM", f"{FLOW}, the MMAE's less the IMM's", 0.0,
    lambda weight, table: _flow("mmae", weight, table) - _flow("imm", weight, table),
)  # fmt: skip
RIVALS = (*_comparison("mmae", "imm"), HOVERING, DISTINGUISHING)
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
                _lost(who, weight, table) - _lost("aggressive", weight, table)
            ),
        )
        for who in MULTIPLE
    ),
    *(
        _sentence(
            f"{NAMES[who]}: the jinking leaves an offset in the mean error that the turns do not",
            "mean position error, jinking less turns, m", 0.0,
            lambda weight, table, who=who: _offset(who, JINKS, weight, table)
            - _offset(who, TURNS, weight, table),
        )
        for who in ("aggressive", "mmae", "imm")
    ),
    *(
        _sentence(
            f"{NAMES[who]}: actual and computed deviations agree for most of the time",
            "share of scans and states", 0.5, partial(_agreeing, who),
        )
        for who in ("aggressive", "mmae", "imm")
    ),
    *(
        _sentence(
            f"{NAMES[who]} makes the errors of deferred decisions greater",
            f"position error added to that of the {NAMES['aggressive']} while jinking, %", 0.0,
            lambda weight, table, who=who: -_saved(who, "aggressive", "position", JINKS, weight, table),
        )
        for who in ("mmae", "imm")
    ),
    _sentence("the MMAE's probability flows with the manoeuvres", FLOW, 0.0, partial(_flow, "mmae")),
    _sentence(
        "it flows rapidly to the aggressive filter and slowly back", "scans half the way back less there",
        0.0, _slower_back,
    ),
)  # fmt: skip
FAILING = (
    _sentence("the benign filter loses over 90 % of the runs", "share lost", 0.9, partial(_lost, "benign")),
    _sentence(
        "it loses them between epochs 100 and 180", "share of the lost", 0.9, partial(_lost_between, 100, 180)
    ),
)
CLUTTER = (
    _sentence(
        "clutter does not significantly impede the flow of probability",
        f"flow in clutter less {HARDLY:g} of that without", 0.0,
        lambda weight, table, clear: _flow("mmae", weight, table) - HARDLY * _flow("mmae", weight, clear),
    ),
    _sentence(
        "clutter shows as a higher variance of the probability",
        "deviation over runs in level flight, in clutter less without", 0.0,
        lambda weight, table, clear: _scatter(weight, table) - _scatter(weight, clear),
    ),
    *(
        _sentence(
            f"the benefit of the benign filters is reduced in clutter ({quantity})",
            "error saved in level flight against aggressive filters alone, without clutter less in it, %",
            0.0,
            lambda weight, table, clear, quantity=quantity: _saved(
                "mmae", "aggressive", quantity, LEVEL, weight, clear
            ) - _saved("mmae", "aggressive", quantity, LEVEL, weight, table),
        )
        for quantity in QUANTITIES
    ),
    _sentence(
        "the offset while jinking does not exist without clutter",
        "mean position error while jinking, in clutter less without, m", 0.0,
        lambda weight, table, clear: _offset("mmae", JINKS, weight, table)
        - _offset("mmae", JINKS, weight, clear),
    ),
)  # fmt: skip
