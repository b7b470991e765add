r"""The chi-square cost of merging two components into their moment match.

Notes
-----
With the shares a_1 and a_2 of the weights, their sum W, and q = N(m, S) the moment match:

.. math::

    b = W \left( \int \frac{(a_1 f_1 + a_2 f_2)^2}{q} - 1 \right) = W \sum_{k, l} a_k a_l (I_{kl} - 1), \qquad
    I_{kl} = \int \frac{f_k f_l}{q}

The product of two components is Gaussian, with covariance C and mean c but for its factor, so that

.. math::

    I_{kl} = N(m_k; m_l, P_k + P_l) \, (2 \pi)^{d/2} \frac{|S|}{|S - C|^{1/2}}
    \exp \left( \tfrac{1}{2} (c - m)^T (S - C)^{-1} (c - m) \right)

where S - C is positive definite; else the integral is infinite, as of a light and wide component beside a
heavy and narrow one. One elimination of the matrix [[-P_k - P_l, P_l], [P_l, S - P_l]], bordered by m_k - m_l
and m_l - m, gives everything: what is left of it below the first block is S - C, bordered by c - m.
"""

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.reduction.distances import times_exponentials
from gmr_gym.reduction.merge_cost import logarithm


@kernel
def chi_square_costs(i, k, columns, room, row):
    """Writes the costs of merging component i with each of the first k to row, for columns and room as those
    of `components_last`."""
    d = len(columns) - 1 - len(room)
    size = d * (d + 1) // 2
    S, one, two = np.empty((size + d, k)), np.empty((size + d, k)), np.empty((2 * d * d + 3 * d, k))
    volume, corner, log_S, share = np.empty(k), np.empty(k), np.empty(k), np.empty(k)
    factor, log_I = np.empty(k), np.empty(k)
    for j in range(k):
        share[j] = columns[0, i] / (columns[0, i] + columns[0, j])
    _fill(i, k, d, columns, share, S, two)
    one[:] = S
    _eliminate(one, d, 0, volume, corner)
    for j in range(k):
        log_S[j], row[j] = logarithm(volume[j]), 0.0
    _eliminate(two, 2 * d, d, volume, corner)
    for j in range(k):
        factor[j] = 2.0 * share[j] * (1.0 - share[j])
        log_I[j] = log_S[j] - 0.5 * (logarithm(volume[j]) + corner[j])
    _add_excess(factor, log_I, volume, row)
    for own in (True, False):
        _fill_own(i, k, d, columns, share, S, one, own)
        _eliminate(one, d, 0, volume, corner)
        for j in range(k):
            a = share[j] if own else 1.0 - share[j]
            log_P = columns[1, i] if own else columns[1, j]
            factor[j], log_I[j] = a * a, log_S[j] - 0.5 * (logarithm(2.0**d * volume[j]) + corner[j] + log_P)
        _add_excess(factor, log_I, volume, row)
    for j in range(k):
        # for two equal components rounding may give -1e-16
        row[j] = max((columns[0, i] + columns[0, j]) * row[j], 0.0) if row[j] < np.inf else np.inf


@kernel
def _add_excess(factor, log_I, volume, row):
    """Adds factor (I - 1) to row, infinite where the volume is not a number; I counts up to e^699."""
    scaled = factor.copy()
    for j in range(len(factor)):
        log_I[j] = min(log_I[j], 699.0)
    times_exponentials(scaled, log_I, np.empty(len(factor)))
    for j in range(len(factor)):
        row[j] += scaled[j] - factor[j] if volume[j] > 0.0 else np.inf


@kernel
def _fill(i, k, d, columns, share, S, two):
    """Writes the covariances of the moment matches, and the matrices of two blocks."""
    size, wide = d * (d + 1) // 2, d * (2 * d + 1)
    q = 0
    for r in range(d):
        mean_r, border = columns[2 + r], wide + r
        for c in range(r + 1):
            mean_c, entries, x = columns[2 + c], columns[2 + d + q], columns[2 + d + q, i]
            left, flip = (d + r) * (d + r + 1) // 2 + c, (d + c) * (d + c + 1) // 2 + r
            low = left + d
            for j in range(k):
                a = share[j]
                spread = (mean_r[j] - mean_r[i]) * (mean_c[j] - mean_c[i])
                S[q, j] = a * x + (1.0 - a) * (entries[j] + a * spread)
                two[q, j] = -x - entries[j]
                two[left, j] = two[flip, j] = entries[j]
                two[low, j] = S[q, j] - entries[j]
            q += 1
        for j in range(k):
            apart = mean_r[j] - mean_r[i]
            S[size + r, j] = apart
            two[border, j], two[border + d, j] = -apart, share[j] * apart


@kernel
def _fill_own(i, k, d, columns, share, S, one, own):
    """Writes S - P / 2 bordered by the mean from m, of component i where it is `own`, else of the other."""
    size = d * (d + 1) // 2
    for q in range(size):
        entries, x = columns[2 + d + q], columns[2 + d + q, i]
        for j in range(k):
            one[q, j] = S[q, j] - 0.5 * (x if own else entries[j])
    for r in range(d):
        for j in range(k):
            one[size + r, j] = (share[j] - 1.0 if own else share[j]) * S[size + r, j]


@kernel
def _eliminate(A, size, negative, volume, corner):
    """Sets volume (k,) to the modulus of the determinant and the corner to -e' A^-1 e, of symmetric matrices
    bordered by e whose lower triangles are the rows of A, overwritten; the volume is nan unless the first
    `negative` pivots are negative and all others positive."""
    k, border = A.shape[1], size * (size + 1) // 2
    inverse, ratio = np.empty(k), np.empty(k)
    for j in range(k):
        volume[j], corner[j] = 1.0, 0.0
    for c in range(size):
        pivot, sign, last = A[c * (c + 3) // 2], (-1.0 if c < negative else 1.0), A[border + c]
        for j in range(k):
            volume[j] *= sign * pivot[j] if sign * pivot[j] > 0.0 else np.nan
            inverse[j] = 1.0 / pivot[j]
            corner[j] -= last[j] * last[j] * inverse[j]
        for r in range(c + 1, size):
            lead = A[r * (r + 1) // 2 + c]
            for j in range(k):
                ratio[j] = lead[j] * inverse[j]
            for t in range(c + 1, r + 1):
                other, target = A[t * (t + 1) // 2 + c], A[r * (r + 1) // 2 + t]
                for j in range(k):
                    target[j] -= ratio[j] * other[j]
            target = A[border + r]
            for j in range(k):
                target[j] -= ratio[j] * last[j]
