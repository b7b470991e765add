"""What a folder of results answers: a record that holds what was asked, by which the folder is named, and
known when it is asked again."""

import json
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from gmr_gym.evaluation.summary import CONFIDENCE
from gmr_gym.experiments.sheets import METRICS
from gmr_gym.version import __version__

FORMAT = 1  # of a record; another is not read


def question(**asked: Any) -> dict[str, Any]:
    """What was asked, of which version, as a record begins with it."""
    return {"format": FORMAT, "version": __version__, **_plain(asked)}


def named(question: dict[str, Any]) -> str:
    """A name for the results, which those of another question do not have."""
    return sha256(json.dumps(question, sort_keys=True).encode()).hexdigest()[:8]


def answered(question: dict[str, Any], tables: list[dict[str, Any]], **further: Any) -> dict[str, Any]:
    """The whole record: the question, the level of all intervals, the unit of every figure, the tables."""
    metrics = {metric: None for table in tables for row in table["rows"] for metric in row["metrics"]}
    units = {metric: METRICS[metric].unit for metric in metrics if metric in METRICS}
    return question | {"level": CONFIDENCE, "units": units, "tables": tables} | further


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
    return value
