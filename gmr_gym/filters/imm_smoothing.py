"""Forward and backward pass over the banks of one track."""

import numpy as np

from gmr_gym.filters.imm_tracks import carried, conditioned, mix
from gmr_gym.kernels import ONE, ZERO, kernel
from gmr_gym.linalg import cholesky_into
from gmr_gym.mixture import match
from gmr_gym.models.intervals import switching_over, transition
from gmr_gym.models.kalman import predict_all
from gmr_gym.models.positions import compared


@kernel
def advanced(banks, modes, look):
    """The bank of one track at the time of the look, updated with its detection, if there is one, as its own
    for certain; the bank given is mixed in place."""
    mix(banks, modes, look.time)
    after = carried(banks, modes, look.time, look.z.shape[1])
    if len(look.at) == 0:
        return after
    r = banks.w.shape[1]
    log_likelihood = np.empty(r)
    for q in range(r):
        m, P = after.m[0, q].copy(), after.P[0, q].copy()
        log_likelihood[q] = compared(m, P, look, ZERO)[6]
        after.m[0, q], after.P[0, q] = conditioned(m, P, modes, look, (ZERO, q, ZERO))
    w = banks.w[0] * np.exp(log_likelihood - log_likelihood.max())
    after.w[0] = w / w.sum()
    return after


@kernel
def smoothed(banks, modes, axes):
    r"""Mode probabilities (T, r), means (T, d) and covariances (T, d, d) given all detections, of the T
    filtered banks of one track, in order of time.

    Notes
    -----
    Let x be the state before and :math:`x_+` the one after, taken as jointly Gaussian with the first two
    moments that the bank gives them: with :math:`w_{ij} = \pi_{ij} \mu_j`, the probability of mode j before
    and i after,

    .. math::

        m^- = \sum w_{ij} F_i m_j, \qquad
        P^- = \sum w_{ij} \left( F_i P_j F_i^T + Q_i + (F_i m_j - m^-) (\cdot)^T \right), \qquad
        C = \sum w_{ij} \left( P_j F_i^T + (m_j - m) (F_i m_j - m^-)^T \right)

    as :math:`x_+ = F_i x + q_i` has the covariance :math:`P_j F_i^T` with x in each pair, and
    :math:`\mathrm{cov}(x, x_+) = \mathrm{E}\,\mathrm{cov} + \mathrm{cov}\,\mathrm{E}`. Given :math:`x_+`, x
    has the mean :math:`m + G (x_+ - m^-)` and the covariance :math:`P - G P^- G^T`, :math:`G = C (P^-)^{-1}`,
    whatever comes later. Over :math:`x_+` given all detections, of mean :math:`m^s_+` and covariance
    :math:`P^s_+`, these are

    .. math:: m^s = m + G (m^s_+ - m^-), \qquad P^s = P + G (P^s_+ - P^-) G^T

    With one mode this is the smoother of Rauch, Tung and Striebel (1965), exact for a linear model. That of
    each pair of modes (Kim 1994) drifts off with a quiet mode, which is certain of straight motion; its mode
    probabilities are taken:

    .. math:: \mu_j^s = \sum_i \mu_{i+}^s \frac{w_{ij}}{\sum_l w_{il}}

    References
    ----------
    Rauch, Tung and Striebel 1965; Kim 1994.
    """
    steps, r, d = banks.m.shape
    w_out, m_out, P_out = banks.w.copy(), np.empty((steps, d)), np.empty((steps, d, d))
    pairs, one, none = np.zeros(r * r, np.int64), np.zeros(r, np.int64), np.zeros(d)
    w, m, P = np.empty(r * r), np.empty((r * r, d)), np.empty((r * r, d, d))
    for t in range(steps - 1, -1, -1):
        _, mean, covariance = match(banks.w[t].copy(), banks.m[t].copy(), banks.P[t].copy(), one, ONE)
        m_out[t], P_out[t] = mean[0], covariance[0]
        if t == steps - 1:
            continue
        dt, C = banks.time[t + 1] - banks.time[t], np.zeros((d, d))
        switching = switching_over(modes, dt)
        w_out[t] = 0.0
        for i in range(r):
            F, Q = transition(modes, i, dt, axes, d)
            m[i * r : i * r + r], P[i * r : i * r + r] = predict_all(banks.m[t], banks.P[t], F, Q, none)
            before = switching[i] * banks.w[t]
            w[i * r : i * r + r] = before
            if before.sum() > 0.0:
                w_out[t] += w_out[t + 1, i] * before / before.sum()
            for j in range(r):
                off, ahead = banks.m[t, j] - mean[0], m[i * r + j] - mean[0]  # any centre does: off sums to 0
                C += before[j] * (banks.P[t, j] @ F.T + off.reshape(d, 1) * ahead)
        _, predicted, S = match(w, m, P, pairs, ONE)
        if not cholesky_into(np.zeros((d, d)), S[0]):  # to rounding: the filtered state stays
            continue
        G = np.linalg.solve(S[0], C.T).T
        m_out[t] += G @ (m_out[t + 1] - predicted[0])
        change = G @ (P_out[t + 1] - S[0]) @ G.T
        P_out[t] += (change + change.T) / 2
    return w_out, m_out, P_out
