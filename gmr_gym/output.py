"""Tables on a screen, progress on long work, and the files a command leaves behind."""

import csv
import json
import sys
from collections.abc import Iterable, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table as Grid

from gmr_gym.crowd import ManyScenario
from gmr_gym.crowd_runs import CrowdRuns
from gmr_gym.crowd_summary import compared
from gmr_gym.metrics import lost_at
from gmr_gym.montecarlo import Runs
from gmr_gym.simulate import Scenario
from gmr_gym.summary import Figure, errors
from gmr_gym.writing import whole

HEADINGS = {
    "track_loss": "lost, %", "rmse_own": "RMSE own, m", "rmse_common": "RMSE common, m",
    "error_capped": "capped error, m", "error_own": "error own, m", "error_common": "error common, m",
    "velocity_rmse_own": "velocity RMSE, m/s", "anees_own": "ANEES", "nci_own": "NCI, dB",
    "inclination_own": "inclination, dB", "components": "components",
    "gate_area": "gate area, m² (volume, m³)",
    "time_per_scan": "time a scan, ms", "time_worst": "longest, ms",
    "rmse_all": "RMSE all, m", "velocity_rmse_all": "velocity RMSE all, m/s",
    "velocity_rmse_common": "velocity RMSE common, m/s",
    "level_rmse_own": "level RMSE own, m", "level_rmse_common": "level RMSE common, m",
    "level_velocity_rmse_own": "level velocity RMSE own, m/s",
    "level_velocity_rmse_common": "level velocity RMSE common, m/s", "nci_all": "NCI all, dB",
    "nci_common": "NCI common, dB", "inclination_all": "inclination all, dB",
    "inclination_common": "inclination common, dB",
    **{f"{axis}_rmse_{over}": f"{axis} RMSE {over}, m" for axis in "xyz" for over in ("own", "common")},
    "sight_bias_own": "bias along the line of sight, m", "position_anees_own": "ANEES of position",
    "gate_volume": "gate volume, m³",
    "ospa": "OSPA, m", "gospa": "GOSPA, m", "localisation": "localisation, m²", "missed": "missed, m²",
    "false": "false, m²", "cardinality_bias": "named less there", "cardinality_error": "number wrong by",
    "wasserstein": "Wasserstein, m", "wasserstein_printed": "Wasserstein by eq. 41, m",
    "wasserstein_undefined": "without one, %", "density_error": "clutter wrong by",
}  # fmt: skip
LEFT_TO_FILES = {"rmse_common", "error_own", "inclination_own"}  # a screen is only so wide
SCALE = {"track_loss": 100, "wasserstein_undefined": 100, "time_per_scan": 1e3, "time_worst": 1e3}


RUN_COLUMNS = (
    "tracker", "run", "lost_at_scan", "rmse_m", "error_m", "velocity_rmse_mps", "components", "gate_area_m2",
)  # fmt: skip
# means over scans
CROWD_FIELDS = [field for field in CrowdRuns._fields if field not in ("seconds", "density_error")]
CROWD_COLUMNS = ("tracker", "run", *CROWD_FIELDS, "wasserstein_undefined")


def grid(title: str, rows: dict[str, dict[str, Figure]]) -> Grid:
    """A table of the main figures with their intervals, one row per tracker."""
    metrics = [metric for metric in next(iter(rows.values())) if metric not in LEFT_TO_FILES]
    table = _empty_grid(title, metrics)
    for tracker, figures in rows.items():
        table.add_row(tracker, *(_shown(metric, figures[metric]) for metric in metrics))
    return table


def comparison(title: str, record: dict[str, Any], metrics: Sequence[str]) -> Grid:
    """A table of `table_record`: our figure, and under it the printed one with its verdict."""
    table = _empty_grid(title, metrics)
    for row in record["rows"]:
        cells = []
        for metric in metrics:
            cell = row["metrics"][metric]
            figure = Figure(*(np.nan if cell[key] is None else cell[key] for key in Figure._fields))
            text = _shown(metric, figure)
            if "paper" in cell:
                text += f"\npaper {cell['paper'] * SCALE.get(metric, 1):.4g} {cell.get('verdict', '')}"
            cells.append(text)
        table.add_row(row["tracker"], *cells)
    return table


