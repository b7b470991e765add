"""Detections that are positions, Cartesian or polar about a sensor that may move, with range rate or without.

Polar detections update by the extended Kalman filter in the sensor's own coordinates. The range rate is not
linear in the position in any coordinates, and in the sensor's the noise of a detection is diagonal whatever
the track, so that one form serves range, azimuth, elevation and range rate.
"""

from typing import NamedTuple

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, log_gaussian_scale, mahalanobis_squared
from gmr_gym.models.spherical import inverse_jacobian_of, spherical_of, wrapped_angle


class Look(NamedTuple):
    """Detections of one scan of a sensor.

    Attributes
    ----------
    time : float
        s, to which tracks are brought.
    at : ndarray (k,)
        Time of each detection, s.
    z : ndarray (k, p)
        m, or range m, azimuth rad[, elevation rad] about the sensor.
    range_rate : ndarray (k,)
        m/s, NaN where not measured.
    origin : ndarray (k, 3)
        Position of the sensor, m.
    deviation : ndarray (p + 1,)
        Standard deviations of z and of the range rate.
    polar : bool
    """

    time: float
    at: np.ndarray
    z: np.ndarray
    range_rate: np.ndarray
    origin: np.ndarray
    deviation: np.ndarray
    polar: bool


@kernel
def measured(x, origin, polar, with_rate, p):
    """What is measured of the state x (d,), and its derivatives (., d): p coordinates, then the range
    rate."""
    h, H = np.empty(p + with_rate), np.zeros((p + with_rate, len(x)))
    off = np.zeros((1, 3))
    for i in range(p):
        off[0, i] = x[i] - origin[i]
    if polar:
        place = spherical_of(off)
        J = inverse_jacobian_of(place)
        for i in range(p):
            h[i] = place[0, i]
            for j in range(p):
                H[i, j] = J[0, i, j]
    else:
        for i in range(p):
            h[i], H[i, i] = x[i], 1.0
    if with_rate:
        far, rate = np.sqrt((off**2).sum()), 0.0
        for i in range(p):
            rate += off[0, i] * x[p + i] / far
        h[p] = rate
        for i in range(p):
            H[p, i] = (x[p + i] - rate * off[0, i] / far) / far
            H[p, p + i] = off[0, i] / far
    return h, H


@kernel
def compared(m, P, look, j):
    """Detection j with the Gaussian m (d,), P (d, d) at its time: innovation, H, noise, H P, the Cholesky
    factor of the innovation covariance, squared distance and log likelihood."""
    p, d = look.z.shape[1], len(m)
    with_rate = 1 if np.isfinite(look.range_rate[j]) else 0
    h, H = measured(m, look.origin[j], look.polar, with_rate, p)
    q = p + with_rate
    nu, C, noise, S, L = np.empty(q), np.zeros((q, d)), np.zeros((q, q)), np.empty((q, q)), np.zeros((q, q))
    for i in range(q):
        nu[i] = (look.z[j, i] if i < p else look.range_rate[j]) - h[i]
        noise[i, i] = look.deviation[i] ** 2
        for c in range(d):
            for k in range(d):
                C[i, c] += H[i, k] * P[k, c]
    if look.polar:
        nu[1] = wrapped_angle(nu[1])
    for i in range(q):
        for c in range(i + 1):
            total = noise[i, c]
            for k in range(d):
                total += C[i, k] * H[c, k]
            S[i, c] = S[c, i] = total
    if not cholesky_into(L, S):
        raise ValueError("an innovation covariance S = H P H' + R is not positive definite")
    d2 = mahalanobis_squared(L, nu, np.zeros(q), np.empty(q))
    return nu, H, noise, C, L, d2, log_gaussian_scale(L) - 0.5 * d2
