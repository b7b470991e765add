"""What a detection makes of a Gaussian: its gain and covariance, in the one place where they are formed."""

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into

# of noise^-1 S, its trace: the square of how much wider than the noise a prediction is. P - W'W rounds a part
# in 1e16 of P, so that up to here it is right to eight digits, and at 1e16 the noise is lost
WIDEST = 1e8


@kernel(inline="always")
def posterior_into(P_out, K, W, L, L_noise, P, C, H, noise):
    """The one covariance update: with S = L L' and W = L^-1 C, C = H P, P_out = P - W'W = P - K S K'
    and the gain K = W' L^-1 (d, p). Where P is so much wider than the noise, S - H P H', that its rounding
    hides it, P_out is Joseph's. All arguments but L, P, C, H and noise are written to."""
    p, d = C.shape
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
    """P_out = A P A' + K noise K', A = I - K H (Bucy and Joseph 1968): a sum of squares, so that it stays
    definite. A is rounded to 1e-16, and enters twice: with deviations of P 1e10 times those of the noise
    P_out is right to eleven digits, with 1e12 to seven, with 1e15 to one."""
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
