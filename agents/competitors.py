"""Policies without training, as plain data in a JSON file."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from judge import Policy
from tracked import Tracked

from gmr_gym.experiments.output import write_json
from gmr_gym.experiments.records import FORMAT, question
from gmr_gym.tuning.policies import ByTable, Constant, Rule, Schedule

KINDS = {kind.__name__: kind for kind in (Constant, Schedule, Rule, ByTable, Tracked)}
TUPLES = ("names", "factors")  # fields that are no arrays


class Rival(NamedTuple):
    """A point of a front."""

    price: float  # of a unit of work, for which it was chosen
    policy: Policy
    env: Mapping[str, Any]  # arguments of the environment that it was made for; none of a tracker


def write(file: Path, env: Mapping[str, Any], policies: Mapping[str, Any]) -> None:
    """The policies, and the arguments of the environment that they were made for."""
    plain = {name: _plain_policy(policy) for name, policy in policies.items()}
    write_json(file, question(env=dict(env)) | {"policies": plain})


def write_fronts(file: Path, fronts: Mapping[str, Sequence[Rival]]) -> None:
    """The fronts of families by name."""
    plain = {
        name: [{"price": r.price, "env": dict(r.env), "policy": _plain_policy(r.policy)} for r in front]
        for name, front in fronts.items()
    }
    write_json(file, question() | {"fronts": plain})


def read_fronts(file: Path) -> dict[str, list[Rival]]:
    """The fronts of families by name. ValueError naming the file for what is none."""
    try:
        fronts = json.loads(file.read_text())["fronts"]
        return {
            name: [Rival(r["price"], _policy(**r["policy"]), r["env"]) for r in front]
            for name, front in fronts.items()
        }
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ValueError(f"{file} holds no fronts of tune_rivals.py: {error!r}") from None


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
            fields[name] = tuple(value) if name in TUPLES else np.array(value, float)
    return KINDS[kind](**fields)


def _plain_policy(policy: Any) -> dict[str, Any]:
    return {"kind": type(policy).__name__} | {k: _plain(v) for k, v in asdict(policy).items()}


def _plain(value):
    return value.tolist() if isinstance(value, np.ndarray) else value
