"""The command that draws an episode."""

from pathlib import Path
from typing import Annotated

import typer

from gmr_gym.experiments.options import EnvId, Seed, Settings, tracker_option
from gmr_gym.experiments.screen import progress, show


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
    show([f"written to {out}"])
