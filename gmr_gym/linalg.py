"""Small symmetric matrices in compiled loops: Cholesky factors, determinants, inverses, singular
values, Mahalanobis distances, sums."""

import numpy as np

from gmr_gym.kernels import kernel, leaf_kernel

LOG_2PI = float(np.log(2 * np.pi))
SWEEPS = 30  # of rotations; some six are needed


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


@leaf_kernel
def half_log_determinant(L):
    """log|L L'| / 2 of a lower Cholesky factor."""
    total = 0.0
    for r in range(len(L)):
        total += np.log(L[r, r])
    return total


@leaf_kernel
def solve_lower(L, A):
    """Overwrites A (d, k) with L^-1 A, for a lower triangular L."""
    d, k = A.shape
    for r in range(d):
        for j in range(k):
            total = A[r, j]
            for c in range(r):
                total -= L[r, c] * A[c, j]
            A[r, j] = total / L[r, r]


@leaf_kernel
def solve_upper(L, A):
    """Overwrites A (d, k) with L'^-1 A, for a lower triangular L."""
    d, k = A.shape
    for r in range(d - 1, -1, -1):
        for j in range(k):
            total = A[r, j]
            for c in range(r + 1, d):
                total -= L[c, r] * A[c, j]
            A[r, j] = total / L[r, r]


@leaf_kernel
def inverse_into(out, S, L):
    """Writes the inverse of the symmetric S (d, d) into out, exactly symmetric, and returns log|S| / 2; nan
    where S is not positive definite. L (d, d) is workspace."""
    if not cholesky_into(L, S):
        return np.nan
    d, volume = len(S), 1.0
    for c in range(d):
        volume *= L[c, c]
        L[c, c] = 1.0 / L[c, c]
        for r in range(c + 1, d):
            total = 0.0
            for k in range(c, r):
                total -= L[r, k] * L[k, c]
            L[r, c] = total / L[r, r]
    for r in range(d):
        for c in range(r + 1):
            total = 0.0
            for k in range(r, d):
                total += L[k, r] * L[k, c]
            out[r, c] = out[c, r] = total
    return np.log(volume)


@leaf_kernel
def orthogonalise(A, V):
    """Rotates the columns of A (d, d) until they are orthogonal, and those of V with them.

    If V is the identity at first, the lengths of the columns are the singular values of A afterwards, to high
    relative accuracy, and V holds the right singular vectors.
    """
    d = len(A)
    for _ in range(SWEEPS):
        rotated = False
        for p in range(d):
            for q in range(p + 1, d):
                pp, qq, pq = 0.0, 0.0, 0.0
                for r in range(d):
                    pp += A[r, p] * A[r, p]
                    qq += A[r, q] * A[r, q]
                    pq += A[r, p] * A[r, q]
                if abs(pq) <= 1e-15 * np.sqrt(pp) * np.sqrt(qq):
                    continue
                rotated = True
                z = 0.5 * (qq - pp) / pq
                t = (1.0 if z >= 0.0 else -1.0) / (abs(z) + np.sqrt(1.0 + z * z))
                cos = 1.0 / np.sqrt(1.0 + t * t)
                sin = cos * t
                for r in range(d):
                    A[r, p], A[r, q] = cos * A[r, p] - sin * A[r, q], sin * A[r, p] + cos * A[r, q]
                    V[r, p], V[r, q] = cos * V[r, p] - sin * V[r, q], sin * V[r, p] + cos * V[r, q]
        if not rotated:
            break
