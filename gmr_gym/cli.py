"""The command line, `gmr-gym`. What a command needs is imported when it runs: help, lists and a shell's
completion wait for nothing."""

import signal
import sys
import warnings
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import typer

from gmr_gym.catalogue import (
    GROUP,
    HYPOTHESIS_REDUCTIONS,
    MULTI_TARGET_GROUP,
    described,
    described_reductions,
)
from gmr_gym.data.loader import flight_names
from gmr_gym.envs.registry import ABOUT, RANKED, READY, TRACKING, TUNING
from gmr_gym.experiments.detection_options import ALL_GROUPS, INPUT_GROUPS, takes
from gmr_gym.experiments.options import (
    TARGETS,
    AnyEnvId,
    Backend,
    Compared,
    EnvId,
    Environments,
    Example,
    Format,
    GridSettings,
    Jobs,
    Json,
    Metrics,
    MoreTrackers,
    MotionModel,
    Once,
    PaperName,
    RunCount,
    Scheduler,
    Seed,
    Settings,
    Shard,
    Tables,
    TrackerNames,
    choice,
    choices,
    completing,
    tracker_option,
)
from gmr_gym.experiments.papers.registry import PAPERS
from gmr_gym.experiments.screen import console, progress, spell_out, waiting
from gmr_gym.version import __version__

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Target tracking in clutter: evaluate trackers, reproduce papers, track recorded data.",
)
command = partial(app.command, cls=Once)


def _version(asked: bool) -> None:
    if asked:
        print(f"gmr-gym {__version__}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="print the version")
    ] = False,
) -> None:
    pass


@command("list")
def list_() -> None:
    """Names of environments, trackers, reductions and papers, with a line about each."""
    screen = console()
    for title, entries in (
        ("environments", ABOUT),
        ("segments of gmr_gym/RecordedFlight-v0", dict.fromkeys(flight_names(), "")),
        ("trackers", described(GROUP)),
        ("trackers of many targets", described(MULTI_TARGET_GROUP)),
        ("reductions, as in mmg-15:reduction=runnalls", described_reductions() | HYPOTHESIS_REDUCTIONS),
        ("papers", PAPERS),
    ):
        screen.print(f"[bold]{title}[/bold]")
        for name, text in entries.items():
            screen.print(f"  {name:26} {text}".rstrip(), soft_wrap=True, markup=False)


@command()
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


@command()
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


@command()
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
    _show(leaderboard.leaderboard(asked, work, unfit, shared, out, json_file))


