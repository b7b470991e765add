"""What the commands share: scenarios and trackers by what a user types, and runs under a progress bar."""

import errno
import os
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from gmr_gym.envs.lookup import scenario_of
from gmr_gym.envs.registry import TRACKING
from gmr_gym.evaluation.blocks import check_folder
from gmr_gym.evaluation.multi_target_summary import multi_target_differences, multi_target_summary
from gmr_gym.evaluation.summary import differences, summary
from gmr_gym.experiments.output import write_json, write_runs
from gmr_gym.experiments.records import answered
from gmr_gym.experiments.sheets import figures_table, legend, notes, on_screen
from gmr_gym.experiments.sweeps import Sweep, runs_shown
from gmr_gym.experiments.tables import table_record
from gmr_gym.simulation.multi_target import MultiTargetScenario
from gmr_gym.simulation.single_target import Scenario


def check_once(option: str, values: Sequence[str]) -> None:
    """ValueError for a value that a repeatable option is given twice; NAME: is NAME."""
    for i, value in enumerate(values):
        if value.removesuffix(":") in (other.removesuffix(":") for other in values[:i]):
            raise ValueError(f"{option} {value} is given twice")


def numbers(name: str, text: str) -> list[float]:
    """Numbers with commas between; ValueError naming the option."""
    try:
        return [float(number) for number in text.split(",")]
    except ValueError:
        raise ValueError(f"{name} must be numbers with commas between, got {text!r}") from None


def pixels(name: str, text: str) -> tuple[int, int]:
    """Width and height from WIDTH or WIDTHxHEIGHT, the height 0 where it is not given; ValueError naming the
    option."""
    width, x, height = text.lower().partition("x")
    if not width.isdecimal() or (x and not (height.isdecimal() and int(height))):
        raise ValueError(f"{name} must be WIDTH or WIDTHxHEIGHT in pixels, as 640 or 640x480, got {text!r}")
    return int(width), int(height or 0)


def check_ending(option: str, file: Path | None, *endings: str) -> None:
    """ValueError naming the option if a file to be written says by its ending that it is of another kind."""
    if file is not None and file.suffix.lower() not in endings:
        raise ValueError(f"{option} must end in {' or '.join(endings)}, got {file.name!r}")


def single_target(env_id: str, world: Mapping[str, Any]) -> Scenario:
    """As `scenario_of`, of one target; ValueError where there are many."""
    scenario = scenario_of(env_id, world)
    if isinstance(scenario, MultiTargetScenario):
        raise ValueError(f"{env_id} has many targets; choose from {', '.join(TRACKING)}")
    return scenario


def evaluated(
    asked: dict[str, Any],
    scenario: Scenario | MultiTargetScenario,
    trackers: Mapping[str, Any],
    sweep: Sweep,
    out: Path,
    copy: Path | None,
) -> Iterator[Any]:
    """Runs trackers in a scenario, leaves record and runs in `out`, and then gives what a screen shows."""
    (results,) = runs_shown(asked["env"], [(scenario, trackers)], sweep)
    if isinstance(scenario, MultiTargetScenario):
        rows, paired = multi_target_summary(scenario, results), multi_target_differences(scenario, results)
    else:
        rows, paired = summary(scenario, results), differences(scenario, results)
    tables = [table_record(asked["env"], asked["settings"], rows)]
    if paired:
        tables.append(table_record("paired differences", asked["settings"], paired))
    remarks = notes(rows, sweep.runs)
    write_runs(out / "runs.csv", scenario, results)
    for file in filter(None, (out / "evaluate.json", copy)):
        write_json(file, answered(asked, tables, notes=remarks))
    yield figures_table(f"{asked['env']}: {sweep.runs} runs, seed {sweep.seed}", rows)
    if paired:
        yield figures_table("paired differences", paired)
    yield from legend(on_screen(rows))
    yield from remarks
    yield f"written to {out}"


def check_writable(*files: Path | None, beside: Path | None = None) -> None:
    """OSError for a file that could not be made, or that is a folder: before the work, and leaving none.
    ValueError for one that is to be written twice, or over the file `beside` that is read."""
    taken = {beside.resolve()} if beside else set()
    for file in filter(None, files):
        if file.resolve() in taken:
            raise ValueError(f"{file} is named twice, and what it holds would be lost; choose another file")
        taken.add(file.resolve())
        if file.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(file))
        check_folder(file.parent)
