"""The command line, `gmr-gym`."""

import signal
import sys
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
import numpy as np
import typer
from rich.console import Console

from gmr_gym.data.loader import flight_names
from gmr_gym.envs.registry import ENVIRONMENTS
from gmr_gym.evaluation import recordings as detections
from gmr_gym.evaluation.blocks import check_folder
from gmr_gym.evaluation.loop import play
from gmr_gym.evaluation.workers import WorkersLost
from gmr_gym.experiments.output import console, progress, spell_out
from gmr_gym.experiments.papers.registry import PAPERS, paper_named
from gmr_gym.experiments.records import check_free, named, question
from gmr_gym.experiments.running import rerun, sharded
from gmr_gym.experiments.specs import (
    Once,
    check_ending,
    check_once,
    check_writable,
    evaluated,
    key_values,
    numbers,
    parsed,
    said,
    scenario_of,
    single_target,
    tracker_of,
)
from gmr_gym.experiments.sweeps import BLOCKS, Sweep, merge_results, runs_shown, say_what_is_left, shard_of
from gmr_gym.filters.registry import MULTI_TARGET_GROUP, make_tracker, trackers
from gmr_gym.filters.tracker import Tracker
from gmr_gym.models.priors import constant_velocity_model, prior_from_first_scan, prior_given
from gmr_gym.reduction.registry import REDUCERS
from gmr_gym.simulation.multi_target import MultiTargetScenario
from gmr_gym.simulation.single_target import draw
from gmr_gym.version import __version__

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Target tracking in clutter: evaluate trackers, reproduce papers, track recorded data.",
)
command = partial(app.command, cls=Once)
EnvId = Annotated[
    str,
    typer.Argument(
        help="an environment's id, as `list` shows it; of your own MODULE:ID, which imports MODULE"
    ),
]
TrackerNames = Annotated[
    list[str],
    typer.Option(
        "--tracker",
        help="NAME or NAME:key=value,key=value; repeat for several. reduction=MODULE:FUNCTION imports MODULE",
    ),
]
Settings = Annotated[list[str], typer.Option("--set", help="key=value for the environment")]
RunCount = Annotated[int, typer.Option("--runs", min=1, help="Monte Carlo runs")]
Seed = Annotated[int, typer.Option("--seed", min=0)]
Jobs = Annotated[int, typer.Option("--jobs", help="worker processes; -1 for one per core, -2 for one less")]
Backend = Annotated[str, typer.Option("--backend", help="loky (this machine), dask or ray")]
Scheduler = Annotated[
    str | None, typer.Option("--scheduler", help="address of the Dask or Ray cluster, all of which is used")
]
Shard = Annotated[str | None, typer.Option("--shard", help="I/N: only every N-th block of runs; see `merge`")]
Json = Annotated[Path | None, typer.Option("--json", help="also write the figures to this file")]


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
    """Environments, trackers and papers."""
    screen = console()
    for title, entries in (
        ("environments", dict.fromkeys(ENVIRONMENTS, "")),
        ("segments of gmr_gym/RecordedFlight-v0", dict.fromkeys(flight_names(), "")),
        ("trackers", trackers()),
        ("trackers of many targets", trackers(MULTI_TARGET_GROUP)),
        ("reductions, as in mmg-15:reduction=runnalls", dict.fromkeys(REDUCERS, "")),
        ("papers", PAPERS),
    ):
        screen.print(f"[bold]{title}[/bold]")
        for name, text in entries.items():
            screen.print(f"  {name:24} {text}".rstrip(), soft_wrap=True, markup=False)


@command()
def evaluate(
    env_id: EnvId,
    tracker: TrackerNames,
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
            "--out", help="folder of results; one in results/evaluate, named by what is asked, unless given"
        ),
    ] = None,
    json_file: Json = None,
) -> None:
    """Trackers on the same episodes of an environment, with intervals and paired differences."""
    part = shard_of(shard, out)
    world = key_values(settings)
    check_once("--tracker", tracker)
    scenario = scenario_of(env_id, world)
    candidates = {spec: tracker_of(spec, scenario) for spec in tracker}
    told = {spec: dict(zip(("name", "parameters"), parsed(spec), strict=True)) for spec in tracker}
    asked = question(env=env_id, settings=world, trackers=told, runs=runs, seed=seed)
    # blocks of runs are shared: another tracker, or more runs, begin with those that are there
    root = out or Path("results/evaluate")
    out = out or root / f"{env_id.rpartition('/')[2]}-{named(asked)}"
    check_writable(out / "evaluate.json", out / "runs.csv", json_file)
    sweep = Sweep(runs, seed, jobs, backend, scheduler, part, root / BLOCKS)
    if not part:
        check_free(out / "evaluate.json", asked)
        _show(evaluated(asked, scenario, candidates, sweep, out, json_file))
        return
    (left,) = runs_shown(env_id, [(scenario, candidates)], sweep)
    say_what_is_left(sweep.blocks, *left)


