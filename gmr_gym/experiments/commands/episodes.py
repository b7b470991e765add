"""The command that writes episodes to learn from offline."""

from pathlib import Path
from typing import Annotated

import typer

from gmr_gym.experiments.options import AnyEnvId, Seed, Settings, tracker_option
from gmr_gym.experiments.screen import progress, show


def episodes(
    env_id: AnyEnvId,
    tracker: Annotated[
        list[str],
        tracker_option("repeatable; of ReductionTuning the policy: learned, constant:alpha=0.1, random"),
    ],
    *,
    count: Annotated[int, typer.Option("--episodes", min=1, help="of every tracker")] = 100,
    settings: Settings = [],  # noqa: B006
    seed: Seed = 0,
    out: Annotated[
        Path, typer.Option("--out", help="folder of the data set, its name with a version: turning-pda-v0")
    ],
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace a data set that is there")] = False,
) -> None:
    """Write episodes of trackers or policies as a Minari data set, to learn from offline."""
    from gmr_gym.experiments.episodes import write_episodes

    with progress("episodes") as report:
        lines = write_episodes(env_id, settings, tracker, count, seed, out, overwrite, progress=report)
    show(lines)
