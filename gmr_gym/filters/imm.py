"""Interacting multiple models with one Gaussian each, a scan in three calls: what `modes` and `association`
say of banks of many hypotheses, put together in loops for one."""

import numpy as np

from gmr_gym.filters.association import expand_into_hypotheses
from gmr_gym.filters.mixing import borrow_into
from gmr_gym.kernels import ONE, kernel
from gmr_gym.linalg import root_determinants
from gmr_gym.mixture import match
from gmr_gym.models.gating import gated_distances_kernel
from gmr_gym.models.kalman import predict_all


@kernel
def mix_and_predict(w, m, P, switching, borrowed, F, Q, offset):
    """Probabilities (r,), means (r, d) and covariances (r, d, d) of r modes, mixed by the switching
    matrix, with `borrowed_states` (r, r, d), and carried forward by F, Q (r, d, d) and offset (r, d)."""
    r, d = m.shape
    one = np.zeros(r, np.int64)
    w_out, m_out, P_out = np.zeros(r), np.empty((r, d)), np.empty((r, d, d))
    unlike = borrowed.any()
    for q in range(r):
        m_in, P_in = m, P
        if unlike:
            m_in, P_in = m.copy(), P.copy()
            for p in range(r):
                borrow_into(m_in[p : p + 1], P_in[p : p + 1], m[q : q + 1], P[q : q + 1], borrowed[q, p])
        total, mean, covariance = match(switching[q] * w, m_in, P_in, one, ONE)
        mean, covariance = predict_all(mean, covariance, F[q], Q[q], offset[q])
        w_out[q], m_out[q], P_out[q] = total[0], mean[0], covariance[0]
    return w_out, m_out, P_out


@kernel
def pda_every_mode(
    w, m, P, gate_S, density, ball, z_hat, S, C, z, R, log_jacobian, H, noise,
    threshold, log_miss, log_detect, give_up_limit,
):  # fmt: skip
    """The scan taken in by all modes, one list of detections for all, and merged to one Gaussian each; their
    probabilities; what they fuse to; and whether there was hope. ball is the volume of the unit ball in the
    space of the gates, whose innovation covariances are gate_S; the rest is a `PredictedDetections`."""
    n, k = len(w), len(log_jacobian)
    alive = ball * (w * density * root_determinants(gate_S)).sum() / w.sum() <= give_up_limit
    near = np.zeros(k, np.bool_)
    if alive:
        d2 = gated_distances_kernel(z_hat, S, z, R, threshold)
        for j in range(k):
            for i in range(n):
                near[j] |= w[i] > 0 and d2[i, j] < np.inf
    listed = np.flatnonzero(near)
    z_near = np.empty((len(z), len(listed), z.shape[2]))
    R_near = np.empty((len(listed) if len(R) else 0, *R.shape[1:]))
    for at in range(len(listed)):
        z_near[:, at] = z[:, listed[at]]
        if len(R):
            R_near[at] = R[listed[at]]
    w, m, P, parent, _, _ = expand_into_hypotheses(
        w, m, P, z_hat, S, C, z_near, R_near, log_jacobian[listed], H, noise, np.inf, log_miss, log_detect
    )
    w, m, P = match(w, m, P, parent, n)
    _, mean, covariance = match(w, m, P, np.zeros(n, np.int64), ONE)
    return w, m, P, mean, covariance, alive
