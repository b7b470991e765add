"""Recorded detections survive their files, and trackers run over them at whatever times."""

from datetime import UTC, timedelta, timezone
from functools import partial

import numpy as np
import pytest

from gmr_gym.evaluation.recordings import (
    Scans,
    Track,
    filled,
    from_first_detection,
    read_scans,
    track,
    write_scans,
    write_track,
)
from gmr_gym.evaluation.times import seconds
from gmr_gym.filters.registry import make_tracker
from gmr_gym.mixture import moments
from gmr_gym.models.priors import MOST_STARTS, constant_velocity_model, prior_from_first_scan, prior_given
from gmr_gym.scenarios.recorded import recorded_flight
from gmr_gym.simulation.single_target import draw, scan

QUIET = 1e-12  # m^-2, next to no clutter
EMPTY = np.empty((0, 2))


def builder(name, prior, density=QUIET, acceleration=1.0, deviation=5.0, probability=0.9, axes=2, gate=0.999):
    def build(dt):
        told = constant_velocity_model(
            dt,
            prior,
            axes=axes,
            acceleration_deviation=acceleration,
            sensor_deviation=deviation,
            detection_probability=probability,
            gate_probability=gate,
            clutter_density=density,
        )
        return make_tracker(name, told)

    return build


def straight(times, start=(10.0, -20.0, 3.0, 40.0)):
    """States (T, 4) at `times` of a target in straight uniform flight, in state `start` at time 0."""
    start = np.array(start)
    times = np.asarray(times, float)[:, None]
    return np.hstack([start[:2] + times * start[2:], np.repeat(start[None, 2:], len(times), axis=0)])


def seen(times, x):
    return Scans(np.asarray(times, float), [row[None, :2] for row in x], ("x", "y"))


# files


def test_written_scans_are_read_back_to_the_last_bit(tmp_path):
    rng = np.random.default_rng(1)
    for p in (1, 2, 3):
        z = [rng.normal(size=(k, p)) * 10.0 ** rng.integers(-300, 300) for k in (3, 0, 1, 0, 50, 0)]
        times = np.cumsum(rng.exponential(size=6)) + 1.7e9
        coordinates = ("east, m", 'the "north"', "up")[:p]
        write_scans(tmp_path / "scans.csv", times, z, coordinates)
        back = read_scans(tmp_path / "scans.csv")
        assert back.coordinates == coordinates
        assert (back.times == times).all()
        assert [a.shape for a in back.z] == [a.shape for a in z]
        assert all((a == b).all() for a, b in zip(back.z, z, strict=True))


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_comments_blank_lines_spaces_and_a_byte_order_mark_are_passed_over(tmp_path, ending, mark):
    lines = ["# a radar", "", "time_s, x,y", "0,1, 2 ", "  ", "0,3,4", "# gap", "1e0,,", "2.5,5,-6e1"]
    file = tmp_path / "scans.csv"
    file.write_bytes((mark + ending.join(lines)).encode())
    scans = read_scans(file)
    assert scans.coordinates == ("x", "y")
    assert scans.times.tolist() == [0.0, 1.0, 2.5]
    assert [z.tolist() for z in scans.z] == [[[1, 2], [3, 4]], [], [[5, -60]]]
    assert scans.z[1].shape == (0, 2)


