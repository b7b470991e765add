"""Greedy merging by Runnalls' cost.

With a = wi / (wi + wj), b = 1 - a, and Pij = a Pi + b Pj + a b (mi - mj)(mi - mj)' the covariance
of the merged pair, merging i and j costs

    B = 1/2 ((wi + wj) log|Pij| - wi log|Pi| - wj log|Pj|)            (D'Ortenzio, eq. 13)

Each pair stands in one row of a table of costs, that of the component born later, and infinity in
the other's. A merge then changes one row, and rows whose least it takes away are searched again
only when they come up. Costs are formed a block of components at a time, component axis last, so
that the compiler turns every loop into vector instructions.
"""

import numpy as np
from numba import njit

BLOCK = 128  # components: a block of 4-D covariances stays in the nearest cache


@njit(cache=True, error_model="numpy")
def merge_greedily(w, m, P, components, budget):
    """Merges the cheapest pair while more than `components` remain or its cost is still within
    `budget`, which every merge lowers: w, m, P and origin (n,) of what is left. The last component
    moves into the place that a merge leaves."""
    n = len(w)
    w, means, entries = _by_entry(w, m, P)
    room = np.empty((len(entries), BLOCK)), np.empty(BLOCK), np.empty(BLOCK), np.empty(BLOCK)
    w_log_det = _weighted_log_determinants(w, entries, room)
    table = np.full((n, n), np.inf)
    # the row's cheapest partner, or -1 when it is gone and the row holds nothing below `least`
    nearest, least = np.full(n, -1), np.zeros(n)
    for i in range(n):
        _form_costs(i, i, w, means, entries, w_log_det, room, table[i])
    name, into = np.arange(n), np.arange(n)
    while n > 1:
        i = _first_least(least, n)
        if nearest[i] < 0:
            nearest[i] = _first_least(table[i], n)
            least[i] = table[i, nearest[i]]
            continue
        budget -= least[i]
        if n <= components and budget < 0.0:
            break
        i, j = min(i, nearest[i]), max(i, nearest[i])
        into[name[j]] = name[i]
        w_log_det[i] = _merge_pair(i, j, w, means, entries, room)
        n -= 1
        for r in range(n + 1):
            if nearest[r] == i or nearest[r] == j:
                nearest[r] = -1
            elif nearest[r] == n:
                nearest[r] = j
        if j != n:
            name[j], w[j], w_log_det[j] = name[n], w[n], w_log_det[n]
            nearest[j], least[j] = nearest[n], least[n]
            for r in range(len(means)):
                means[r, j] = means[r, n]
            for q in range(len(entries)):
                entries[q, j] = entries[q, n]
            for r in range(n):
                table[j, r], table[r, j] = table[n, r], table[r, n]
            table[j, j] = np.inf
        _form_costs(i, n, w, means, entries, w_log_det, room, table[i])
        for r in range(n):
            table[r, i] = np.inf
        nearest[i], least[i] = -1, 0.0
    return _by_component(n, w, means, entries, name, into)


@njit(cache=True, error_model="numpy")
def _first_least(row, n):
    best = 0
    for j in range(1, n):
        if row[j] < row[best]:
            best = j
    return best


@njit(cache=True, error_model="numpy")
def _form_costs(i, n, w, means, entries, w_log_det, room, row):
    """Costs of merging component i with 0..n-1, written to row."""
    A, determinant, log_det, share = room
    for start in range(0, n, BLOCK):
        stop = min(start + BLOCK, n)
        _pair_covariances(i, start, stop, w, means, entries, share, A)
        _determinants(A, stop - start, determinant)
        _logarithms(determinant, stop - start, log_det)
        for j in range(start, stop):
            cost = (w[i] + w[j]) * log_det[j - start] - w_log_det[i] - w_log_det[j]
            row[j] = 0.5 * cost if cost > 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def _pair_covariances(i, start, stop, w, means, entries, share, A):
    """Covariances by entry of component i merged with each of start..stop-1, written to the first
    columns of A; share is left holding w_i / (w_i + w_j)."""
    n = stop - start
    for j in range(n):
        share[j] = w[i] / (w[i] + w[start + j])
    q = 0
    for r in range(len(means)):
        for c in range(r + 1):
            mean_r, mean_c, entry = means[r, i], means[c, i], entries[q, i]
            others_r, others_c = means[r, start:stop], means[c, start:stop]
            others, target = entries[q, start:stop], A[q]
            for j in range(n):
                spread = (mean_r - others_r[j]) * (mean_c - others_c[j])
                target[j] = share[j] * entry + (1 - share[j]) * (others[j] + share[j] * spread)
            q += 1


