"""What the commands share: scenarios and trackers by what a user types, and runs under a progress bar."""

import errno
import os
from collections.abc import Iterable, Mapping, Sequence
from inspect import signature
from pathlib import Path
from typing import Any

from gmr_gym.catalogue import GROUP, MULTI_TARGET_GROUP, tracker_entry_points
from gmr_gym.envs.lookup import parsed, scenario_of
from gmr_gym.envs.registry import TRACKING
from gmr_gym.evaluation.blocks import check_folder
from gmr_gym.filters.registry import FORMER_PARAMETERS
from gmr_gym.simulation.multi_target import MultiTargetScenario
from gmr_gym.simulation.single_target import Scenario


def check_once(option: str, values: Sequence[str]) -> None:
    """ValueError for a value that a repeatable option is given twice; NAME: is NAME."""
    for i, value in enumerate(values):
        if value.removesuffix(":") in (other.removesuffix(":") for other in values[:i]):
            raise ValueError(f"{option} {value} is given twice")


def numbers(name: str, text: str) -> list[float]:
    """Numbers with commas between; ValueError naming the option."""
    try:
        return [float(number) for number in text.split(",")]
    except ValueError:
        raise ValueError(f"{name} must be numbers with commas between, got {text!r}") from None


def pixels(name: str, text: str) -> tuple[int, int]:
    """Width and height from WIDTH or WIDTHxHEIGHT, the height 0 where it is not given; ValueError naming the
    option."""
    width, x, height = text.lower().partition("x")
    if not width.isdecimal() or (x and not (height.isdecimal() and int(height))):
        raise ValueError(f"{name} must be WIDTH or WIDTHxHEIGHT in pixels, as 640 or 640x480, got {text!r}")
    return int(width), int(height or 0)


def check_ending(option: str, file: Path | None, *endings: str) -> None:
    """ValueError naming the option if a file to be written says by its ending that it is of another kind."""
    if file is not None and file.suffix.lower() not in endings:
        raise ValueError(f"{option} must end in {' or '.join(endings)}, got {file.name!r}")


def single_target(env_id: str, world: Mapping[str, Any]) -> Scenario:
    """As `scenario_of`, of one target; ValueError where there are many."""
    scenario = scenario_of(env_id, world)
    if isinstance(scenario, MultiTargetScenario):
        raise ValueError(f"{env_id} has many targets; choose from {', '.join(TRACKING)}")
    return scenario


def complete(spec: str, scenario: Scenario | MultiTargetScenario) -> dict[str, Any]:
    """All parameters of the tracker NAME:key=value,key=value, those that are not given as they are by
    default."""
    usual, given = usual_and_given(spec, scenario)
    return usual | given


def usual_and_given(
    spec: str, scenario: Scenario | MultiTargetScenario | None
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Parameters of the tracker NAME:key=value,key=value, of one target without a scenario: as they are by
    default, and those that are given, a number at the end of the name too."""
    name, given = parsed(spec)
    known = tracker_entry_points(MULTI_TARGET_GROUP if isinstance(scenario, MultiTargetScenario) else GROUP)
    base, _, number = name.rpartition("-")
    name, given = (name, given) if name in known else (base, {"components": int(number)} | given)
    takes = list(signature(known[name].load()).parameters.values())[1:]
    usual = {one.name: one.default for one in takes if one.default is not one.empty}
    return usual, {
        next((new for new in FORMER_PARAMETERS.get(key, ()) if new in usual), key): value
        for key, value in given.items()
    }


def parsed_all(specs: Iterable[str]) -> dict[str, dict[str, Any]]:
    """Names and parameters of trackers, as a question has them."""
    return {spec: dict(zip(("name", "parameters"), parsed(spec), strict=True)) for spec in specs}


def check_absent(option: str, file: Path | None, overwrite: bool) -> None:
    """ValueError, with the way out, for a file that is there and may not be written over."""
    if file is not None and file.is_file() and not overwrite:
        raise ValueError(f"{option}: {file} is there already; give --overwrite, or another name")


def check_writable(*files: Path | None, beside: Sequence[Path | str | None] = ()) -> None:
    """OSError for a file that could not be made, or that is a folder: before the work, and leaving none.
    ValueError for one that is to be written twice, or over one of the files `beside` that are read."""
    taken = {Path(file).resolve() for file in beside if file}
    for file in filter(None, files):
        if file.resolve() in taken:
            raise ValueError(f"{file} is named twice, and what it holds would be lost; choose another file")
        taken.add(file.resolve())
        if file.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(file))
        check_folder(file.parent)