@pytest.mark.parametrize(
    "text, where",
    [
        ("", "line 1, column 1: a header"),
        ("# only a comment\n", "line 1, column 1: a header"),
        ("\n0,1,2\n", "line 2, column 1: a header"),
        ("x,y,time\n", "line 1, column 1: a header"),
        ("time\n0\n", "line 1, column 1: a header"),
        ("time;x;y\n0;1;2\n", "line 1, column 1: a header"),
        ("time,x,x\n", "line 1, column 3: 'x'"),
        ("time,x,\n", "line 1, column 3: ''"),
        ("time,x,y\n# nothing\n", "line 1, column time: no rows"),
        ("time,x,y\n0,1,two\n", "line 2, column y: 'two' is not a finite number"),
        ("time,x,y\n0,1,2\n\nnoon,1,2\n", "line 4, column time: 'noon'"),
        ("time,x,y\n0,nan,2\n", "line 2, column x: 'nan'"),
        ("time,x,y\n0,1,-inf\n", "line 2, column y: '-inf'"),
        ("time,x,y\n0,1,1e999\n", "line 2, column y: '1e999'"),
        ("time,x,y\n0,1_0,2\n", "line 2, column x: '1_0'"),
        ("time,x,y\n0,1,\n", "line 2, column y: ''"),
        ("time,x,y\n0,,2\n", "line 2, column x: ''"),
        ("time,x,y\n,1,2\n", "line 2, column time: ''"),
        ("time,x,y\n,,\n", "line 2, column time: ''"),
        ("time,x,y\n0,1\n", "line 2, column y: 2 cells under 3 columns"),
        ("time,x,y\n0\n", "line 2, column x: 1 cells under 3 columns"),
        ("time,x,y\n0,1,2,\n", "line 2, column y: 4 cells under 3 columns"),
        ("time,x,y\n0,1,2\n# back\n-1,1,2\n", "line 4, column time: -1.0 comes after 0.0"),
        ("time,x,y\n0,1,2\n0,,\n", "line 3, column x: an empty scan"),
        ("time,x,y\n0,,\n0,1,2\n", "line 3, column x: an empty scan"),
        ('time,x,y\n0,"1,2\n', "line 2: not a row of CSV"),
        ("time,x,y\n1700000000123456789,1,2\n", "line 2, column time: 1700000000123456789 has more digits"),
        ("time,x,y\n1e9,1,2\n1000000000.00000001,1,2\n", "line 3, column time: 1000000000.00000001 has more"),
        ("time,x,y\r0,1,2\r", "line 1: not a row of CSV"),
    ],
)
def test_a_malformed_file_is_refused_with_file_line_and_column(tmp_path, text, where):
    file = tmp_path / "scans.csv"
    file.write_text(text, encoding="utf-8", newline="")
    with pytest.raises(ValueError) as error:
        read_scans(file)
    assert str(error.value).startswith(f"{file}, {where}")


def test_one_time_in_several_spellings_is_one_scan(tmp_path):
    for times in (("1", "1.0", "1e0"), ("0", "-0.0", f"1e-{'9' * 30}")):
        rows = "\n".join(f"{time},{i}" for i, time in enumerate(times))
        (tmp_path / "scans.csv").write_text(f"time,x\n{rows}\n")
        assert [z.tolist() for z in read_scans(tmp_path / "scans.csv").z] == [[[0.0], [1.0], [2.0]]]


def test_a_coordinate_is_limited_where_a_limit_is_given_and_a_time_is_not(tmp_path):
    (tmp_path / "scans.csv").write_text("time,x,y\n200,0,-9\n201,-11,0\n")
    assert len(read_scans(tmp_path / "scans.csv").z) == len(read_scans(tmp_path / "scans.csv", farthest=11).z)
    with pytest.raises(ValueError, match=r"line 3, column x: -11 lies beyond \+-10"):
        read_scans(tmp_path / "scans.csv", farthest=10)


@pytest.mark.parametrize(
    "data, line",
    [(b"\x89PNG\r\n\x1a\n\xff", 1), (b"time,x\n0,1\n1,\xe9\n", 3), ("time,x".encode("utf-16"), 1)],
)
def test_a_file_that_is_not_utf_8_is_refused_with_its_line(tmp_path, data, line):
    (tmp_path / "scans.csv").write_bytes(data)
    with pytest.raises(ValueError, match=f"line {line}: not text in UTF-8"):
        read_scans(tmp_path / "scans.csv")


def test_binary_that_happens_to_be_utf_8_is_refused(tmp_path):
    (tmp_path / "scans.csv").write_bytes("time,x\n0,1\n".encode("utf-16-le"))
    with pytest.raises(ValueError, match="line 1, column 1: a header"):
        read_scans(tmp_path / "scans.csv")


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="absent"):
        read_scans(tmp_path / "absent.csv")


