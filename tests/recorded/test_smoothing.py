"""Smoothed tracks: the joint Gaussian of one motion model, and what smoothing is for."""

from itertools import pairwise

import numpy as np
import pytest

from gmr_gym.models.intervals import transition
from gmr_gym.recorded import LiveTracker, Scan, SensorSpec, Tracks, from_arrays, track, tracking_model
from gmr_gym.recorded.smoothing import smooth

RADAR = SensorSpec("radar", deviation=(5.0, 8.0), detection_probability=0.9, clutter_per_scan=0.01)
ROWS = [2.0, 4.0, 5.0, 8.0, 10.0, 12.0]  # s, of scans
SEEN = [1.5, 4.0, 4.2, None, 9.9, 11.0]  # s, of their detections


def tracked(motion, acceleration, x):
    """Detections of one target at x(t), their scans tracked, the model."""
    rng = np.random.default_rng(1)
    at = np.array([t for t in SEEN if t is not None])
    z = np.array([x(t) for t in at]) + rng.normal(0, [5.0, 8.0], (len(at), 2))
    found, row = from_arrays(at, z, sensors=[RADAR]), 0
    scans = []
    for time, seen in zip(ROWS, SEEN, strict=True):
        rows = np.arange(row, row + (seen is not None))
        row += len(rows)
        scans.append(Scan(time, time, time, rows, 0))
    model = tracking_model(
        [RADAR], (-1e3, -1e3), (1e3, 1e3), motion=motion, acceleration_deviation=acceleration, max_speed=40.0
    )
    return found, track(found, scans, model), model