@command()
def compare_reductions(
    reduction: Annotated[
        list[str],
        typer.Option(
            "--reduction",
            help="reduction to compare with runnalls; repeatable; by default all",
            autocompletion=completing(described_reductions()),
        ),
    ] = [],  # noqa: B006
    *,
    tracking: Annotated[
        list[str],
        typer.Option(
            "--track",
            help="compare only this one with runnalls in tracking; repeatable; by default all",
            autocompletion=completing(described_reductions()),
        ),
    ] = [],  # noqa: B006
    env_ids: Annotated[
        list[str],
        typer.Option(
            "--env",
            help="environment of one target to track in; repeatable",
            **choices("environment", {env_id: ABOUT[env_id] for env_id in TRACKING}),
        ),
    ] = ["gmr_gym/TurningTarget-v0", "gmr_gym/JumpMarkov-v0"],  # noqa: B006
    components: Annotated[
        list[int], typer.Option("--components", min=1, help="hypotheses kept in tracking; repeatable")
    ] = [2, 3, 5, 10, 20],  # noqa: B006
    mixtures: Annotated[
        int, typer.Option("--mixtures", min=1, help="mixtures from every environment that are reduced")
    ] = 20,
    slowest: Annotated[
        float,
        typer.Option(
            "--slowest",
            min=1,
            help="leave out of tracking what takes more than this many times as long as runnalls",
        ),
    ] = 40.0,
    runs: RunCount = 100,
    seed: Seed = 0,
    jobs: Jobs = -1,
    backend: Backend = "loky",
    scheduler: Scheduler = None,
    shard: Shard = None,
    out: Annotated[Path, typer.Option("--out", help="folder of results")] = Path(
        "results/compare-reductions"
    ),
    json_file: Json = None,
    form: Format = "table",
) -> None:
    """Compare reductions: the error that each makes, how tracking suffers, and the time it takes."""
    from gmr_gym.envs.lookup import scenario_of
    from gmr_gym.experiments import formats, records, reductions_compared, specs, sweeps
    from gmr_gym.reduction.registry import reducer

    part = sweeps.shard_of(shard, out)
    specs.check_once("--reduction", reduction)
    specs.check_once("--env", env_ids)
    specs.check_once("--components", [*map(str, components)])
    specs.check_once("--track", tracking)
    names = [*dict.fromkeys(("runnalls", *(reduction or described_reductions())))]
    for name in names:
        reducer(name, 1)
    for name in tracking:
        if name not in names:
            raise ValueError(f"--track {name} is not compared; choose from {', '.join(names)}")
    asked = records.question(
        reductions=names, tracking=tracking or names, environments=env_ids, components=sorted(components),
        mixtures=mixtures, slowest=slowest, runs=runs, seed=seed,
    )  # fmt: skip
    again = records.command(
        "compare-reductions", reduction=reduction, track=tracking, env=env_ids, components=components,
        mixtures=[mixtures], slowest=[slowest], runs=[runs], seed=[seed],
    )  # fmt: skip
    specs.check_writable(out / "compare-reductions.json", json_file)
    sweep = sweeps.Sweep(runs, seed, jobs, backend, scheduler, part, out / sweeps.BLOCKS, again)
    if not part:
        records.check_free(out / "compare-reductions.json", asked)
    scenarios = {env_id: scenario_of(env_id, {}) for env_id in env_ids}
    lines = reductions_compared.compared(asked, names, scenarios, sweep, out, json_file)
    formats.write_out(lines, form, out / "compare-reductions.json")


@command()
def reproduce(
    paper: PaperName,
    *,
    table: Tables = [],  # noqa: B006
    tracker: MoreTrackers = [],  # noqa: B006
    runs: Annotated[
        int | None,
        typer.Option("--runs", min=1, help="Monte Carlo runs; by default as many as on the paper's page"),
    ] = None,
    seed: Seed = 0,
    jobs: Jobs = -1,
    backend: Backend = "loky",
    scheduler: Scheduler = None,
    shard: Shard = None,
    out: Annotated[Path | None, typer.Option("--out", help="folder of results")] = None,
    json_file: Json = None,
    form: Format = "table",
) -> None:
    """Reproduce a paper's tables and figures: its numbers beside ours, and whether they agree."""
    from gmr_gym.experiments import formats, records, running, specs, sweeps
    from gmr_gym.experiments.papers.registry import paper_named

    asked_for = paper_named(paper)
    known = asked_for.entries()
    for name in table:
        if name not in known:
            raise ValueError(f"{paper} has no table {name!r}; choose from {', '.join(known)}")
    specs.check_once("--table", table)
    table = [name for name in known if name in table]  # in whatever order they were typed
    part, usual = sweeps.shard_of(shard, out), asked_for.tables[0].runs
    runs, names = runs or usual, table or list(known)
    entries = [known[name].with_rows(tracker) for name in names]
    if tracker and all(entry is known[entry.name] for entry in entries):
        raise ValueError(f"--tracker has no row in {', '.join(names)}: it compares reductions, or settings")
    trackers = {entry.name: entry.trackers for entry in entries}
    asked = records.question(paper=paper, asked=names, trackers=trackers, runs=runs, seed=seed)
    root = out or Path("results") / paper
    other = [f"table-{name}" for name in table] + [f"more-{records.named(asked)}"] * bool(tracker)
    other += [f"runs-{runs}"] * (runs != usual) + [f"seed-{seed}"] * (seed > 0)
    out = out or root / "-".join(other)
    specs.check_writable(out / f"{paper}.json", json_file)
    again = records.command("reproduce", paper, table=table, tracker=tracker, runs=[runs], seed=[seed])
    sweep = sweeps.Sweep(runs, seed, jobs, backend, scheduler, part, root / sweeps.BLOCKS, again)
    if part:
        sweeps.say_what_is_left(sweep.blocks, *running.sharded(entries, sweep))
        return
    records.check_free(out / f"{paper}.json", asked)
    lines = running.rerun(paper, asked_for, entries, asked, sweep, out, json_file)
    formats.write_out(lines, form, out / f"{paper}.json")