@command()
def reproduce(
    paper: Annotated[str, typer.Argument(help="a paper's short name, as `list` shows it")],
    table: Annotated[list[str], typer.Option("--table", help="only this table; repeatable")] = [],  # noqa: B006
    runs: Annotated[
        int | None,
        typer.Option("--runs", min=1, help="Monte Carlo runs; as many as the paper's page has unless given"),
    ] = None,
    seed: Seed = 0,
    jobs: Jobs = -1,
    backend: Backend = "loky",
    scheduler: Scheduler = None,
    shard: Shard = None,
    out: Annotated[Path | None, typer.Option("--out", help="folder of results")] = None,
    json_file: Json = None,
) -> None:
    """A paper's tables and figures: its numbers beside ours, with intervals and verdicts."""
    asked_for = paper_named(paper)
    known = asked_for.entries()
    for name in table:
        if name not in known:
            raise ValueError(f"{paper} has no table {name!r}; choose from {', '.join(known)}")
    check_once("--table", table)
    part, usual = shard_of(shard, out), asked_for.tables[0].runs
    runs, names = runs or usual, table or list(known)
    asked = question(paper=paper, asked=names, runs=runs, seed=seed)
    root = out or Path("results") / paper
    other = [f"table-{name}" for name in table]
    other += [f"runs-{runs}"] * (runs != usual) + [f"seed-{seed}"] * (seed > 0)
    out = out or root / "-".join(other)
    check_writable(out / f"{paper}.json", json_file)
    sweep = Sweep(runs, seed, jobs, backend, scheduler, part, root / BLOCKS)
    if part:
        say_what_is_left(sweep.blocks, *sharded((known[name] for name in names), sweep))
        return
    check_free(out / f"{paper}.json", asked)
    _show(rerun(paper, asked_for, [known[name] for name in names], asked, sweep, out, json_file))


@command()
def merge(
    folders: Annotated[list[Path], typer.Argument(help="folders of results that shards left")],
    into: Annotated[Path, typer.Option("--into", help="folder of results that the whole goes to")],
) -> None:
    """Brings together what shards of a sweep left on machines that share nothing: the same command without
    its shard, with this folder as its --out, then finds every block of runs."""
    check_folder(into / BLOCKS)
    merge_results(folders, into)


@command()
def watch(
    env_id: EnvId,
    tracker: Annotated[
        str, typer.Option("--tracker", help="runnalls-30, mmg-15 or learning-pmb unless given")
    ] = "",
    settings: Settings = [],  # noqa: B006
    seed: Seed = 0,
    out: Annotated[Path, typer.Option("--out", help=".gif or .mp4")] = Path("episode.gif"),
) -> None:
    """One episode as a film: clutter, gates, hypotheses, truth and estimates."""
    from gmr_gym.experiments.film import film

    check_writable(out)
    scenario = scenario_of(env_id, key_values(settings))
    if isinstance(scenario, MultiTargetScenario):
        tracker = tracker or "learning-pmb"
    else:
        tracker = tracker or ("mmg-15" if len(scenario.model.motions) > 1 else "runnalls-30")
    with progress("drawing") as report:
        film(scenario, tracker_of(tracker, scenario), seed, out, title=tracker, progress=report)
    console().print(f"written to {out}", highlight=False)


@command()
def record(
    env_id: EnvId,
    tracker: Annotated[
        str, typer.Option("--tracker", help="whom a following window follows; pda or imm-pda unless given")
    ] = "",
    settings: Settings = [],  # noqa: B006
    seed: Seed = 0,
    out: Annotated[Path, typer.Option("--out", help="CSV of detections")] = Path("detections.csv"),
    truth: Annotated[Path | None, typer.Option("--truth", help="also a CSV of the truth")] = None,
) -> None:
    """One episode's detections in a file, as `track` reads them; of a radar in range and angles, which it
    does not."""
    check_writable(out, truth)
    check_ending("--out", out, ".csv")
    check_ending("--truth", truth, ".csv")
    scenario = single_target(env_id, key_values(settings))
    tracker = tracker or ("imm-pda" if len(scenario.model.motions) > 1 else "pda")
    episode = draw(scenario, seed)
    z = [played.scan.z for played in play(scenario, tracker_of(tracker, scenario), episode)]
    times = scenario.period * np.arange(1, len(z) + 1)
    detections.write_scans(out, times, z, scenario.sensor.coordinates)
    if truth:
        positions = episode.x[:, list(scenario.position)]
        names = [f"{axis}_m" for axis in "xyz"[: positions.shape[1]]]
        detections.write_scans(truth, times, list(positions[:, None]), names)
    console().print(f"written to {out}", highlight=False)


