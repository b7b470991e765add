"""Commands that run trackers in environments and compare them."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from gmr_gym.envs.registry import RANKED
from gmr_gym.experiments.options import (
    Backend,
    EnvId,
    Environments,
    Format,
    GridSettings,
    Jobs,
    Json,
    Metrics,
    RunCount,
    Scheduler,
    Seed,
    Settings,
    Shard,
    TrackerNames,
    tracker_option,
)
from gmr_gym.experiments.screen import show


def evaluate(
    env_id: EnvId,
    tracker: TrackerNames,
    *,
    settings: Settings = [],  # noqa: B006
    runs: RunCount = 100,
    seed: Seed = 0,
    jobs: Jobs = -1,
    backend: Backend = "loky",
    scheduler: Scheduler = None,
    shard: Shard = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            help="folder of results; by default one of its own in results/evaluate for every question",
        ),
    ] = None,
    json_file: Json = None,
    metric: Metrics = [],  # noqa: B006
    form: Format = "table",
) -> None:
    """Compare trackers on the same episodes of an environment, with intervals and paired differences."""
    from gmr_gym.envs import lookup
    from gmr_gym.experiments import evaluating, figures, formats, records, specs, sweeps
    from gmr_gym.literals import key_values

    part = sweeps.shard_of(shard, out)
    world = key_values(settings)
    specs.check_once("--tracker", tracker)
    specs.check_once("--metric", metric)
    scenario = lookup.scenario_of(env_id, world)
    figures.check_known(metric, evaluating.figures_of(scenario))
    candidates = {spec: lookup.tracker_of(spec, scenario) for spec in tracker}
    parsed = specs.parsed_all(tracker)
    asked = records.question(env=env_id, settings=world, trackers=parsed, runs=runs, seed=seed)
    again = records.command("evaluate", env_id, tracker=tracker, set=settings, runs=[runs], seed=[seed])
    # blocks of runs are shared: another tracker, or more runs, begin with those that are there
    root = out or Path("results/evaluate")
    out = out or root / f"{env_id.rpartition('/')[2]}-{records.named(asked)}"
    specs.check_writable(out / "evaluate.json", out / "runs.csv", json_file)
    sweep = sweeps.Sweep(runs, seed, jobs, backend, scheduler, part, root / sweeps.BLOCKS, again)
    if not part:
        records.check_free(out / "evaluate.json", asked)
        lines = evaluating.evaluated(asked, scenario, candidates, sweep, out, json_file, metric)
        formats.write_out(lines, form, out / "evaluate.json", metric)
        return
    (left,) = sweeps.runs_shown(env_id, [(scenario, candidates)], sweep)
    sweeps.say_what_is_left(sweep.blocks, *left)


def sweep(
    env_id: EnvId,
    tracker: TrackerNames,
    *,
    settings: GridSettings,
    runs: RunCount = 100,
    seed: Seed = 0,
    jobs: Jobs = -1,
    backend: Backend = "loky",
    scheduler: Scheduler = None,
    shard: Shard = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", help="folder of results; by default one of its own in results/sweep for every question"
        ),
    ] = None,
    json_file: Json = None,
    metric: Metrics = [],  # noqa: B006
    form: Format = "table",
    plot: Annotated[
        bool, typer.Option("--plot", help="also draw the figures, as sweep.png and sweep.svg")
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="run a grid of more than a thousand settings")] = False,
) -> None:
    """Compare trackers over a grid of settings of an environment, on the same episodes."""
    from gmr_gym.experiments import evaluating, figures, formats, grid, records, specs, sweeps

    part = sweeps.shard_of(shard, out)
    asked_for = grid.grid_of(settings, yes)
    if plot:
        grid.check_drawable(asked_for)
    specs.check_once("--tracker", tracker)
    specs.check_once("--metric", metric)
    work = grid.work_of(env_id, asked_for, tracker)
    figures.check_known(metric, evaluating.figures_of(work[0][0]))
    parsed = specs.parsed_all(tracker)
    asked = records.question(
        env=env_id, settings=asked_for.settings, axes=asked_for.axes, trackers=parsed, runs=runs, seed=seed
    )
    again = records.command("sweep", env_id, tracker=tracker, set=settings, runs=[runs], seed=[seed])
    # what `evaluate` has run of a setting is found
    kept = (out or Path("results/evaluate")) / sweeps.BLOCKS
    out = out or Path("results/sweep") / f"{env_id.rpartition('/')[2]}-{records.named(asked)}"
    specs.check_writable(out / "sweep.json", out / "sweep.csv", out / "sweep-runs.csv", json_file)
    shared = sweeps.Sweep(runs, seed, jobs, backend, scheduler, part, kept, again)
    if not part:
        records.check_free(out / "sweep.json", asked)
    print(grid.size(asked_for, tracker, runs), file=sys.stderr)
    if part:
        left = sweeps.runs_shown(env_id, work, shared)
        sweeps.say_what_is_left(kept, *map(sum, zip(*left, strict=True)))
        return
    lines = grid.swept(asked, asked_for, work, shared, out, json_file, metric, plot)
    formats.write_out(lines, form, out / "sweep.json", metric)


def leaderboard(
    environment: Environments = [],  # noqa: B006
    tracker: Annotated[
        list[str], tracker_option("add this tracker: NAME or NAME:key=value,key=value; repeatable")
    ] = [],  # noqa: B006
    *,
    runs: RunCount = 200,
    seed: Seed = 0,
    jobs: Jobs = -1,
    backend: Backend = "loky",
    scheduler: Scheduler = None,
    shard: Shard = None,
    out: Annotated[Path, typer.Option("--out", help="folder of results")] = Path("results/leaderboard"),
    json_file: Json = None,
) -> None:
    """Rank every installed tracker in every environment that it can be used in, on one page."""
    from gmr_gym.experiments import leaderboard, records, specs, sweeps

    part = sweeps.shard_of(shard, out)
    specs.check_once("--env", environment)
    specs.check_once("--tracker", tracker)
    chosen = environment or [*RANKED]
    work, unfit = leaderboard.entries(chosen, tracker)
    asked = records.question(environments=chosen, trackers=tracker, runs=runs, seed=seed)
    again = records.command("leaderboard", env=environment, tracker=tracker, runs=[runs], seed=[seed])
    specs.check_writable(out / "leaderboard.json", json_file)
    shared = sweeps.Sweep(runs, seed, jobs, backend, scheduler, part, out / sweeps.BLOCKS, again)
    if part:
        left = sweeps.runs_shown("leaderboard", work.values(), shared)
        sweeps.say_what_is_left(shared.blocks, *map(sum, zip(*left, strict=True)))
        return
    records.check_free(out / "leaderboard.json", asked)
    show(leaderboard.leaderboard(asked, work, unfit, shared, out, json_file))


def merge(
    folders: Annotated[list[Path], typer.Argument(help="folders of results, one of each shard")],
    into: Annotated[Path, typer.Option("--into", help="folder of results to write")],
) -> None:
    """Join the results of shards that ran on several machines.

    Then give their command once more, without --shard and with this folder as --out: it shows the whole.
    """
    from gmr_gym.evaluation.blocks import check_folder
    from gmr_gym.experiments.sweeps import BLOCKS, merge_results

    check_folder(into / BLOCKS)
    merge_results(folders, into)