@command()
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


@command()
def watch(
    env_id: EnvId,
    tracker: Annotated[
        list[str], tracker_option("up to four, repeatable; by default runnalls-30, mmg-15 or learning-pmb")
    ] = [],  # noqa: B006
    *,
    settings: Settings = [],  # noqa: B006
    seed: Seed = 0,
    scans: Annotated[
        int | None, typer.Option("--scans", help="how many scans, from the first; by default all")
    ] = None,
    frame: Annotated[
        int | None, typer.Option("--frame", help="the scan that a .png or .svg shows, counted from 1")
    ] = None,
    size: Annotated[
        str, typer.Option("--size", help="pixels of a film or picture: WIDTH or WIDTHxHEIGHT")
    ] = "",
    fps: Annotated[
        float | None, typer.Option("--fps", help="scans a second of a film; by default 10")
    ] = None,
    out: Annotated[
        Path,
        typer.Option(
            "--out",
            help="a page with a player, .html; a film, .gif or .mp4; or a picture of one scan, .png or .svg",
        ),
    ] = Path("episode.html"),
) -> None:
    """Draw one episode as a page, film or picture: detections, gates, hypotheses, merges and estimates."""
    from gmr_gym.envs.lookup import scenario_of
    from gmr_gym.experiments import specs
    from gmr_gym.literals import key_values
    from gmr_gym.replay import record, write_page
    from gmr_gym.replay.film import FILMS, FPS, PICTURES, film
    from gmr_gym.replay.lineup import trackers_of
    from gmr_gym.simulation.multi_target import MultiTargetScenario

    specs.check_ending("--out", out, ".html", ".gif", ".mp4", ".png", ".svg")
    specs.check_writable(out)
    specs.check_once("--tracker", tracker)
    ending = out.suffix.lower()
    for option, value, endings in (
        ("--frame", frame, PICTURES), ("--size", size or None, (*FILMS, *PICTURES)), ("--fps", fps, FILMS)
    ):  # fmt: skip
        if value is not None and ending not in endings:
            raise ValueError(f"{option} is for {' or '.join(endings)}, and --out is {out.name}")
    pixels = specs.pixels("--size", size) if size else None
    scenario = scenario_of(env_id, key_values(settings))
    if isinstance(scenario, MultiTargetScenario):
        usual = "learning-pmb"
    else:
        usual = "mmg-15" if len(scenario.model.motions) > 1 else "runnalls-30"
    trackers = trackers_of(tracker or [usual], scenario, env_id)
    with progress("tracking") as report:
        if ending == ".html":
            name = " ".join((env_id, *(one if len(one) <= 60 else f"{one[:57]}..." for one in settings)))
            write_page(record(scenario, trackers, seed, scans, environment=name, progress=report), out)
        else:
            rate = FPS if fps is None else fps
            film(
                scenario,
                trackers,
                seed,
                out,
                frame=frame,
                scans=scans,
                size=pixels,
                fps=rate,
                progress=report,
            )
    _show([f"written to {out}"])


@command()
def reduce(
    file: Annotated[
        Path | None, typer.Argument(metavar="MIXTURE", help=".json, .npz or .csv; or give --example")
    ] = None,
    *,
    method: Annotated[
        list[str],
        typer.Option(
            "--method",
            help="reduction, NAME or NAME:key=value,key=value; up to four, repeatable; by default runnalls",
            autocompletion=completing(described_reductions()),
        ),
    ] = [],  # noqa: B006
    example: Example = None,
    compare: Compared = None,
    components: Annotated[
        int | None,
        typer.Option(
            "--components", help="how many remain; by default half of them, and on a page down to 1"
        ),
    ] = None,
    axes: Annotated[str, typer.Option("--axes", help="two coordinates that are drawn; by default 1,2")] = "",
    out: Annotated[
        Path | None,
        typer.Option(
            "--out",
            help="a page of every step, .html (by default reduction.html); a picture, .png or .svg; or the "
            "reduced mixture, .json, .npz or .csv",
        ),
    ] = None,
) -> None:
    """Reduce a mixture by several methods: the error and time of each, and a page that shows every merge."""
    from gmr_gym.experiments import reducing, specs

    if compare:
        for option, given in (("--method", method), ("--axes", axes), ("--out", out)):
            if given:
                raise ValueError(f"{option} is not for --compare, which takes all and writes nothing")
        _show(reducing.comparison(*reducing.mixture_asked(file, example), components))
        return
    out = out or Path("reduction.html")
    specs.check_ending("--out", out, *reducing.ENDINGS)
    specs.check_writable(out, beside=[file])
    specs.check_once("--method", method)
    name, mixture = reducing.mixture_asked(file, example)
    _show(reducing.reduction(name, mixture, method or ["runnalls"], components, axes, out))


