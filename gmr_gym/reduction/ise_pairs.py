"""Greedy reduction by the integral squared error: the stored products and bounds of pairs of components."""

from typing import NamedTuple

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into
from gmr_gym.reduction.distances import BLOCK, dimension, known, products_of_columns, products_with

# the letters are those of ise.py

RIDGE = 1e-6  # keeps x and y small where A and B are alike
LEAST_VARIANCE = 1e-15  # a conditional variance below this fraction of the variance may be rounding alone
ROUNDING = 1e-14  # relative error of a sum of products: margin of the bounds


class Work(NamedTuple):
    """The original mixture f, the reduced one g, and the stored products. A merge takes the slot of its
    first component, so the components of g keep the order of the inputs; nothing moves when one is
    removed."""

    M: np.ndarray  # (T, L) packed Gaussians: the N of f, then the merges that g holds
    w: np.ndarray  # (L,) their weights in f
    u: np.ndarray  # (L,) their weights in g
    place: np.ndarray  # (N,) column of component a of g, -1 once it is gone
    q: np.ndarray  # (N,) its weight, 0 once it is gone
    h: np.ndarray  # (N,) <f, q[a] M[a]>
    g: np.ndarray  # (N,) <g, q[a] M[a]>
    E: np.ndarray  # (N, N) <M[a], M[b]>
    D: np.ndarray  # (N, N) <delta, delta> of the pair a < b, infinite once one is gone or they may not merge
    x: np.ndarray  # (N, N) the multiples x of A and
    y: np.ndarray  # (N, N) y of B for which x A + y B is nearest to C
    reach: np.ndarray  # (N, N) |C - x A - y B|, rounded up
    ec: np.ndarray  # (N, N) <e, C>, nan while unknown
    fc: np.ndarray  # (N, N) <f, C>, nan while unknown
    bound: np.ndarray  # (N, N) lower bound of the cost of merging a < b
    origin: np.ndarray  # (N,) component of g that each input went into, -1 once deleted


@kernel
def score_pairs(work, a, others):
    """Set D, x, y and reach of a with each of `others`; their other products become unknown."""
    q, E = work.q, work.E
    c, qc = _moment_match(work, np.full(len(others), a), others)
    near = work.M[:, work.place[others]]
    cc = products_of_columns(c, c, len(others))
    ac = products_with(work.M[:, work.place[a]].copy(), c, len(others))
    bc = products_of_columns(near, c, len(others))
    for k in range(len(others)):
        b = others[k]
        AA, BB, AB = q[a] * q[a] * E[a, a], q[b] * q[b] * E[b, b], q[a] * q[b] * E[a, b]
        AC, BC, CC = qc[k] * q[a] * ac[k], qc[k] * q[b] * bc[k], qc[k] * qc[k] * cc[k]
        x, y = _projection(AA, AB, BB, AC, BC)
        apart = CC - 2.0 * (x * AC + y * BC) + x * x * AA + y * y * BB + 2.0 * x * y * AB
        i, j = min(a, b), max(a, b)
        D = AA + BB + CC + 2.0 * (AB - AC - BC)
        work.D[i, j] = max(D, 0.0) if D < np.inf else np.inf  # nan: the merged covariance is lost in rounding
        work.x[i, j], work.y[i, j] = (x, y) if a < b else (y, x)
        work.reach[i, j] = np.sqrt(max(apart, 0.0) + ROUNDING * (AA + BB + CC + x * x * AA + y * y * BB))
        work.ec[i, j] = work.fc[i, j] = np.nan


@kernel
def _projection(AA, AB, BB, AC, BC):
    """The x and y for which x A + y B is about nearest to C."""
    if not (AA > 0.0 and BB > 0.0):
        return 1.0, 1.0
    a, b = (1.0 + RIDGE) * AA, (1.0 + RIDGE) * BB
    det = 1.0 - (AB / a) * (AB / b)
    return (AC / a - (AB / a) * (BC / b)) / det, (BC / b - (AB / b) * (AC / a)) / det