def claims_grid(records: list[dict[str, Any]]) -> Grid:
    """What a paper says, by table and set of runs: the number, its interval and the verdict."""
    table = _titled_grid(
        "what the paper says", ["table", "runs", "claim", "measure", "value", "holds above", "verdict"]
    )
    for record in records:
        figure = Figure(*(np.nan if record[key] is None else record[key] for key in Figure._fields))
        table.add_row(
            record["table"], record["runs"], record["claim"], record["measure"],
            _shown("", figure), f"{record['threshold']:g}", record["verdict"],
        )  # fmt: skip
    return table


def _empty_grid(title: str, metrics: Sequence[str]) -> Grid:
    return _titled_grid(title, ["", *(HEADINGS.get(metric, metric) for metric in metrics)])


def _titled_grid(title: str, headings: list[str]) -> Grid:
    terminal = Console().is_terminal
    style = box.SIMPLE_HEAD if terminal else box.ASCII2
    table = Grid(title=title, title_justify="left", show_lines=terminal, box=style)
    for heading in headings:
        table.add_column(heading)
    return table


def _shown(metric: str, figure: Figure) -> str:
    scaled = (SCALE.get(metric, 1) * number for number in figure)
    value, low, high = (f"{number:.3g}" if abs(number) < 1000 else f"{number:.0f}" for number in scaled)
    return value if np.isnan(figure.low) else f"{value} [{low}, {high}]"


def write_runs(file: Path, scenario: Any, results: dict[str, Any]) -> None:
    """One row per tracker and run, of one target or of many; nothing in it depends on the clock."""
    many = isinstance(scenario, ManyScenario)
    columns, figures = (CROWD_COLUMNS, _crowd_run_figures) if many else (RUN_COLUMNS, _run_figures)
    rows = [
        [tracker, i, *row]
        for tracker, runs in results.items()
        for i, row in enumerate(zip(*figures(scenario, runs), strict=True))
    ]
    write_rows(file, columns, rows)


def _run_figures(scenario: Scenario, runs: Runs) -> list[list]:
    position, velocity = errors(scenario, runs)
    lost = lost_at(runs.off_target, scenario.patience) + 1
    figures = [
        np.sqrt((position**2).mean(axis=1)), position.mean(axis=1), np.sqrt((velocity**2).mean(axis=1)),
        runs.components.mean(axis=1), runs.gate_volume.mean(axis=1),
    ]  # fmt: skip
    return [[scan or "" for scan in lost], *(figure.tolist() for figure in figures)]


def _crowd_run_figures(scenario: ManyScenario, runs: CrowdRuns) -> list[list]:
    """Means over scans, of the Wasserstein distance over those at which it is defined."""
    undefined = np.isnan(runs.wasserstein).mean(axis=1)
    means = runs._replace(wasserstein=compared(runs.wasserstein)[:, None])
    return [*(getattr(means, field).mean(axis=1).tolist() for field in CROWD_FIELDS), undefined.tolist()]


def write_rows(file: Path, header: Sequence[str], rows: Iterable[Sequence]) -> None:
    """A CSV file; floats keep all their digits."""
    with whole(file) as partial, partial.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def write_json(file: Path, record: dict[str, Any]) -> None:
    """Plain data as JSON."""
    with whole(file) as partial:
        partial.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


def write_csv(file: Path, record: dict[str, Any]) -> None:
    """A paper's record, one figure a line."""
    keys = ("value", "low", "high", "paper", "verdict")
    rows = [
        [table["name"], row["tracker"], metric, *(cell.get(key) for key in keys)]
        for table in record["tables"]
        for row in table["rows"]
        for metric, cell in row["metrics"].items()
    ]
    write_rows(file, ("table", "tracker", "metric", *keys), rows)


def console() -> Console:
    """Wide and plain where the output is no terminal."""
    screen = Console()
    return screen if screen.is_terminal else Console(width=240)


@contextmanager
def progress(label: str):
    """A progress(done, total) callback: a bar on a terminal, a line every tenth elsewhere."""
    console = Console(stderr=True)
    if not console.is_terminal:
        said = -1

        def tell(done: int, total: int) -> None:
            nonlocal said
            if done * 10 // total > said:
                said = done * 10 // total
                print(f"{label}: {done} of {total}", file=sys.stderr, flush=True)

        yield tell
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(label, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)
