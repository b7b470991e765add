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

from gmr_gym.kernels import kernel
from gmr_gym.linalg import (
    LOG_2PI,
    cholesky_into,
    half_log_determinant,
    mahalanobis_squared,
    orthogonalise,
    solve_lower,
)

MEASURES = ("kl", "reverse-kl", "symmetrised-kl", "wasserstein", "cauchy-schwarz", "isd")
TELESCOPING = MEASURES[:2]  # merging down to one costs the same in any order
KL, REVERSE_KL, SYMMETRISED_KL, WASSERSTEIN, CAUCHY_SCHWARZ, ISD = range(len(MEASURES))
LOG_2 = float(np.log(2.0))


# A cost D(f, q) >= 0 is a kernel of the means and covariances of f and q, infinite where a covariance is not
# positive definite. Every measure has one of its own, or it would wait for the compilation of all.


@kernel
def kl_cost(m1, P1, m2, P2):
    """KL(f || q)."""
    L1, L2, definite = _factors(P1, P2)
    return max(_divergence(L1, L2, m1 - m2), 0.0) if definite else np.inf


@kernel
def reverse_kl_cost(m1, P1, m2, P2):
    """KL(q || f)."""
    return kl_cost(m2, P2, m1, P1)


@kernel
def symmetrised_kl_cost(m1, P1, m2, P2):
    """The mean of the two."""
    L1, L2, definite = _factors(P1, P2)
    apart = m1 - m2
    return max(0.5 * (_divergence(L1, L2, apart) + _divergence(L2, L1, apart)), 0.0) if definite else np.inf


@kernel
def wasserstein_cost(m1, P1, m2, P2):
    """The squared Wasserstein distance."""
    L1, L2, definite = _factors(P1, P2)
    return _transport_cost(L1, L2, m1 - m2) if definite else np.inf


@kernel
def cauchy_schwarz_cost(m1, P1, m2, P2):
    """Minus the logarithm of the correlation."""
    half, half1, half2, d2 = _overlap(m1, P1, m2, P2)
    # of two equals rounding may give -1e-16
    return max(half - 0.5 * (half1 + half2) + 0.5 * d2, 0.0) if half < np.inf else np.inf


@kernel
def isd_cost(m1, P1, m2, P2):
    """The integral squared difference."""
    half, half1, half2, d2 = _overlap(m1, P1, m2, P2)
    scale = np.exp(-0.5 * len(m1) * (LOG_2PI + LOG_2))
    cost = scale * (np.exp(-half1) + np.exp(-half2) - 2.0 * np.exp(-half - 0.5 * d2))
    return max(cost, 0.0) if half < np.inf else np.inf


COSTS = kl_cost, reverse_kl_cost, symmetrised_kl_cost, wasserstein_cost, cauchy_schwarz_cost, isd_cost


@kernel
def _factors(P1, P2):
    """Cholesky factors of two covariances, and whether these are positive definite."""
    L1, L2 = np.zeros(P1.shape), np.zeros(P1.shape)
    return L1, L2, cholesky_into(L1, P1) and cholesky_into(L2, P2)


@kernel
def _overlap(m1, P1, m2, P2):
    """log|(P1 + P2) / 2| / 2, log|P1| / 2, log|P2| / 2, and the squared distance of the means by P1 + P2; all
    infinite where a covariance is not positive definite."""
    d = len(m1)
    room = np.zeros((4, d, d))  # in one array: five took as long as all the rest
    L1, L2, L, both = room[0], room[1], room[2], room[3]
    if not (cholesky_into(L1, P1) and cholesky_into(L2, P2)):
        return np.inf, np.inf, np.inf, np.inf
    for r in range(d):
        for c in range(d):
            both[r, c] = P1[r, c] + P2[r, c]
    cholesky_into(L, both)
    half = half_log_determinant(L) - 0.5 * d * LOG_2
    d2 = mahalanobis_squared(L, m1, m2, both[0])
    return half, half_log_determinant(L1), half_log_determinant(L2), d2


@kernel
def aligned(L1, L2):
    """L2 R (d, d) with the rotation R for which it is nearest to L1: the squared norm of L1 - L2 R is the
    covariance part of the squared Wasserstein distance of covariances L1 L1' and L2 L2'."""
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
