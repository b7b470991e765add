r"""What it costs to merge one component with each of many, by a measure D: the least of w_i D(i, q) + w_j
D(j, q) over all Gaussians q, or a lower bound of it.

Notes
-----
With the shares a and b of the weights, their sum W, and the difference of the means d, these are exact:

.. math::

    \text{reverse KL:}\quad & \tfrac{1}{2} \left( W \log |N| - w_j \log |P_i| - w_i \log |P_j|
    + W a b\, d^T N^{-1} d \right), \qquad N = b P_i + a P_j \\
    \text{Wasserstein:}\quad & W a b\, \mathrm{W}_2^2(i, j)

and for KL it is Runnalls' cost B. Lower bounds, in a fraction of the time of the barycentre, are:

- symmetrised KL: the mean of the two divergences.
- Wasserstein: the trace of the root of Pi Pj is at most the root of tr Pi Pj + sqrt((tr^2 Pi - tr Pi^2) (tr^2
  Pj - tr Pj^2)), exact in one and two dimensions (Miszczak et al. 2009, of fidelities).
- ISD: W a b times the integral squared difference of i and j, which is what the whole adds to the integral
  squared difference of the pair from q.
- Cauchy-Schwarz: q is one of all unit vectors of the space of functions, of which the best lies between the
  two; and, along the line that tells them apart best, it is a Gaussian in one dimension, of the wider one's
  scale.
"""

from collections.abc import Callable

import numpy as np

from gmr_gym.kernels import ZERO, kernel
from gmr_gym.linalg import LOG_2PI
from gmr_gym.reduction.barycentres import best_correlation, geometric_mean, least_difference
from gmr_gym.reduction.distances import eliminate, eliminate_four, times_exponentials
from gmr_gym.reduction.measures import (
    LOG_2,
    cauchy_schwarz_cost,
    isd_cost,
    symmetrised_kl_cost,
    wasserstein_cost,
)
from gmr_gym.reduction.merge_cost import cost_row, logarithm, whole

CLOSE = 1.0 - 1e-9  # factor of the bounds, for rounding
ENOUGH = 1e-4  # relative change that ends the computation of a barycentre: its cost is then known to 1e-8
ROUNDING = 1e-14  # and what is taken from them, relative to the terms that cancel

# ---- costs of merging component i with each of the first k, or lower bounds, written to row; columns and
# room are those of `components_last` ----


@kernel
def kl_costs(i, k, columns, room, row):
    """Exact."""
    cost_row(i, ZERO, whole(k), columns, room, row)


@kernel
def reverse_kl_costs(i, k, columns, room, row):
    """Exact."""
    bordered, root = _sums(i, k, columns, True, True)
    _reverse_costs(i, k, columns, bordered[0], root, row, False)


@kernel
def symmetrised_kl_bounds(i, k, columns, room, row):
    cost_row(i, ZERO, whole(k), columns, room, row)
    bordered, root = _sums(i, k, columns, True, True)
    _reverse_costs(i, k, columns, bordered[0], root, row, True)


@kernel
def wasserstein_bounds(i, k, columns, room, row):
    _transport_bounds(i, k, columns, row, True)


@kernel
def unweighted_bounds(i, k, columns, room, row):
    """Of the squared Wasserstein distance of the two, whatever their weights."""
    _transport_bounds(i, k, columns, row, False)


@kernel
def cauchy_schwarz_bounds(i, k, columns, room, row):
    bordered, root = _sums(i, k, columns, False, False)  # what the plain elimination leaves is needed
    _overlap_bounds(i, k, len(columns) - 1 - len(room), columns, bordered, root, row)


@kernel
def isd_bounds(i, k, columns, room, row):
    bordered, root = _sums(i, k, columns, False, True)
    _isd_bounds(i, k, len(columns) - 1 - len(room), columns, bordered[0], root, row)


@kernel
def _sums(i, k, columns, by_shares, fast):
    """What `eliminate` leaves of b Pi + a Pj, or of Pi + Pj, bordered by the difference of the means, and the
    inverse roots of their determinants (k,)."""
    T = len(columns) - 2
    d = int(np.sqrt(2.0 * T + 2.25) - 1.0)
    bordered, root = np.empty((T + 1, k)), np.empty(k)
    _border(i, k, columns, bordered, by_shares)
    if d == 4 and fast:
        eliminate_four(root, bordered)
    else:
        eliminate(root, bordered, d)
    return bordered, root


