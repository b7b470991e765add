"""Noise of sensors and of motion, from the detections that tracks took."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from gmr_gym.models.gating import gate_threshold
from gmr_gym.recorded.detections import POLAR, Detections
from gmr_gym.recorded.innovations import measured_of

MAD = 1.482602218505602  # standard deviations of a Gaussian in its median absolute deviation
WIDTH = 1.166 * np.sqrt(1.94)  # of its relative error, times sqrt(n): differences overlap
LONGEST = 2.5  # median intervals of a track, beyond which a gap is left out
BEYOND = 0.999  # probability of the gate beyond which a detection is taken for another's


class Likelihoods(NamedTuple):
    """What innovations say of c pairs of noise."""

    log: np.ndarray  # (c,), that of innovations beyond the gate is that of its edge
    nis: np.ndarray  # (c, n)
    dof: int  # of each innovation


def differences(hits: Sequence[np.ndarray], found: Detections, points: np.ndarray, sensor: int) -> np.ndarray:
    r"""How far detections of a sensor lie from the straight line between those before and after.

    Parameters
    ----------
    hits : sequence of ndarray of int
        Of each track the detections that it took, in order of time.
    found : Detections
    points : ndarray (n, p)
        Their positions in local coordinates, m.
    sensor : int

    Returns
    -------
    ndarray (k, p)
        In the coordinates of the sensor, with the deviation of one detection.

    Notes
    -----
    With the intervals :math:`s` before and :math:`t` after, the line is
    :math:`a z_0 + b z_2, a = t / (s + t), b = s / (s + t)`, and the distance from it has the variance
    :math:`\sigma^2 (1 + a^2 + b^2)`; for equal intervals it is half of :math:`z_0 - 2 z_1 + z_2`. What is
    accelerated by :math:`u` adds :math:`s t u / 2`.
    """
    triples = [np.empty((0, 3), int)]
    for taken in hits:
        own = taken[found.sensor[taken] == sensor]
        gap = np.diff(found.time[own])
        short = (gap > 0) & (gap <= LONGEST * np.median(gap)) if len(gap) else gap > 0
        at = np.flatnonzero(short[:-1] & short[1:])
        triples.append(own[at[:, None] + np.arange(3)])
    before, now, after = np.concatenate(triples).T
    s, t = found.time[now] - found.time[before], found.time[after] - found.time[now]
    a, b = (t / (s + t))[:, None], (s / (s + t))[:, None]
    spec, line = found.sensors[sensor], a * points[before] + b * points[after]
    h, _ = measured_of(np.hstack([line, 0 * line]), found.origin[now], spec)
    away = found.z[now, : spec.p] - h
    if spec.kind == POLAR:
        away[:, 1] = (away[:, 1] + np.pi) % (2 * np.pi) - np.pi
    return away / np.sqrt(1 + a**2 + b**2)


def deviation_of(away: np.ndarray) -> tuple[np.ndarray, float]:
    """Standard deviations (p,) of `differences`, whatever a few of them are, and the factor by which its 95 %
    interval goes up and down."""
    return MAD * np.median(np.abs(away), axis=0), float(np.exp(1.96 * WIDTH / np.sqrt(len(away))))


def likelihoods(
    hits: Sequence[np.ndarray], found: Detections, points: np.ndarray, pairs: np.ndarray
) -> Likelihoods:
    """Likelihoods of the innovations of Kalman filters that follow the tracks at nearly constant velocity.

    Parameters
    ----------
    hits : sequence of ndarray of int
        As for `differences`.
    found : Detections
        The deviations of its sensors must be known.
    points : ndarray (n, p)
    pairs : ndarray (c, 2)
        Factors of these deviations, and what white noise adds to the velocity in a second, m/s.

    Returns
    -------
    Likelihoods
    """
    p, c = points.shape[1], len(pairs)
    worst, log, nis = gate_threshold(BEYOND, p), np.zeros(c), [np.empty((c, 0))]
    for taken in hits:
        time, z, R = found.time[taken], points[taken], _local_covariances(found, points, taken)
        for d2, log_volume in _innovations(time, z, R, pairs, worst):
            log -= 0.5 * (np.minimum(d2, worst) + log_volume)
            nis.append(d2[:, None])
    return Likelihoods(log, np.hstack(nis), p)


def _local_covariances(found: Detections, points: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Covariances (k, p, p) of detections in local coordinates, m^2."""
    p = points.shape[1]
    covariances = np.empty((len(rows), p, p))
    for i, spec in enumerate(found.sensors):
        own = found.sensor[rows] == i
        x = points[rows[own]]
        _, H = measured_of(np.hstack([x, 0 * x]), found.origin[rows[own]], spec)
        back = np.linalg.inv(H[:, :, :p])
        covariances[own] = back @ np.diag(np.square(spec.deviation)) @ back.swapaxes(1, 2)
    return covariances


def _innovations(
    time: np.ndarray, z: np.ndarray, R: np.ndarray, pairs: np.ndarray, worst: float
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Of each detection from the third on its NIS (c,) and the logarithms of the determinants of the
    innovation covariances, for each pair of noise. One beyond the gate updates as if it were at the edge."""
    p, R = z.shape[1], pairs[:, 0, None, None, None] ** 2 * R
    q, eye = pairs[:, 1, None, None] ** 2, np.eye(p)
    dt = max(time[1] - time[0], 1e-3)
    x = np.tile(np.r_[z[1], (z[1] - z[0]) / dt], (len(pairs), 1))
    cross, spread = R[:, 1] / dt, (R[:, 0] + R[:, 1]) / dt**2 + q * dt / 3 * eye
    P = np.concatenate(
        [np.concatenate([R[:, 1], cross], axis=2), np.concatenate([cross, spread], axis=2)], axis=1
    )
    for k in range(2, len(time)):
        dt = time[k] - time[k - 1]
        F = np.eye(2 * p) + dt * np.eye(2 * p, k=p)
        Q = q * np.kron([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]], eye)
        x, P = x @ F.T, F @ P @ F.T + Q
        v, S = z[k] - x[:, :p], P[:, :p, :p] + R[:, k]
        d2 = np.einsum("ci,ci->c", v, np.linalg.solve(S, v[..., None])[..., 0])
        K = P[:, :, :p] @ np.linalg.inv(S) * (worst / np.maximum(d2, worst))[:, None, None]
        yield d2, np.linalg.slogdet(S)[1]
        x, P = x + (K @ v[..., None])[..., 0], P - K @ P[:, :p]
