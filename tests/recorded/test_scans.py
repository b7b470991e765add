"""Detections are cut into the scans that the sensor made."""

import numpy as np
import pytest

from gmr_gym.recorded import SensorSpec, cut, from_arrays
from gmr_gym.recorded.detections import POLAR

PERIOD = 4.0


def antenna(way, turns=30, error=1.0, away=(), first=0.7, targets=5, seed=0):
    """Times, azimuths and turns of rows of an antenna over targets that stand still. It turns clockwise for
    `way` -1; in the turns `away` nothing was detected."""
    rng = np.random.default_rng(seed)
    directions = np.sort(rng.uniform(0.1, 0.9, targets))  # of a turn, from where the antenna starts
    rows = [(turn + at, turn) for turn in range(turns) for at in directions if turn not in away]
    turned, turn = np.array(rows).T
    azimuth = first + way * 2 * np.pi * turned + rng.normal(0, 0.002, len(rows))
    return turned * PERIOD * error, (azimuth + np.pi) % (2 * np.pi) - np.pi, turn.astype(int)


def seen(time, azimuth, period=PERIOD):
    spec = SensorSpec("radar", POLAR, deviation=(10.0, 0.01), rotation_period=period)
    return from_arrays(time, np.column_stack([np.full(len(time), 1e4), azimuth]), sensors=[spec])


@pytest.mark.parametrize("way", [-1, 1])
@pytest.mark.parametrize("error", [1.0, 1.004, 0.997])
def test_turns_are_cut_once_a_turn_even_where_the_period_is_not_quite_right(way, error):
    time, azimuth, turn = antenna(way, error=error, turns=60)  # the errors add up to a quarter of a turn
    scans = cut(seen(time, azimuth))
    assert sum(len(scan.rows) for scan in scans) == len(time)
    assert {len(scan.rows) for scan in scans[1:-1]} == {5}
    start, end = scans[0].azimuths
    assert end - start == pytest.approx(way * 2 * np.pi)
    for scan in scans[1:-1]:  # from the cut on, in the direction in which the antenna turns
        swept = np.mod(way * (azimuth[scan.rows] - start), 2 * np.pi)
        assert (np.diff(swept) > 0).all()
    whole = [scan for scan in scans if len(scan.rows) == 5]
    assert len(whole) >= len(set(turn)) - 1


def test_a_turn_without_detections_is_a_scan():
    time, azimuth, _ = antenna(-1, away=(11, 12))
    scans = cut(seen(time, azimuth))
    assert sum(len(scan.rows) == 0 for scan in scans) in (
        1,
        2,
    )  # the cut may lie in the middle of their sector
    assert all(0.5 * PERIOD < gap < 1.6 * PERIOD for gap in np.diff([scan.time for scan in scans])[1:-1])


def test_azimuths_that_do_not_go_with_time_are_cut_by_time_alone():
    rng = np.random.default_rng(2)
    time = np.sort(rng.uniform(0, 100, 400))
    scans = cut(seen(time, rng.uniform(-np.pi, np.pi, 400)))
    assert scans[0].azimuths is None and all(scan.last - scan.first <= PERIOD for scan in scans)


def test_the_usual_way_is_by_what_the_file_has():
    z = np.zeros((4, 2))
    times = [0.0, 0.0, 1.0, 5.0]
    by_time = cut(from_arrays(times, z))
    assert [scan.rows.tolist() for scan in by_time] == [[0, 1], [2], [3]]
    assert [scan.rows.tolist() for scan in cut(from_arrays(times, z, scan=[3, 3, 3, 4]))] == [[0, 1, 2], [3]]
    windows = cut(from_arrays(times, z), window=2.0)
    assert [(s.time, s.first, s.last) for s in windows] == [(1, 0, 1), (5, 5, 5)]
    reports = cut(from_arrays([0, 1, 2, 3], z, identity=list("abab")))
    assert [scan.rows.tolist() for scan in reports] == [[0], [1], [2], [3]]
    assert len(cut(from_arrays(times, z, identity=list("abab")), by="reports")) == 4


def test_each_sensor_has_its_own_scans_and_empty_looks_are_scans():
    sensors = [SensorSpec("a"), SensorSpec("b")]
    found = from_arrays(
        [0, 0, 1], np.zeros((3, 2)), sensor=[0, 1, 0], sensors=sensors,
        empty_time=np.array([0.5]), empty_sensor=np.array([1]),
    )  # fmt: skip
    scans = cut(found)
    assert [(s.time, s.sensor, s.rows.tolist()) for s in scans] == [
        (0, 0, [0]),
        (0, 1, [1]),
        (0.5, 1, []),
        (1, 0, [2]),
    ]
    assert cut(from_arrays([], np.empty((0, 2)))) == []


def test_scans_that_some_rows_lack_and_turns_beyond_number_are_refused():
    found = from_arrays([0, 1, 2], np.ones((3, 2)), scan=[0, -1, 1])
    with pytest.raises(ValueError, match="1 of 3 rows of sensor '' have no scan; leave them out"):
        cut(found)
    found = from_arrays([0, 1], np.ones((2, 2)), sensors=[SensorSpec("", rotation_period=1e-6)])
    with pytest.raises(ValueError, match="a rotation period of 1e-06 s makes 1000001 turns of 2 rows"):
        cut(found)


@pytest.mark.parametrize(
    "by, message",
    [
        ("turn", "by must be one of times, column, turns, reports, window"),
        ("turns", "scans by turns need the period of sensor ''; give --rotation-period S"),
        ("column", "scans by a column need it; give --scan COLUMN"),
        ("window", "scans by a window need its length; give --scan-window SECONDS"),
    ],
)
def test_a_way_to_which_the_detections_give_nothing_is_refused(by, message):
    with pytest.raises(ValueError, match=message):
        cut(from_arrays([0.0], [[0.0, 0.0]]), by)
    with pytest.raises(ValueError, match="window must be positive"):
        cut(from_arrays([0.0], [[0.0, 0.0]]), window=0.0)