@kernel
def _moment_match(work, a, b):
    """Packed merges (T, k) of the components a (k,) with b (k,), and their weights (eq. 9)."""
    # unsigned indices need no test for counting from the end, which would take half of the time
    M, a_at, b_at = work.M, work.place[a].astype(np.uint32), work.place[b].astype(np.uint32)
    T, k = len(M), len(a)
    d = dimension(T)
    c, qc, share, apart = np.empty((T, k)), np.empty(k), np.empty(k), np.empty((d, k))
    for i in range(k):
        qc[i] = work.q[a[i]] + work.q[b[i]]
        share[i] = work.q[a[i]] / qc[i] if qc[i] > 0.0 else 0.5
    t = 0
    for row in range(d):
        mean, out = M[T - d + row], c[T - d + row]
        for i in range(k):
            apart[row, i] = mean[a_at[i]] - mean[b_at[i]]
            out[i] = share[i] * mean[a_at[i]] + (1.0 - share[i]) * mean[b_at[i]]
        for col in range(row + 1):
            entry, out, left, right = M[t], c[t], apart[row], apart[col]
            for i in range(k):
                P = entry[a_at[i]] + (1.0 - share[i]) * (left[i] * right[i])
                out[i] = share[i] * P + (1.0 - share[i]) * entry[b_at[i]]
            t += 1
    return c, qc


@kernel
def pair(work, a, b):
    """The merge of a and b, packed (T,), and its weight."""
    c, qc = _moment_match(work, np.full(1, a), np.full(1, b))
    return c.reshape(-1), qc[0]


@kernel
def stands_out(c):
    """Whether the covariance of the Gaussian packed in c (T,) is definite beyond its rounding."""
    d = dimension(len(c))
    S, L, t = np.empty((d, d)), np.zeros((d, d)), 0
    for row in range(d):
        for col in range(row + 1):
            S[row, col] = c[t]
            t += 1
    if not cholesky_into(L, S):
        return False
    for row in range(d):
        if not L[row, row] ** 2 > LEAST_VARIANCE * S[row, row]:
            return False
    return True


@kernel
def add_products(work, table, a, b, columns, weights):
    """Add the weighted products of C with the Gaussians packed in columns (T, L) to the table, for the
    pairs of a (k,) with b (k,). The table holds nan where there is no product yet."""
    for start in range(0, len(a), BLOCK):
        left, right = a[start : start + BLOCK], b[start : start + BLOCK]
        c, qc = _moment_match(work, left, right)
        total = np.zeros(len(left))
        if len(left) < len(weights):
            for i in range(len(left)):
                total[i] = weighted(weights, products_with(c[:, i].copy(), columns, len(weights)))
        else:
            for k in range(len(weights)):
                with_c = products_with(columns[:, k].copy(), c, len(left))
                for i in range(len(left)):
                    total[i] += weights[k] * known(with_c[i])
        for i in range(len(left)):
            so_far = table[left[i], right[i]]
            table[left[i], right[i]] = qc[i] * total[i] + (0.0 if np.isnan(so_far) else so_far)


@kernel
def update_known(work, change, weights):
    """Subtract the weighted Gaussians packed in change (T, k) from e in every known <e, C>."""
    a, b = _known_pairs(work)
    add_products(work, work.ec, a, b, change, -weights)


@kernel
def _known_pairs(work):
    """Components a < b (k,) of the pairs whose <e, C> is known."""
    alive = np.flatnonzero(work.place >= 0)
    n = len(alive)
    a, b, count = np.empty(n * n // 2 + 1, np.int64), np.empty(n * n // 2 + 1, np.int64), 0
    for i in range(n):
        row = work.ec[alive[i]]
        for j in range(i + 1, n):
            a[count], b[count] = alive[i], alive[j]
            count += not np.isnan(row[alive[j]])
    return a[:count], b[:count]


@kernel
def products_with_all(work, c):
    """Products of the Gaussian packed in c (T,) with every column in use."""
    return products_with(c, work.M, len(work.q) + count_merges(work))


@kernel
def count_merges(work):
    return (work.place >= len(work.q)).sum()


@kernel
def weighted(weights, products):
    total = 0.0
    for i in range(len(products)):
        total += weights[i] * known(products[i])
    return total