@pytest.mark.parametrize(
    "times, z, coordinates, message",
    [
        ([0.0], [EMPTY, EMPTY], ("x", "y"), "times must be finite, one for each of the 2 scans"),
        ([], [], ("x", "y"), "times must be finite"),
        ([0, 1.7e18], [EMPTY, EMPTY], ("x", "y"), r"times must lie within \+-9.01e\+15 s, got 1.7e\+18"),
        ([0.0, np.nan], [EMPTY, EMPTY], ("x", "y"), "times must be finite"),
        ([1.0, 1.0], [EMPTY, EMPTY], ("x", "y"), "times must increase, but 1.0 follows 1.0"),
        ([0.0], [np.zeros((2, 3))], ("x", "y"), r"z must have shape \(k, 2\)"),
        ([0.0], [np.full((1, 2), np.inf)], ("x", "y"), "z must be finite"),
        ([0.0], [EMPTY], ("x", "x"), "names, column 3: 'x'"),
        ([0.0], [EMPTY], ("x", "time"), "names, column 3: 'time'"),
        ([0.0], [EMPTY], ("x", "two\nlines"), "names, column 3"),
        ([0.0], [EMPTY], (), "names, column 1: a header"),
    ],
)
def test_scans_that_do_not_fit_are_not_written(tmp_path, times, z, coordinates, message):
    with pytest.raises(ValueError, match=message):
        write_scans(tmp_path / "scans.csv", times, z, coordinates)
    assert not (tmp_path / "scans.csv").exists()


def test_track_file_holds_estimates_and_the_upper_triangle(tmp_path):
    P = np.array([[4.0, 1.0], [1.0, 9.0]])
    result = Track(np.array([0.5]), np.array([[0.1, 2.0]]), P[None], np.array([7]), np.array([True]))
    write_track(tmp_path / "track.csv", result, ("px", "vx"))
    header, row = (tmp_path / "track.csv").read_text().splitlines()
    assert header == "time,px,vx,var_px,cov_px_vx,var_vx,components,alive"
    assert row == "0.5,0.1,2.0,4.0,1.0,9.0,7,1"
    with pytest.raises(ValueError, match="names must name the 2 states of the track, got 3"):
        write_track(tmp_path / "track.csv", result, ("px", "vx", "ax"))
    with pytest.raises(ValueError, match="names, column 3: 'px'"):
        write_track(tmp_path / "track.csv", result, ("px", "px"))


# tracking


@pytest.mark.parametrize("name", ["nearest-neighbour", "pda", "capping-5", "runnalls-30", "adaptive"])
def test_a_noise_free_straight_target_is_tracked_exactly(name):
    times = np.array([0.0, 1.0, 1.5, 4.0, 4.25, 9.0])
    x = straight(times)
    prior = prior_given(straight([-1.0])[0], [5, 5, 2, 2])
    result = track(seen(times, x), builder(name, prior), prior_time=-1.0)
    # machine precision of a dozen matrix products on numbers of some hundred
    np.testing.assert_allclose(result.x, x, rtol=0, atol=1e-10)
    assert result.P.shape == (6, 4, 4) and (result.times == times).all()


def test_a_track_says_when_it_was_given_up(tmp_path):
    times = np.arange(40.0)
    nothing = Scans(times, [np.empty((0, 2))] * 40, ("x", "y"))
    build = builder("mmg", prior_given([0, 0, 0, 0], [10, 10, 5, 5]), density=1e-3)
    result = track(nothing, build, prior_time=-1.0)
    assert result.alive[0] and not result.alive[-1]
    assert (np.diff(result.alive.astype(int)) <= 0).all()  # for good
    write_track(tmp_path / "track.csv", result, ("x", "y", "vx", "vy"))
    column = [line.rpartition(",")[2] for line in (tmp_path / "track.csv").read_text().splitlines()]
    assert column == ["alive", *("1" if alive else "0" for alive in result.alive)]
    assert track(nothing, builder("pda", prior_given([0, 0, 0, 0], [10, 10, 5, 5]))).alive.all()


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_irregular_times_equal_a_kalman_filter_written_out(axes):
    rng = np.random.default_rng(axes)
    times = np.cumsum(rng.exponential(2.0, 30))
    z = rng.normal(0, 50, (30, axes)).cumsum(axis=0)
    q, r = 30.0, 8.0
    mean, deviations = rng.normal(size=2 * axes), rng.uniform(10, 20, 2 * axes)
    scans = Scans(times, [row[None] for row in z], tuple("xyz"[:axes]))
    build = builder(
        "nearest-neighbour", prior_given(mean, deviations),
        acceleration=q, deviation=r, probability=1.0, axes=axes, gate=1.0,
    )  # fmt: skip
    result = track(scans, build, prior_time=times[0] - 3.0)
    m, P = mean, np.diag(deviations**2)
    eye, H = np.eye(axes), np.eye(axes, 2 * axes)
    for t, dt in enumerate(np.diff(times, prepend=times[0] - 3.0)):
        F = np.kron([[1, dt], [0, 1]], eye)
        G = np.kron([[dt**2 / 2], [dt]], eye)
        m, P = F @ m, F @ P @ F.T + q**2 * G @ G.T
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + r**2 * eye)
        m, P = m + K @ (z[t] - H @ m), (np.eye(2 * axes) - K @ H) @ P
        # intervals are rounded to 1e-9 s, at speeds and rates of some hundred
        np.testing.assert_allclose(result.x[t], m, rtol=1e-6, atol=1e-5)
        np.testing.assert_allclose(result.P[t], P, rtol=1e-6, atol=1e-5)