@njit(cache=True, error_model="numpy")
def _merge_pair(i, j, w, means, entries, room):
    """Writes the moment match of i and j to place i; returns its weight times log determinant."""
    A, determinant, log_det, share = room
    _pair_covariances(i, j, j + 1, w, means, entries, share, A)
    for q in range(len(entries)):
        entries[q, i] = A[q, 0]
    for r in range(len(means)):
        means[r, i] = share[0] * means[r, i] + (1 - share[0]) * means[r, j]
    w[i] += w[j]
    _determinants(A, 1, determinant)
    _logarithms(determinant, 1, log_det)
    return w[i] * log_det[0]


@njit(cache=True, error_model="numpy")
def _weighted_log_determinants(w, entries, room):
    A, determinant, log_det, _ = room
    out = np.empty(len(w))
    for i in range(len(w)):
        for q in range(len(entries)):
            A[q, 0] = entries[q, i]
        _determinants(A, 1, determinant)
        if not determinant[0] > 0.0:
            raise ValueError("a covariance of the mixture is not positive definite")
        _logarithms(determinant, 1, log_det)
        out[i] = w[i] * log_det[0]
    return out


@njit(cache=True, error_model="numpy")
def _determinants(A, n, out):
    """Determinants of the first n symmetric matrices given by entry, A (d (d + 1) / 2, n), by LDL'
    without square roots; A is overwritten."""
    for j in range(n):
        out[j] = 1.0
    d = int(np.sqrt(2 * len(A)))
    for k in range(d):
        pivot = A[k * (k + 3) // 2]
        for j in range(n):
            out[j] *= pivot[j]
            pivot[j] = 1.0 / pivot[j]
        for r in range(k + 1, d):
            below = A[r * (r + 1) // 2 + k]
            for c in range(k + 1, r + 1):
                target, beside = A[r * (r + 1) // 2 + c], A[c * (c + 1) // 2 + k]
                for j in range(n):
                    target[j] -= below[j] * pivot[j] * beside[j]


@njit(cache=True, error_model="numpy")
def _logarithms(x, n, out):
    """Natural logarithms of the first n of the positive normal numbers x, to the last bit or the
    one before. A call of the library's logarithm would keep the loop from being vectorised."""
    x_bits, mantissa_bits = x.view(np.int64), out.view(np.int64)
    for j in range(n):
        mantissa_bits[j] = (x_bits[j] & 0x000FFFFFFFFFFFFF) | 0x3FF0000000000000
    for j in range(n):
        exponent, mantissa = float((x_bits[j] >> 52) - 1023), out[j]
        above = mantissa > 1.4142135623730951
        mantissa = 0.5 * mantissa if above else mantissa
        exponent = exponent + 1.0 if above else exponent
        # log(mantissa) = 2 (s + s^3/3 + s^5/5 + ...), |s| < 0.172
        s = (mantissa - 1.0) / (mantissa + 1.0)
        s2 = s * s
        # written out, since a loop over the coefficients would not be vectorised over j
        series = 1 / 15 + s2 * (1 / 17 + s2 * (1 / 19 + s2 * (1 / 21)))
        series = 1 / 7 + s2 * (1 / 9 + s2 * (1 / 11 + s2 * (1 / 13 + s2 * series)))
        series = 1 / 3 + s2 * (1 / 5 + s2 * series)
        out[j] = exponent * 0.6931471805599453 + 2.0 * (s + s * s2 * series)


@njit(cache=True, error_model="numpy")
def _by_entry(w, m, P):
    """The mixture with the component axis last, so that a loop over components is vectorised: w
    (n,), means (d, n), lower triangles of the covariances row by row (d (d + 1) / 2, n)."""
    n, d = m.shape
    means, entries = np.empty((d, n)), np.empty((d * (d + 1) // 2, n))
    for i in range(n):
        q = 0
        for r in range(d):
            means[r, i] = m[i, r]
            for c in range(r + 1):
                entries[q, i] = P[i, r, c]
                q += 1
    return w.copy(), means, entries


@njit(cache=True, error_model="numpy")
def _by_component(n, w, means, entries, name, into):
    """Undoes `_by_entry` for the first n components; origin from the chain of merges `into`."""
    d = len(means)
    m, P = np.empty((n, d)), np.empty((n, d, d))
    place, origin = np.empty(len(into), np.int64), np.empty(len(into), np.int64)
    for i in range(n):
        place[name[i]] = i
        q = 0
        for r in range(d):
            m[i, r] = means[r, i]
            for c in range(r + 1):
                P[i, r, c] = P[i, c, r] = entries[q, i]
                q += 1
    for i in range(len(into)):
        root = i
        while into[root] != root:
            root = into[root]
        origin[i] = place[root]
    return w[:n].copy(), m, P, origin
