"""Published tables, run again: the paper's figures beside ours, with a verdict on each; and what a paper
says of its curves, as numbers.

A paper's module holds TABLES; `figures(table, scenario, results, rows, out)` for its plots; where a table
keeps evidence, `claims(evidence by table)`; and, for grids of settings, MAPS and `map_figures(map, rows,
out)`.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtri

from gmr_gym.evaluation.summary import CONFIDENCE, FEWEST, Estimate, summary, wilson

TOO_FEW = "too few runs"
COLUMNS = ("track_loss", "components", "rmse_own", "error_common", "time_per_scan", "gate_area")


@dataclass(frozen=True)
class Table:
    """One published table: where it was run, what was run, and what was printed."""

    name: str
    title: str
    env_id: str
    settings: dict[str, Any]  # of the environment
    trackers: dict[str, dict[str, Any]]  # name -> parameters
    published: dict[str, dict[str, float]] = field(default_factory=dict)  # tracker -> metric -> figure
    runs: int = 1000  # behind the published figures
    summarise: Callable = summary  # (scenario, results) -> rows of figures
    columns: tuple[str, ...] = COLUMNS  # the metrics shown on a screen
    evidence: Callable | None = None  # (scenario, results) -> what the paper's claims need of them
    paired: Callable | None = None  # (scenario, results) -> rows of differences from the first tracker


@dataclass(frozen=True)
class SettingsGrid:
    """The same trackers over a grid of settings, a cell of it as a table is, with fewer runs."""

    name: str
    title: str
    env_id: str
    settings: dict[str, Any]  # of the environment, everywhere
    axes: dict[str, tuple[float, ...]]  # setting -> what it takes on
    trackers: dict[str, dict[str, Any]]
    share: int  # a cell has one in so many of the runs asked for
    summarise: Callable  # (scenario, results) -> a row of figures, one row a cell
    columns: tuple[str, ...]

    def cells(self) -> dict[str, dict[str, Any]]:
        """What the settings of each cell are, by the cell's name."""
        named = [dict(zip(self.axes, values, strict=True)) for values in product(*self.axes.values())]
        return {", ".join(f"{k}={v:g}" for k, v in cell.items()): self.settings | cell for cell in named}


class Claim(NamedTuple):
    """A sentence of a paper as a number: it holds where the number lies above the threshold."""

    sentence: str
    measure: str
    threshold: float
    value: Callable[..., Any]  # of the evidence: the number, or what it is the mean of, run by run


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
    numbers = {key: _number(value) for key, value in figure._asdict().items()}
    return record | numbers | {"threshold": claim.threshold, "verdict": verdict}


def no_event_width(figures: Iterable[Estimate], runs: int) -> list[Estimate]:
    """Where no resample of the runs differs, rounding apart, a bootstrap claims certainty: the interval is
    then as wide as that of no event in as many runs, for numbers that are shares."""
    most = wilson(0, runs).high
    return [
        Estimate(f.value, f.value - most, f.value + most) if f.high - f.low < 1e-9 else f for f in figures
    ]


def verdict(figure: Estimate, runs: int, printed: float, printed_runs: int, share: bool) -> str:
    """ "agrees" when ours and the printed figure differ by no more than chance allows 99 times in a
    hundred, else "above" or "below"; TOO_FEW where either's runs are too few to judge. The printed
    figure is given the relative sampling error ours would have with as many runs; `share` marks a proportion,
    whose error is known from the figure itself."""
    if share:  # pooled: with no event in few runs our own figure knows no error
        pooled = (runs * figure.value + printed_runs * printed) / (runs + printed_runs)
        deviation = np.sqrt(pooled * (1 - pooled) * (1 / runs + 1 / printed_runs))
    else:
        own = (figure.high - figure.low) / 2 / ndtri((1 + CONFIDENCE) / 2)
        deviation = own * np.hypot(1, printed / figure.value * np.sqrt(runs / printed_runs))
    if not np.isfinite(deviation):
        return "unknown"
    if min(runs, printed_runs) < FEWEST:
        return TOO_FEW
    if abs(figure.value - printed) <= ndtri(0.995) * deviation:
        return "agrees"
    return "above" if figure.value > printed else "below"


def table_record(
    name: str,
    settings: Mapping[str, Any],
    rows: Mapping[str, Mapping[str, Estimate]],
    table: Table | None = None,
    runs: int = 0,
) -> dict[str, Any]:
    """A table as plain data for JSON; with the published Table, its figures and verdicts."""
    records = []
    for tracker, figures in rows.items():
        metrics = {}
        for metric, figure in figures.items():
            cell: dict[str, Any] = {key: _number(value) for key, value in figure._asdict().items()}
            printed = table.published.get(tracker, {}).get(metric) if table else None
            if table and printed is not None:
                cell["paper"] = printed
                if metric != "time_per_scan":  # another machine's clock
                    cell["verdict"] = verdict(figure, runs, printed, table.runs, share=metric == "track_loss")
            metrics[metric] = cell
        records.append({"tracker": tracker, "metrics": metrics})
    return {"name": name, "settings": dict(settings), "rows": records}


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
