"""Reads the recorded flights, and the reconstructed flight of an F-16.

The recorded ones are at 1 Hz; `flights/LICENCE.md` states their source and processing. The F-16's is at 2 Hz,
from a flight simulator (`fly_f16.py`). The tables of instances beside them are drawn by
`agents/draw_instances.py`.
"""

from difflib import get_close_matches
from importlib.resources import files

import numpy as np

COLUMNS = "time_s,east_m,north_m\n"  # the line between a file's comments and its rows


def flight_names() -> tuple[str, ...]:
    """Names of the recorded flights, sorted.

    Examples
    --------
    >>> from gmr_gym.data import flight_names
    >>> flight_names()[0]
    'refuelling-orbit'
    """
    found = (entry.name for entry in (files("gmr_gym.data") / "flights").iterdir())
    return tuple(sorted(name.removesuffix(".csv") for name in found if name.endswith(".csv")))


def flight(segment: str) -> np.ndarray:
    """Positions of a recorded flight, one row per second.

    Parameters
    ----------
    segment : str
        One of `flight_names()`.

    Returns
    -------
    ndarray (T, 2)
        [east, north] from the start, m.

    Raises
    ------
    ValueError
        For an unknown segment.

    Examples
    --------
    >>> from gmr_gym.data import flight
    >>> flight("refuelling-orbit").shape
    (301, 2)
    """
    names = flight_names()
    if segment not in names:
        near = get_close_matches(str(segment), names, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise ValueError(f"unknown segment {segment!r}; {hint}choose one of {', '.join(names)}")
    text = (files("gmr_gym.data") / "flights" / f"{segment}.csv").read_text(encoding="utf-8")
    rows = text.partition(COLUMNS)[2].splitlines()
    return np.loadtxt(rows, delimiter=",", usecols=(1, 2))


def f16_flight() -> np.ndarray:
    """States of an F-16 that flies level, turns and jinks, two rows per second.

    Returns
    -------
    ndarray (350, 6)
        [north, up] from the first epoch, their velocities and accelerations, m and s.
    """
    text = (files("gmr_gym.data") / "f16.csv").read_text(encoding="utf-8")
    rows = [line for line in text.splitlines() if not line.startswith("#")][1:]
    return np.loadtxt(rows, delimiter=",", usecols=range(1, 7))
