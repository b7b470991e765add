"""What can be typed on the command line: choices, how a shell completes them, and the options that commands
share. Nothing that a command runs is imported here."""

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand

from gmr_gym.catalogue import (
    BACKENDS,
    GROUP,
    HYPOTHESIS_REDUCTIONS,
    MULTI_TARGET_GROUP,
    described,
    described_reductions,
)
from gmr_gym.envs.registry import ABOUT, MULTI_TARGET, RECORDED, TRACKED, TUNINGS
from gmr_gym.experiments.figures import ALL_FIGURES
from gmr_gym.experiments.papers.registry import PAPERS, paper_named

FORMATS = ("table", "markdown", "csv", "latex", "json")
EXAMPLES = {
    "crouse": "ten components in one dimension, of Crouse et al. 2011",
    "posterior": "hypotheses of a turning target before their reduction",
    "random": "ten components drawn at random in four dimensions, as in the table of Crouse et al. 2011",
}
TARGETS = ("one", "many")
COMPARED = ("all",)
IMPORTS = "reduction=MODULE:FUNCTION imports MODULE"
MODELS = {"constant-velocity": "a target whose velocity changes by a random acceleration"}

Named = Mapping[str, str]  # what a shell completes to, each with a line about it


def choice(what: str, names: Collection[str]) -> dict[str, Any]:
    """Arguments of an option or argument that takes one of these names, and no other."""

    def check(ctx: typer.Context, value: str | None) -> str | None:
        absent = value is None or ctx.resilient_parsing  # while a shell completes, there may be none
        if not absent and value not in names:
            one = "one of " if len(names) > 1 else ""
            raise ValueError(f"unknown {what} {value!r}; choose {one}{', '.join(names)}")
        return value

    lines = names if isinstance(names, Mapping) else dict.fromkeys(names, "")
    return {"callback": check, "autocompletion": completing(lines)}


def choices(what: str, names: Collection[str]) -> dict[str, Any]:
    """`choice` for an option that is repeated."""
    one = choice(what, names)

    def check(ctx: typer.Context, values: list[str]) -> list[str]:
        return [one["callback"](ctx, value) for value in values]

    return {**one, "callback": check}


def completing(lines: Named) -> Callable[[str], list[tuple[str, str]]]:
    """A completion to fixed names."""
    return lambda incomplete: [*lines.items()]


def complete_tracker(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    """Trackers for the environment that was typed before; reductions after NAME:reduction=."""
    before, parameter, _ = incomplete.rpartition("reduction=")
    if parameter:
        known = described_reductions() | HYPOTHESIS_REDUCTIONS
        return [(f"{before}{parameter}{name}", line) for name, line in known.items()]
    return [*described(MULTI_TARGET_GROUP if _typed(ctx, MULTI_TARGET | RECORDED) else GROUP).items()]


def complete_table(ctx: typer.Context, incomplete: str) -> list[str]:
    """Tables of the paper that was typed before."""
    paper = _typed(ctx, PAPERS)
    if paper is None:
        return []
    return [*paper_named(paper).entries()]


def _typed(ctx: typer.Context, names: Iterable[str]) -> str | None:
    """The one of the names that was typed before; words after an option without its value are not parsed."""
    words = [*ctx.args, *ctx.params.values()]
    return next((name for name in names if name in words), None)


class Once(TyperCommand):
    """A command whose options, but for those that make lists, are given once: of two the last would count."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        _, _, given = self.make_parser(ctx).parse_args(args=list(args))
        for parameter, count in Counter(given).items():
            if count > 1 and not parameter.multiple and not ctx.resilient_parsing:
                raise ValueError(f"{parameter.opts[0]} is given {count} times")
        return super().parse_args(ctx, args)


EnvId = Annotated[
    str,
    typer.Argument(
        help=f"{', '.join(TRACKED)}; or MODULE:ID for one of your own (imports MODULE)",
        autocompletion=completing({env_id: ABOUT[env_id] for env_id in TRACKED}),
    ),
]
AnyEnvId = Annotated[
    str,
    typer.Argument(
        help=f"{', '.join((*TRACKED, *TUNINGS))}; or MODULE:ID for one of your own (imports MODULE)",
        autocompletion=completing(ABOUT),
    ),
]
Environments = Annotated[
    list[str],
    typer.Option(
        "--env",
        help="environment; repeatable; by default all without files, on the leaderboard but DenseTargets",
        **choices("environment", ABOUT),
    ),
]
PaperName = Annotated[str, typer.Argument(help=", ".join(PAPERS), **choice("paper", PAPERS))]
Tables = Annotated[
    list[str],
    typer.Option("--table", help="only this table; repeatable", autocompletion=complete_table),
]
TrackerNames = Annotated[
    list[str],
    typer.Option(
        "--tracker",
        help=f"NAME or NAME:key=value,key=value; repeat for several. {IMPORTS}",
        autocompletion=complete_tracker,
    ),
]
MoreTrackers = Annotated[
    list[str],
    typer.Option(
        "--tracker",
        help="add this tracker as a row of every table: NAME or NAME:key=value,key=value; repeatable",
        autocompletion=complete_tracker,
    ),
]
Example = Annotated[
    str | None,
    typer.Option(
        "--example",
        metavar="|".join(EXAMPLES),
        help="mixture to reduce, in place of a file",
        **choice("example", EXAMPLES),
    ),
]
Compared = Annotated[
    str | None,
    typer.Option(
        "--compare",
        metavar="|".join(COMPARED),
        help="show every reduction in one table, and write no file",
        **choice("reductions to compare", COMPARED),
    ),
]
Settings = Annotated[
    list[str], typer.Option("--set", help="argument of the environment, key=value; repeatable")
]
GridSettings = Annotated[
    list[str],
    typer.Option(
        "--set",
        help="argument of the environment, key=value,value; repeat for a grid; (1, 2) is one value",
    ),
]
Metrics = Annotated[
    list[str],
    typer.Option(
        "--metric", help="show only this figure; repeatable", autocompletion=completing(ALL_FIGURES)
    ),
]
Format = Annotated[
    str,
    typer.Option(
        "--format",
        metavar="|".join(FORMATS),
        help="format of the printed output; with all but table, remarks go to the error stream",
        **choice("format", FORMATS),
    ),
]
RunCount = Annotated[int, typer.Option("--runs", min=1, help="Monte Carlo runs")]
Seed = Annotated[int, typer.Option("--seed", min=0, help="seed of the random numbers")]
Jobs = Annotated[int, typer.Option("--jobs", help="worker processes; -1 for one per core, -2 for one less")]
Backend = Annotated[
    str,
    typer.Option(
        "--backend",
        metavar="|".join(BACKENDS),
        help="where runs are computed; loky: on this machine",
        **choice("backend", BACKENDS),
    ),
]
Scheduler = Annotated[
    str | None, typer.Option("--scheduler", help="address of the Dask or Ray cluster; all of it is used")
]
Shard = Annotated[str | None, typer.Option("--shard", help="I/N: only part I of N of the runs; see `merge`")]
Json = Annotated[Path | None, typer.Option("--json", help="also write the figures to this file")]
MotionModel = Annotated[
    str,
    typer.Option(
        "--model", metavar="|".join(MODELS), help="motion model of the target", **choice("model", MODELS)
    ),
]


def tracker_option(help: str) -> Any:
    """The option --tracker of a command that takes one."""
    return typer.Option("--tracker", help=f"{help}. {IMPORTS}", autocompletion=complete_tracker)
