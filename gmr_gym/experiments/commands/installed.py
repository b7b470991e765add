"""Commands on what is installed: lists of names, and compiling ahead."""

from typing import Annotated

from gmr_gym.catalogue import (
    GROUP,
    HYPOTHESIS_REDUCTIONS,
    MULTI_TARGET_GROUP,
    described,
    described_reductions,
)
from gmr_gym.data.loader import flight_names
from gmr_gym.envs.registry import ABOUT, READY, TUNING
from gmr_gym.experiments.options import Environments, Jobs, tracker_option
from gmr_gym.experiments.papers.registry import PAPERS
from gmr_gym.experiments.screen import console, progress, show


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
    show([f"pairs of an environment and a tracker compiled: {pairs}"])
