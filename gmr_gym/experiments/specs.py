"""What the commands share: scenarios and trackers by what a user types, and runs under a progress bar."""

import ast
import errno
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from difflib import get_close_matches
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any

import gymnasium as gym

from gmr_gym.catalogue import GROUP, MULTI_TARGET_GROUP, tracker_entry_points
from gmr_gym.envs.episodic import make_scenario
from gmr_gym.envs.registry import ENVIRONMENTS, MULTI_TARGET, TRACKING
from gmr_gym.evaluation.blocks import check_folder
from gmr_gym.evaluation.multi_target_summary import multi_target_differences, multi_target_summary
from gmr_gym.evaluation.summary import differences, summary
from gmr_gym.experiments.by_scan import by_scan
from gmr_gym.experiments.figures import MULTI_TARGET as MULTI_TARGET_FIGURES
from gmr_gym.experiments.figures import ONE_TARGET as ONE_TARGET_FIGURES
from gmr_gym.experiments.figures import Evaluated, legend
from gmr_gym.experiments.output import write_json, write_runs, write_text
from gmr_gym.experiments.records import answered
from gmr_gym.experiments.report import report
from gmr_gym.experiments.sheets import comparison, notes
from gmr_gym.experiments.sweeps import Sweep, runs_shown
from gmr_gym.experiments.tables import table_record
from gmr_gym.filters.registry import FORMER_PARAMETERS, make_tracker
from gmr_gym.simulation.multi_target import MultiTargetScenario
from gmr_gym.simulation.single_target import Scenario


def key_value(text: str) -> tuple[str, Any]:
    """key=value with the value read as a Python literal where it is one."""
    key, sign, value = text.partition("=")
    if not sign or not key:
        raise ValueError(f"expected key=value, got {text!r}")
    for read in (ast.literal_eval, float):  # float reads nan and inf, which are then refused by name
        try:
            return key, read(value)
        except (ValueError, SyntaxError, TypeError, MemoryError, RecursionError):  # two of deep nesting
            pass
    if value.startswith(("[", "(", "{")):
        raise ValueError(f"{key} cannot be read as a list: {value}")
    return key, value


def key_values(texts: Iterable[str]) -> dict[str, Any]:
    """Values by key, of key=value each; ValueError for a key that is there twice."""
    found: dict[str, Any] = {}
    for key, value in map(key_value, texts):
        if key in found:
            raise ValueError(f"{key} is given twice, as {found[key]!r} and as {value!r}")
        found[key] = value
    return found


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


def check_ending(option: str, file: Path | None, *endings: str) -> None:
    """ValueError naming the option if a file to be written says by its ending that it is of another kind."""
    if file is not None and file.suffix.lower() not in endings:
        raise ValueError(f"{option} must end in {' or '.join(endings)}, got {file.name!r}")


def parsed(spec: str) -> tuple[str, dict[str, Any]]:
    """A tracker's name and parameters from NAME:key=value,key=value."""
    name, _, parameters = spec.partition(":")
    return name, key_values(filter(None, parameters.split(",")))


def scenario_of(env_id: str, world: Mapping[str, Any]) -> Any:
    """The Scenario or MultiTargetScenario of an environment with the settings `world`. Raises ValueError for
    an id that is none of ours, with the nearest that is, and for an environment without one."""
    bare = {name.partition("/")[2]: name for name in ENVIRONMENTS}
    if env_id not in gym.registry and (
        near := get_close_matches(env_id.partition("/")[2] or env_id, bare, n=1)
    ):
        raise ValueError(f"unknown environment {env_id!r}; did you mean {bare[near[0]]!r}?")
    # of the settings only what the scenario of the id takes: no value names code to be imported
    module, _, known_as = env_id.rpartition(":")
    if module:
        import_module(module)  # `gym.make` does so, and not `gym.spec`
    elif known_as not in gym.registry:
        raise ValueError(
            f"unknown environment {env_id!r}; choose from {', '.join((*TRACKING, *MULTI_TARGET))}, or give "
            "one of your own as MODULE:ID"
        )
    kept = gym.spec(known_as).kwargs.get("scenario")
    scenario = make_scenario(kept, world) if kept else None
    if not isinstance(scenario, Scenario | MultiTargetScenario):
        raise ValueError(
            f"{env_id} is not a tracking environment: no tracker runs in it; choose from "
            f"{', '.join((*TRACKING, *MULTI_TARGET))}"
        )
    return scenario