def test_a_tracker_is_built_once_for_each_interval():
    asked = []

    def build(dt):
        asked.append(dt)
        return builder("nearest-neighbour", prior_given([0, 0, 0, 0], [1, 1, 1, 1]))(dt)

    times = np.array([0, 0.1, 0.2, 0.3, 1.3, 1.4])  # differences vary in the last bits
    track(Scans(times, [EMPTY] * 6, ("x", "y")), build)
    assert asked == [0.1, 1.0]


def test_the_prior_lies_one_median_interval_or_one_period_before_the_first_scan():
    times = np.array([10.0, 12.0, 14.0, 16.0, 100.0])
    x = straight(times)
    build = builder("nearest-neighbour", prior_given(straight([8.0])[0], [5, 5, 2, 2]))
    by_default, stated = track(seen(times, x), build), track(seen(times, x), build, prior_time=8.0)
    assert (by_default.x == stated.x).all() and (by_default.P == stated.P).all()
    even = seen(times[:4], x[:4])
    by_period = track(even, build, period=2.0)
    assert (by_period.P == stated.P[:4]).all()
    assert len(track(seen([10.0], x[:1]), build, period=2.0).x) == 1


def test_gaps_are_filled_with_empty_scans_at_multiples_of_the_period():
    z = [np.full((1, 2), float(i)) for i in range(3)]
    times = np.array([5.0, 7.05, 9.9])
    result = filled(Scans(times, z, ("x", "y")), period=1.0)
    assert result.times.tolist() == [5.0, 6.0, 7.05, 8.0, 9.0, 9.9]
    assert [len(points) for points in result.z] == [1, 0, 1, 0, 0, 1]
    assert all((result.z[i] == z[j]).all() for i, j in ((0, 0), (2, 1), (5, 2)))


def test_a_filled_gap_is_tracked_as_scans_that_detected_nothing():
    times = np.array([0.0, 1.0, 4.0])
    x = straight(times)
    build = builder("runnalls-5", prior_given(straight([-1.0])[0], [5, 5, 2, 2]), density=1e-4)
    explicit = [x[0, None, :2], x[1, None, :2], EMPTY, EMPTY, x[2, None, :2]]
    stated = track(Scans(np.arange(5.0), explicit, ("x", "y")), build)
    gaps = track(seen(times, x), build, period=1.0)
    assert gaps.times.tolist() == [0, 1, 2, 3, 4]
    assert (gaps.x == stated.x).all() and (gaps.P == stated.P).all()
    assert gaps.P[3, 0, 0] > max(gaps.P[1, 0, 0], gaps.P[4, 0, 0])


@pytest.mark.parametrize(
    "times, period, message",
    [
        ([0.0, 1.0, 2.2], 1.0, "period 1.0 does not fit time 2.2: it makes scan 3.2"),
        ([0.0, 1.0, 1.05], 1.0, "period 1.0 does not fit time 1.05: it makes scan 2.05"),
        ([0.0, 1e7], 1.0, "period 1.0 does not fit time 10000000.0"),
        ([0.0, 1.0], 0.0, "period must be positive and finite, got 0.0"),
        ([0.0, 1.0], np.inf, "period must be positive and finite"),
    ],
)
def test_a_period_that_does_not_fit_is_refused(times, period, message):
    build = builder("nearest-neighbour", prior_given([0, 0, 0, 0], [1, 1, 1, 1]))
    with pytest.raises(ValueError, match=message):
        track(Scans(np.array(times), [EMPTY] * len(times), ("x", "y")), build, period=period)


