"""Papers as data, and published tables run again: the paper's figures beside ours, with a verdict on each."""

from collections.abc import Callable, Iterable, Mapping
from csv import DictReader
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import ndtri

from gmr_gym.evaluation.summary import CONFIDENCE, FEWEST, Estimate, summary
from gmr_gym.experiments.claims import TOO_FEW, Asked, ByTracker, claim_records, plain
from gmr_gym.experiments.evidence import Evidence, Quantities, all_measured

COLUMNS = ("track_loss", "components", "rmse_own", "error_common", "time_per_scan", "gate_area")


@dataclass(frozen=True)
class Table:
    """One published table: where it was run, what was run, and what was printed."""

    name: str
    title: str
    env_id: str
    settings: dict[str, Any] = field(default_factory=dict)  # of the environment
    trackers: dict[str, dict[str, Any]] = field(default_factory=dict)  # name -> parameters
    published: dict[str, dict[str, float]] = field(default_factory=dict)  # tracker -> metric -> figure
    runs: int = 1000  # behind the published figures
    summarise: Callable = summary  # (scenario, results) -> rows of figures
    columns: tuple[str, ...] = COLUMNS  # the metrics shown on a screen
    roles: tuple[str, ...] | None = None  # what claims call the first trackers, unless by their names
    paired: Callable | None = None  # (scenario, results) -> rows of differences from the first tracker


def plainly(trackers: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Trackers of a table that are what their names say, without further parameters."""
    return {name: {} for name in trackers}


def printed_in(paper: str) -> dict[str, dict[str, dict[str, float]]]:
    """The figures a paper prints, by table, row and metric: `papers/PAPER.csv`, a line for each row; an empty
    field is a figure that it does not print."""
    tables: dict[str, dict[str, dict[str, float]]] = {}
    with (Path(__file__).parent / "papers" / f"{paper}.csv").open(newline="", encoding="utf-8") as stream:
        for line in DictReader(stream):
            row = tables.setdefault(line.pop("table"), {}).setdefault(line.pop("row"), {})
            row.update((metric, float(figure)) for metric, figure in line.items() if figure)
    return tables


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


@dataclass(frozen=True)
class Paper:
    """A paper as data; its figures are code. Its name and its sentence are in `papers/registry.py`.

    Parameters
    ----------
    tables : tuple of Table
    figures : Callable
        `figures(table, scenario, results, rows, out)` leaves a table's plots in the folder `out`.
    quantities : mapping of str to Callable
        What the claims need of a tracker's runs: `quantity(scenario, runs)` `(runs, ...)`, by name.
    claims : tuple of Asked
    maps : tuple of SettingsGrid
    map_figures : Callable, optional
        `map_figures(grid, rows, out)` draws a grid.
    """

    tables: tuple[Table, ...]
    figures: Callable
    quantities: Quantities = field(default_factory=dict)
    claims: tuple[Asked, ...] = ()
    maps: tuple[SettingsGrid, ...] = ()
    map_figures: Callable | None = None

    def entries(self) -> dict[str, Table | SettingsGrid]:
        """Tables and grids by name."""
        every: tuple[Table | SettingsGrid, ...] = (*self.tables, *self.maps)
        return {entry.name: entry for entry in every}

    def evidence(self, table: Table, scenario: Any, results: Mapping[str, Any]) -> dict[str, Evidence] | None:
        """What the claims need of a table's results; None where none is about the table."""
        if not any(table.name in asked.tables for asked in self.claims):
            return None
        return all_measured(self.quantities, scenario, results, table.roles)

    def claim_records(self, evidence: Mapping[str, ByTracker]) -> list[dict[str, Any]]:
        """Its claims, judged by the evidence of the tables at hand, as plain data."""
        return claim_records(self.claims, evidence)


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
            cell: dict[str, Any] = plain(figure)
            printed = table.published.get(tracker, {}).get(metric) if table else None
            if table and printed is not None:
                cell["paper"] = printed
                if metric != "time_per_scan":  # another machine's clock
                    cell["verdict"] = verdict(figure, runs, printed, table.runs, share=metric == "track_loss")
            metrics[metric] = cell
        records.append({"tracker": tracker, "metrics": metrics})
    return {"name": name, "settings": dict(settings), "rows": records}
