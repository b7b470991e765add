"""A bank of motion models in every track, each track with its own time, compared with detections at theirs.

The recursion of `imm` for intervals that differ: mixed over the interval to the scan, carried to each
detection's own time and, after its update, on to the time of the scan.
"""

from typing import NamedTuple

import numpy as np

from gmr_gym.kernels import ONE, ZERO, kernel
from gmr_gym.linalg import cholesky_into, mahalanobis_squared
from gmr_gym.mixture import match
from gmr_gym.models.intervals import switching_over, transition
from gmr_gym.models.kalman import predict_all
from gmr_gym.models.positions import compared
from gmr_gym.models.update import posterior_into


class Banks(NamedTuple):
    """IMM banks of n tracks.

    Attributes
    ----------
    w : ndarray (n, r)
        Mode probabilities.
    m, P : ndarray (n, r, d), (n, r, d, d)
        Mean and covariance of each mode.
    time : ndarray (n,)
        Time of each track, s.
    """

    w: np.ndarray
    m: np.ndarray
    P: np.ndarray
    time: np.ndarray


@kernel(inline="always")
def mix(banks, modes, time):
    """Mix the modes of every track over the interval from its own time to `time`, in place (see
    `imm.mix_and_predict`; no mode is moved yet)."""
    n, r = banks.w.shape
    one, before, switching = np.zeros(r, np.int64), np.nan, np.eye(r)
    for i in range(n if r > 1 else 0):
        dt = time - banks.time[i]
        if dt != before:
            before, switching = dt, switching_over(modes, dt)
        w, m, P = banks.w[i].copy(), banks.m[i].copy(), banks.P[i].copy()
        for q in range(r):
            total, mean, covariance = match(switching[q] * w, m, P, one, ONE)
            banks.w[i, q], banks.m[i, q], banks.P[i, q] = total[0], mean[0], covariance[0]


@kernel
def carried(banks, modes, time, axes):
    """The banks with every mode carried from the track's own time to `time`; mode probabilities stay."""
    n, r, d = banks.m.shape
    m_out, P_out, none = np.empty((n, r, d)), np.empty((n, r, d, d)), np.zeros(d)
    for q in range(r):
        before, F, Q = np.nan, np.eye(d), np.eye(d)
        for i in range(n):
            dt = time - banks.time[i]
            if dt != before:
                before = dt
                F, Q = transition(modes, q, dt, axes, d)
            m, P = predict_all(banks.m[i, q : q + 1], banks.P[i, q : q + 1], F, Q, none)
            m_out[i, q], P_out[i, q] = m[0], P[0]
    return Banks(banks.w, m_out, P_out, np.full(n, time))


@kernel
def moved(m, P, modes, mode, dt, axes):
    """One mode's mean (d,) and covariance (d, d) carried over dt seconds."""
    d = len(m)
    F, Q = transition(modes, mode, dt, axes, d)
    m, P = predict_all(m.reshape(1, d), P.reshape(1, d, d), F, Q, np.zeros(d))
    return m[0], P[0]


@kernel
def at_detection(banks, predicted, modes, look, pair):
    """Mean and covariance of a mode at the time of a detection; pair is (track, mode, detection)."""
    i, q, j = pair
    if look.at[j] == predicted.time[i]:
        return predicted.m[i, q], predicted.P[i, q]
    axes = look.z.shape[1]
    return moved(banks.m[i, q], banks.P[i, q], modes, q, look.at[j] - banks.time[i], axes)


@kernel
def conditioned(m, P, modes, look, pair):
    """`at_detection` updated with the detection and carried on to the time of the scan."""
    _, q, j = pair
    nu, H, noise, C, L, _, _ = compared(m, P, look, j)
    p, d = H.shape
    m_hit, P_hit, K = m.copy(), np.empty((d, d)), np.empty((d, p))
    posterior_into(P_hit, K, (np.empty((p, d)), np.zeros((p, p))), L, P, C, H, noise)
    for r in range(d):
        for c in range(p):
            m_hit[r] += K[r, c] * nu[c]
    if look.at[j] == look.time:
        return m_hit, P_hit
    return moved(m_hit, P_hit, modes, q, look.time - look.at[j], look.z.shape[1])


@kernel
def normalised_innovation(banks, predicted, modes, look, i, j):
    """Squared innovation of detection j, normalised by the covariance of the mixture of the modes of track
    i."""
    r, one = banks.w.shape[1], np.zeros(banks.w.shape[1], np.int64)
    m, P = at_detection(banks, predicted, modes, look, (i, ZERO, j))
    q = len(compared(m, P, look, j)[0])
    off, S, L = np.empty((r, q)), np.empty((r, q, q)), np.zeros((q, q))
    for mode in range(r):
        m, P = at_detection(banks, predicted, modes, look, (i, mode, j))
        nu, _, _, _, L_mode, _, _ = compared(m, P, look, j)
        off[mode], S[mode] = nu, L_mode @ L_mode.T
    _, nu, S = match(banks.w[i].copy(), off, S, one, ONE)
    cholesky_into(L, S[0])
    return mahalanobis_squared(L, nu[0], np.zeros(q), np.empty(q))