def test_a_track_without_any_detection_is_the_prior_carried_forward():
    prior = prior_given([0, 0, 10, -10], [1, 1, 1, 1])
    result = track(Scans(np.arange(1.0, 6.0), [EMPTY] * 5, ("x", "y")), builder("runnalls-3", prior))
    np.testing.assert_allclose(result.x, straight(np.arange(1.0, 6.0), (0, 0, 10, -10)), atol=1e-12)
    assert (np.diff(result.P[:, 0, 0]) > 0).all()


START = np.datetime64("2026-11-28T12:34:56.700", "ms")
HERE = timezone(timedelta(hours=2))
MILLISECONDS = np.array([0, 100, 200, 300, 1300, 1400])  # of what no float holds a tenth


def moments_of(unit):
    return (START + MILLISECONDS.astype("timedelta64[ms]")).astype(f"datetime64[{unit}]")


def stamps(zone=None):
    utc = [time.replace(tzinfo=UTC) for time in moments_of("us").tolist()]
    return [time.astimezone(zone) if zone else time.replace(tzinfo=None) for time in utc]


GIVEN = {
    **{unit: moments_of(unit) for unit in ("ms", "us", "ns", "10ms")},
    "big-endian": moments_of("us").astype(">M8[us]"),
    "list": list(moments_of("ns")),
    "objects": np.array([moments_of("ms")[0], *moments_of("ns")[1:]], object),
    "datetime": stamps(),
    "array of datetime": np.array(stamps(), object),
    "utc": stamps(UTC),
    "zone": stamps(HERE),
    "seconds": moments_of("ms").astype(int) / 1000,
}


@pytest.mark.parametrize("given", GIVEN)
def test_the_same_moments_give_the_same_track_however_they_are_given(given, tmp_path):
    elapsed = MILLISECONDS / 1000
    x = straight(elapsed)
    build = builder("runnalls-5", prior_given(straight([-0.1])[0], [5, 5, 2, 2]))
    wanted = track(seen(elapsed, x), build)
    times = moments_of("ms").astype(int) / 1000
    scans = seen(elapsed, x)._replace(times=GIVEN[given])
    result = track(scans, build)
    np.testing.assert_array_equal(result.times, times)
    np.testing.assert_array_equal(result.x, wanted.x)
    np.testing.assert_array_equal(result.P, wanted.P)
    np.testing.assert_array_equal(track(from_first_detection(scans), build).x, wanted.x)
    write_scans(tmp_path / "scans.csv", *scans)
    np.testing.assert_array_equal(read_scans(tmp_path / "scans.csv").times, times)
    np.testing.assert_array_equal(filled(scans, 0.1).times[[0, 1, 2, 3, 13, 14]], times)


@pytest.mark.parametrize("unit", ["D", "h", "m", "s"])
def test_coarse_moments_are_seconds_too(unit):
    times = np.array(["1970-01-02", "1970-01-04"], f"datetime64[{unit}]")
    assert seconds(times).tolist() == [86400, 3 * 86400]


def test_a_prior_time_and_a_period_are_times_too():
    x = straight(MILLISECONDS / 1000)
    build = builder("runnalls-5", prior_given(straight([-0.5])[0], [5, 5, 2, 2]))
    wanted = track(seen(MILLISECONDS / 1000, x), build, 0.1, -0.5)
    scans = seen(MILLISECONDS, x)._replace(times=moments_of("us"))
    before = START - np.timedelta64(500, "ms")
    for period, prior_time in (
        (0.1, before),
        (np.timedelta64(100, "ms"), before.astype("M8[ns]")),
        (timedelta(milliseconds=100), before.astype("M8[us]").item()),
    ):
        np.testing.assert_array_equal(track(scans, build, period, prior_time).x, wanted.x)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([np.datetime64("NaT", "ms"), START], "times must be given in full, but number 0 is NaT"),
        ([START, START - np.timedelta64(1, "ms")], r"times must increase, but 2026.*699 follows 2026.*700"),
        ([*stamps()[:1], *stamps(UTC)[1:2]], "times must all have a time zone, or none"),
        (np.array([1, 2], "timedelta64[M]"), r"times in timedelta64\[M\] have no length in seconds"),
        ([stamps()[0], 5.0], "times must increase"),
        (["12:00", "12:01"], r"times must be seconds or datetimes \(datetime64, datetime.datetime\), got"),
        ([stamps()[0].date(), None], "times must be seconds or datetimes"),
        ([1j, 2j], "times must be seconds or datetimes"),
        (np.ma.array([0.0, 1.0], mask=[0, 1]), "times must be given in full, but some of it is masked"),
    ],
)
def test_what_is_no_time_is_refused(times, message):
    build = builder("nearest-neighbour", prior_given([0, 0, 0, 0], [1, 1, 1, 1]))
    with pytest.raises(ValueError, match=message):
        track(Scans(times, [EMPTY] * 2, ("x", "y")), build)


