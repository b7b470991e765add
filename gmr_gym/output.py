"""Tables on a screen, progress on long work, and the files a command leaves behind."""

import csv
import json
import sys
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table as Grid

from gmr_gym.metrics import lost_at
from gmr_gym.montecarlo import Runs
from gmr_gym.simulate import Scenario
from gmr_gym.summary import Figure, errors

HEADINGS = {
    "track_loss": "lost, %", "rmse_own": "RMSE own, m", "rmse_common": "RMSE common, m",
    "error_own": "error own, m", "error_common": "error common, m",
    "velocity_rmse_own": "velocity RMSE, m/s", "anees_own": "ANEES", "nci_own": "NCI, dB",
    "inclination_own": "inclination, dB", "components": "components",
    "gate_area": "gate area, m²", "time_per_scan": "time a scan, ms",
}  # fmt: skip
LEFT_TO_FILES = {"rmse_common", "error_own", "inclination_own"}  # a screen is only so wide
SCALE = {"track_loss": 100, "time_per_scan": 1e3}


RUN_COLUMNS = (
    "tracker", "run", "lost_at_scan", "rmse_m", "error_m", "velocity_rmse_mps", "components", "gate_area_m2",
)  # fmt: skip


def grid(title: str, rows: dict[str, dict[str, Figure]]) -> Grid:
    """A table of the main figures with their intervals, one row per tracker."""
    metrics = [metric for metric in next(iter(rows.values())) if metric not in LEFT_TO_FILES]
    table = _empty_grid(title, metrics)
    for tracker, figures in rows.items():
        table.add_row(tracker, *(_shown(metric, figures[metric]) for metric in metrics))
    return table


def comparison(title: str, record: dict[str, Any]) -> Grid:
    """A table of `table_record`: our figure, and under it the printed one with its verdict."""
    metrics = ["track_loss", "components", "rmse_own", "error_common", "time_per_scan", "gate_area"]
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


def _empty_grid(title: str, metrics: list[str]) -> Grid:
    terminal = Console().is_terminal
    style = box.SIMPLE_HEAD if terminal else box.ASCII2
    table = Grid(title=title, title_justify="left", show_lines=terminal, box=style)
    for heading in ["tracker", *(HEADINGS[metric] for metric in metrics)]:
        table.add_column(heading)
    return table


def _shown(metric: str, figure: Figure) -> str:
    scaled = (SCALE.get(metric, 1) * number for number in figure)
    value, low, high = (f"{number:.3g}" if abs(number) < 1000 else f"{number:.0f}" for number in scaled)
    return value if np.isnan(figure.low) else f"{value} [{low}, {high}]"


def write_runs(file: Path, scenario: Scenario, results: dict[str, Runs]) -> None:
    """One row per tracker and run; nothing in it depends on the clock."""
    with file.open("w", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(RUN_COLUMNS)
        for tracker, runs in results.items():
            position, velocity = errors(scenario, runs)
            lost = lost_at(runs.off_target, scenario.patience) + 1
            figures = np.stack([
                np.sqrt((position**2).mean(axis=1)), position.mean(axis=1),
                np.sqrt((velocity**2).mean(axis=1)),
                runs.components.mean(axis=1), runs.gate_volume.mean(axis=1),
            ], axis=1)  # fmt: skip
            for i, row in enumerate(figures.tolist()):
                writer.writerow([tracker, i, lost[i] or "", *map(repr, row)])


def write_json(file: Path, record: dict[str, Any]) -> None:
    """Plain data as JSON."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(record, indent=1) + "\n")


def write_csv(file: Path, record: dict[str, Any]) -> None:
    """A paper's record, one figure a line."""
    with file.open("w", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(["table", "tracker", "metric", "value", "low", "high", "paper", "verdict"])
        for table in record["tables"]:
            for row in table["rows"]:
                for metric, cell in row["metrics"].items():
                    keys = ("value", "low", "high", "paper", "verdict")
                    writer.writerow([table["name"], row["tracker"], metric, *(cell.get(key) for key in keys)])


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
