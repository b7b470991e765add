"""Policies without training, as plain data in a JSON file."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from judge import Policy

from gmr_gym.experiments.output import write_json
from gmr_gym.experiments.records import FORMAT, question
from gmr_gym.tuning.policies import ByTable, Constant, Rule, Schedule

KINDS = {kind.__name__: kind for kind in (Constant, Schedule, Rule, ByTable)}


def write(file: Path, env: Mapping[str, Any], policies: Mapping[str, Any]) -> None:
    """The policies, and the arguments of the environment that they were made for."""
    plain = {
        name: {"kind": type(policy).__name__} | {k: _plain(v) for k, v in asdict(policy).items()}
        for name, policy in policies.items()
    }
    write_json(file, question(env=dict(env)) | {"policies": plain})


def read(file: Path) -> tuple[dict[str, Any], dict[str, Policy]]:
    """Arguments of the environment, and policies by name. ValueError naming the file for what is none."""
    try:
        record = json.loads(file.read_text())
        if record.get("format", FORMAT) != FORMAT:  # the first had none
            raise ValueError(f"format {record['format']}, and this version reads format {FORMAT}")
        return record["env"], {name: _policy(**fields) for name, fields in record["policies"].items()}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{file} holds no policies of tune_static.py: {error!r}") from None


def _policy(kind: str, **fields) -> Policy:
    for name, value in fields.items():
        if isinstance(value, list):
            fields[name] = tuple(value) if name == "names" else np.array(value, float)
    return KINDS[kind](**fields)


def _plain(value):
    return value.tolist() if isinstance(value, np.ndarray) else value
