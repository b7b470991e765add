"""Smoothed tracks: the joint Gaussian of one motion model, and what smoothing is for."""

from itertools import pairwise

import numpy as np

from gmr_gym.models.intervals import transition
from gmr_gym.recorded import Scan, SensorSpec, from_arrays, track, tracking_model
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
