"""The files a command leaves behind."""

import csv
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gmr_gym.evaluation.metrics import lost_at
from gmr_gym.evaluation.mixture_problems import MixtureProblem
from gmr_gym.evaluation.montecarlo import Runs
from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns
from gmr_gym.evaluation.multi_target_summary import TRACK_FIGURES, compared, track_figures
from gmr_gym.evaluation.reduction_runs import ReductionRuns
from gmr_gym.evaluation.summary import errors
from gmr_gym.evaluation.writing import whole
from gmr_gym.experiments.formats import rows_of
from gmr_gym.experiments.records import text_of
from gmr_gym.simulation.multi_target import MultiTargetScenario
from gmr_gym.simulation.single_target import Scenario

RUN_COLUMNS = (
    "tracker", "run", "lost_at_scan", "rmse_m", "error_m", "velocity_rmse_mps", "components", "gate_area_m2",
)  # fmt: skip
# means over scans
MULTI_TARGET_FIELDS = (
    "ospa", "gospa", "localisation", "missed", "false", "wasserstein", "targets", "named", "expected",
    "components",
)  # fmt: skip
MULTI_TARGET_COLUMNS = ("tracker", "run", *MULTI_TARGET_FIELDS, "wasserstein_undefined", *TRACK_FIGURES)
REDUCTION_FIELDS = [field for field in ReductionRuns._fields if field != "seconds"]
REDUCTION_COLUMNS = ("reduction", "run", *REDUCTION_FIELDS)


def write_runs(file: Path, scenario: Any, results: dict[str, Any]) -> None:
    """One row per tracker and run, of one target or of many, or per reduction and mixture; nothing in it
    depends on the clock."""
    header, *rows = run_rows(scenario, results)
    write_rows(file, header, rows)


def run_rows(scenario: Any, results: dict[str, Any]) -> Iterator[Sequence]:
    """A header, and one row per tracker and run."""
    columns, figures = _columns_and_figures(scenario)
    yield columns
    for tracker, runs in results.items():
        for i, row in enumerate(zip(*figures(scenario, runs), strict=True)):
            yield [tracker, i, *row]


def _columns_and_figures(scenario: Any) -> tuple[Sequence[str], Callable[..., list[list]]]:
    if isinstance(scenario, MixtureProblem):
        return REDUCTION_COLUMNS, _reduction_run_figures
    if isinstance(scenario, MultiTargetScenario):
        return MULTI_TARGET_COLUMNS, _multi_target_run_figures
    return RUN_COLUMNS, _run_figures


def _run_figures(scenario: Scenario, runs: Runs) -> list[list]:
    position, velocity = errors(scenario, runs)
    lost = lost_at(runs.off_target, scenario.patience) + 1
    figures = [
        np.sqrt((position**2).mean(axis=1)), position.mean(axis=1), np.sqrt((velocity**2).mean(axis=1)),
        runs.components.mean(axis=1), runs.gate_volume.mean(axis=1),
    ]  # fmt: skip
    return [[scan or "" for scan in lost], *(figure.tolist() for figure in figures)]


def _multi_target_run_figures(scenario: MultiTargetScenario, runs: MultiTargetRuns) -> list[list]:
    """Means over scans, of the Wasserstein distance over those at which it is defined."""
    undefined = np.isnan(runs.wasserstein).mean(axis=1)
    means = runs._replace(wasserstein=compared(runs.wasserstein)[:, None])
    return [
        *(getattr(means, field).mean(axis=1).tolist() for field in MULTI_TARGET_FIELDS),
        undefined.tolist(),
        *(figure.tolist() for figure in track_figures(scenario, runs).values()),
    ]


def _reduction_run_figures(problem: MixtureProblem, runs: ReductionRuns) -> list[list]:
    return [getattr(runs, field)[:, 0].tolist() for field in REDUCTION_FIELDS]


def write_rows(file: Path, header: Sequence[str], rows: Iterable[Sequence]) -> None:
    """A CSV file; floats keep all their digits."""
    with whole(file) as partial, partial.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(header)
        writer.writerows(rows)


def write_json(file: Path, record: dict[str, Any]) -> None:
    """Plain data as JSON."""
    write_text(file, text_of(record))


def write_text(file: Path, text: str) -> None:
    """Text as UTF-8."""
    with whole(file) as partial:
        partial.write_text(text, encoding="utf-8")


def write_csv(file: Path, record: dict[str, Any]) -> None:
    """A record, one figure a line."""
    header, *rows = rows_of(record)
    write_rows(file, header, rows)
