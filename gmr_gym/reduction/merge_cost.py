r"""Runnalls' cost of merging two components, many pairs at once.

Notes
-----
With the shares of the weights and the covariance of the merged pair

.. math::

    a = \frac{w_i}{w_i + w_j}, \qquad b = 1 - a, \qquad P_{ij} = a P_i + b P_j + a b (m_i - m_j)(m_i - m_j)^T

merging i and j costs (D'Ortenzio, eq. 13)

.. math::

    B = \tfrac{1}{2} \left( w_i (\log |P_{ij}| - \log |P_i|) + w_j (\log |P_{ij}| - \log |P_j|) \right)

which is the minimum of wi KL(i || N) + wj KL(j || N) over all Gaussians N.

Loops from `start` run over unsigned indices: a signed one may count from the end, so that every entry was
gathered by itself, and a pair took 19 ns instead of 5.
"""

import numpy as np

from gmr_gym.kernels import ONE, kernel, leaf_kernel

LANES = 8  # pairs that a loop handles at once; what is left over, one by one, takes several times as long
PLANAR = 16  # rows of the columns of four states
BLOCK = 128  # components: a block of covariances fits in the first-level cache


@leaf_kernel
def cost_row(i, start, stop, columns, room, row):
    """Costs of merging component i with each of start..stop-1, written to the same columns of row."""
    if len(columns) == PLANAR:
        _planar_determinants(i, start, stop, columns, row)
    else:
        share, A, d = room[0], room[1:], len(columns) - 1 - len(room)
        for first in range(start, stop, BLOCK):
            last = min(first + BLOCK, stop)
            pair_covariances(i, first, last, columns[0], columns[2 : 2 + d], columns[2 + d :], share, A)
            _determinants(A, last - first, row[first:])
    w, log_det = columns[0], columns[1]
    wi, log_det_i = w[i], log_det[i]
    for j in range(np.uint64(start), np.uint64(stop)):
        log_det_ij = logarithm(row[j])
        cost = 0.5 * (wi * (log_det_ij - log_det_i) + w[j] * (log_det_ij - log_det[j]))
        cost = cost if cost > 0.0 else 0.0
        # beyond 1e8 standard deviations apart the determinant is lost in rounding: never the nearest
        row[j] = cost if row[j] > 0.0 else np.inf


@kernel(inline="always")
def merge_pair(i, j, w, means, entries, room):
    """Writes the moment match of i and j to slot i; returns its log determinant."""
    share, A = room[0], room[1:]
    pair_covariances(i, j, j + 1, w, means, entries, share, A)
    for q in range(len(entries)):
        entries[q, i] = A[q, 0]
    for r in range(len(means)):
        means[r, i] = share[0] * means[r, i] + (1 - share[0]) * means[r, j]
    w[i] += w[j]
    _determinants(A, ONE, share)
    return logarithm(share[0])


@kernel
def total_cost(w, m, P):
    """Cost of merging everything, the sum of the costs B of any sequence of merges down to one, and the
    mean (d,) and covariance (d, d) of that one."""
    return shared_total_cost(w, m, P, np.arange(len(w)))


