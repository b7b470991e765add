"""Small symmetric matrices in compiled loops: Cholesky factors, determinants, Mahalanobis distances, sums."""

import numpy as np

from gmr_gym.kernels import kernel, leaf_kernel

LOG_2PI = float(np.log(2 * np.pi))


@leaf_kernel
def pairwise_sum(w):
    """Sum of w (n,) by pairwise summation, which keeps the rounding small; equal to NumPy's to the last
    bit."""
    n = len(w)
    if n < 8:
        out = 0.0
        for i in range(n):
            out += w[i]
        return out
    if n > 128:
        half = n // 2 - n // 2 % 8
        return pairwise_sum(w[:half]) + pairwise_sum(w[half:])
    s0, s1, s2, s3, s4, s5, s6, s7 = w[0], w[1], w[2], w[3], w[4], w[5], w[6], w[7]
    whole = n - n % 8
    for i in range(8, whole, 8):
        s0, s1, s2, s3 = s0 + w[i], s1 + w[i + 1], s2 + w[i + 2], s3 + w[i + 3]
        s4, s5, s6, s7 = s4 + w[i + 4], s5 + w[i + 5], s6 + w[i + 6], s7 + w[i + 7]
    out = ((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7))
    for i in range(whole, n):
        out += w[i]
    return out


@leaf_kernel
def cholesky_into(L, S):
    """Writes the lower Cholesky factor of the symmetric S (p, p) into L; False when S is not positive
    definite."""
    p = len(S)
    if p == 2:  # the same steps without loops, in a third of the time
        if not S[0, 0] > 0.0:
            return False
        L[0, 0] = np.sqrt(S[0, 0])
        L[1, 0] = S[1, 0] / L[0, 0]
        left = S[1, 1] - L[1, 0] * L[1, 0]
        if not left > 0.0:
            return False
        L[1, 1] = np.sqrt(left)
        return True
    for r in range(p):
        for c in range(r + 1):
            total = S[r, c]
            for k in range(c):
                total -= L[r, k] * L[c, k]
            if r == c:
                if not total > 0.0:
                    return False
                L[r, r] = np.sqrt(total)
            else:
                L[r, c] = total / L[c, c]
    return True


@kernel
def root_determinants(P):
    """sqrt|P[i]| (n,) of positive definite matrices (n, d, d)."""
    n, d = P.shape[:2]
    out, L = np.empty(n), np.zeros((d, d))
    for i in range(n):
        if not cholesky_into(L, P[i]):
            raise ValueError("a covariance of the mixture is not positive definite")
        out[i] = 1.0
        for r in range(d):
            out[i] *= L[r, r]
    return out


@leaf_kernel
def mahalanobis_squared(L, z, z_hat, y):
    """(z - z_hat)' S^-1 (z - z_hat) with S = L L'; y (p,) is workspace."""
    d2 = 0.0
    for r in range(len(z)):
        total = z[r] - z_hat[r]
        for k in range(r):
            total -= L[r, k] * y[k]
        y[r] = total / L[r, r]
        d2 += y[r] * y[r]
    return d2


@leaf_kernel
def log_gaussian_scale(L):
    """log of N(z; z, L L'), the density at the mean."""
    p = len(L)
    total = -0.5 * p * LOG_2PI
    for r in range(p):
        total -= np.log(L[r, r])
    return total
