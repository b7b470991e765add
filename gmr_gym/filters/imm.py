"""Compiled IMM with one Gaussian per mode: a scan in a few calls.

The same recursion as `filter_bank` and `association` give for banks of many hypotheses, for one hypothesis.
"""

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
    """Mix r modes (see `filter_bank.imm_mix`) and predict each by its motion model.

    w (r,), m (r, d) and P (r, d, d) are mode probabilities, means and covariances, switching (r, r) is the
    transition matrix, borrowed (r, r, d) comes from `borrowed_states`, and F, Q (r, d, d) and offset (r, d)
    are the motion models. Returns the predicted w, m and P.
    """
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
def pda_every_mode(predicted, predicted_z, gates, density, ball, log_miss, log_detect, give_up_limit):
    r"""Update every mode by PDA with one common list of detections.

    Returns mode probabilities, means and covariances, the IMM output's mean and covariance, and False where
    the track is to be given up. `predicted`, `predicted_z` and `gates` are plain tuples of the fields of a
    Mixture, its PredictedDetections and Gates, `ball` is the volume of the unit ball in the gates' space, and
    `density` the clutter density at each gate.

    Notes
    -----
    With the association weights of `association.expand` mode :math:`q` has the likelihood and PDA update

    .. math::

        \Lambda_q \propto 1 - P_D P_G + \sum_j \frac{P_D}{\lambda} \mathcal{N}(z_j; \hat z_q, S_q), \qquad
        \mu_q \propto \bar\mu_q \Lambda_q

    .. math::

        m_q = \bar m_q + K_q \sum_j \beta_{qj} \nu_{qj}, \qquad
        P_q = \beta_{q0} \bar P_q + \sum_j \beta_{qj} (I - K_q H) \bar P_q + \text{spread of the means}
    """
    (w, m, P), (z_hat, S, C, z, R, log_jacobian, H, noise) = predicted, predicted_z
    _, gate_S, threshold = gates
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
    listed_z = z_hat, S, C, z_near, R_near, log_jacobian[listed], H, noise
    full = expand_into_hypotheses(predicted, listed_z, np.inf, log_miss, log_detect)
    w, m, P = full.mixture
    w, m, P = match(w, m, P, full.parent, n)
    _, mean, covariance = match(w, m, P, np.zeros(n, np.int64), ONE)
    return w, m, P, mean, covariance, alive