@kernel
def shared_total_cost(w, m, P, row):
    """`total_cost` of components whose covariances are the rows `row` (n,) of P, which they share."""
    n, d = m.shape
    weight, mean, covariance = 0.0, np.zeros(d), np.zeros((d, d))
    for i in range(n):
        weight += w[i]
    for i in range(n):
        share = w[i] / weight
        for r in range(d):
            mean[r] += share * m[i, r]
    A, log_det, apart = np.empty((d * (d + 1) // 2, BLOCK)), np.empty(len(P)), 0.0
    for start in range(0, len(P), BLOCK):
        stop = min(start + BLOCK, len(P))
        for j in range(start, stop):
            _triangle_into(A, P[j], j - start)
        _log_determinants(A, stop - start, log_det[start:])
    for i in range(n):
        share, j = w[i] / weight, row[i]
        apart += w[i] * log_det[j]
        for r in range(d):
            for c in range(r + 1):
                covariance[r, c] += share * (P[j, r, c] + (m[i, r] - mean[r]) * (m[i, c] - mean[c]))
    for r in range(d):
        for c in range(r):
            covariance[c, r] = covariance[r, c]
    _triangle_into(A, covariance, 0)
    _log_determinants(A, ONE, log_det)
    return max(0.0, 0.5 * (weight * log_det[0] - apart)), mean, covariance


@leaf_kernel
def _triangle_into(A, P, j):
    """Writes the lower triangle of P (d, d), row by row, to column j of A."""
    q = 0
    for r in range(len(P)):
        for c in range(r + 1):
            A[q, j] = P[r, c]
            q += 1


@kernel
def _log_determinants(A, n, out):
    """Logarithms of `_determinants`; ValueError for a matrix that is not positive definite."""
    _determinants(A, n, out)
    for j in range(n):
        if not 1e-300 < out[j] < 1e300:
            raise ValueError(
                "a covariance of the mixture is not positive definite, or its determinant lies "
                "outside 1e-300 to 1e300: choose units nearer to the spread of the states"
            )
        out[j] = logarithm(out[j])


@kernel
def components_last(w, m, P):
    """The columns of a mixture, and workspace for costs.

    The component axis is the last, so that loops over components are vectorised: a row of weights, one of log
    determinants, d of means, and d (d + 1) / 2 of the lower triangles of the covariances row by row. In one
    array, since a call with many arrays took a quarter of the time of a short row of costs.
    """
    n, d = m.shape
    columns = empty_columns(n, d)
    for i in range(n):
        columns[0, i], q = w[i], 2 + d
        for r in range(d):
            columns[2 + r, i] = m[i, r]
            for c in range(r + 1):
                columns[q, i] = P[i, r, c]
                q += 1
    room = np.empty((len(columns) - 1 - d, BLOCK))
    for start in range(0, n, BLOCK):
        stop = min(start + BLOCK, n)
        for q in range(1, len(room)):
            for j in range(start, stop):
                room[q, j - start] = columns[1 + d + q, j]
        _log_determinants(room[1:], stop - start, columns[1, start:])
    return columns, room


@kernel(inline="always")
def empty_columns(n, d):
    """Room for the columns of n components and of as many more as fill the lanes."""
    return np.empty((2 + d + d * (d + 1) // 2, whole(n)))


@leaf_kernel
def whole(n):
    """The least multiple of LANES that is at least n."""
    return (n + LANES - 1) // LANES * LANES


@leaf_kernel
def pair_covariances(i, start, stop, w, means, entries, share, A):
    """Covariances of component i merged with each of start..stop-1, one entry a row, written to the first
    columns of A; share holds w_i / (w_i + w_j) afterwards."""
    i, first, last = np.uint64(i), np.uint64(start), np.uint64(stop)
    for j in range(first, last):
        share[j - first] = w[i] / (w[i] + w[j])
    q = 0
    for r in range(len(means)):
        for c in range(r + 1):
            mean_r, mean_c, entry = means[r, i], means[c, i], entries[q, i]
            for j in range(first, last):
                spread = (mean_r - means[r, j]) * (mean_c - means[c, j])
                a = share[j - first]
                A[q, j - first] = a * entry + (1 - a) * (entries[q, j] + a * spread)
            q += 1


@leaf_kernel(inline="always")
def _planar_determinants(i, start, stop, columns, out):
    """`_determinants` of `pair_covariances` for four states (planar position and velocity), unrolled: |A
    + c dd'| = |A| (1 + c d'A^-1 d) with A = a Pi + b Pj and c = a b, by blocks of two states."""
    w, means, entries, i = columns[0], columns[2:6], columns[6:], np.uint64(i)
    wi, m0, m1, m2, m3 = w[i], means[0, i], means[1, i], means[2, i], means[3, i]
    q00, q10, q11, q20, q21 = entries[0, i], entries[1, i], entries[2, i], entries[3, i], entries[4, i]
    q22, q30, q31, q32, q33 = entries[5, i], entries[6, i], entries[7, i], entries[8, i], entries[9, i]
    for j in range(np.uint64(start), np.uint64(stop)):
        b = w[j] / (wi + w[j])
        p00, p10, p11 = (
            q00 + b * (entries[0, j] - q00),
            q10 + b * (entries[1, j] - q10),
            q11 + b * (entries[2, j] - q11),
        )
        p20, p21, p22 = (
            q20 + b * (entries[3, j] - q20),
            q21 + b * (entries[4, j] - q21),
            q22 + b * (entries[5, j] - q22),
        )
        p30, p31 = q30 + b * (entries[6, j] - q30), q31 + b * (entries[7, j] - q31)
        p32, p33 = q32 + b * (entries[8, j] - q32), q33 + b * (entries[9, j] - q33)
        d0, d1, d2, d3 = means[0, j] - m0, means[1, j] - m1, means[2, j] - m2, means[3, j] - m3
        upper = p00 * p11 - p10 * p10
        v = 1.0 / upper
        x0, x1 = (p11 * p20 - p10 * p21) * v, (p00 * p21 - p10 * p20) * v
        y0, y1 = (p11 * p30 - p10 * p31) * v, (p00 * p31 - p10 * p30) * v
        p22, p32, p33 = p22 - x0 * p20 - x1 * p21, p32 - y0 * p20 - y1 * p21, p33 - y0 * p30 - y1 * p31
        d2, d3 = d2 - x0 * d0 - x1 * d1, d3 - y0 * d0 - y1 * d1
        c = b * (1 - b)
        lower = p22 * p33 - p32 * p32
        # c d'A^-1 d times lower: the part of the first two states, and of the others given these
        near = lower * (p11 * d0 * d0 - 2 * p10 * d0 * d1 + p00 * d1 * d1) * v
        far = p33 * d2 * d2 - 2 * p32 * d2 * d3 + p22 * d3 * d3
        spread = c * (near + far)
        # 0 where the covariance itself would be lost in rounding
        out[j] = upper * (lower + spread) if spread < 1e16 * lower else 0.0


@leaf_kernel
def _determinants(A, n, out):
    """Determinants of the first n symmetric matrices, one entry a row in A (d (d + 1) / 2, n), by LDL'
    without square roots; A is overwritten."""
    for j in range(n):
        out[j] = 1.0
    d = int(np.sqrt(2 * len(A)))
    for k in range(d):
        pivot = k * (k + 3) // 2
        for j in range(n):
            out[j] *= A[pivot, j]
            A[pivot, j] = 1.0 / A[pivot, j]
        for r in range(k + 1, d):
            below = r * (r + 1) // 2 + k
            for c in range(k + 1, r + 1):
                target, beside = r * (r + 1) // 2 + c, c * (c + 1) // 2 + k
                for j in range(n):
                    A[target, j] -= A[below, j] * A[pivot, j] * A[beside, j]


@leaf_kernel
def logarithm(x):
    """Natural logarithm of a positive normal number, to the last bit or the one before. A call of the
    library's logarithm would prevent a loop from being vectorised."""
    bits = np.float64(x).view(np.int64)
    mantissa = np.int64((bits & 0x000FFFFFFFFFFFFF) | 0x3FF0000000000000).view(np.float64)
    exponent = float((bits >> 52) - 1023)
    above = mantissa > 1.4142135623730951
    mantissa = 0.5 * mantissa if above else mantissa
    exponent = exponent + 1.0 if above else exponent
    # log(mantissa) = 2 (s + s^3/3 + s^5/5 + ...), |s| < 0.172
    s = (mantissa - 1.0) / (mantissa + 1.0)
    s2 = s * s
    # written out, since a loop over the coefficients would not be vectorised
    series = 1 / 15 + s2 * (1 / 17 + s2 * (1 / 19 + s2 * (1 / 21)))
    series = 1 / 7 + s2 * (1 / 9 + s2 * (1 / 11 + s2 * (1 / 13 + s2 * series)))
    series = 1 / 3 + s2 * (1 / 5 + s2 * series)
    return exponent * 0.6931471805599453 + 2.0 * (s + s * s2 * series)


@kernel
def merge_costs(entered, left):
    r"""Number of pairwise costs B that greedy merging evaluates from n = `entered` to r = `left` components.

    Notes
    -----
    One for each of the n (n - 1) / 2 pairs at first, then, after each merge, one for the new component with
    each of the others:

    .. math:: \frac{n (n - 1)}{2} + (r - 1) + r + \dots + (n - 2) = (n - 1)^2 - \frac{(r - 1) (r - 2)}{2}
    """
    return (entered - 1) ** 2 - (left - 1) * (left - 2) // 2
