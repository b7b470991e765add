"""Updates that the PHD, CPHD and PMB filters share: likelihood ratios and posterior components."""

import numpy as np

from gmr_gym.kernels import kernel, leaf_kernel
from gmr_gym.linalg import cholesky_into, log_gaussian_scale, mahalanobis_squared
from gmr_gym.mixture import Mixture
from gmr_gym.models.update import posterior_into

# pairs of component and detection with a smaller ratio to the clutter lie beyond the gate: their sum is of
# the order of the rounding error of 1
LOG_NEGLIGIBLE = float(np.log(1e-18))


@kernel
def log_ratios(w, z_hat, S, z, log_kappa, detection_probability):
    """log of w P_D N(z; H m, S) / kappa(z) (n, k), minus infinity where it is negligible.

    w (n,), z_hat (n, p) and S (n, p, p) are of the components, z (k, p) are detections, log_kappa (k,) is
    the log clutter intensity there.
    """
    # arrays: with the record of them all it takes 8 % longer to compile
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
                # bounding box of the gate: rejects most clutter cheaply
                within &= (z[j, r] - z_hat[i, r]) ** 2 <= threshold * S[i, r, r]
            if within:
                d2 = mahalanobis_squared(L, z[j], z_hat[i], y)
                if d2 <= threshold:
                    out[i, j] = log_peak - log_kappa[j] - 0.5 * d2
    return out


@kernel
def posteriors(missed, found, predicted_z, least):
    """Mixture of the posterior components of weight at least `least`, and the parent of each.

    missed is the Mixture of the n components with a missed detection, unchanged but for the weights; found
    (n, k) are the weights of components conditioned on each detection; predicted_z are the
    PredictedDetections of a Sensor.
    """
    w, m, P = missed
    z_hat, S, C = predicted_z.z_hat, predicted_z.S, predicted_z.C
    z, H, R = predicted_z.z[0], predicted_z.H[0], predicted_z.noise[0]
    (n, d), (k, p) = m.shape, z.shape
    count = 0
    for i in range(n):
        count += w[i] >= least and w[i] > 0.0
        for j in range(k):
            count += found[i, j] >= least and found[i, j] > 0.0
    w_out, m_out, P_out = np.empty(count), np.empty((count, d)), np.empty((count, d, d))
    parent = np.empty(count, np.int64)
    L, K, W, P_hit = np.zeros((p, p)), np.empty((d, p)), np.empty((p, d)), np.empty((d, d))
    L_noise = np.zeros((p, p))
    at = 0
    for i in range(n):
        conditioned = False
        for j in range(-1, k):  # -1: missed detection
            weight = found[i, j] if j >= 0 else w[i]
            if not (weight >= least and weight > 0.0):
                continue
            if j >= 0 and not conditioned:
                cholesky_into(L, S[i])
                posterior_into(P_hit, K, (W, L_noise), L, P[i], C[i], H, R)
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
    return Mixture(w_out, m_out, P_out), parent


@leaf_kernel
def log_sum(a, b):
    """log(exp a + exp b)."""
    top = a if a > b else b
    least = b if a > b else a
    return top + np.log1p(np.exp(least - top)) if least > -np.inf else top
