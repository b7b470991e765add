r"""Measures of how unlike a Gaussian q is to a component f of a mixture, each in closed form.

Notes
-----
With f = N(m_1, P_1), q = N(m_2, P_2), the difference of the means d, and J_fq the integral of f q:

.. math::

    D_{KL}(f, q) &= \mathrm{KL}(f \,\|\, q), \qquad D_{reverse}(f, q) = \mathrm{KL}(q \,\|\, f), \qquad
    D_{symmetrised} = \tfrac{1}{2} (D_{KL} + D_{reverse}) \\
    D_{Wasserstein} &= |d|^2 + \operatorname{tr}(P_1 + P_2 - 2 (P_1^{1/2} P_2 P_1^{1/2})^{1/2}) \\
    D_{CS} &= -\log J_{fq} + \tfrac{1}{2} \log (J_{ff} J_{qq}), \qquad
    D_{ISD} = J_{ff} + J_{qq} - 2 J_{fq}

References
----------
D'Ortenzio, Manes and Orguner 2021, for the measures; Olkin and Pukelsheim 1982, for Wasserstein's.
"""

import numpy as np

from gmr_gym.kernels import kernel, leaf_kernel
from gmr_gym.linalg import LOG_2PI, cholesky_into

MEASURES = ("kl", "reverse-kl", "symmetrised-kl", "wasserstein", "cauchy-schwarz", "isd")
KL, REVERSE_KL, SYMMETRISED_KL, WASSERSTEIN, CAUCHY_SCHWARZ, ISD = range(len(MEASURES))
LOG_2 = float(np.log(2.0))
LOG_4PI = LOG_2 + LOG_2PI
SWEEPS = 30  # of rotations; some six are needed


@kernel
def component_cost(code, m1, P1, m2, P2):
    """D(f, q) >= 0 of f = N(m1, P1) and q = N(m2, P2); `code` is the place of the measure in `MEASURES`.
    Infinite where a covariance is not positive definite."""
    d = len(m1)
    L1, L2 = np.zeros((d, d)), np.zeros((d, d))
    if not (cholesky_into(L1, P1) and cholesky_into(L2, P2)):
        return np.inf
    apart = m1 - m2
    if code == KL:
        cost = _divergence(L1, L2, apart)
    elif code == REVERSE_KL:
        cost = _divergence(L2, L1, apart)
    elif code == SYMMETRISED_KL:
        cost = 0.5 * (_divergence(L1, L2, apart) + _divergence(L2, L1, apart))
    elif code == WASSERSTEIN:
        cost = _transport_cost(L1, L2, apart)
    else:
        L = np.zeros((d, d))
        cholesky_into(L, P1 + P2)
        half = half_log_determinant(L) - 0.5 * d * LOG_2
        half1, half2 = half_log_determinant(L1), half_log_determinant(L2)
        d2 = _whitened_square(L, apart)
        if code == CAUCHY_SCHWARZ:
            cost = half - 0.5 * (half1 + half2) + 0.5 * d2
        else:
            scale = np.exp(-0.5 * d * LOG_4PI)
            cost = scale * (np.exp(-half1) + np.exp(-half2) - 2.0 * np.exp(-half - 0.5 * d2))
    return max(cost, 0.0)  # of two equals rounding may give -1e-16


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
    """Writes the inverse of the symmetric S (d, d) into out, exactly symmetric; L is workspace. Returns log|S| /
    2; nan where S is not positive definite."""
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


@kernel
def aligned(L1, L2):
    """L2 R (d, d) with the rotation R for which it is nearest to L1: |L1 - L2 R|^2 is the covariance part of
    the squared Wasserstein distance of covariances L1 L1' and L2 L2'."""
    d = len(L1)
    A, V = np.zeros((d, d)), np.eye(d)
    for r in range(d):
        for c in range(d):
            for k in range(max(r, c), d):
                A[r, c] += L2[k, r] * L1[k, c]
    orthogonalise(A, V)
    out = np.zeros((d, d))
    for k in range(d):
        length = 0.0
        for r in range(d):
            length += A[r, k] * A[r, k]
        for r in range(d):
            along = 0.0  # entry of L2 times the left singular vector
            for q in range(r + 1):
                along += L2[r, q] * A[q, k]
            along /= np.sqrt(length)
            for c in range(d):
                out[r, c] += along * V[c, k]
    return out


@kernel
def _divergence(L1, L2, apart):
    """KL(N(m1, L1 L1') || N(m2, L2 L2')), `apart` being m1 - m2."""
    A, total = L1.copy(), _whitened_square(L2, apart) - len(L1)
    solve_lower(L2, A)
    for x in A.flat:
        total += x * x
    return 0.5 * total - half_log_determinant(A)


@kernel
def _transport_cost(L1, L2, apart):
    total = 0.0
    for x in apart:
        total += x * x
    for x in (L1 - aligned(L1, L2)).flat:
        total += x * x
    return total


@kernel
def _whitened_square(L, apart):
    y, total = apart.copy().reshape(-1, 1), 0.0
    solve_lower(L, y)
    for x in y.flat:
        total += x * x
    return total