@command()
def record(
    env_id: EnvId,
    tracker: Annotated[
        str, tracker_option("tracker that a moving field of view follows; by default pda or imm-pda")
    ] = "",
    settings: Settings = [],  # noqa: B006
    seed: Seed = 0,
    out: Annotated[Path, typer.Option("--out", help="CSV of detections")] = Path("detections.csv"),
    truth: Annotated[Path | None, typer.Option("--truth", help="also a CSV of the truth")] = None,
) -> None:
    """Write the detections of one episode to a file. `track` reads it, unless they are ranges and angles."""
    from gmr_gym.experiments import specs
    from gmr_gym.experiments.tracks import record_episode
    from gmr_gym.literals import key_values

    specs.check_writable(out, truth)
    specs.check_ending("--out", out, ".csv")
    specs.check_ending("--truth", truth, ".csv")
    scenario = specs.single_target(env_id, key_values(settings))
    tracker = tracker or ("imm-pda" if len(scenario.model.motions) > 1 else "pda")
    with waiting("recording"):
        record_episode(scenario, tracker, seed, out, truth)
    _show([f"written to {out}"])


@command()
def episodes(
    env_id: AnyEnvId,
    tracker: Annotated[
        list[str],
        tracker_option("repeatable; of ReductionTuning the policy: learned, constant:alpha=0.1, random"),
    ],
    *,
    count: Annotated[int, typer.Option("--episodes", min=1, help="of every tracker")] = 100,
    settings: Settings = [],  # noqa: B006
    seed: Seed = 0,
    out: Annotated[
        Path, typer.Option("--out", help="folder of the data set, its name with a version: turning-pda-v0")
    ],
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace a data set that is there")] = False,
) -> None:
    """Write episodes of trackers or policies as a Minari data set, to learn from offline."""
    from gmr_gym.experiments.episodes import write_episodes

    with progress("episodes") as report:
        lines = write_episodes(env_id, settings, tracker, count, seed, out, overwrite, progress=report)
    _show(lines)


