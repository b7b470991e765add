"""Trackers over a grid of settings of an environment: what is asked, the runs of every cell, and their
figures."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

from gmr_gym.envs.lookup import scenario_of, tracker_of
from gmr_gym.experiments.evaluating import figures_of, judged
from gmr_gym.experiments.figures import cell_name, heading, legend
from gmr_gym.experiments.output import run_rows, write_csv, write_json, write_rows
from gmr_gym.experiments.records import answered
from gmr_gym.experiments.sheets import Sheet, figure_of, notes, shown
from gmr_gym.experiments.specs import complete
from gmr_gym.experiments.sweeps import Sweep, Work, runs_shown
from gmr_gym.literals import key_value

MOST = 1000  # settings of a grid that is run without being asked about
WIDEST = 8  # panels beside one another


class Grid(NamedTuple):
    """Settings of an environment, those with one value and those with several."""

    settings: dict[str, Any]
    axes: dict[str, list[Any]]

    def cells(self) -> dict[str, dict[str, Any]]:
        """What the settings with several values are in each cell, by the cell's name."""
        named = [dict(zip(self.axes, values, strict=True)) for values in product(*self.axes.values())]
        return {cell_name(cell): cell for cell in named}


def grid_of(texts: Iterable[str], any_size: bool) -> Grid:
    """The grid of settings key=value,value, in the order of their names, numbers by size. Commas in brackets
    are of a value. Raises ValueError for one that is empty or given twice, and without a key of several."""
    found: dict[str, list[Any]] = {}
    for text in texts:
        key, values = _values(text)
        if key in found:
            raise ValueError(f"{key} is given twice; several values of it have commas between")
        found[key] = values
    found = dict(sorted(found.items()))
    grid = Grid(
        {key: values[0] for key, values in found.items() if len(values) == 1},
        {key: values for key, values in found.items() if len(values) > 1},
    )
    if not grid.axes:
        raise ValueError("no setting has several values, as in --set clutter_rate=50,100,200")
    cells = prod(map(len, grid.axes.values()))
    if cells > MOST and not any_size:
        raise ValueError(f"the grid has {cells} settings, more than {MOST}; say --yes to run it")
    return grid


def check_drawable(grid: Grid) -> None:
    """ValueError for a grid whose panels would be too many to stand beside one another."""
    panels = len(grid.cells()) // max(map(len, grid.axes.values()))
    if panels > WIDEST:
        raise ValueError(f"--plot has room for {WIDEST} panels beside one another, and the grid has {panels}")


def _values(text: str) -> tuple[str, list[Any]]:
    key, sign, listed = text.partition("=")
    if not sign or not key:
        raise ValueError(f"expected key=value or key=value,value, got {text!r}")
    values: list[Any] = []
    for part in _parts(listed):
        if not part.strip():
            raise ValueError(f"{key} has an empty value; expected {key}=value,value, got {text!r}")
        _, value = key_value(f"{key}={part.strip()}")
        if value in values:
            raise ValueError(f"{key} has the value {part.strip()} twice")
        values.append(value)
    numbers = all(isinstance(value, int | float) for value in values)
    return key, sorted(values) if numbers else values


def _parts(text: str) -> list[str]:
    """What stands between commas that are in no brackets."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter in "([{") - (letter in ")]}")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return parts


def work_of(env_id: str, grid: Grid, trackers: Sequence[str]) -> list[Work]:
    """The scenario of every cell, with the trackers."""
    scenarios = [scenario_of(env_id, grid.settings | cell) for cell in grid.cells().values()]
    return [(scenario, {spec: tracker_of(spec, scenario) for spec in trackers}) for scenario in scenarios]


def size(grid: Grid, trackers: Sequence[str], runs: int) -> str:
    """How much a grid is to run, before it does."""
    cells = len(grid.cells())
    parts = (f"{count} {noun}{'s' * (count > 1)}" for count, noun in (
        (cells, "setting"), (len(trackers), "tracker"), (runs, "run"),
    ))  # fmt: skip
    return f"{' x '.join(parts)}: {cells * len(trackers) * runs} in all"


def swept(
    asked: dict[str, Any],
    grid: Grid,
    work: Sequence[Work],
    sweep: Sweep,
    out: Path,
    copy: Path | None,
    metrics: Sequence[str],
    draw: bool,
) -> Iterator[Any]:
    """Runs every cell, leaves record, figures and runs in `out`, with `draw` curves too, and then gives what
    a screen shows: a table for each of the metrics, or of the usual ones."""
    scenario, trackers = work[0]
    metrics = metrics or figures_of(scenario).swept
    tables, remarks, runs = _judged_by_cell(asked["env"], grid, work, sweep)
    parameters = {spec: complete(spec, scenario) for spec in trackers}
    record = answered(asked, tables, notes=remarks, command=sweep.command, parameters=parameters)
    write_rows(out / "sweep-runs.csv", *runs)
    write_csv(out / "sweep.csv", record)
    for file in filter(None, (out / "sweep.json", copy)):
        write_json(file, record)
    if draw:
        from gmr_gym.experiments.drawings import over_settings, save

        for ending in ("png", "svg"):
            save(over_settings(by_cell(record), grid.axes, metrics), out / f"sweep.{ending}")
    for metric in metrics:
        yield across(record, grid, metric)
    yield from legend(metrics)
    yield from remarks
    yield f"these and all other figures, and the runs, are in {out}"


def _judged_by_cell(
    label: str, grid: Grid, work: Sequence[Work], sweep: Sweep
) -> tuple[list[dict[str, Any]], list[str], tuple[list[str], list[list[Any]]]]:
    """Runs every cell: the records of all tables, the remarks, and a header and the rows of all runs. The
    results of a cell are gone when the next begins."""
    tables: list[dict[str, Any]] = []
    remarks: list[str] = []
    rows: list[list[Any]] = []
    header: list[str] = []
    few = notes({}, sweep.runs)
    every = runs_shown(label, work, sweep)
    for (name, cell), (scenario, _), results in zip(grid.cells().items(), work, every, strict=True):
        names = name, f"{name}, paired differences"
        found, said = judged(names, grid.settings | cell, scenario, results)
        tables += found
        remarks += [f"{name}: {line}" for line in said if line not in few]
        columns, *own = run_rows(scenario, results)
        header = [*cell, *columns]
        rows += [[*cell.values(), *row] for row in own]
    return tables, remarks + few, (header, rows)


def by_cell(record: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    """The metrics of every tracker, by the names of cells and trackers."""
    return {
        table["name"]: {row["tracker"]: row["metrics"] for row in table["rows"]} for table in record["tables"]
    }


def across(record: Mapping[str, Any], grid: Grid, metric: str) -> Sheet:
    """A table of one metric: a row for each cell, a column for each tracker."""
    found, axes = by_cell(record), [*grid.axes]
    cells = grid.cells()
    trackers = [*found[next(iter(cells))]]
    rows = [
        [
            str(cell[axes[0]]) if len(axes) == 1 else name,
            *(shown(metric, figure_of(found[name][tracker][metric])) for tracker in trackers),
        ]
        for name, cell in cells.items()
    ]
    return Sheet(heading(metric), [axes[0] if len(axes) == 1 else "", *trackers], rows)
