"""The screen that a command writes to, and progress on long work."""

import codecs
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from io import TextIOWrapper
from typing import Any

from rich.console import Console


def spell_out(*streams: Any) -> None:
    """Has the streams show in plain letters what their encoding lacks, where they would raise."""
    for stream in streams:
        if isinstance(stream, TextIOWrapper):
            stream.reconfigure(errors=SPELLED)


def _spelled(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    from gmr_gym.experiments.sheets import plain

    return plain(error.object[error.start : error.end]), error.end


SPELLED = "gmr-gym-spelled"
codecs.register_error(SPELLED, _spelled)


def console() -> Console:
    """Wide and plain where the output is no terminal, since a file has no width. COLUMNS, which a shell does
    not pass on by itself, is a width that is asked for."""
    spell_out(sys.stdout)
    screen = Console()
    return screen if screen.is_terminal or "COLUMNS" in os.environ else Console(width=240)


def show(lines: Iterable[Any]) -> None:
    """Prints lines; a sentence is wrapped by the terminal, so that a command in it can be copied."""
    screen = console()
    for line in lines:
        screen.print(line, highlight=False, markup=False, soft_wrap=isinstance(line, str))


def waiting(label: str) -> AbstractContextManager:
    """Within it a terminal shows that work is done; elsewhere nothing is printed."""
    return Console(stderr=True).status(label)


@contextmanager
def progress(label: str) -> Iterator[Callable[[int, int], None]]:
    """A progress(done, total) callback: a bar on a terminal, a line every tenth elsewhere."""
    console = Console(stderr=True)
    if not console.is_terminal:
        said = -1

        def tell(done: int, total: int) -> None:
            nonlocal said
            if done * 10 // total > said:
                said = done * 10 // total
                print(f"{label}: {done} of {total}", file=sys.stderr, flush=True)

        yield tell
        return
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console, transient=True) as progress:
        task = progress.add_task(label, total=None)
        yield lambda done, total: progress.update(task, completed=done, total=total)
