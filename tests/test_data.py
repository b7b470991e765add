"""The recorded flights are what their files and LICENCE.md say, and fly like aircraft."""

import re
from importlib.resources import files

import numpy as np
import pytest

from gmr_gym.data.loader import COLUMNS, flight, flight_names

FOLDER = files("gmr_gym.data") / "flights"


def motion_of(x):
    """Velocity and acceleration (T - 2, 2) by central differences at 1 Hz."""
    return (x[2:] - x[:-2]) / 2, x[2:] - 2 * x[1:-1] + x[:-2]


def test_names_are_sorted_and_there_are_five():
    assert len(flight_names()) == 5
    assert list(flight_names()) == sorted(flight_names())


@pytest.mark.parametrize("name", flight_names())
def test_flight_is_100_to_300_seconds_at_1_hz_from_the_origin(name):
    x = flight(name)
    rows = (FOLDER / f"{name}.csv").read_text(encoding="utf-8").partition(COLUMNS)[2].splitlines()
    seconds = [float(row.split(",")[0]) for row in rows]
    assert seconds == list(range(len(x)))
    assert x.shape == (len(seconds), 2) and np.isfinite(x).all()
    assert 100 <= seconds[-1] <= 300
    assert (x[0] == 0).all()


@pytest.mark.parametrize("name", flight_names())
def test_flight_moves_like_a_transport_aircraft(name):
    v, a = motion_of(flight(name))
    speed = np.hypot(*v.T)
    # a large jet stalls below 60 m/s and, without a gale behind it, keeps below 260 m/s
    assert 60 < speed.min() and speed.max() < 260
    # a 57 degree bank or a hard pull-up gives 1.5 g; a stale or wild fix would give tens of g
    assert np.hypot(*a.T).max() < 15
    # jerk: rolling into a steep bank takes some 5 s, so acceleration never leaps in one
    assert np.hypot(*np.diff(a, axis=0).T).max() < 2


@pytest.mark.parametrize("name", flight_names())
def test_flight_manoeuvres(name):
    v, a = motion_of(flight(name))
    heading = np.unwrap(np.arctan2(v[:, 0], v[:, 1]))
    speed = np.hypot(*v.T)
    assert np.ptp(heading) > np.pi / 2 or np.ptp(speed) > 100
    assert np.hypot(*a.T).max() > 4  # m/s^2; a routine airline turn at 20 degrees has 3.6


@pytest.mark.parametrize("name", flight_names())
def test_first_line_states_source_and_licence(name):
    first = (FOLDER / f"{name}.csv").read_text(encoding="utf-8").splitlines()[0]
    assert first.startswith("#") and "traffic 2.13" in first and "MIT licence" in first


def test_licence_table_agrees_with_the_flights():
    text = (FOLDER / "LICENCE.md").read_text(encoding="utf-8")
    assert "Copyright (c) 2018 Xavier Olive" in text and "Permission is hereby granted" in text
    row = r"^\| `([\w-]+)` \| (\d+) \| (\d+)-(\d+) \| ([\d.]+) \|"
    table = {name: numbers for name, *numbers in re.findall(row, text, re.MULTILINE)}
    assert sorted(table) == list(flight_names())
    for name, numbers in table.items():
        x = flight(name)
        v, a = motion_of(x)
        speed = np.hypot(*v.T)
        measured = [len(x) - 1, round(speed.min()), round(speed.max())]
        assert [int(number) for number in numbers[:3]] == measured
        assert float(numbers[3]) == round(np.hypot(*a.T).max(), 1)


def test_unknown_segment_suggests_the_nearest_and_lists_all():
    with pytest.raises(ValueError, match="unknown segment 'zero-gravity-trun'") as error:
        flight("zero-gravity-trun")
    assert "did you mean 'zero-gravity-turn'?" in str(error.value)
    assert all(name in str(error.value) for name in flight_names())


def test_unknown_segment_like_no_other_still_lists_all():
    with pytest.raises(ValueError, match="choose one of refuelling-orbit") as error:
        flight("q")
    assert "did you mean" not in str(error.value)
