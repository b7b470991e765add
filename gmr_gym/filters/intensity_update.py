"""What filters of an intensity share: likelihood ratios of components and detections, and posteriors."""

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, log_gaussian_scale, mahalanobis_squared
from gmr_gym.models.update import posterior_into

# a pair of component and detection that would weigh less, were there clutter alone beside it, is beyond
# the gate: all such pairs together are the rounding error of 1
LOG_NEGLIGIBLE = float(np.log(1e-18))


@kernel
def log_ratios(w, z_hat, S, z, log_kappa, detection_probability):
    """log of w P_D N(z; H m, S) / kappa(z) (n, k), minus infinity where that is negligible."""
    n, (k, p) = len(w), z.shape
    out = np.full((n, k), -np.inf)
    L, y = np.zeros((p, p)), np.empty(p)
    for i in range(n):
        if not cholesky_into(L, S[i]):
            raise ValueError("an innovation covariance S = H P H' + R is not positive definite")
        log_w = np.log(w[i] * detection_probability) if w[i] > 0.0 else -np.inf
        log_peak = log_w + log_gaussian_scale(L)
        for j in range(k):
            threshold = 2.0 * (log_peak - log_kappa[j] - LOG_NEGLIGIBLE)
            within = threshold > 0.0
            for r in range(p):
                # a gate is never wider than this along any axis: most clutter ends here
                within &= (z[j, r] - z_hat[i, r]) ** 2 <= threshold * S[i, r, r]
            if within:
                d2 = mahalanobis_squared(L, z[j], z_hat[i], y)
                if d2 <= threshold:
                    out[i, j] = log_peak - log_kappa[j] - 0.5 * d2
    return out


@kernel
def posteriors(missed, found, m, P, z_hat, S, C, H, R, z, least):
    """The components that weigh anything, and at least `least`, of those of weights missed (n,), as they
    are, and found (n, k), each conditioned on its detection; then the parent of each."""
    n, d = m.shape
    k, p = z.shape
    count = 0
    for i in range(n):
        count += missed[i] >= least and missed[i] > 0.0
        for j in range(k):
            count += found[i, j] >= least and found[i, j] > 0.0
    w_out, m_out, P_out = np.empty(count), np.empty((count, d)), np.empty((count, d, d))
    parent = np.empty(count, np.int64)
    L, K, W, P_hit = np.zeros((p, p)), np.empty((d, p)), np.empty((p, d)), np.empty((d, d))
    L_noise = np.zeros((p, p))
    at = 0
    for i in range(n):
        conditioned = False
        for j in range(-1, k):  # -1 for none
            weight = found[i, j] if j >= 0 else missed[i]
            if not (weight >= least and weight > 0.0):
                continue
            if j >= 0 and not conditioned:
                cholesky_into(L, S[i])
                posterior_into(P_hit, K, W, L, L_noise, P[i], C[i], H, R)
                conditioned = True
            w_out[at], parent[at] = weight, i
            for r in range(d):
                m_out[at, r] = m[i, r]
                if j >= 0:
                    for c in range(p):
                        m_out[at, r] += K[r, c] * (z[j, c] - z_hat[i, c])
                for c in range(d):
                    P_out[at, r, c] = P_hit[r, c] if j >= 0 else P[i, r, c]
            at += 1
    return w_out, m_out, P_out, parent