@command("track")
@takes(*ALL_GROUPS)
def track_(
    file: Annotated[Path, typer.Argument(help="CSV, text, JSON, Parquet, AIS or ASTERIX, also in gzip")],
    *,
    targets: Annotated[
        str | None,
        typer.Option(
            metavar="|".join(TARGETS),
            help="how many are in the file; by default many",
            **choice("targets", TARGETS),
        ),
    ] = None,
    tracker: Annotated[
        str | None,
        tracker_option(
            "of many targets pmb (default), pda, gnn, mht, phd, or another; of one target by default "
            "runnalls-30. NAME or NAME:key=value,key=value"
        ),
    ] = None,
    model: MotionModel = "constant-velocity",
    prior: Annotated[
        str | None,
        typer.Option(help="initial state of one target: positions, then velocities, with commas between"),
    ] = None,
    prior_deviations: Annotated[
        str | None, typer.Option(help="standard deviations of --prior, in the same order")
    ] = None,
    speed: Annotated[
        float | None,
        typer.Option(help="standard deviation of one target's unknown initial velocity, m/s; by default 150"),
    ] = None,
    period: Annotated[
        float | None,
        typer.Option(help="s between scans of one target, if empty scans have no row in the file"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", help="CSV of estimates; by default track.csv (one target) or tracks.csv"),
    ] = None,
    **given: Any,
) -> None:
    """Track the targets in a file of detections, and write labelled tracks of many, or the track of one.

    Both have covariances. Without --prior one target may be any detection of the first scan.
    """
    from gmr_gym.experiments.reading import configuration_of
    from gmr_gym.experiments.track_files import targets_asked, track_many
    from gmr_gym.experiments.track_one import track_one

    own = {
        "tracker": tracker, "prior": prior, "prior_deviations": prior_deviations, "speed": speed,
        "period": period,
    }  # fmt: skip
    settings = configuration_of(given)
    run = track_many if targets_asked(targets, settings) == "many" else track_one
    _show(run(file, out, settings, given, own))


@command()
@takes(*INPUT_GROUPS)
def inspect(
    file: Annotated[Path, typer.Argument(help="CSV, text, JSON, Parquet, AIS or ASTERIX, also in gzip")],
    *,
    write: Annotated[
        Path | None,
        typer.Option(
            "--write",
            help="also estimate deviations, clutter and motion, and write them as TOML for `track --config`",
        ),
    ] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace the file of --write")] = False,
    **given: Any,
) -> None:
    """Show how a file of detections is read: columns, units, times, scans, sensors.

    With --write, also estimate from the file what `track` needs to know.
    """
    from gmr_gym.experiments import reading, specs
    from gmr_gym.recorded import cut
    from gmr_gym.recorded.description import described

    specs.check_ending("--write", write, ".toml")
    specs.check_absent("--write", write, overwrite)
    specs.check_writable(write, beside=[file])
    settings = reading.configuration_of(given)
    found = reading.detections_of(file, settings)
    scans = cut(found, window=given["scan_window"])
    _show(described(found, scans))
    if write:
        from gmr_gym.experiments.proposing import write_proposal

        _show(write_proposal(write, file, found, scans, settings))


@command()
def warm(
    environments: Environments = [],  # noqa: B006
    tracker: Annotated[
        list[str], tracker_option("NAME or NAME:key=value,key=value; repeatable; by default all")
    ] = [],  # noqa: B006
    jobs: Jobs = -1,
) -> None:
    """Compile ahead, so that no later command waits for the compiler.

    Without options all environments and trackers, and what `track` needs.
    """
    from gmr_gym.experiments.warming import warm

    with progress("compiled") as tell:
        chosen = environments or [*READY, TUNING]
        pairs = warm(chosen, tracker, jobs, tell, files=not (environments or tracker))
    _show([f"pairs of an environment and a tracker compiled: {pairs}"])


def _show(lines: Iterable[Any]) -> None:
    screen = console()
    for line in lines:
        # a sentence is wrapped by the terminal, so that a command in it can be copied
        screen.print(line, highlight=False, markup=False, soft_wrap=isinstance(line, str))


def main() -> None:
    """Entry point: what a user got wrong is one line, not a traceback."""
    # what a batch queue sends before it kills: finished blocks are kept and named, as after Ctrl-C
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    spell_out(sys.stdout, sys.stderr)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = partial(_show_warning, warnings.showwarning)
            app()
    except Exception as error:
        if not _of_the_user(error):
            raise
        from rich.console import Console

        Console(stderr=True, soft_wrap=True, emoji=False).print(
            f"error: {_line(error)}", style="red", markup=False
        )
        sys.exit(2)


def _show_warning(usual: Any, message: Warning | str, category: type[Warning], *place: Any) -> None:
    """A warning to who typed the command is one line without a place in the code; all others are as usual."""
    if category is UserWarning:
        print(f"warning: {message}", file=sys.stderr)
    else:
        usual(message, category, *place)


def _of_the_user(error: Exception) -> bool:
    """Whether an error is about what was typed, or about the machine it was typed on."""
    if isinstance(error, ValueError | TypeError | ArithmeticError | ImportError | MemoryError | OSError):
        return True
    from gymnasium.error import Error

    from gmr_gym.evaluation.workers import WorkersLost

    return isinstance(error, Error | WorkersLost)


def _line(error: Exception) -> str:
    """An error as a line for who typed the command: of a file which it is, and what is wrong with it."""
    if isinstance(error, OSError) and error.filename is not None and error.strerror:
        return f"{error.filename}: {error.strerror[0].lower()}{error.strerror[1:]}"
    return str(error)
