"""Long work shared among workers and machines, as the command line asks for it."""

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from gmr_gym.evaluation import blocks
from gmr_gym.evaluation.montecarlo import Runs, run, run_shard
from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns
from gmr_gym.evaluation.reduction_runs import ReductionRuns
from gmr_gym.experiments.screen import console, progress

BLOCKS = "blocks"  # the folder, in a folder of results, that finished blocks of runs are kept in


class Sweep(NamedTuple):
    """What is asked of every scenario of a command, and of whom."""

    runs: int
    seed: int
    jobs: int
    backend: str
    scheduler: str | None
    shard: tuple[int, int] | None  # which part of how many
    blocks: Path  # the folder in which finished blocks of runs are kept
    command: str  # to be typed again


def shard_of(text: str | None, out: Path | None) -> tuple[int, int] | None:
    """The part of how many that I/N asks for; ValueError where it is none, or where `out` is not given."""
    if text is None:
        return None
    part, _, parts = text.partition("/")
    if not part.isdecimal() or not parts.isdecimal() or not 0 < int(part) <= int(parts):
        raise ValueError(f"shard must be I/N with I from 1 to N, as in 2/3, got {text!r}")
    if out is None:
        raise ValueError("shard leaves blocks of runs to be merged; say with --out in which folder")
    return int(part), int(parts)


def say_what_is_left(blocks: Path, there: int, total: int) -> None:
    """After a shard: how many blocks of runs are in the folder, and what to do for the rest."""
    if there < total:
        rest = f"{total - there} are left to other shards; `gmr-gym merge` brings their folders together"
    else:
        rest = "none is left: the same command without --shard finds every one"
    console().print(f"{there} of {total} blocks of runs are in {blocks}, {rest}", highlight=False)


def merge_results(folders: Sequence[Path], into: Path) -> None:
    """Copies the blocks of folders of results to another, and says what became of every file. Raises
    ValueError for a folder that is none, and at the end for blocks that cannot be read."""
    for folder in folders:
        if not (folder / BLOCKS).is_dir():
            raise ValueError(f"{folder} is no folder of results: it has no {BLOCKS}")
    kinds = Runs, MultiTargetRuns, ReductionRuns
    merged = blocks.merge([folder / BLOCKS for folder in folders], into / BLOCKS, *kinds)
    screen = console()
    screen.print(f"{len(merged.copied)} blocks of runs copied to {into / BLOCKS}", highlight=False)
    for what, files in (
        ("there already, the same to the last bit", merged.present),
        ("there already with other results, which stay: other processors or libraries", merged.differing),
        ("no block of runs, left out", merged.foreign),
    ):  # fmt: skip
        for file in files:
            screen.print(f"{file}: {what}", highlight=False, markup=False)
    if merged.refused:
        raise ValueError(f"{len(merged.refused)} refused, all else is merged: {'; '.join(merged.refused)}")


Work = tuple[Any, Mapping[str, Any]]  # a scenario and the trackers in it, or mixtures and reductions


def runs_shown(label: str, work: Iterable[Work], sweep: Sweep) -> Iterator[Any]:
    """What each scenario's trackers did, one scenario after the other under one bar; of a shard, how many
    blocks there are and of how many. On Ctrl-C it says where finished ones are kept, if any is, and exits."""
    work = list(work)
    call = partial(run_shard, shard=sweep.shard) if sweep.shard else run
    kept = f"finished blocks of runs are kept in {sweep.blocks}"
    with stopped(sweep.blocks, "*.npz", kept, "no block of runs was finished"), progress(label) as report:
        for i, (scenario, trackers) in enumerate(work):
            yield call(
                scenario, trackers, sweep.runs, sweep.seed, jobs=sweep.jobs, folder=sweep.blocks,
                progress=partial(_so_far, report, i, len(work)), backend=sweep.backend,
                scheduler=sweep.scheduler,
            )  # fmt: skip


@contextmanager
def stopped(folder: Path, files: str, kept: str, nothing: str) -> Iterator[None]:
    """Within it Ctrl-C says what is kept in a folder, where there are such files, or that nothing is, and
    exits."""
    try:
        yield
    except (KeyboardInterrupt, SystemError) as error:
        if not interrupted(error):
            raise
        left = f"{kept}; the same command goes on there" if any(folder.glob(files)) else nothing
        Console(stderr=True, soft_wrap=True).print(f"stopped: {left}", highlight=False)
        sys.exit(130)


def interrupted(error: BaseException) -> bool:
    """Whether it is Ctrl-C, or what a kernel makes of one that comes while it is being called."""
    return isinstance(error, KeyboardInterrupt) or isinstance(error.__cause__, KeyboardInterrupt)


def _so_far(report: Callable[[int, int], None], before: int, parts: int, done: int, total: int) -> None:
    report(before * total + done, parts * total)