def single_target(env_id: str, world: Mapping[str, Any]) -> Scenario:
    """As `scenario_of`, of one target; ValueError where there are many."""
    scenario = scenario_of(env_id, world)
    if isinstance(scenario, MultiTargetScenario):
        raise ValueError(f"{env_id} has many targets; choose from {', '.join(TRACKING)}")
    return scenario


def tracker_of(spec: str, scenario: Scenario | MultiTargetScenario, **parameters: Any) -> Any:
    """The tracker NAME:key=value,key=value, with further parameters, for the scenario's filter model."""
    name, further = parsed(spec)
    return make_tracker(name, scenario.model, **parameters, **further)


def complete(spec: str, scenario: Scenario | MultiTargetScenario) -> dict[str, Any]:
    """All parameters of the tracker NAME:key=value,key=value, those that are not given as they are by
    default."""
    name, given = parsed(spec)
    known = tracker_entry_points(MULTI_TARGET_GROUP if isinstance(scenario, MultiTargetScenario) else GROUP)
    base, _, number = name.rpartition("-")
    name, given = (name, given) if name in known else (base, {"components": int(number)} | given)
    takes = list(signature(known[name].load()).parameters.values())[1:]
    usual = {one.name: one.default for one in takes if one.default is not one.empty}
    return usual | {
        next((new for new in FORMER_PARAMETERS.get(key, ()) if new in usual), key): value
        for key, value in given.items()
    }


def parsed_all(specs: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Names and parameters of trackers, as a question has them."""
    return {spec: dict(zip(("name", "parameters"), parsed(spec), strict=True)) for spec in specs}


def figures_of(scenario: Scenario | MultiTargetScenario) -> Evaluated:
    """Which figures its runs come to."""
    return MULTI_TARGET_FIGURES if isinstance(scenario, MultiTargetScenario) else ONE_TARGET_FIGURES


def evaluated(
    asked: dict[str, Any],
    scenario: Scenario | MultiTargetScenario,
    trackers: Mapping[str, Any],
    sweep: Sweep,
    out: Path,
    copy: Path | None,
    metrics: Sequence[str],
) -> Iterator[Any]:
    """Runs trackers in a scenario, leaves record and runs in `out`, and then gives what a screen shows: these
    metrics, or the usual ones."""
    metrics = metrics or figures_of(scenario).shown
    (results,) = runs_shown(asked["env"], [(scenario, trackers)], sweep)
    names = asked["env"], "paired differences"
    tables, remarks = judged(names, asked["settings"], scenario, results)
    write_runs(out / "runs.csv", scenario, results)
    record = answered(
        asked, tables, notes=remarks, command=sweep.command, scans=by_scan(scenario, results),
        parameters={spec: complete(spec, scenario) for spec in trackers},
    )  # fmt: skip
    for file in filter(None, (out / "evaluate.json", copy)):
        write_json(file, record)
    write_text(out / "report.html", report(record, scenario.period))
    yield comparison(f"{asked['env']}: {sweep.runs} runs, seed {sweep.seed}", tables[0], metrics)
    for paired in tables[1:]:
        there = [metric for metric in metrics if metric in paired["rows"][0]["metrics"]]
        if there:
            yield comparison(paired["name"], paired, there)
    yield from legend(metrics)
    yield from remarks
    left = [metric for metric in tables[0]["rows"][0]["metrics"] if metric not in metrics]
    if left:
        yield f"{', '.join(left)} are in evaluate.json besides; --metric NAME shows one"
    yield f"written to {out}"


def judged(
    names: tuple[str, str], settings: Mapping[str, Any], scenario: Any, results: Mapping[str, Any]
) -> tuple[list[dict[str, Any]], list[str]]:
    """What runs come to: the records of their table and, of several trackers, of the paired differences, by
    these names, and what is to be said of them."""
    if isinstance(scenario, MultiTargetScenario):
        rows, paired = multi_target_summary(scenario, results), multi_target_differences(scenario, results)
    else:
        rows, paired = summary(scenario, results), differences(scenario, results)
    tables = [table_record(name, settings, found) for name, found in zip(names, (rows, paired), strict=True)]
    runs = len(next(iter(results.values())).components)
    return tables[: 1 + bool(paired)], notes(rows, runs)


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
