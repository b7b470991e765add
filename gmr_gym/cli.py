"""The command line, `gmr-gym`: its commands by name, and what it makes of errors. The commands are in
`gmr_gym.experiments.commands`."""

import signal
import sys
import warnings
from collections.abc import Callable
from functools import partial
from typing import Annotated, Any

import typer

from gmr_gym.experiments.commands.episodes import episodes
from gmr_gym.experiments.commands.evaluating import evaluate, leaderboard, merge, sweep
from gmr_gym.experiments.commands.files import inspect, record, track
from gmr_gym.experiments.commands.installed import list_, warm
from gmr_gym.experiments.commands.reductions import compare_reductions, reduce
from gmr_gym.experiments.commands.reproducing import reproduce
from gmr_gym.experiments.commands.tuning import tune, tune_recording
from gmr_gym.experiments.commands.watching import watch
from gmr_gym.experiments.options import Once
from gmr_gym.experiments.screen import spell_out
from gmr_gym.version import __version__

COMMANDS: dict[str, Callable[..., None]] = {  # in the order of the help
    "list": list_, "evaluate": evaluate, "sweep": sweep, "leaderboard": leaderboard,
    "tune": tune, "tune-recording": tune_recording, "compare-reductions": compare_reductions,
    "reproduce": reproduce, "merge": merge, "watch": watch, "reduce": reduce, "record": record,
    "episodes": episodes, "track": track, "inspect": inspect, "warm": warm,
}  # fmt: skip

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Target tracking in clutter: evaluate trackers, reproduce papers, track recorded data.",
)
for name, function in COMMANDS.items():
    app.command(name, cls=Once)(function)


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
