"""The command that reproduces papers."""

from pathlib import Path
from typing import Annotated

import typer

from gmr_gym.experiments.options import (
    Backend,
    Format,
    Jobs,
    Json,
    MoreTrackers,
    PaperName,
    Scheduler,
    Seed,
    Shard,
    Tables,
)


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
