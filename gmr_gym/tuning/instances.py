"""Instances of the tuning problem: rows of a table, each of which makes a scenario."""

import csv
from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gmr_gym.data.loader import f16_flight, flight, flight_names
from gmr_gym.scenarios.dortenzio import START, printed_path
from gmr_gym.scenarios.planar import along, following_box, path
from gmr_gym.scenarios.zhang import jump_markov
from gmr_gym.simulation.single_target import Scenario

TABLES = ("train", "valid", "test", "extrapolation")
# noise assumed wrong both ways, and recorded flights as they were flown: the tables of v1
WIDE = ("wide-train", "wide-valid", "wide-test", "wide-extrapolation", "real")
PERIOD = 1.0  # s
SCANS = 100  # of an episode, fewer where the path is shorter
AREA = 1316.5 * 662.5  # m^2, D'Ortenzio's field of view
WINDOW = (1000.0, 1000.0)  # m, follows the estimate: a box about the path would show where the path is


class Instance(NamedTuple):
    """One scenario, and the filter model where it differs."""

    instance_id: str
    trajectory: str  # one of trajectory_names(), or jump-markov-N, a path drawn from the seed N
    first_scan: int  # of the path, from 0: the state there is the prior, the episode starts one scan later
    manoeuvre: float  # factor on the accelerations of the path
    clutter_rate: float  # expected false alarms per scan in D'Ortenzio's field of view
    detection_probability: float  # of the truth and of the filter model
    sensor_deviation: float  # m, standard deviation of the true measurement noise
    told_sensor_deviation: float  # m, the same in the filter model
    told_acceleration_deviation: float  # m/s^2, process noise of the filter model


def instances(table: str) -> dict[str, Instance]:
    """Read a table of instances.

    Parameters
    ----------
    table : str
        One of `TABLES` or `WIDE`, or the path of a CSV file whose columns are the fields of Instance, in any
        order.

    Returns
    -------
    dict of str to Instance
        By id, in the order of the table.

    Raises
    ------
    ValueError
        Naming file, row and column, for a missing file, an unknown or missing column, a value of which no
        scenario can be made, and an id used twice.
    """
    file = files("gmr_gym.data") / "instances" / f"{table}.csv" if table in (*TABLES, *WIDE) else Path(table)
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise ValueError(
            f"cannot read the instances {table!r} ({error}); give one of {', '.join(TABLES)} or a CSV file"
        ) from None
    rows = csv.reader(lines)
    header = next(rows, [])
    for column in header:
        if column not in Instance._fields:
            near = get_close_matches(column, Instance._fields, n=1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise ValueError(
                f"{table}: unknown column {column!r}; {hint}columns: {', '.join(Instance._fields)}"
            )
    for column in Instance._fields:
        if header.count(column) != 1:
            times = header.count(column)
            raise ValueError(f"{table}: column {column!r} must appear once, not {times} times")
    found: dict[str, Instance] = {}
    for row in rows:
        where = f"{table}, row {rows.line_num}"
        if len(row) != len(header):
            raise ValueError(f"{where}: {len(row)} cells for {len(header)} columns")
        instance = _checked(where, dict(zip(header, row, strict=True)))
        if instance.instance_id in found:
            raise ValueError(f"{where}, column instance_id: {instance.instance_id!r} is used twice")
        found[instance.instance_id] = instance
    if not found:
        raise ValueError(f"{table}: no instances below the header")
    return found


def world(instance: Instance) -> Scenario:
    """The scenario of an instance.

    It has D'Ortenzio's sensor and filter model along the instance's path, in clutter in a window that follows
    the estimate.

    Parameters
    ----------
    instance : Instance

    Returns
    -------
    Scenario

    Raises
    ------
    ValueError
        For an unknown path, or one that is too short.
    """
    x = trajectory(instance.trajectory)[instance.first_scan :][: SCANS + 1]
    if len(x) < 4:
        raise ValueError(
            f"{instance.trajectory} has {len(x)} scans from scan {instance.first_scan}, wanted at least 4"
        )
    x, _ = path(x, PERIOD)
    # the path without any acceleration stays; the difference from it scales with the accelerations
    times = PERIOD * np.arange(len(x))[:, None]
    straight = np.hstack([x[0, :2] + times * x[0, 2:], np.repeat(x[:1, 2:], len(x), axis=0)])
    x = straight + instance.manoeuvre * (x - straight)
    return along(
        x[1:],
        x[0],
        following_box(WINDOW),
        period=PERIOD,
        clutter_rate=None,
        clutter_density=instance.clutter_rate / AREA,
        detection_probability=instance.detection_probability,
        sensor_deviation=instance.sensor_deviation,
        told_sensor_deviation=instance.told_sensor_deviation,
        told_acceleration_deviation=instance.told_acceleration_deviation,
    )


def trajectory_names() -> tuple[str, ...]:
    """Names of the paths that need no number."""
    return ("turning-target", "agile-flight", *flight_names())


def trajectory(name: str) -> np.ndarray:
    """A path at one scan per second.

    Parameters
    ----------
    name : str
        "turning-target": D'Ortenzio's path; "agile-flight": every second epoch of Maybeck's flight; the name
        of a recorded flight; or "jump-markov-N": the path that Zhang's target draws from the seed N.

    Returns
    -------
    ndarray (T, 2) or (T, 4)
        Positions, or positions and velocities, m and m/s.

    Raises
    ------
    ValueError
        For another name.
    """
    kind, _, number = name.rpartition("-")
    if name == "turning-target":
        return np.vstack([START, printed_path()])
    if name == "agile-flight":
        return f16_flight()[::2, :4]
    if kind == "jump-markov" and number.isdecimal():
        return jump_markov().truth(np.random.default_rng(int(number))).x
    if name in flight_names():
        return flight(name)
    raise ValueError(f"unknown {name!r}; choose from {', '.join(trajectory_names())} and jump-markov-N")


def _checked(where: str, cells: dict[str, str]) -> Instance:
    values: dict[str, str | int | float] = {}
    for column, kind in Instance.__annotations__.items():
        try:
            values[column] = value = kind(cells[column])
        except ValueError:
            wanted = "a whole number" if kind is int else "a number"
            raise ValueError(f"{where}, column {column}: {cells[column]!r} is not {wanted}") from None
        if value == "" or (kind is not str and not _possible(column, value)):
            raise ValueError(f"{where}, column {column}: {cells[column]!r} is invalid")
    instance = Instance(**values)  # type: ignore[arg-type]
    try:
        world(instance)
    except ValueError as error:
        column = "first_scan" if "scans from" in str(error) else "trajectory"
        raise ValueError(f"{where}, column {column}: {error}") from None
    return instance


def _possible(column: str, value: float) -> bool:
    if column == "detection_probability":
        return 0 < value <= 1
    if column in ("first_scan", "manoeuvre"):
        return 0 <= value <= 1e4
    return 0 < value <= 1e4