def test_a_period_that_is_a_moment_is_refused():
    with pytest.raises(ValueError, match="period must be seconds or a time difference, got the moment 2026"):
        filled(Scans([0.0, 1.0], [EMPTY] * 2, ("x", "y")), START)


def test_masked_detections_are_absent(tmp_path):
    z = np.ma.array([[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]], mask=[[0, 0], [1, 0], [1, 1]])
    write_scans(tmp_path / "scans.csv", [0.0, 1.0], [z, z[1:]], ("x", "y"))
    assert [points.tolist() for points in read_scans(tmp_path / "scans.csv").z] == [[[1.0, 2.0]], []]
    assert filled(Scans([0.0, 1.0], [z, z[1:]], ("x", "y")), 1.0).z[0].tolist() == [[1.0, 2.0]]
    kept = from_first_detection(Scans([0.0, 1.0], [z[1:], z], ("x", "y")))
    assert len(kept.times) == 1 and kept.times[0] == 1.0
    assert len(prior_from_first_scan(z, 1.0, 1.0).w) == 1
    with pytest.raises(ValueError, match="mean must be given in full, but some of it is masked"):
        prior_given(z[1], [1.0, 1.0])


def test_what_does_not_fit_the_trackers_is_refused():
    build = builder("nearest-neighbour", prior_given([0, 0, 0, 0], [1, 1, 1, 1]))
    two = Scans(np.array([0.0, 1.0]), [EMPTY] * 2, ("x", "y"))
    with pytest.raises(ValueError, match="scans have 1 coordinates, but the tracker's sensor 2"):
        track(Scans(two.times, [np.empty((0, 1))] * 2, ("x",)), build)
    with pytest.raises(ValueError, match=r"give a period, or a prior_time before 0\.0"):
        track(Scans(two.times[:1], two.z[:1], ("x", "y")), build)
    for late in (0.5, np.nan, -np.inf):
        with pytest.raises(ValueError, match=r"prior_time before 0\.0"):
            track(two, build, prior_time=late)
    with pytest.raises(ValueError, match="times must increase"):
        track(Scans(np.array([1.0, 0.0]), [EMPTY] * 2, ("x", "y")), build)


# priors and models


def test_the_first_estimate_of_a_prior_from_the_first_scan_is_its_mean_and_covariance():
    z = np.array([[0.0, 0.0], [100.0, 40.0]])
    prior = prior_from_first_scan(z, sensor_deviation=5.0, speed_deviation=30.0)
    assert prior.w.tolist() == [0.5, 0.5]
    assert prior.m.tolist() == [[0, 0, 0, 0], [100, 40, 0, 0]]
    assert all((P == np.diag([25, 25, 900, 900])).all() for P in prior.P)
    scans = Scans(np.array([3.0, 4.0]), [z, z], ("x", "y"))
    result = track(scans, builder("runnalls-30", prior), prior_time=3.0)
    mean, covariance = moments(prior)
    assert (result.x[0] == mean).all() and (result.P[0] == covariance).all()
    assert result.components[0] == 2 and result.P[1, 0, 0] != covariance[0, 0]


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_prior_from_the_first_scan_converges_on_an_aircraft_in_clutter(tmp_path, seed):
    scenario = recorded_flight("refuelling-orbit", clutter_rate=20, horizon=60)
    episode = draw(scenario, seed)
    # 20 false detections a scan in a square kilometre about the aircraft
    z = [scan(scenario, episode, t, scenario.sensor.H @ x).z for t, x in enumerate(episode.x)]
    write_scans(tmp_path / "flight.csv", np.arange(60.0), z, ("east", "north"))
    scans = from_first_detection(read_scans(tmp_path / "flight.csv"))
    prior = prior_from_first_scan(scans.z[0], 70**0.5, speed_deviation=150.0)
    build = builder(
        "runnalls-30", prior, density=scenario.model.clutter_density, acceleration=3.0, deviation=70**0.5
    )
    result = track(scans, build, period=1.0, prior_time=scans.times[0])
    error = np.hypot(*(result.x - episode.x)[:, :2].T)
    assert error[:3].max() > 50  # it did not know
    # sqrt(60) m of noise an axis; a wrong track would be hundreds of metres off
    assert error[-10:].max() < 40
    assert result.components.max() <= 30