@kernel
def _border(i, k, columns, bordered, by_shares):
    """Writes b Pi + a Pj, or Pi + Pj, to the rows of `bordered`, bordered by the difference of the means."""
    T = len(bordered) - 1
    d = int(np.sqrt(2.0 * T + 2.25) - 1.0)
    share = np.ones(k)
    if by_shares:
        for j in range(k):
            share[j] = columns[0, i] / (columns[0, i] + columns[0, j])
    for q in range(T - d):
        entries, x = columns[2 + d + q], columns[2 + d + q, i]
        for j in range(k):
            a = share[j]
            b = 1.0 - a if by_shares else 1.0
            bordered[q, j] = b * x + a * entries[j]
    for r in range(d):
        mean, x = columns[2 + r], columns[2 + r, i]
        for j in range(k):
            bordered[T - d + r, j] = mean[j] - x


@kernel
def _reverse_costs(i, k, columns, exponent, root, row, halved):
    """The cost of reverse KL; `halved`, its mean with what stands in row."""
    w, log_det = columns[0], columns[1]
    wi, log_det_i = w[i], log_det[i]
    for j in range(k):
        log_N, W = -2.0 * logarithm(root[j]), wi + w[j]
        spread = -2.0 * exponent[j] * wi * (w[j] / W)
        cost = 0.5 * (w[j] * (log_N - log_det_i) + wi * (log_N - log_det[j]) + spread)
        cost = cost if cost > 0.0 else 0.0
        row[j] = CLOSE * 0.5 * (cost + row[j]) if halved else cost


@kernel
def _transport_bounds(i, k, columns, row, weighted):
    T = len(columns) - 2
    d = int(np.sqrt(2.0 * T + 2.25) - 1.0)
    w, own = columns[0], columns[2 + d :, i]
    trace, square, cross, apart = np.zeros(k), np.zeros(k), np.zeros(k), np.zeros(k)
    trace_i, square_i, q = 0.0, 0.0, 0
    for r in range(d):
        mean, x = columns[2 + r], columns[2 + r, i]
        for j in range(k):
            apart[j] += (mean[j] - x) ** 2
        for c in range(r + 1):
            twice = 1.0 if c == r else 2.0
            entries, y = columns[2 + d + q], own[q]
            square_i += twice * y * y
            for j in range(k):
                square[j] += twice * entries[j] * entries[j]
                cross[j] += twice * entries[j] * y
            q += 1
        trace_i += own[q - 1]
        for j in range(k):
            trace[j] += columns[1 + d + q, j]
    left_i = max(trace_i * trace_i - square_i, 0.0)
    for j in range(k):
        left = max(trace[j] * trace[j] - square[j], 0.0)
        fidelity = np.sqrt(max(cross[j] + np.sqrt(left_i * left), 0.0))
        both = trace_i + trace[j]
        cost = apart[j] + both - 2.0 * fidelity - ROUNDING * both
        factor = w[i] * (w[j] / (w[i] + w[j])) if weighted else 1.0
        row[j] = max(CLOSE * factor * cost, 0.0)


@kernel
def _isd_bounds(i, k, d, columns, exponent, root, row):
    w, log_det = columns[0], columns[1]
    peak, x, room = np.exp(-0.5 * d * LOG_2PI), np.empty(k), np.empty(k)
    ii = peak * np.exp(-0.5 * (log_det[i] + d * LOG_2))
    for j in range(k):
        row[j], x[j] = peak, -0.5 * (log_det[j] + d * LOG_2)
    times_exponentials(root, exponent, room)
    times_exponentials(row[:k], x, room)
    for j in range(k):
        both = ii + row[j]
        cost = both - 2.0 * peak * root[j] - ROUNDING * both
        row[j] = max(CLOSE * w[i] * (w[j] / (w[i] + w[j])) * cost, 0.0)


