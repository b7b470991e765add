"""The Kalman measurement update: gain and covariance, formed here alone."""

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into

# trace of noise^-1 S: the ratio of the variances of prediction and noise. P - W'W has a rounding error of
# 1e-16 P, so that up to this ratio it is accurate to eight digits; at 1e16 the noise is lost
WIDEST = 1e8


@kernel(inline="always")
def posterior_into(P_out, K, room, L, P, C, H, noise):
    r"""Covariance and gain of the Kalman update, written to P_out and K; room, (p, d) and (p, p), is
    workspace.

    Notes
    -----
    With the innovation covariance S = L L', C = H P, and W = L^-1 C:

    .. math::

        K = P H^T S^{-1} = W^T L^{-1}, \qquad P^+ = P - K S K^T = P - W^T W

    P_out is Joseph's form where P is so much larger than the noise, S - H P H', that its rounding hides the
    noise.
    """
    (W, L_noise), (p, d) = room, C.shape
    wide = 0.0 if cholesky_into(L_noise, noise) else np.inf
    for c in range(p):
        for r in range(c, p):
            total = L[r, c]
            for k in range(c, r):
                total -= L_noise[r, k] * W[k, c]
            W[r, c] = total / L_noise[r, r]
            wide += W[r, c] * W[r, c]
    for c in range(d):
        for r in range(p):
            total = C[r, c]
            for k in range(r):
                total -= L[r, k] * W[k, c]
            W[r, c] = total / L[r, r]
        for r in range(p - 1, -1, -1):
            total = W[r, c]
            for k in range(r + 1, p):
                total -= L[k, r] * K[c, k]
            K[c, r] = total / L[r, r]
    if not wide <= WIDEST:
        joseph_into(P_out, K, P, H, noise)
    else:
        for r in range(d):
            for c in range(r + 1):
                total = P[r, c]
                for k in range(p):
                    total -= W[k, r] * W[k, c]
                P_out[r, c] = P_out[c, r] = total


@kernel
def joseph_into(P_out, K, P, H, noise):
    r"""Covariance of the Kalman update in Joseph's form: a sum of squares, so that it stays positive
    definite.

    Notes
    -----
    .. math::

        P^+ = A P A^T + K R K^T, \qquad A = I - K H

    with R the noise (Bucy and Joseph 1968). A has a rounding error of 1e-16 and enters twice: with standard
    deviations of P 1e10 times those of the noise P_out is accurate to eleven digits, with 1e12 to seven, with
    1e15 to one.
    """
    p, d = H.shape
    A, AP, KN = np.eye(d), np.zeros((d, d)), np.zeros((d, p))
    for i in range(d):
        for r in range(p):
            for k in range(d):
                A[i, k] -= K[i, r] * H[r, k]
            for k in range(p):
                KN[i, r] += K[i, k] * noise[k, r]
        for k in range(d):
            for j in range(d):
                AP[i, j] += A[i, k] * P[k, j]
    for i in range(d):
        for j in range(i + 1):
            total = 0.0
            for k in range(d):
                total += AP[i, k] * A[j, k]
            for r in range(p):
                total += KN[i, r] * K[j, r]
            P_out[i, j] = P_out[j, i] = total
