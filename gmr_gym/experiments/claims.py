"""What papers say of their trackers, as numbers: each is resampled over the runs and judged, in one loop."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import wraps
from operator import add, neg, sub
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtri

from gmr_gym.evaluation.curves import resampled
from gmr_gym.evaluation.summary import CONFIDENCE, FEWEST, Estimate, bootstrap_mean, wilson
from gmr_gym.experiments.evidence import Evidence

TOO_FEW = "too few runs"
ByTracker = Mapping[str, Evidence]  # of one table


def of_values(operation: Callable[..., Any]) -> Callable[..., "Number"]:
    """What makes of numbers, and of constants, the number that the operation makes of their values."""
    return lambda *operands: Number(
        lambda *evidence: operation(*(each(*evidence) if callable(each) else each for each in operands))
    )


@dataclass(frozen=True, eq=False)
class Number:
    """A number that evidence has, `function(*args, *evidence)`. Of numbers of the same evidence, and of
    constants, sums, differences and multiples are numbers again."""

    function: Callable[..., Any]
    args: tuple[Any, ...] = ()

    def __call__(self, *evidence: Any) -> Any:
        return self.function(*self.args, *evidence)

    __add__ = of_values(add)
    __sub__ = of_values(sub)
    __radd__ = of_values(lambda own, other: other + own)
    __rsub__ = of_values(lambda own, other: other - own)
    __rmul__ = of_values(lambda own, other: other * own)
    __neg__ = of_values(neg)
    __abs__ = of_values(abs)


least, greatest = of_values(min), of_values(max)


def number(function: Callable[..., Any]) -> Callable[..., Number]:
    """Of `function(*args, *evidence)` what makes the number of it by its args."""
    return wraps(function)(lambda *args: Number(function, args))


def in_first(one: Number) -> Number:
    """Of two tables the number in the first, whatever evidence stands before them."""
    return Number(lambda *evidence: one(*evidence[:-1]))


def in_last(one: Number) -> Number:
    """Of two tables the number in the second."""
    return Number(lambda *evidence: one(*evidence[:-2], evidence[-1]))


class Claim(NamedTuple):
    """A sentence of a paper as a number: it holds where the number lies above the threshold.

    Parameters
    ----------
    sentence : str
        What the paper says.
    measure : str
        What the number is, with its unit.
    threshold : float
    value : Callable
        `value(weight, *evidence)` is the number with every run counted as often as weight `(runs,)` says. Of
        claims that are judged run by run, `value(*evidence)` `(runs,)`, and the number is the mean.
    of, against : str
        The tracker the sentence is about, in the first table, and its rival, in the last: the two whose
        evidence `value` takes. Without them it takes whole tables.
    widened : bool
        Whether an interval without width is taken for that of no event, as of a share.
    """

    sentence: str
    measure: str
    threshold: float
    value: Callable[..., Any]
    of: str = ""
    against: str = ""
    widened: bool = True

    def answerable(self, tables: Sequence[ByTracker]) -> bool:
        """Whether its trackers are in the tables."""
        return not self.of or (self.of in tables[0] and self.against in tables[-1])

    def evidence(self, tables: Sequence[ByTracker]) -> Sequence[Any]:
        """What the number is taken of."""
        return (tables[0][self.of], tables[-1][self.against]) if self.of else tables


class Asked(NamedTuple):
    """Claims about the same tables, judged where the evidence of all of these is at hand.

    Parameters
    ----------
    claims : tuple of Claim
    tables : tuple of str
        Names of the tables, in the order in which `value` takes their evidence.
    runs : str
        What a record says of the runs; their number goes where the braces are.
    table : str
        What a record calls the tables, unless "one against other".
    kept : bool
        Over the runs that no tracker at hand lost, not over all.
    run_by_run : bool
        The values are numbers of each run; their mean is judged.
    prepare : Callable, optional
        `prepare(weight, *tables)` are the arguments that every `value` takes instead.
    """

    claims: tuple[Claim, ...]
    tables: tuple[str, ...]
    runs: str = "all {}"
    table: str = ""
    kept: bool = False
    run_by_run: bool = False
    prepare: Callable[..., tuple] | None = None


def claim_records(asked: Iterable[Asked], evidence: Mapping[str, ByTracker]) -> list[dict[str, Any]]:
    """Every claim that the evidence of the tables at hand can tell of, judged, as plain data."""
    records = []
    for each in asked:
        if not set(each.tables) <= set(evidence):
            continue
        tables = [evidence[name] for name in each.tables]
        claims = [claim for claim in each.claims if claim.answerable(tables)]
        estimates = _run_by_run(claims, tables) if each.run_by_run else _resampled(each, claims, tables)
        name = each.table or " against ".join(each.tables)
        for claim, (figure, count) in zip(claims, estimates, strict=True):
            if claim.widened and count:
                (figure,) = no_event_width([figure], count)
            records.append(judged(claim, figure, count, table=name, runs=each.runs.format(count)))
    return records


def _run_by_run(claims: Iterable[Claim], tables: list[ByTracker]) -> list[tuple[Estimate, int]]:
    values = [claim.value(*claim.evidence(tables)) for claim in claims]
    return [(bootstrap_mean(each), len(each)) for each in values]


def _resampled(asked: Asked, claims: list[Claim], tables: list[ByTracker]) -> list[tuple[Estimate, int]]:
    kept = [one.kept for table in tables for one in table.values()]
    mask = np.logical_and.reduce(kept) if asked.kept else np.ones(len(kept[0]), bool)

    def values(weight: np.ndarray) -> np.ndarray:
        shared = asked.prepare(weight, *tables) if asked.prepare else None
        return np.array([claim.value(*shared or (weight, *claim.evidence(tables))) for claim in claims])

    return [(figure, int(mask.sum())) for figure in resampled(values, mask)] if claims else []


def judged(claim: Claim, figure: Estimate, count: int, **about: str) -> dict[str, Any]:
    """A claim about a figure of so many runs as plain data: "holds" or "fails" when chance puts the number on
    the other side of the threshold less than once in a hundred times, else "tie"; "unknown" without an
    interval, and TOO_FEW where so few runs do not tell how often that is."""
    # from the interval's confidence to 99 %, as `verdict` asks
    reach = (figure.high - figure.low) / 2 * ndtri(0.995) / ndtri((1 + CONFIDENCE) / 2)
    if not np.isfinite(reach):
        verdict = "unknown"
    elif count < FEWEST:
        verdict = TOO_FEW
    elif abs(figure.value - claim.threshold) <= reach:
        verdict = "tie"
    else:
        verdict = "holds" if figure.value > claim.threshold else "fails"
    record: dict[str, Any] = {**about, "claim": claim.sentence, "measure": claim.measure}
    return record | plain(figure) | {"threshold": claim.threshold, "verdict": verdict}


def no_event_width(figures: Iterable[Estimate], runs: int) -> list[Estimate]:
    """Where no resample of the runs differs, rounding apart, a bootstrap claims certainty: the interval is
    then as wide as that of no event in as many runs, for numbers that are shares."""
    most = wilson(0, runs).high
    return [
        Estimate(f.value, f.value - most, f.value + most) if f.high - f.low < 1e-9 else f for f in figures
    ]


def plain(figure: Estimate) -> dict[str, float | None]:
    """A figure and its interval for JSON, which knows no number that is not finite."""
    return {key: float(value) if np.isfinite(value) else None for key, value in figure._asdict().items()}
