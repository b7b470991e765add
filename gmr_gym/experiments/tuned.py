"""A tracker is tuned, and judged on episodes that it was not tuned on."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.evaluation.summary import Estimate, bootstrap_mean
from gmr_gym.experiments import trials
from gmr_gym.experiments.claims import plain
from gmr_gym.experiments.evaluating import judged
from gmr_gym.experiments.figures import legend
from gmr_gym.experiments.objectives import METRIC, Tuned, paired, shown_with
from gmr_gym.experiments.output import write_json, write_rows, write_runs
from gmr_gym.experiments.records import answered, command
from gmr_gym.experiments.screen import progress
from gmr_gym.experiments.search_space import Space
from gmr_gym.experiments.sheets import comparison, shown
from gmr_gym.experiments.sweeps import Sweep, runs_shown, stopped

HELD_OUT, PAIRED = "held-out episodes", "held-out episodes, paired difference"


class Job(NamedTuple):
    """What is tuned between which values, how much is tried, and on how many other episodes it is judged."""

    asked: dict[str, Any]  # see `records.question`
    problem: Tuned
    space: Space
    default: Mapping[str, Any]
    plan: trials.Plan
    held_out: int
    typed: Sequence[str]  # settings of the environment, as they were typed
    blocks: Path  # folder in which finished blocks of runs are kept
    again: str  # the command


def tune(job: Job, out: Path, copy: Path | None) -> Iterator[Any]:
    """Tries parameters, runs the best on held-out episodes beside the default, leaves record, trials and runs
    in `out`, and then gives what a screen shows."""
    study = trials.opened(out / "trials.log", job.space, job.default, job.asked)
    kept = f"trials are kept in {out}"
    with stopped(out, "trials.log", kept, "no trial was made"), progress("runs tried") as report:
        found = trials.search(study, job.space, job.problem, job.plan, report)
    write_trials(out / "trials.csv", found, job.space)
    best = trials.best(found)
    known = {"best": best.parameters, "trials": len(found), "command": job.again}
    yield from trials_said(found)
    if best.number == 0 and trials.begins_with(job.default, job.space):
        write_records(answered(job.asked, [], **known), out, copy)
        yield f"none of them was better than {job.problem.spec} as it is"
    else:
        yield from _judged(job, best, known, out, copy)
    yield f"written to {out}"


def _judged(
    job: Job, best: trials.Tried, known: Mapping[str, Any], out: Path, copy: Path | None
) -> Iterator[Any]:
    """The best trial and the default on held-out episodes."""
    problem, env_id, seed = job.problem, job.asked["env"], job.plan.seed + 1
    spec, tuned = problem.spec, spec_with(problem.spec, best.parameters)
    trackers = {spec: problem.tracker({}), tuned: problem.tracker(best.parameters)}
    sweep = Sweep(job.held_out, seed, job.plan.jobs, "loky", None, None, job.blocks, job.again)
    (results,) = runs_shown("held-out runs", [(problem.scenario, trackers)], sweep)
    tables, remarks = judged((HELD_OUT, PAIRED), job.asked["settings"], problem.scenario, results)
    difference = with_objective(problem, tables, [problem.figure(runs) for runs in results.values()])
    use = command("evaluate", env_id, tracker=[spec, tuned], set=job.typed, runs=[job.held_out], seed=[seed])
    write_records(answered(job.asked, tables, notes=remarks, use=use, **known), out, copy)
    write_runs(out / "held-out.csv", problem.scenario, results)
    first = problem.figure_name
    metrics = [*dict.fromkeys((first, METRIC[problem.objective], *shown_with(problem.scenario)))]
    yield comparison(f"{env_id}: {job.held_out} {HELD_OUT} (seed {seed})", tables[0], metrics)
    yield comparison(PAIRED, tables[1], [name for name in metrics if name in tables[1]["rows"][0]["metrics"]])
    yield from (*legend(metrics), *remarks)
    yield f"{verdict(difference)}: {shown(first, difference)} on episodes that it was not tuned on"
    yield f"tuned: {tuned}"
    yield f"compare them again: {use}"


def spec_with(spec: str, parameters: Mapping[str, Any]) -> str:
    """NAME:key=value,key=value with these parameters too."""
    own, _, fixed = spec.partition(":")
    more = ",".join(f"{name}={value}" for name, value in parameters.items())
    return f"{own}:{','.join(filter(None, (fixed, more)))}"


def with_objective(
    problem: Tuned, tables: Sequence[dict[str, Any]], values: Sequence[np.ndarray]
) -> Estimate:
    """Adds the objective to the first figures of the tables of held-out runs and of their paired difference,
    which it gives back."""
    difference = paired(problem.objective, problem.price, values[1] - values[0])
    rows = [*tables[0]["rows"], *tables[1]["rows"]]
    for row, figure in zip(rows, [*map(bootstrap_mean, values), difference], strict=True):
        row["metrics"] = {problem.figure_name: plain(figure)} | row["metrics"]
    return difference


def write_trials(file: Path, found: Sequence[trials.Tried], space: Space) -> None:
    """One row per trial."""
    rows = (
        [one.number, one.state, len(one.values), one.value if len(one.values) else "",
         *(one.parameters.get(name, "") for name in space), one.error]
        for one in found
    )  # fmt: skip
    write_rows(file, ["trial", "state", "runs", "objective", *space, "error"], rows)


def write_records(record: dict[str, Any], out: Path, copy: Path | None) -> None:
    """The record, and a copy where one is asked for."""
    for file in filter(None, (out / "tune.json", copy)):
        write_json(file, record)


def trials_said(found: Sequence[trials.Tried]) -> Iterator[str]:
    """What became of the trials."""
    states = [trial.state for trial in found]
    line = (
        f"{len(found)} trials: {states.count('complete')} complete, {states.count('pruned')} given up early"
    )
    failed = [trial for trial in found if trial.state == "fail"]
    if failed:
        line += f", {len(failed)} failed, the last at {failed[-1].parameters}: {failed[-1].error}"
    yield line


def verdict(difference: Estimate) -> str:
    """What a paired difference says, where less is better."""
    if difference.high < 0:
        return "better"
    return "worse" if difference.low > 0 else "no difference shown"