def test_a_scan_of_ten_thousand_detections_is_taken_in():
    rng = np.random.default_rng(5)
    x = straight(np.arange(3.0))
    z = [np.vstack([rng.uniform(-2000, 2000, (9_999, 2)), row[:2]]) for row in x]
    prior = prior_given(straight([-1.0])[0], [5, 5, 2, 2])
    result = track(
        Scans(np.arange(3.0), z, ("x", "y")), builder("runnalls-30", prior, density=9_999 / 4000**2)
    )
    assert np.hypot(*(result.x - x)[:, :2].T).max() < 10
    with pytest.raises(ValueError, match=f"z must be 1 to {MOST_STARTS} finite detections"):
        prior_from_first_scan(z[0], 5.0, 30.0)


def test_tracking_starts_at_the_first_detection():
    point = np.ones((1, 2))
    scans = Scans(np.arange(4.0), [EMPTY, EMPTY, point, EMPTY], ("x", "y"))
    started = from_first_detection(scans)
    assert started.times.tolist() == [2.0, 3.0]
    assert (started.z[0] == point).all() and started.coordinates == ("x", "y")
    with pytest.raises(ValueError, match="scans hold no detection: all 2 are empty"):
        from_first_detection(Scans(scans.times[:2], scans.z[:2], ("x", "y")))


@pytest.mark.parametrize(
    "call, message",
    [
        (partial(prior_given, [[0.0]], [1.0]), "mean must be finite numbers"),
        (partial(prior_given, [np.nan], [1.0]), "mean must be finite numbers"),
        (partial(prior_given, [0.0, 0.0], [1.0]), "deviations must be 2 positive numbers"),
        (partial(prior_given, [0.0], [0.0]), "deviations must be 1 positive numbers"),
        (partial(prior_from_first_scan, EMPTY, 1.0, 1.0), "z must be 1 to"),
        (partial(prior_from_first_scan, [[np.nan]], 1.0, 1.0), "z must be 1 to"),
        (partial(prior_from_first_scan, [[0.0]], 0.0, 1.0), "sensor_deviation must be positive"),
        (partial(prior_from_first_scan, [[0.0]], 1.0, np.inf), "speed_deviation must be positive"),
    ],
)
def test_a_prior_that_cannot_be_is_refused(call, message):
    with pytest.raises(ValueError, match=message):
        call()


@pytest.mark.parametrize(
    "wrong, message",
    [
        ({"dt": 0.0}, "dt must be positive"),
        ({"axes": 0}, "axes must be positive"),
        ({"axes": 3}, "prior has 4 states, but sensor.H has 6"),
        ({"acceleration_deviation": -1.0}, "acceleration_deviation must be positive"),
        ({"sensor_deviation": np.nan}, "sensor_deviation must be positive"),
        ({"detection_probability": 1.1}, "detection_probability must lie in"),
        ({"gate_probability": 0.0}, "gate_probability must lie in"),
        ({"clutter_density": 0.0}, "clutter_density must be positive"),
    ],
)
def test_a_model_that_cannot_be_is_refused(wrong, message):
    right = {
        "dt": 1.0,
        "prior": prior_given([0, 0, 0, 0], [1, 1, 1, 1]),
        "axes": 2,
        "acceleration_deviation": 1.0,
        "sensor_deviation": 1.0,
        "detection_probability": 0.9,
        "clutter_density": QUIET,
    }
    constant_velocity_model(**right)
    with pytest.raises(ValueError, match=message):
        constant_velocity_model(**right | wrong)


def test_no_track_starts_beyond_all_measure():
    with pytest.raises(ValueError, match=r"z must lie within \+-1e\+10; row 1 is"):
        prior_from_first_scan([[0.0, 0.0], [2e10, 0.0]], 10.0, 30.0)
