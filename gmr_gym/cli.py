"""The command line, `gmr-gym`."""

import ast
import sys
from collections.abc import Iterator
from difflib import get_close_matches
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
import numpy as np
import typer
from rich.console import Console

from gmr_gym import detections
from gmr_gym.crowd import ManyScenario
from gmr_gym.crowd_summary import crowd_differences, crowd_summary
from gmr_gym.data import flight_names
from gmr_gym.envs import CROWDS, ENVIRONMENTS
from gmr_gym.montecarlo import run
from gmr_gym.output import (
    claims_grid,
    comparison,
    console,
    grid,
    progress,
    write_crowd_runs,
    write_csv,
    write_json,
    write_runs,
)
from gmr_gym.play import play
from gmr_gym.reducers import REDUCERS
from gmr_gym.reproduce import Map, Table, table_record
from gmr_gym.simulate import Scenario, draw
from gmr_gym.summary import differences, summary
from gmr_gym.tracker import CROWD_GROUP, Tracker, make_tracker, trackers

PAPERS = {
    "dortenzio": "adaptive reduction of a single target's hypotheses: Tables 1-4, Fig. 1",
    "li": "a radar's converted measurements, models and data association: Figs. 1-4, three regimes, a map",
    "maybeck": "an F-16 in clutter, filter banks and hypotheses: Table I, Figs. 3-7",
    "maybeck-zhang": "models in the mixture or in filter banks: either paper's trackers in either's world",
    "zhang": "models and hypotheses of a manoeuvring target reduced jointly: cases 1 and 2, Figs. 1-2",
}

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Target tracking in clutter: evaluate trackers, reproduce papers, track recorded data.",
)
EnvId = Annotated[str, typer.Argument(help="an environment's id, as `list` shows it")]
TrackerNames = Annotated[
    list[str],
    typer.Option("--tracker", help="NAME or NAME:key=value,key=value; repeat for several"),
]
Settings = Annotated[list[str], typer.Option("--set", help="key=value for the environment")]
RunCount = Annotated[int, typer.Option("--runs", min=1, help="Monte Carlo runs")]
Seed = Annotated[int, typer.Option("--seed", min=0)]
Jobs = Annotated[int, typer.Option("--jobs", help="worker processes; -1 for one per core")]
Out = Annotated[Path, typer.Option("--out", help="folder of results; a stopped run goes on there")]
Json = Annotated[Path | None, typer.Option("--json", help="also write the figures to this file")]


@app.command("list")
def list_() -> None:
    """Environments, trackers and papers."""
    screen = console()
    for title, entries in (
        ("environments", dict.fromkeys(ENVIRONMENTS, "")),
        ("segments of gmr_gym/RecordedFlight-v0", dict.fromkeys(flight_names(), "")),
        ("trackers", trackers()),
        ("trackers of many targets", trackers(CROWD_GROUP)),
        ("reductions, as in mmg-15:reduction=runnalls", dict.fromkeys(REDUCERS, "")),
        ("papers", PAPERS),
    ):
        screen.print(f"[bold]{title}[/bold]")
        for name, text in entries.items():
            screen.print(f"  {name:24} {text}".rstrip(), soft_wrap=True, markup=False)


@app.command()
def evaluate(
    env_id: EnvId,
    tracker: TrackerNames,
    settings: Settings = [],  # noqa: B006
    runs: RunCount = 100,
    seed: Seed = 0,
    jobs: Jobs = -1,
    out: Out = Path("results/evaluate"),
    json_file: Json = None,
) -> None:
    """Trackers on the same episodes of an environment, with intervals and paired differences."""
    world = dict(map(_key_value, settings))
    many = env_id in CROWDS
    scenario = _scenario(env_id, world, ManyScenario if many else Scenario)
    candidates = {spec: _tracker(spec, scenario) for spec in tracker}
    results = _run(env_id, scenario, candidates, runs, seed, jobs, out)
    rows = (crowd_summary if many else summary)(scenario, results)
    screen = console()
    screen.print(grid(f"{env_id}: {runs} runs, seed {seed}", rows))
    paired = (crowd_differences if many else differences)(scenario, results)
    if paired:
        screen.print(grid("paired differences", paired))
    if many:
        write_crowd_runs(out / "runs.csv", results)
    else:
        write_runs(out / "runs.csv", scenario, results)
    tables = [table_record(env_id, world, rows)]
    if paired:
        tables.append(table_record("paired differences", world, paired))
    record = {"env": env_id, "seed": seed, "runs": runs, "tables": tables}
    for file in filter(None, (out / "evaluate.json", json_file)):
        write_json(file, record)
    screen.print(f"written to {out}", highlight=False)


