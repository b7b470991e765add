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
from gmr_gym.linalg import LOG_2PI, cholesky_into, half_log_determinant, orthogonalise, solve_lower

MEASURES = ("kl", "reverse-kl", "symmetrised-kl", "wasserstein", "cauchy-schwarz", "isd")
TELESCOPING = MEASURES[:2]  # merging down to one costs the same in any order
KL, REVERSE_KL, SYMMETRISED_KL, WASSERSTEIN, CAUCHY_SCHWARZ, ISD = range(len(MEASURES))
LOG_2 = float(np.log(2.0))


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
            scale = np.exp(-0.5 * d * (LOG_2PI + LOG_2))
            cost = scale * (np.exp(-half1) + np.exp(-half2) - 2.0 * np.exp(-half - 0.5 * d2))
    return max(cost, 0.0)  # of two equals rounding may give -1e-16


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
