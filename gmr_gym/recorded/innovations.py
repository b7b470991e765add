"""Innovations of tracks, found again from what they hold after an update.

For a Kalman filter with one detection in the gate the residual after the update, e = z - h(x), and the
covariance of the state after it, P, say what the innovation v and its covariance S were: with the noise R
and C = R - H P H', v = R C^-1 e and S = R C^-1 R. Nothing of the prediction need be kept.
"""

from typing import NamedTuple

import numpy as np

from gmr_gym.recorded.detections import POLAR, Detections, SensorSpec
from gmr_gym.recorded.tracks import CONFIRMED, Tracks

SURE = 0.95  # weight from which a detection is taken for the track's own
LEAST_LEFT = 1e-6  # of the variance of a detection, that is not the state's after the update


class Innovations(NamedTuple):
    """Innovations of one sensor, in its own coordinates: m, or m, rad[, rad]."""

    row: np.ndarray  # (k,) index into `Tracks`, increasing
    v: np.ndarray  # (k, p)
    S: np.ndarray  # (k, p, p)
    cartesian: np.ndarray  # (k, 2), m, east and north


def innovations(tracks: Tracks, detections: Detections, sensor: int) -> Innovations:
    """The innovations of confirmed tracks with one detection in the gate, which they took.

    Parameters
    ----------
    tracks : Tracks
    detections : Detections
    sensor : int
        Index into `detections.sensors`; its deviations must be known.

    Returns
    -------
    Innovations
        Of the rows for which they can be found: not where the update added nothing. For one motion model and
        Cartesian detections at the time of the scan they are exact; else their directions are of the first
        order, and their lengths those of the tracker's NIS.
    """
    spec = detections.sensors[sensor]
    usable = (tracks.status == CONFIRMED) & (tracks.detections == 1) & (tracks.weight >= SURE)
    rows = np.flatnonzero(usable & (tracks.detection >= 0))
    rows = rows[detections.sensor[tracks.detection[rows]] == sensor]
    at = tracks.detection[rows]
    x, P = _at_time(tracks.x[rows], tracks.P[rows], detections.time[at] - tracks.time[rows])
    h, H = measured_of(x, detections.origin[at], spec)
    e = detections.z[at, : spec.p] - h
    if spec.kind == POLAR:
        e[:, 1] = (e[:, 1] + np.pi) % (2 * np.pi) - np.pi
    R = np.diag(np.square(spec.deviation))
    C = R - H @ P @ H.swapaxes(1, 2)
    scaled = C / np.sqrt(np.outer(R.diagonal(), R.diagonal()))
    sound = np.linalg.eigvalsh(scaled)[:, 0] > LEAST_LEFT
    rows, C, e, h = rows[sound], C[sound], e[sound], h[sound]
    v = (R @ np.linalg.solve(C, e[..., None]))[..., 0]
    S = R @ np.linalg.solve(C, np.broadcast_to(R, C.shape))
    v *= _scale(tracks.nis[rows], v, S, detections.range_rate[tracks.detection[rows]])[:, None]
    return Innovations(rows, v, S, _cartesian(v, h, spec))


def _scale(nis: np.ndarray, v: np.ndarray, S: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """What makes the innovations as long as the tracker says, where it says so of the same coordinates."""
    found = np.einsum("ki,ki->k", v, np.linalg.solve(S, v[..., None])[..., 0])
    known = np.isfinite(nis) & ~np.isfinite(rate) & (found > 0)
    return np.sqrt(np.divide(nis, found, out=np.ones(len(nis)), where=known))


def _at_time(x: np.ndarray, P: np.ndarray, after: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """States and covariances so many seconds later, or earlier, at constant velocity."""
    if not after.any():
        return x, P
    d = x.shape[1]
    F = np.eye(d) + after[:, None, None] * np.eye(d, k=d // 2)
    return (F @ x[..., None])[..., 0], F @ P @ F.swapaxes(1, 2)


def measured_of(x: np.ndarray, origin: np.ndarray, spec: SensorSpec) -> tuple[np.ndarray, np.ndarray]:
    """What the sensor measures of the states, (k, p), and its derivatives (k, p, d)."""
    k, d = x.shape
    p, axes = spec.p, d // 2
    H = np.zeros((k, p, d))
    if spec.kind != POLAR:
        H[:] = np.eye(p, d)
        return x[:, :p], H
    off = np.zeros((k, 3))
    off[:, :axes] = x[:, :axes] - origin[:, :axes]
    across, far = np.hypot(off[:, 0], off[:, 1]), np.linalg.norm(off, axis=1)
    h = np.stack([far, np.arctan2(off[:, 1], off[:, 0]), np.arctan2(off[:, 2], across)], axis=1)
    J = np.zeros((k, 3, 3))
    J[:, 0] = off / far[:, None]
    J[:, 1, 0], J[:, 1, 1] = -off[:, 1] / across**2, off[:, 0] / across**2
    J[:, 2, :2] = -off[:, :2] * (off[:, 2] / across / far**2)[:, None]
    J[:, 2, 2] = across / far**2
    H[:, :, :axes] = J[:, :p, :axes]
    return h[:, :p], H


def _cartesian(v: np.ndarray, h: np.ndarray, spec: SensorSpec) -> np.ndarray:
    """Innovations (k, p) of detections h as east and north, m."""
    if spec.kind != POLAR:
        return v[:, :2]
    cos, sin = np.cos(h[:, 1]), np.sin(h[:, 1])
    aside = h[:, 0] * v[:, 1]
    return np.stack([v[:, 0] * cos - aside * sin, v[:, 0] * sin + aside * cos], axis=1)