@app.command()
def reproduce(
    paper: Annotated[str, typer.Argument(help="a paper's short name, as `list` shows it")],
    table: Annotated[list[str], typer.Option("--table", help="only this table; repeatable")] = [],  # noqa: B006
    runs: RunCount = 1000,
    seed: Seed = 0,
    jobs: Jobs = -1,
    out: Annotated[Path | None, typer.Option("--out", help="folder of results")] = None,
    json_file: Json = None,
) -> None:
    """A paper's tables and figures: its numbers beside ours, with intervals and verdicts."""
    if paper not in PAPERS:
        raise ValueError(f"unknown paper {paper!r}; choose one of {', '.join(PAPERS)}")
    module = import_module(f"gmr_gym.reproduce.{paper.replace('-', '_')}")
    known = {entry.name: entry for entry in (*module.TABLES, *getattr(module, "MAPS", ()))}
    for name in table:
        if name not in known:
            raise ValueError(f"{paper} has no table {name!r}; choose from {', '.join(known)}")
    out = out or Path("results") / paper
    screen, records, evidence = console(), [], {}
    for name in table or known:
        if isinstance(known[name], Map):
            record = _mapped(module, known[name], runs, seed, jobs, out)
            screen.print(comparison(f"{paper}, {name}: {known[name].title}", record, known[name].columns))
            records.append(record)
            continue
        (first, *paired), kept = _reproduced(module, known[name], runs, seed, jobs, out)
        title = f"{paper}, table {name}: {known[name].title}; {runs} runs"
        screen.print(comparison(title, first, known[name].columns))
        for record in paired:
            screen.print(comparison(record["name"], record, list(record["rows"][0]["metrics"])))
        records += [first, *paired]
        if kept is not None:
            evidence[name] = kept
    record = {"paper": paper, "seed": seed, "runs": runs, "tables": records}
    if evidence:
        record["claims"] = module.claims(evidence)
        screen.print(claims_grid(record["claims"]))
    for file in filter(None, (out / f"{paper}.json", json_file)):
        write_json(file, record)
    write_csv(out / f"{paper}.csv", record)
    screen.print(f"tables, figures and runs are in {out}", highlight=False)


def _reproduced(module, entry: Table, runs, seed, jobs, out) -> tuple[list[dict[str, Any]], Any]:
    """Runs a table and leaves its files; the records of it, and the evidence its paper's claims need. The
    results are gone by then: a table of a thousand runs is a hundred megabytes."""
    scenario = _scenario(entry.env_id, entry.settings)
    candidates = _candidates(entry, scenario)
    results = _run(f"table {entry.name}", scenario, candidates, runs, seed, jobs, out)
    rows = entry.summarise(scenario, results)
    write_runs(out / f"runs-{entry.name}.csv", scenario, results)
    module.figures(entry, scenario, results, rows, out)
    evidence = entry.evidence(scenario, results) if entry.evidence else None
    records = [table_record(entry.name, entry.settings, rows, entry, runs)]
    if entry.paired:
        name = f"{entry.name}, paired differences"
        records.append(table_record(name, entry.settings, entry.paired(scenario, results)))
    return records, evidence


