"""Detections of made-up targets, and their tracks by a Kalman filter that knows which one is whose."""

from datetime import datetime
from typing import NamedTuple

import numpy as np

from gmr_gym.recorded.detections import Detections, SensorSpec, from_arrays
from gmr_gym.recorded.scans import Scan
from gmr_gym.recorded.tracks import COASTED, CONFIRMED, DELETED, TENTATIVE, Tracks

START = datetime(2024, 3, 1, 12, 0, 0, 250000)
REFERENCE = (63.4, 10.4, 20.0)
CONFIRM, PATIENCE = 3, 5  # detections, misses


class Made(NamedTuple):
    tracks: Tracks
    detections: Detections
    scans: list[Scan]
    truth: np.ndarray  # (T, n, 2)


def made(
    seed=0, scans=40, *, starts=((0.0, 0.0, 8.0, 3.0), (900.0, 200.0, -6.0, 4.0), (400.0, -300.0, 0.0, 0.0)),
    deviation=5.0, acceleration=0.3, seen=0.9, clutter=3.0, period=2.0, assumed=1.0, **fields,
) -> Made:  # fmt: skip
    """Targets from these states; `assumed` scales the deviation that the filter believes."""
    rng = np.random.default_rng(seed)
    x = np.array(starts, float)
    F, Q = _motion(period, acceleration)
    truth, times, filters = [], [], [None] * len(x)
    z, lines, scan_rows = [], [], []
    for t in range(scans):
        time = round(period * t, 6)
        moving = x[:, 2:].any(axis=1)
        x = np.where(moving[:, None], x @ F.T + rng.multivariate_normal(np.zeros(4), Q, len(x)), x)
        truth.append(x[:, :2])
        first = len(z)
        found = [-1] * len(x)
        for i in range(len(x)):
            if t < CONFIRM or rng.random() < seen:
                found[i] = len(z)
                z.append(x[i, :2] + rng.normal(0, deviation, 2))
        z.extend(rng.uniform(-1000, 1000, (rng.poisson(clutter), 2)))
        times.extend([time] * (len(z) - first))
        scan_rows.append(Scan(time, time, time, np.arange(first, len(z)), 0))
        for i, row in enumerate(found):
            filters[i], line = _step(filters[i], F, Q, (assumed * deviation) ** 2, z, row)
            if line is not None:
                lines.append((time, i + 1, *line))
    n = len(z)
    spec = SensorSpec(
        "radar", deviation=(assumed * deviation,) * 2, detection_probability=seen, clutter_per_scan=clutter
    )
    usual = {"sensors": [spec], "row": 2 + np.arange(n), "metadata": {"snr": [f"{i}.5" for i in range(n)]}}
    return Made(_tracks(lines), from_arrays(times, z, **usual | fields), scan_rows, np.array(truth))


def _motion(period, acceleration):
    F = np.eye(4) + period * np.eye(4, k=2)
    G = np.kron([[period**2 / 2], [period]], np.eye(2))
    return F, acceleration**2 * G @ G.T


def _step(kept, F, Q, R, z, row):
    """State of one filter after a scan: (x, P, detections, missed in a row, age), and its line."""
    H = np.eye(2, 4)
    if kept is None:
        x, P, hits, missed, age = np.r_[z[row], 0, 0], np.diag([R, R, 400.0, 400.0]), 1, 0, 0
        return (x, P, hits, missed, age), (TENTATIVE, x, P, 0.5, 1, row, 1.0, np.nan, age)
    x, P, hits, missed, age = kept
    if missed > PATIENCE:
        return kept, None
    x, P, nis = F @ x, F @ P @ F.T + Q, np.nan
    if row >= 0:
        S = H @ P @ H.T + R * np.eye(2)
        K, v = P @ H.T @ np.linalg.inv(S), z[row] - H @ x
        x, P, nis = x + K @ v, (np.eye(4) - K @ H) @ P, float(v @ np.linalg.solve(S, v))
    hits, missed, age = hits + (row >= 0), 0 if row >= 0 else missed + 1, age + 1
    status = CONFIRMED if row >= 0 else COASTED if missed <= PATIENCE else DELETED
    status = TENTATIVE if hits < CONFIRM else status
    return (x, P, hits, missed, age), (
        status, x, P, 0.99 if row >= 0 else 0.8, int(row >= 0), row, 0.97 * (row >= 0), nis, age,
    )  # fmt: skip


def _tracks(lines):
    time, track, status, x, P, existence, count, row, weight, nis, age = (
        np.array(column) for column in zip(*lines, strict=True)
    )
    modes = np.tile([0.75, 0.25], (len(lines), 1))
    return Tracks(time, track, status.astype(np.int8), x, P, existence, modes, count, row, weight, nis, age)
