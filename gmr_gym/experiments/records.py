"""What a folder of results answers: a record that holds what was asked, by which the folder is named, and
known when it is asked again."""

import json
import platform
import re
import shlex
from collections.abc import Iterable
from hashlib import sha256
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from gmr_gym.evaluation.summary import CONFIDENCE
from gmr_gym.experiments.figures import METRICS
from gmr_gym.version import __version__

FORMAT = 1  # of a record; another is not read
VERSIONS = ("gmr-gym", "numpy", "numba", "scipy")


def question(**asked: Any) -> dict[str, Any]:
    """What was asked, of which version, as a record begins with it."""
    return {"format": FORMAT, "version": __version__, **_plain(asked)}


def named(question: dict[str, Any]) -> str:
    """A name for the results, which those of another question do not have."""
    return sha256(json.dumps(question, sort_keys=True).encode()).hexdigest()[:8]


def command(*words: str, **options: Iterable[Any]) -> str:
    """A command as it is typed, with each value of an option under it."""
    further = (
        word
        for option, values in options.items()
        for value in values
        for word in (f"--{option.replace('_', '-')}", str(value))
    )
    return shlex.join(["gmr-gym", *words, *further])


def answered(question: dict[str, Any], tables: list[dict[str, Any]], **further: Any) -> dict[str, Any]:
    """The whole record: the question, by which versions it is answered, the level of all intervals, the unit
    of every figure, the tables."""
    versions = {"python": platform.python_version(), **{name: version(name) for name in VERSIONS}}
    metrics = {metric: None for table in tables for row in table["rows"] for metric in row["metrics"]}
    units = {metric: METRICS[metric].unit for metric in metrics if metric in METRICS}
    known = {"versions": versions, "level": CONFIDENCE, "units": units, "tables": tables}
    return question | known | _plain(further)


def text_of(record: dict[str, Any]) -> str:
    """A record as JSON, numbers of a list in one line."""
    text = json.dumps(record, indent=1)
    return (
        re.sub(r"\[\n([-+\d\s.,enul]+)\n\s*\]", lambda found: f"[{' '.join(found[1].split())}]", text) + "\n"
    )


def read(file: Path) -> dict[str, Any]:
    """The record in a file. Raises ValueError naming the file for what is none, and for another format."""
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
        found = record.get("format")
    except (OSError, ValueError, AttributeError) as error:
        raise ValueError(f"{file} is no record of results: {error}") from None
    if found != FORMAT:
        by = record.get("version", "an earlier version")
        raise ValueError(f"{file} has format {found}, left by {by}, and this version reads format {FORMAT}")
    return record


def check_free(file: Path, question: dict[str, Any]) -> None:
    """ValueError where the file holds the answer to another question, which would be lost."""
    if not file.exists():
        return
    try:
        there = read(file)
    except ValueError as error:
        raise ValueError(f"{error}; choose another folder with --out, or delete it") from None
    other = [
        f"{key} {_short(there.get(key))}, asked {_short(question[key])}"
        for key in question
        if there.get(key) != question[key]
    ]
    if other:
        raise ValueError(
            f"{file} has the results of another call ({'; '.join(other)}); choose another folder with --out, "
            "or delete it"
        )


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _plain(value: Any) -> Any:
    """As JSON has it; numbers that it has not as text."""
    if isinstance(value, dict):
        return {str(key): _plain(part) for key, part in value.items()}
    if isinstance(value, tuple | list):
        return [_plain(part) for part in value]
    if isinstance(value, float) and not np.isfinite(value):
        return str(value)
    if isinstance(value, np.ndarray):
        return [float(number) if np.isfinite(number) else None for number in value]
    return value if isinstance(value, str | int | float | None) else str(value)
