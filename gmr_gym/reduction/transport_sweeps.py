"""The two steps of a sweep that lowers the composite transportation divergence: kernels.

The Gaussians of the reduced mixture are the rows of tables of shares and of costs (L, n), the components of
the mixture the columns.
"""

from collections.abc import Callable

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, half_log_determinant, inverse_into
from gmr_gym.reduction.barycentres import BARYCENTRES
from gmr_gym.reduction.measures import COSTS
from gmr_gym.reduction.overlap_descent import EXACT, STEPS

LEAST_SHARE = 1e-9  # of the weight of a Gaussian, that counts in a barycentre other than the moment match
LEAST_WEIGHT = 1e-300  # of a Gaussian, beside components of weight 1: below it digits are lost


def _gathering(barycentre: Callable, component_cost: Callable) -> Callable:
    """The kernel for a measure."""

    @kernel
    def gather(share, m, P):
        """Weights (L,), means and covariances of the barycentres of rows of shares of the components m, P,
        the costs (L, n), and whether no barycentre was cut short."""
        v, c, S = _weights(share), np.zeros((len(share), m.shape[1])), np.zeros((len(share), *P.shape[1:]))
        table, exact = np.full(share.shape, np.inf), True
        for j in range(len(v)):
            if v[j] > 0.0:
                at = np.flatnonzero(share[j] > LEAST_SHARE * v[j])
                c[j], S[j], steps = barycentre(share[j][at], m[at], P[at], EXACT)
                exact &= steps < STEPS
                for i in range(len(m)):
                    table[j, i] = component_cost(m[i], P[i], c[j], S[j])
        return v, c, S, table, exact

    return gather


GATHERED = tuple(_gathering(*kernels) for kernels in zip(BARYCENTRES, COSTS, strict=True))


@kernel
def moment_matches(share, m, P, columns, half):
    """`barycentres` by the Kullback-Leibler divergence, with what `divergences` needs."""
    n, d = m.shape
    v, c, S = _weights(share), np.zeros((len(share), d)), np.zeros((len(share), d, d))
    for j in range(len(v)):
        if not v[j] > 0.0:
            continue
        for i in range(n):
            if share[j, i] > 0.0:
                a = share[j, i] / v[j]
                for r in range(d):
                    c[j, r] += a * m[i, r]
        for i in range(n):
            if share[j, i] > 0.0:
                a = share[j, i] / v[j]
                for r in range(d):
                    for s in range(r + 1):
                        S[j, r, s] += a * (P[i, r, s] + (m[i, r] - c[j, r]) * (m[i, s] - c[j, s]))
        for r in range(d):
            for s in range(r):
                S[j, s, r] = S[j, r, s]
    return v, c, S, divergences(columns, half, v, c, S), True


@kernel
def divergences(columns, half, v, c, S):
    """KL(component || Gaussian) (L, n) of components packed in columns (T, n), with log|P| / 2 in half (n,);
    infinite for a Gaussian without weight, and where a covariance is lost in rounding."""
    (count, d), (T, n) = c.shape, columns.shape
    table = np.full((count, n), np.inf)
    L, precision, apart = np.zeros((d, d)), np.empty((d, d)), np.empty((d, n))
    for j in range(count):
        own = inverse_into(precision, S[j], L) if v[j] > 0.0 else np.nan
        if np.isnan(own):
            continue
        row, q = table[j], 0
        for i in range(n):
            row[i] = own - half[i] - 0.5 * d
        for r in range(d):
            mean, x = columns[T - d + r], apart[r]
            for i in range(n):
                x[i] = mean[i] - c[j, r]
            for s in range(r + 1):
                entry, y = columns[q], apart[s]
                weight = 0.5 * precision[r, s] if r == s else precision[r, s]
                for i in range(n):
                    row[i] += weight * (entry[i] + x[i] * y[i])
                q += 1
        for i in range(n):
            row[i] = max(row[i], 0.0)  # for two equals rounding may give -1e-16
    return table


@kernel
def half_log_determinants(P):
    """log|P| / 2 (n,)."""
    n, d = P.shape[:2]
    out, L = np.empty(n), np.zeros((d, d))
    for i in range(n):
        cholesky_into(L, P[i])
        out[i] = half_log_determinant(L)
    return out


@kernel
def keep_better(share, c, S, table, new_c, new_S, new_table):
    """Takes the new Gaussians and their costs, but for rows that cost more than the old: a barycentre that
    is one of several minima may be another than before."""
    for j in range(len(share)):
        old, new = 0.0, 0.0
        for i in range(share.shape[1]):
            if share[j, i] > 0.0:
                old += share[j, i] * table[j, i]
                new += share[j, i] * new_table[j, i]
        if not new > old:
            table[j], c[j], S[j] = new_table[j], new_c[j], new_S[j]


@kernel
def share_out(table, w, v, temperature, weighted):
    """The shares (L, n) of least objective, given the costs, and the objective."""
    if temperature == 0.0:
        return _to_the_nearest(table, w)
    count, n = table.shape
    share, total, prior, objective = np.empty((count, n)), w.sum(), np.zeros(count), 0.0
    if weighted:
        for j in range(count):
            prior[j] = np.log(v[j] / total)
    for i in range(n):
        largest, parts = -np.inf, 0.0
        for j in range(count):
            share[j, i] = prior[j] - table[j, i] / temperature
            largest = max(largest, share[j, i])
        for j in range(count):
            share[j, i] = np.exp(share[j, i] - largest)
            parts += share[j, i]
        for j in range(count):
            share[j, i] *= w[i] / parts
        objective -= w[i] * temperature * (largest + np.log(parts))
    return share, objective


@kernel
def _to_the_nearest(table, w):
    """`share_out` without entropy: every component whole to the Gaussian of least cost, the first among
    equals."""
    share, objective = np.zeros(table.shape), 0.0
    for i in range(len(w)):
        nearest = 0
        for j in range(len(table)):
            if table[j, i] < table[nearest, i]:
                nearest = j
        share[nearest, i] = w[i]
        objective += w[i] * table[nearest, i]
    return share, objective


@kernel
def _weights(share):
    """Sums (L,) of the rows, 0 for next to nothing."""
    v = np.zeros(len(share))
    for j in range(len(share)):
        for x in share[j]:
            v[j] += x
        v[j] = v[j] if v[j] > LEAST_WEIGHT else 0.0
    return v
