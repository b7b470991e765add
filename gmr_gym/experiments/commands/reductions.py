"""Commands on reductions of a mixture."""

from pathlib import Path
from typing import Annotated

import typer

from gmr_gym.catalogue import described_reductions
from gmr_gym.envs.registry import ABOUT, TRACKING
from gmr_gym.experiments.options import (
    Backend,
    Compared,
    Example,
    Format,
    Jobs,
    Json,
    RunCount,
    Scheduler,
    Seed,
    Shard,
    choices,
    completing,
)
from gmr_gym.experiments.screen import show


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
        show(reducing.comparison(*reducing.mixture_asked(file, example), components))
        return
    out = out or Path("reduction.html")
    specs.check_ending("--out", out, *reducing.ENDINGS)
    specs.check_writable(out, beside=[file])
    specs.check_once("--method", method)
    name, mixture = reducing.mixture_asked(file, example)
    show(reducing.reduction(name, mixture, method or ["runnalls"], components, axes, out))
