"""Trackers in a scenario, run and judged, and the files they leave."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from gmr_gym.evaluation.multi_target_summary import multi_target_differences, multi_target_summary
from gmr_gym.evaluation.summary import differences, summary
from gmr_gym.experiments.by_scan import by_scan
from gmr_gym.experiments.figures import MULTI_TARGET, ONE_TARGET, Evaluated, legend
from gmr_gym.experiments.output import write_json, write_runs, write_text
from gmr_gym.experiments.records import answered
from gmr_gym.experiments.report import report
from gmr_gym.experiments.sheets import comparison, notes
from gmr_gym.experiments.specs import complete
from gmr_gym.experiments.sweeps import Sweep, runs_shown
from gmr_gym.experiments.tables import table_record
from gmr_gym.simulation.multi_target import MultiTargetScenario
from gmr_gym.simulation.single_target import Scenario


def figures_of(scenario: Scenario | MultiTargetScenario) -> Evaluated:
    """Which figures its runs come to."""
    return MULTI_TARGET if isinstance(scenario, MultiTargetScenario) else ONE_TARGET


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
        asked, tables, notes=remarks, command=sweep.command, by_scan=by_scan(scenario, results),
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
        yield f"evaluate.json also has {', '.join(left)}; --metric NAME shows one"
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
