"""Papers as data, and published tables run again: the paper's figures beside ours, with a verdict on each."""

from collections.abc import Callable, Collection, Iterable, Mapping
from csv import DictReader
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from scipy.special import ndtri

from gmr_gym.envs.lookup import scenario_of, tracker_of
from gmr_gym.evaluation.mixture_problems import MixtureProblem
from gmr_gym.evaluation.summary import CONFIDENCE, FEWEST, Estimate, summary
from gmr_gym.experiments.claims import TOO_FEW, Asked, ByTracker, claim_records, plain
from gmr_gym.experiments.evidence import Evidence, Quantities, all_measured
from gmr_gym.experiments.sweeps import Work
from gmr_gym.reduction.registry import reducer

CLOCKS = ("time_per_scan", "time_per_reduction")  # another machine's is no better or worse
COLUMNS = ("track_loss", "components", "rmse_own", "error_common", "time_per_scan", "gate_area")


@dataclass(frozen=True)
class Table:
    """One published table: where it was run, what was run, and what was printed."""

    of: ClassVar[str] = "tracker"  # what its rows are
    name: str
    title: str
    env_id: str = ""
    settings: dict[str, Any] = field(default_factory=dict)  # of the environment
    trackers: dict[str, dict[str, Any]] = field(default_factory=dict)  # name -> parameters
    published: dict[str, dict[str, float]] = field(default_factory=dict)  # tracker -> metric -> figure
    runs: int = 1000  # behind the published figures
    summarise: Callable = summary  # (scenario, results) -> rows of figures
    columns: tuple[str, ...] = COLUMNS  # the metrics shown on a screen
    roles: tuple[str, ...] | None = None  # what claims call the first trackers, unless by their names
    paired: Callable | None = None  # (scenario, results) -> rows of differences from the first tracker

    def work(self) -> list[Work]:
        """The scenario and its trackers."""
        return [_work(self.env_id, self.settings, self.trackers)]

    @property
    def exact(self) -> bool:
        """Whether its figures are the same in every run, so that it has one."""
        return False

    def runs_of(self, asked: int) -> int:
        """How many runs it has when so many are asked for."""
        return 1 if self.exact else asked

    def with_rows(self, specs: Collection[str]) -> Self:
        """The same with a row more for each tracker; ValueError for one that is there."""
        for spec in specs:
            if spec in self.trackers:
                raise ValueError(f"tracker {spec!r} has its row in table {self.name} already")
        return replace(self, trackers=self.trackers | plainly(specs))


@dataclass(frozen=True)
class MixtureTable(Table):
    """One published table of reductions, which stand in the place of trackers: a run is a mixture, reduced by
    each. Trackers that are asked for beside have no rows in it."""

    of: ClassVar[str] = "reduction"
    problem: MixtureProblem = field(default_factory=MixtureProblem)
    components: int = 1  # that remain

    def work(self) -> list[Work]:
        """The mixtures and the reductions."""
        told = self.trackers.items()
        return [(self.problem, {spec: reducer(spec, self.components, **given) for spec, given in told})]

    @property
    def exact(self) -> bool:
        """Whether the mixture is always the same."""
        return self.problem.mixture is not None

    def with_rows(self, specs: Collection[str]) -> Self:
        """The table itself."""
        return self


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

    def work(self) -> list[Work]:
        """The scenarios of the cells, each with the trackers."""
        return [_work(self.env_id, settings, self.trackers) for settings in self.cells().values()]

    def runs_of(self, asked: int) -> int:
        """The runs of a cell when so many are asked for."""
        return max(2, asked // self.share)

    def with_rows(self, specs: Collection[str]) -> Self:
        """The grid itself."""
        return self


def _work(env_id: str, settings: Mapping[str, Any], trackers: Mapping[str, Mapping[str, Any]]) -> Work:
    scenario = scenario_of(env_id, settings)
    return scenario, {spec: tracker_of(spec, scenario, **told) for spec, told in trackers.items()}


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
                if metric not in CLOCKS:
                    cell["verdict"] = verdict(figure, runs, printed, table.runs, share=metric == "track_loss")
            metrics[metric] = cell
        records.append({"tracker": tracker, "metrics": metrics})
    return {"name": name, "settings": dict(settings), "rows": records}
