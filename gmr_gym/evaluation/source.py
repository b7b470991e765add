"""The source code that a run depends on. It names finished runs, and every worker must have the same."""

import marshal
import socket
import sys
from collections.abc import Callable, Iterator, Mapping
from functools import cache, partial
from pathlib import Path

import joblib

PACKAGE = "gmr_gym"
# of the package's source, what only reads finished runs; and the trackers, each hashed by itself
NOT_HASHED = (
    "baselines", "cli.py", "envs", "evaluation/curves.py", "evaluation/multi_target_summary.py",
    "evaluation/summary.py", "experiments", "learning", "offline", "recorded", "replay",
)  # fmt: skip


def code(tracker) -> str:
    """Digest of the source that a run of the tracker depends on, so that an edited tracker is run again."""
    # a class typed at a prompt has no file, but has code
    typed = [
        marshal.dumps(thing.__code__.replace(co_filename=""))
        for thing in _things(tracker)
        if _file(thing.__module__) is None and hasattr(thing, "__code__")
    ]
    return joblib.hash([*typed, sources(tracker)])


def sources(tracker) -> dict[str, str]:
    """Digest of each module that a run of the tracker depends on, by name; the package is one module."""
    modules = {thing.__module__ for thing in _things(tracker)}
    return {name: digest(name) for name in (PACKAGE, *sorted(modules)) if name == PACKAGE or _file(name)}


def digest(module: str) -> str:
    """Digest of the files of an imported module."""
    if module != PACKAGE:
        return joblib.hash(Path(_file(module) or "").read_bytes())
    root = Path(__file__).parents[1]
    own = [file for file in root.glob("**/*.py") if is_hashed(file.relative_to(root))]
    return joblib.hash([file.read_bytes() for file in sorted(own)])


def is_hashed(file: Path) -> bool:
    """Whether runs depend on a file of the package, given relative to it."""
    return not any(entry in (file.as_posix(), *map(Path.as_posix, file.parents)) for entry in NOT_HASHED)


def check_sources(expected: Mapping[str, str]) -> None:
    """Check that the modules of this process have the digests of another machine.

    Parameters
    ----------
    expected : mapping of str to str
        Digest of each module by name, see `sources`.

    Raises
    ------
    ValueError
        If a module differs: its runs would be kept under a name that is not theirs.
    """
    for module, wanted in expected.items():
        # classes of __main__ are sent by value, and its file here belongs to another program
        if module != "__main__" and module in sys.modules and _imported(module) != wanted:
            raise ValueError(
                f"{module} on {socket.gethostname()} is not the source that this sweep was started with; "
                "install the same version there and restart its workers"
            )


_imported = cache(digest)  # a file edited later is not what this process has imported


def _file(module: str) -> str | None:
    return getattr(sys.modules.get(module), "__file__", None)


def _things(tracker) -> Iterator[Callable]:
    """The class of a tracker and the functions it holds, and those of the trackers it holds; the function of
    a reduction."""
    if isinstance(tracker, partial):  # a reduction
        yield from _functions(tracker)
        return
    yield type(tracker)
    for field in getattr(tracker, "__dataclass_fields__", ()):
        part = getattr(tracker, field, None)
        yield from _things(part) if hasattr(part, "__dataclass_fields__") else _functions(part)


def _functions(part) -> Iterator[Callable]:
    """The function, or those inside a partial one."""
    if isinstance(part, partial):
        for inner in (part.func, *part.args, *part.keywords.values()):
            yield from _functions(inner)
    elif callable(part):
        yield part
