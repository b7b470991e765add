"""Recorded aircraft tracks at 1 Hz, `flights/LICENCE.md` says whose and how they were cut; and a flight of
an F-16 at 2 Hz, reconstructed in a flight simulator by `fly_f16.py`. Beside them the tables of instances that
`draw_instances.py` draws."""

from difflib import get_close_matches
from importlib.resources import files

import numpy as np

COLUMNS = "time_s,east_m,north_m\n"  # the line between a file's comments and its rows


def flight_names() -> tuple[str, ...]:
    """Names of the segments, sorted."""
    found = (entry.name for entry in (files("gmr_gym.data") / "flights").iterdir())
    return tuple(sorted(name.removesuffix(".csv") for name in found if name.endswith(".csv")))


def flight(segment: str) -> np.ndarray:
    """[east, north] (T, 2) of a segment, in metres from its start, one row a second."""
    names = flight_names()
    if segment not in names:
        near = get_close_matches(str(segment), names, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise ValueError(f"unknown segment {segment!r}; {hint}choose one of {', '.join(names)}")
    text = (files("gmr_gym.data") / "flights" / f"{segment}.csv").read_text(encoding="utf-8")
    rows = text.partition(COLUMNS)[2].splitlines()
    return np.loadtxt(rows, delimiter=",", usecols=(1, 2))


def f16_flight() -> np.ndarray:
    """[north, up] from the first epoch, their velocities and accelerations (350, 6), m and s, of an F-16
    that flies level, turns and jinks; two rows a second."""
    text = (files("gmr_gym.data") / "f16.csv").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if not line.startswith("#")][1:]
    return np.loadtxt(rows, delimiter=",", usecols=range(1, 7))