def test_with_one_motion_model_rows_are_those_of_the_joint_gaussian():
    """All states at all times at once: least squares over prior, motion and detections."""
    found, tracks, model = tracked("constant-velocity", 0.7, lambda t: [10.0 * t, 50.0 - 3.0 * t])
    assert tracks.track.tolist() == [1] * len(ROWS)
    times = sorted({*ROWS, *found.time})
    size = 4 * len(times)
    information, pull = np.zeros((size, size)), np.zeros(size)

    def add(A, value, covariance):
        weighted = A.T @ np.linalg.inv(covariance)
        information[...] += weighted @ A
        pull[...] += weighted @ value

    def state(time):
        rows = np.zeros((4, size))
        at = 4 * times.index(time)
        rows[:, at : at + 4] = np.eye(4)
        return rows

    R = np.diag([25.0, 64.0])
    for time, z in zip(found.time, found.z, strict=True):
        add(state(time)[:2], z, R)
    add(state(found.time[0])[2:], np.zeros(2), 400.0 * np.eye(2))  # uniform up to 40 m/s in the plane
    for before, after in pairwise(times):
        F, Q = transition(model.bank(), 0, after - before, 2, 4)
        add(state(after) - F @ state(before), np.zeros(4), Q)
    P = np.linalg.inv(information)
    x = P @ pull
    smoothed = smooth(tracks, found, model)
    for row, time in enumerate(ROWS):
        at = slice(4 * times.index(time), 4 * times.index(time) + 4)
        np.testing.assert_allclose(smoothed.x[row], x[at], rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(smoothed.P[row], P[at, at], rtol=1e-6, atol=1e-6)


def test_smoothing_changes_nothing_but_states_and_brings_errors_down():
    errors = []
    for seed in range(3):
        rng = np.random.default_rng(seed)
        times = np.arange(40.0)
        truth = np.stack([12 * times, 60 * np.sin(times / 8)], axis=1)
        found = from_arrays(times, truth + rng.normal(0, [5.0, 8.0], (40, 2)), sensors=[RADAR])
        scans = [Scan(t, t, t, np.array([i]), 0) for i, t in enumerate(times)]
        model = tracking_model([RADAR], (-1e3, -1e3), (1e3, 1e3), acceleration_deviation=(0.1, 2.0))
        tracks = track(found, scans, model)
        smoothed = smooth(tracks, found, model)
        for name in ("time", "track", "status", "existence", "detection", "age"):
            np.testing.assert_array_equal(getattr(tracks, name), getattr(smoothed, name))
        np.testing.assert_allclose(smoothed.x[-1], tracks.x[-1], atol=0.2)
        mine = tracks.track == 1
        at = tracks.time[mine].astype(int)
        errors.append([np.sqrt(((t.x[mine, :2] - truth[at]) ** 2).mean()) for t in (tracks, smoothed)])
    filtered, after = np.mean(errors, axis=0)
    assert after < 0.75 * filtered


def restricted(tracks, found, model, until, scan):
    """The rows at one scan's time, smoothed by all rows until another's."""
    past = Tracks(*(column[tracks.time <= until] for column in tracks))
    late = smooth(past, found, model)
    return Tracks(*(column[late.time == scan] for column in late))


def test_rows_some_scans_late_are_those_of_all_data_up_to_then(tmp_path):
    """Two targets and false alarms, one of which ends; saved and loaded on the way."""
    rng, lag = np.random.default_rng(5), 3
    times, at, z, scans = np.arange(16.0), [], [], []
    for t in times:
        here = [[10.0 * t, 50.0], *([[-300.0, 8.0 * t]] if t < 6 else []), rng.uniform(-900, 900, 2)]
        scans.append(Scan(t, t - 0.4, t, np.arange(len(z), len(z) + len(here)), 0))
        z += list(np.array(here) + rng.normal(0, [5.0, 8.0], (len(here), 2)))
        at += [t - 0.4, *[t] * (len(here) - 1)]
    found = from_arrays(at, z, sensors=[RADAR])
    model = tracking_model(
        [RADAR], (-1e3, -1e3), (1e3, 1e3), acceleration_deviation=(0.1, 2.0), delete=(2, 3), max_speed=20.0
    )
    tracks, tracker, seen = track(found, scans, model), LiveTracker(model, lag=lag), 0
    for i, scan in enumerate(scans):
        tracker.update(scan.time, found.z[scan.rows], times=found.time[scan.rows])
        if i == 8:
            tracker.save(tmp_path / "tracker.npz")
            tracker = LiveTracker.load(tmp_path / "tracker.npz")
        late, wanted = tracker.smoothed(), restricted(tracks, found, model, times[i], times[max(i - lag, 0)])
        assert late.track.tolist() == (wanted.track.tolist() if i >= lag else [])
        if i >= lag:
            for name in ("time", "status", "x", "P", "modes", "existence"):
                np.testing.assert_allclose(getattr(late, name), getattr(wanted, name), rtol=1e-9, atol=1e-9)
            seen += len(late.track)
            assert len(tracker.state.last[0].label) < 2 * (lag + 2) * 12
    assert seen > 30 and {1, 2} < set(tracks.track.tolist())
    last = tracker.smoothed(0)
    wanted = restricted(tracks, found, model, times[-1], times[-1])
    np.testing.assert_allclose(last.x, wanted.x, rtol=1e-9, atol=1e-9)


def test_reports_of_single_targets_are_smoothed_late_too():
    times, names = np.arange(12.0), ["a", "b", "a", "a"] * 3
    z = np.stack([5 * times, np.where(np.array(names) == "a", 0.0, 400.0)], axis=1)
    found = from_arrays(times, z, sensors=[RADAR], identity=names)
    scans = [Scan(t, t, t, np.array([i]), 0) for i, t in enumerate(times)]
    model = tracking_model([RADAR], (-1e3, -1e3), (1e3, 1e3))
    tracks, tracker = track(found, scans, model, reports=True), LiveTracker(model, lag=2)
    for i, t in enumerate(times):
        tracker.update(t, z[i : i + 1], identity=names[i])
        if i >= 2:
            late, wanted = tracker.smoothed(), restricted(tracks, found, model, t, times[i - 2])
            np.testing.assert_allclose(late.x, wanted.x, rtol=1e-9, atol=1e-9)
            assert late.track.tolist() == wanted.track.tolist() == [1 if names[i - 2] == "a" else 2]


def test_a_lag_that_is_not_kept_is_refused():
    model = tracking_model([RADAR], (-1e3, -1e3), (1e3, 1e3))
    with pytest.raises(ValueError, match="lag must be a number of scans, 0 or more, got -1"):
        LiveTracker(model, lag=-1)
    with pytest.raises(ValueError, match=r"lag must be in 0\.\.2, got 3; give LiveTracker\(model, lag="):
        LiveTracker(model, lag=2).smoothed(3)


def test_a_doubtful_detection_counts_as_much_as_the_tracker_believed_it():
    """The last row, which nothing follows, against the update by probabilistic data association."""
    at, z = [0.0, 1.0, 2.0, 3.0], [[0.0, 0.0], [10.0, 0.0], [20.0, 0.0], [30.0, 40.0]]
    found = from_arrays(at, z, sensors=[RADAR])
    scans = [Scan(t, t, t, np.array([i]), 0) for i, t in enumerate(at)]
    model = tracking_model(
        [RADAR], (-1e3, -1e3), (1e3, 1e3), motion="constant-velocity", acceleration_deviation=2.0
    )
    tracks = track(found, scans, model)
    tracks = Tracks(*(column[tracks.track == 1] for column in tracks))
    share = 0.4
    weight = np.append(tracks.existence[:-1], share * tracks.existence[-1])
    tracks = tracks._replace(weight=weight, detection=np.arange(4))
    sure, missed = (
        smooth(tracks._replace(weight=np.append(weight[:-1], part)), found, model)
        for part in (tracks.existence[-1], 0.0)
    )
    smoothed = smooth(tracks, found, model)
    (hit, P_hit), (miss, P_miss) = ((each.x[-1], each.P[-1]) for each in (sure, missed))
    off = hit - miss
    np.testing.assert_allclose(smoothed.x[-1], miss + share * off, rtol=1e-9)
    P = share * P_hit + (1 - share) * P_miss + share * (1 - share) * np.outer(off, off)
    np.testing.assert_allclose(smoothed.P[-1], P, rtol=1e-9)