@kernel
def _overlap_bounds(i, k, d, columns, bordered, root, row):
    w, log_det, exponent = columns[0], columns[1], bordered[0]
    part, square, x, room = _parts_along(i, k, d, columns, bordered), np.ones(k), np.empty(k), np.empty(k)
    for j in range(k):
        own = -d * LOG_2 - 0.5 * (log_det[i] + log_det[j])
        x[j] = min(2.0 * (logarithm(root[j]) + exponent[j]) - own, 0.0)
    times_exponentials(square, x, room)  # of the correlation of the two
    for j in range(k):
        W = w[i] + w[j]
        a, b = w[i] / W, w[j] / W
        cot = np.sqrt(square[j] / (1.0 - square[j]))
        nearest = 2.0 / (cot + np.sqrt(cot * cot + 4.0 * a * b))
        between = a * logarithm(1.0 + (b * nearest) ** 2) + b * logarithm(1.0 + (a * nearest) ** 2)
        apart = -2.0 * a * b * exponent[j] / max(part[j], 1.0 - part[j])
        s = apart + np.sqrt(apart * apart + 1.0)
        along = apart / (1.0 + s) + logarithm((1.0 + s) / (2.0 * np.sqrt(s)))
        lost = ROUNDING * (1.0 + abs(log_det[i]) + abs(log_det[j]))
        row[j] = max(W * (0.5 * CLOSE * max(between, along) - lost), 0.0)


@kernel
def _parts_along(i, k, d, columns, bordered):
    """Part of v' Pi v in v' (Pi + Pj) v along v = (Pi + Pj)^-1 (mj - mi), from what `eliminate` leaves."""
    v, part = np.empty((d, k)), np.zeros(k)
    for c in range(d - 1, -1, -1):
        lead, pivot = d * (d + 1) // 2 + c, c * (c + 3) // 2
        for j in range(k):
            # the first pivot has made room for the exponent
            inverse = bordered[pivot, j] if c > 0 else 1.0 / (columns[2 + d, i] + columns[2 + d, j])
            v[c, j] = bordered[lead, j]
            for r in range(c + 1, d):
                v[c, j] -= bordered[r * (r + 1) // 2 + c, j] * v[r, j]
            v[c, j] *= inverse
    q = 2 + d
    for r in range(d):
        for c in range(r + 1):
            entry = columns[q, i] if c == r else 2.0 * columns[q, i]
            for j in range(k):
                part[j] += entry * v[r, j] * v[c, j]
            q += 1
    for j in range(k):
        d2 = -2.0 * bordered[0, j]
        part[j] = min(part[j] / d2, 1.0) if d2 > 0.0 else 1.0
    return part


@kernel
def pair_of(i, j, w, m, P):
    """Weights (2,), means and covariances of two components."""
    d = m.shape[1]
    w2, m2, P2 = np.empty(2), np.empty((2, d)), np.empty((2, d, d))
    for k, x in enumerate((i, j)):
        w2[k] = w[x]
        for r in range(d):
            m2[k, r] = m[x, r]
            for c in range(d):
                P2[k, r, c] = P[x, r, c]
    return w2, m2, P2


# ---- the cost of merging i and j, and the steps of its computation ----


@kernel
def no_more(i, j, w, m, P):
    """For a row of costs that is exact."""
    return 0.0, 0


@kernel
def wasserstein_pair(i, j, w, m, P):
    return w[i] * (w[j] / (w[i] + w[j])) * wasserstein_cost(m[i], P[i], m[j], P[j]), 0


@kernel
def unweighted_pair(i, j, w, m, P):
    return wasserstein_cost(m[i], P[i], m[j], P[j]), 0


def _pair_cost(barycentre: Callable, cost: Callable) -> Callable:
    """The kernel for a symmetric measure whose barycentre is iterated for."""

    @kernel
    def pair_cost(i, j, w, m, P):
        w2, m2, P2 = pair_of(i, j, w, m, P)
        mean, S, steps = barycentre(w2, m2, P2, ENOUGH)
        total = w2[0] * cost(m2[0], P2[0], mean, S) + w2[1] * cost(m2[1], P2[1], mean, S)
        # the heavier instead: that has more digits where the other is far lighter
        return min(total, min(w2[0], w2[1]) * cost(m2[0], P2[0], m2[1], P2[1])), steps

    return pair_cost


symmetrised_kl_pair = _pair_cost(geometric_mean, symmetrised_kl_cost)
cauchy_schwarz_pair = _pair_cost(best_correlation, cauchy_schwarz_cost)
isd_pair = _pair_cost(least_difference, isd_cost)
PAIR_COSTS = (
    (kl_costs, no_more), (reverse_kl_costs, no_more), (symmetrised_kl_bounds, symmetrised_kl_pair),
    (wasserstein_bounds, wasserstein_pair), (cauchy_schwarz_bounds, cauchy_schwarz_pair),
    (isd_bounds, isd_pair),
)  # fmt: skip