def _mapped(module, entry: Map, runs, seed, jobs, out) -> dict[str, Any]:
    """Runs every cell of a map and leaves its drawing; the record of it."""
    scenarios = {name: _scenario(entry.env_id, settings) for name, settings in entry.cells().items()}
    work = [(scenario, _candidates(entry, scenario)) for scenario in scenarios.values()]
    runs = max(2, runs // entry.share)
    results = _runs(entry.name, work, runs, seed, jobs, out)
    rows = {
        name: entry.summarise(scenario, found)
        for (name, scenario), found in zip(scenarios.items(), results, strict=True)
    }
    module.map_figures(entry, rows, out)
    return table_record(entry.name, entry.settings | {"runs": runs}, rows)


def _candidates(entry: Table | Map, scenario: Scenario) -> dict[str, Tracker]:
    found = {}
    for spec, parameters in entry.trackers.items():
        name, further = _spec(spec)
        found[spec] = make_tracker(name, scenario.model, **parameters, **further)
    return found


@app.command()
def watch(
    env_id: EnvId,
    tracker: Annotated[str, typer.Option("--tracker", help="runnalls-30 or mmg-15 unless given")] = "",
    settings: Settings = [],  # noqa: B006
    seed: Seed = 0,
    out: Annotated[Path, typer.Option("--out", help=".gif or .mp4")] = Path("episode.gif"),
) -> None:
    """One episode as a film: clutter, gates, hypotheses, truth and estimate."""
    from gmr_gym.watch import film

    scenario = _scenario(env_id, dict(map(_key_value, settings)))
    tracker = tracker or ("mmg-15" if len(scenario.model.motions) > 1 else "runnalls-30")
    with progress("drawing") as report:
        film(scenario, _tracker(tracker, scenario), seed, out, title=tracker, progress=report)
    console().print(f"written to {out}", highlight=False)


@app.command()
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
    scenario = _scenario(env_id, dict(map(_key_value, settings)))
    tracker = tracker or ("imm-pda" if len(scenario.model.motions) > 1 else "pda")
    episode = draw(scenario, seed)
    z = [played.scan.z for played in play(scenario, _tracker(tracker, scenario), episode)]
    times = scenario.period * np.arange(1, len(z) + 1)
    detections.write_scans(out, times, z, scenario.sensor.coordinates)
    if truth:
        positions = episode.x[:, list(scenario.position)]
        names = [f"{axis}_m" for axis in "xyz"[: positions.shape[1]]]
        detections.write_scans(truth, times, list(positions[:, None]), names)
    console().print(f"written to {out}", highlight=False)


@app.command("track")
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
    if motion != "constant-velocity":
        raise ValueError(f"unknown model {motion!r}; choose constant-velocity")
    if bool(prior) != bool(prior_deviations):
        raise ValueError("give prior and prior_deviations together, or neither")
    scans = detections.read_scans(file)
    detections.check_positions(file, scans)
    if prior:
        state = _numbers("prior", prior), _numbers("prior_deviations", prior_deviations)
        start, prior_time = detections.prior_given(*state), None
    else:
        scans = detections.from_first_detection(scans)
        start = detections.prior_from_first_scan(scans.z[0], sensor_deviation, speed)
        prior_time = scans.times[0]

    def build(interval: float) -> Tracker:
        told = detections.constant_velocity_model(
            interval, start, axes=len(scans.coordinates), acceleration_deviation=acceleration_deviation,
            sensor_deviation=sensor_deviation, detection_probability=detection_probability,
            clutter_density=clutter_density,
        )  # fmt: skip
        name, parameters = _spec(tracker)
        return make_tracker(name, told, **parameters)

    track = detections.track(scans, build, period, prior_time)
    names = [*scans.coordinates, *(f"{name}_velocity" for name in scans.coordinates)]
    detections.write_track(out, track, names)
    screen = console()
    for i in np.flatnonzero(~track.alive)[:1]:
        screen.print(f"given up at scan {i + 1}, time {track.times[i]:g}: from there on it only coasts")
    screen.print(f"{len(track.times)} scans tracked; written to {out}", highlight=False)


def main() -> None:
    """Entry point: what a user got wrong is one line, not a traceback."""
    try:
        app()
    except (
        ValueError,
        TypeError,
        ArithmeticError,
        ImportError,
        MemoryError,
        OSError,
        gym.error.Error,
    ) as error:
        Console(stderr=True, soft_wrap=True).print(f"error: {error}", style="red", markup=False)
        sys.exit(2)


def _key_value(text: str) -> tuple[str, Any]:
    """key=value with the value read as a Python literal where it is one."""
    key, sign, value = text.partition("=")
    if not sign or not key:
        raise ValueError(f"expected key=value, got {text!r}")
    for read in (ast.literal_eval, float):  # float reads nan and inf, which are then refused by name
        try:
            return key, read(value)
        except (ValueError, SyntaxError):
            pass
    return key, value


def _scenario(env_id: str, world: dict[str, Any], kind: type = Scenario) -> Any:
    bare = {name.partition("/")[2]: name for name in ENVIRONMENTS}
    if env_id not in gym.registry and (
        near := get_close_matches(env_id.partition("/")[2] or env_id, bare, n=1)
    ):
        raise ValueError(f"unknown environment {env_id!r}; did you mean {bare[near[0]]!r}?")
    scenario = getattr(gym.make(env_id, **world).unwrapped, "scenario", None)
    if not isinstance(scenario, kind):
        single = ", ".join(name for name in ENVIRONMENTS if name not in CROWDS)
        what = "has many targets" if env_id in CROWDS else "is not a tracking environment"
        raise ValueError(f"{env_id} {what}; choose from {single}")
    return scenario


def _tracker(text: str, scenario: Scenario | ManyScenario) -> Any:
    name, parameters = _spec(text)
    told = scenario.population if isinstance(scenario, ManyScenario) else scenario.model
    return make_tracker(name, told, **parameters)


def _spec(text: str) -> tuple[str, dict[str, Any]]:
    """A tracker's name and parameters from NAME:key=value,key=value."""
    name, _, parameters = text.partition(":")
    return name, dict(map(_key_value, filter(None, parameters.split(","))))


def _numbers(name: str, text: str) -> list[float]:
    try:
        return [float(number) for number in text.split(",")]
    except ValueError:
        raise ValueError(f"{name} must be numbers with commas between, got {text!r}") from None


def _so_far(report, before: int, parts: int, done: int, total: int) -> None:
    report(before * total + done, parts * total)


def _run(label, scenario, candidates, runs, seed, jobs, out) -> dict[str, Any]:
    (results,) = _runs(label, [(scenario, candidates)], runs, seed, jobs, out)
    return results


def _runs(label, work, runs, seed, jobs, out) -> Iterator[dict[str, Any]]:
    """The results of each scenario with its trackers, one after the other under one bar."""
    folder = out / "blocks"
    try:
        with progress(label) as report:
            for i, (scenario, candidates) in enumerate(work):
                tell = partial(_so_far, report, i, len(work))
                yield run(scenario, candidates, runs, seed, jobs=jobs, folder=folder, progress=tell)
    except KeyboardInterrupt:
        Console(stderr=True, soft_wrap=True).print(
            f"stopped: finished blocks of runs are kept in {folder}; the same command goes on from there",
            highlight=False,
        )
        sys.exit(130)
