"""What Zhang and Liu say of their curves in section 6.4, each sentence as a number with an interval."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from gmr_gym.curves import Curves, Errors, curves, errors_of, resampled
from gmr_gym.montecarlo import Runs
from gmr_gym.reproduce import Claim, judged
from gmr_gym.scenarios.zhang import SWITCHES
from gmr_gym.simulate import Scenario
from gmr_gym.summary import kept

BEFORE, AFTER = 5, 5  # scans before a switch, and from it on, that a peak is looked for in
MOST, CONSTANTLY = 0.5, 0.9  # shares of the scans


class Evidence(NamedTuple):
    """The runs of one table that the sentences are about."""

    case: str
    mmg: Errors
    imm_mht: Errors
    imm_pda: Errors
    kept: np.ndarray  # (runs,), by all three


class Trio(NamedTuple):
    """The curves of the three trackers over some runs."""

    mmg: Curves
    imm_mht: Curves
    imm_pda: Curves

    @property
    def rivals(self) -> tuple[Curves, Curves]:
        return self.imm_mht, self.imm_pda


def evidence(case: str, scenario: Scenario, results: Mapping[str, Runs]) -> Evidence:
    """Evidence from a table's results, whose first three trackers are MMG, IMM+MHT and IMM+PDA."""
    trio = list(results.values())[:3]
    mmg, imm_mht, imm_pda = (errors_of(scenario, runs) for runs in trio)
    kept_by_all = np.logical_and.reduce([kept(scenario, runs) for runs in trio])
    return Evidence(case, mmg, imm_mht, imm_pda, kept_by_all)


def claims(tables: Mapping[str, Evidence]) -> list[dict]:
    """Every sentence that the tables run can speak to, over all runs and over the runs kept by all three,
    as plain data. A sentence on both cases needs both tables at the same process noise."""
    records = []
    for name, one in tables.items():
        about = CASE_1 if one.case == "1" else CASE_2
        records += _judged(name, about, [one])
        first = tables.get(name.replace("2", "1", 1))
        if one.case == "2" and first is not None:
            records += _judged(f"{name} against {name.replace('2', '1', 1)}", BOTH, [first, one])
    return records


def _judged(name: str, about: tuple[Claim, ...], tables: list[Evidence]) -> list[dict]:
    everything = np.ones(len(tables[0].kept), bool)
    records = []
    for which, mask in (("all", everything), ("kept", np.logical_and.reduce([one.kept for one in tables]))):

        def values(weight):
            trios = [Trio(*(curves(errors, weight) for errors in one[1:4])) for one in tables]
            return np.array([claim.value(*trios) for claim in about])

        figures = resampled(values, mask)
        records += [
            judged(claim, figure, table=name, runs=f"{which} {mask.sum()}")
            for claim, figure in zip(about, figures, strict=True)
        ]
    return records


def _lead(field: str, trio: Trio) -> float:
    """By how much the better rival's average over the scans exceeds MMG's."""
    own, *others = (getattr(one, field).mean() for one in trio)
    return min(others) - own


def _lowest(field: str, trio: Trio) -> float:
    """Share of the scans at which MMG's curve is the lowest."""
    own, *others = (getattr(one, field) for one in trio)
    return float((own < np.minimum(*others)).mean())


def _peak(field: str, one: Curves, switch: int) -> float:
    """The curve after a switch (its mean over `AFTER` scans) relative to before it."""
    curve = getattr(one, field)
    first = switch - 1  # scans are counted from 1
    return curve[first : first + AFTER].mean() / curve[first - BEFORE : first].mean()


def _peaks(field: str, trio: Trio) -> float:
    return min(_peak(field, trio.mmg, switch) for switch in SWITCHES) - 1


def _calmer(field: str, trio: Trio) -> float:
    return _peak(field, trio.mmg, SWITCHES[0]) - max(_peak(field, one, SWITCHES[0]) for one in trio.rivals)


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


PEAKS = "MMG's {} RMSE over five scans from a switch, relative to the five before, less 1; the lesser switch"
CALM = "MMG's rise of {} RMSE at the first switch less the rivals' greater rise"
CASE_1 = (
    Claim(
        "MMG has the best position RMSE",
        "better rival's average less MMG's, m", 0.0, lambda trio: _lead("rmse", trio),
    ),
    Claim(
        "MMG has the best velocity RMSE",
        "better rival's average less MMG's, m/s", 0.0, lambda trio: _lead("velocity_rmse", trio),
    ),
    Claim(
        "two peaks of MMG are the two switches (position)",
        PEAKS.format("position"), 0.0, lambda trio: _peaks("rmse", trio),
    ),
    Claim(
        "two peaks of MMG are the two switches (velocity)",
        PEAKS.format("velocity"), 0.0, lambda trio: _peaks("velocity_rmse", trio),
    ),
    Claim(
        "the IMM based methods have no peak at the first switch (position)",
        CALM.format("position"), 0.0, lambda trio: _calmer("rmse", trio),
    ),
    Claim(
        "the IMM based methods have no peak at the first switch (velocity)",
        CALM.format("velocity"), 0.0, lambda trio: _calmer("velocity_rmse", trio),
    ),
    Claim(
        "MMG has the lowest NCI for most of the time",
        "share of scans", MOST, lambda trio: _lowest("nci", trio),
    ),
    Claim(
        "MMG is constantly pessimistic except at the transients",
        "share of scans away from start and switches", CONSTANTLY, _pessimistic,
    ),
    Claim(
        "IMM+PDA is constantly optimistic",
        "share of scans", CONSTANTLY, lambda trio: _optimistic(trio.imm_pda),
    ),
    Claim(
        "IMM+MHT shows no consistent pattern of inclination",
        "share of scans on the rarer side of 0", 1 - CONSTANTLY,
        lambda trio: min(_optimistic(trio.imm_mht), 1 - _optimistic(trio.imm_mht)),
    ),
)  # fmt: skip
CASE_2 = (
    Claim(
        "MMG has the lowest position RMSE for most of the time",
        "share of scans", MOST, lambda trio: _lowest("rmse", trio),
    ),
    Claim(
        "MMG has the lowest velocity RMSE for most of the time",
        "share of scans", MOST, lambda trio: _lowest("velocity_rmse", trio),
    ),
    *CASE_1[4:6],
    Claim(
        "the NCI of IMM+PDA is much worse than that of the other two",
        "average less the worse of the others', dB", 0.0, lambda trio: _worse_pda("nci", trio),
    ),
    Claim(
        "the inclination of IMM+PDA is much worse than that of the other two",
        "average magnitude less the worse of the others', dB", 0.0,
        lambda trio: _worse_pda("inclination", trio),
    ),
)  # fmt: skip
BOTH = (
    Claim(
        "all filters have larger position errors than in case 1",
        "average in case 2 less case 1, m; the least of the three", 0.0,
        lambda first, second: min(b.rmse.mean() - a.rmse.mean() for a, b in zip(first, second, strict=True)),
    ),
    Claim(
        "PDA is more sensitive to the clutter density",
        "rise of IMM+PDA's average NCI less the greater of the others', dB", 0.0,
        lambda first, second: (
            second.imm_pda.nci.mean() - first.imm_pda.nci.mean()
            - max(b.nci.mean() - a.nci.mean() for a, b in zip(first[:2], second[:2], strict=True))
        ),
    ),
)  # fmt: skip