@command("track")
def track_(
    file: Annotated[Path, typer.Argument(help="CSV: time (s), then coordinates (m); a row a detection")],
    sensor_deviation: Annotated[float, typer.Option(help="of a detection, m")],
    clutter_density: Annotated[float, typer.Option(help="false detections a scan per m^2 (m^3 in space)")],
    tracker: Annotated[str, typer.Option("--tracker")] = "runnalls-30",
    motion: Annotated[str, typer.Option("--model", help="how the target moves")] = "constant-velocity",
    acceleration_deviation: Annotated[float, typer.Option(help="of the target, m/s^2")] = 3.0,
    detection_probability: Annotated[float, typer.Option()] = 0.9,
    prior: Annotated[str, typer.Option(help="first state: positions, velocities, comma between")] = "",
    prior_deviations: Annotated[str, typer.Option(help="its standard deviations likewise")] = "",
    speed: Annotated[float, typer.Option(help="m/s, deviation of the unknown first velocity")] = 150.0,
    period: Annotated[float | None, typer.Option(help="s, if empty scans leave no row")] = None,
    out: Annotated[Path, typer.Option("--out", help="CSV of estimates")] = Path("track.csv"),
) -> None:
    """Recorded detections in, estimates with their covariances out. Without --prior the track starts
    from the first scan: any of its detections may be the target."""
    check_writable(out, beside=file)
    check_ending("--out", out, ".csv")
    if motion != "constant-velocity":
        raise ValueError(f"unknown model {motion!r}; choose constant-velocity")
    if bool(prior) != bool(prior_deviations):
        raise ValueError("give --prior and --prior-deviations together, or neither")
    if not 0 < speed < np.inf:
        raise ValueError(f"--speed must be positive and finite, got {speed}")
    scans = detections.read_scans(file)
    detections.check_positions(file, scans)
    if prior:
        axes = len(scans.coordinates)
        state = numbers("--prior", prior), numbers("--prior-deviations", prior_deviations)
        for name, values in zip(("--prior", "--prior-deviations"), state, strict=True):
            if len(values) != 2 * axes:
                raise ValueError(
                    f"{name} must be {axes} positions and {axes} velocities, got {len(values)} numbers"
                )
        start, prior_time = prior_given(*state), None
    else:
        scans = detections.from_first_detection(scans)
        start = prior_from_first_scan(scans.z[0], sensor_deviation, speed)
        prior_time = scans.times[0]
    if len(scans.times) == 1 and not (prior and period):
        raise ValueError(
            f"{file} holds one scan to start from and none after it: give --prior with --prior-deviations, "
            "and --period, or a file with another scan"
        )

    def build(interval: float) -> Tracker:
        told = constant_velocity_model(
            interval, start, axes=len(scans.coordinates), acceleration_deviation=acceleration_deviation,
            sensor_deviation=sensor_deviation, detection_probability=detection_probability,
            clutter_density=clutter_density,
        )  # fmt: skip
        name, parameters = parsed(tracker)
        return make_tracker(name, told, **parameters)

    track = detections.track(scans, build, period, prior_time)
    names = [*scans.coordinates, *(f"{name}_velocity" for name in scans.coordinates)]
    detections.write_track(out, track, names)
    screen = console()
    for i in np.flatnonzero(~track.alive)[:1]:
        screen.print(f"given up at scan {i + 1}, time {track.times[i]:g}: from there on it only coasts")
    screen.print(f"{len(track.times)} scans tracked; written to {out}", highlight=False)


def _show(said: Iterable[Any]) -> None:
    screen = console()
    for what in said:
        screen.print(what, highlight=False, markup=False)


def main() -> None:
    """Entry point: what a user got wrong is one line, not a traceback."""
    # what a batch queue sends before it kills: finished blocks are kept and named, as after Ctrl-C
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    spell_out(sys.stdout, sys.stderr)
    try:
        app()
    except (
        ValueError,
        TypeError,
        ArithmeticError,
        ImportError,
        MemoryError,
        OSError,
        WorkersLost,
        gym.error.Error,
    ) as error:
        Console(stderr=True, soft_wrap=True).print(f"error: {said(error)}", style="red", markup=False)
        sys.exit(2)
