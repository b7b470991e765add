"""The command line, `gmr-gym`."""

import ast
import sys
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import gymnasium as gym
import typer
from rich.console import Console

from gmr_gym.data import flight_names
from gmr_gym.envs import ENVIRONMENTS
from gmr_gym.montecarlo import Runs, run
from gmr_gym.output import (
    comparison,
    console,
    grid,
    progress,
    write_csv,
    write_json,
    write_runs,
)
from gmr_gym.reproduce import table_record
from gmr_gym.simulate import Scenario
from gmr_gym.summary import differences, summary
from gmr_gym.tracker import Tracker, make_tracker, trackers

PAPERS = {"dortenzio": "adaptive reduction of a single target's hypotheses: Tables 1-4, Fig. 1"}

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
    scenario = _scenario(env_id, world)
    candidates = {spec: _tracker(spec, scenario) for spec in tracker}
    results = _run(env_id, scenario, candidates, runs, seed, jobs, out)
    rows = summary(scenario, results)
    screen = console()
    screen.print(grid(f"{env_id}: {runs} runs, seed {seed}", rows))
    if len(results) > 1:
        screen.print(grid("paired differences", differences(scenario, results)))
    write_runs(out / "runs.csv", scenario, results)
    record = {"env": env_id, "seed": seed, "runs": runs, "tables": [table_record(env_id, world, rows)]}
    write_json(json_file or out / "evaluate.json", record)
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
    module = import_module(f"gmr_gym.reproduce.{paper}")
    known = {entry.name: entry for entry in module.TABLES}
    for name in table:
        if name not in known:
            raise ValueError(f"{paper} has no table {name!r}; choose from {', '.join(known)}")
    out = out or Path("results") / paper
    screen, records = console(), []
    for name in table or known:
        entry = known[name]
        scenario = _scenario(entry.env_id, entry.settings)
        candidates = {
            tracker: make_tracker(tracker, scenario.model, **parameters)
            for tracker, parameters in entry.trackers.items()
        }
        results = _run(f"table {name}", scenario, candidates, runs, seed, jobs, out)
        record = table_record(name, entry.settings, summary(scenario, results), entry, runs)
        records.append(record)
        screen.print(comparison(f"{paper}, table {name}: {entry.title}; {runs} runs", record))
        write_runs(out / f"runs-{name}.csv", scenario, results)
        if name == "1":
            module.figure(scenario, results, out / "figure-1.png")
    record = {"paper": paper, "seed": seed, "runs": runs, "tables": records}
    write_json(json_file or out / f"{paper}.json", record)
    write_csv(out / f"{paper}.csv", record)
    screen.print(f"tables, figures and runs are in {out}", highlight=False)


@app.command()
def watch(
    env_id: EnvId,
    tracker: Annotated[str, typer.Option("--tracker")] = "runnalls-30",
    settings: Settings = [],  # noqa: B006
    seed: Seed = 0,
    out: Annotated[Path, typer.Option("--out", help=".gif or .mp4")] = Path("episode.gif"),
) -> None:
    """One episode as a film: clutter, gates, hypotheses, truth and estimate."""
    from gmr_gym.watch import film

    scenario = _scenario(env_id, dict(map(_key_value, settings)))
    with progress("drawing") as report:
        film(scenario, _tracker(tracker, scenario), seed, out, title=tracker, progress=report)
    console().print(f"written to {out}", highlight=False)


def main() -> None:
    """Entry point: what a user got wrong is one line, not a traceback."""
    try:
        app()
    except (ValueError, TypeError, ImportError, OSError, gym.error.Error) as error:
        Console(stderr=True, soft_wrap=True).print(f"error: {error}", style="red", markup=False)
        sys.exit(2)


def _key_value(text: str) -> tuple[str, Any]:
    """key=value with the value read as a Python literal where it is one."""
    key, sign, value = text.partition("=")
    if not sign or not key:
        raise ValueError(f"expected key=value, got {text!r}")
    try:
        return key, ast.literal_eval(value)
    except (ValueError, SyntaxError):
        return key, value


def _scenario(env_id: str, world: dict[str, Any]) -> Scenario:
    env = gym.make(env_id, **world).unwrapped
    if not hasattr(env, "scenario"):
        raise ValueError(f"{env_id} is not a tracking environment; choose from {', '.join(ENVIRONMENTS)}")
    return env.scenario


def _tracker(spec: str, scenario: Scenario) -> Tracker:
    name, _, parameters = spec.partition(":")
    return make_tracker(name, scenario.model, **dict(map(_key_value, filter(None, parameters.split(",")))))


def _run(label, scenario, candidates, runs, seed, jobs, out) -> dict[str, Runs]:
    folder = out / "blocks"
    try:
        with progress(label) as report:
            return run(scenario, candidates, runs, seed, jobs=jobs, folder=folder, progress=report)
    except KeyboardInterrupt:
        kept = len(list(folder.glob("*.npz")))
        Console(stderr=True, soft_wrap=True).print(
            f"stopped: {kept} finished blocks of runs are kept in {folder}; "
            "the same command goes on from there",
            highlight=False,
        )
        sys.exit(130)
