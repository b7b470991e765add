"""Greedy merging by Runnalls' cost B.

For three components let F be the least of the sum of w KL(component || N) over all Gaussians N. It is the
same for any order of merging, F = B(i, j) + B(ij, k). Each of B(i, j), B(i, k) and B(j, k) minimises two of
the three terms of that sum, so F is at least each of them, and at least half of their sum. Hence

    B(ij, k) >= max(B(i, k), B(j, k), 1/2 (B(i, j) + B(i, k) + B(j, k))) - B(i, j)

which holds also where B(i, k) and B(j, k) are themselves lower bounds. After a merge, the cheapest of all,
few pairs with the merged component need their exact cost: of those that the plain form computes again, 4 % in
400 hypotheses of a tracker reduced to 50, and a third in random mixtures. The cost of a pair is computed
before it is merged, so the merges are the same as when every cost is computed.

Tried and rejected: bounds from single states instead of the first costs take 4.8 ns a pair, more than half of
the 8 ns of the costs themselves, and many of the costs are needed all the same.
"""

import numpy as np

from gmr_gym.kernels import ZERO, kernel, leaf_kernel
from gmr_gym.reduction.merge_cost import Columns, components_last, cost_row, merge_pair

ROUNDING = 1e-15  # relative to weight times log determinant: margin of the bounds
SOON = 2.0  # times the cost of the last merge: pairs with a bound below it are computed as a batch
FULL = 0.75  # fraction of the slots in use below which the gaps between them are closed
UNKNOWN, GONE = -1, -2


@kernel
def merge_greedily(w, m, P, components, budget):
    """Merges the cheapest pair while more than `components` remain or its cost is within `budget`, which
    every merge reduces. Returns w, m, P and origin (n,) of the components that remain, in the order of
    their first members. At equal cost the pair with the lower later component comes first, then the
    one with the lower earlier component."""
    n, d = m.shape
    columns, room = components_last(w, m, P)
    w, means, entries, log_det = columns
    near, costs = Columns(np.empty(n), np.empty((d, n)), np.empty(entries.shape), np.empty(n)), np.empty(n)
    largest = 0.0
    for i in range(n):
        largest = max(largest, abs(log_det[i]))
    rounding = ROUNDING * (10.0 + largest)
    # table[i, j], j < i: lower bound of the cost of merging the two; infinite once one of them is gone
    table = np.empty((n, n))
    # the least of row i and its column; or a lower bound of it and UNKNOWN; or infinite and GONE
    least, nearest = np.full(n, np.inf), np.full(n, UNKNOWN)
    for i in range(1, n):
        cost_row(i, ZERO, i, columns, room, table[i])
        nearest[i] = first_least(table[i], i)
        least[i] = table[i, nearest[i]]
    row, listed = np.empty(n), np.empty(n, np.int64)
    name, into, left = np.empty(n, np.int64), np.empty(n, np.int64), n
    for i in range(n):
        name[i] = into[i] = i
    while left > 1:
        i = first_least(least, n)
        if least[i] == np.inf:
            if left <= components and budget < np.inf:
                break
            raise ValueError("components lie too far apart to compute the cost of merging them")
        if nearest[i] == UNKNOWN:
            nearest[i] = first_least(table[i], i)
            least[i] = table[i, nearest[i]]
            continue
        j = nearest[i]
        cost_row(i, j, j + 1, columns, room, row)
        cost = row[j]
        if cost > least[i]:
            table[i, j], nearest[i] = cost, UNKNOWN
            continue
        budget -= cost
        if left <= components and budget < 0.0:
            break
        _bound_costs(i, j, n, w, cost, rounding, table, row)
        into[name[i]] = name[j]
        log_det[j] = merge_pair(j, i, w, means, entries, room)
        least[i], nearest[i] = np.inf, GONE
        left -= 1
        k = _below(SOON * cost, row, n, listed)
        _compute_costs(j, listed, k, columns, near, costs, room, row)
        for r in range(j):
            table[j, r] = row[r]
        least[j], nearest[j] = 0.0 if j > 0 else np.inf, UNKNOWN
        for r in range(j + 1, n):
            table[r, j] = row[r]
            if row[r] < least[r]:
                least[r], nearest[r] = row[r], j
            elif nearest[r] == i or nearest[r] == j:
                nearest[r] = UNKNOWN
        if left < FULL * n:
            n = _close_gaps(n, columns, table, least, nearest, name)
    n = _close_gaps(n, columns, table, least, nearest, name)
    return _by_component(n, columns, name, into)


@kernel(inline="always")
def _bound_costs(i, j, n, w, cost, rounding, table, row):
    """Lower bounds of the costs of merging each of the first n with the merge of i and j, written to row;
    the costs of i become infinite in the table."""
    for r in range(j):
        row[r] = table[j, r]
    for r in range(j + 1, n):
        row[r] = table[r, j]
    other = table[i]
    for r in range(i + 1, n):
        other[r], table[r, i] = table[r, i], np.inf
    row[i] = row[j] = other[i] = other[j] = np.inf
    weight = w[i] + w[j]
    for r in range(n):
        larger = row[r] if row[r] > other[r] else other[r]
        half = 0.5 * (cost + row[r] + other[r])
        bound = (larger if larger > half else half) - cost - rounding * (weight + w[r])
        row[r] = bound if bound > 0.0 else 0.0
    for r in range(i):
        other[r] = np.inf


@leaf_kernel
def _below(limit, row, n, listed):
    """Writes the indices of the first n of row that are below the limit to `listed`; returns their number."""
    k = 0
    for r in range(n):
        if row[r] < limit:
            listed[k] = r
            k += 1
    return k


@kernel(inline="always")
def _compute_costs(i, listed, k, columns, near, costs, room, row):
    """Writes the costs of merging component i with each of the first k listed to their columns of row."""
    w, means, entries, log_det = columns
    w_near, means_near, entries_near, log_det_near = near
    for r in range(k + 1):
        c = listed[r] if r < k else i
        w_near[r], log_det_near[r] = w[c], log_det[c]
        for q in range(len(means)):
            means_near[q, r] = means[q, c]
        for q in range(len(entries)):
            entries_near[q, r] = entries[q, c]
    cost_row(k, ZERO, k, near, room, costs)
    for r in range(k):
        row[listed[r]] = costs[r]


@kernel
def _close_gaps(n, columns, table, least, nearest, name):
    """Moves the components that remain to the first slots, in order; returns their number."""
    w, means, entries, log_det = columns
    place, at, left = np.full(n, -1), np.empty(n, np.int64), 0
    for i in range(n):
        if nearest[i] != GONE:
            place[i], at[left] = left, i
            left += 1
    for k in range(left):
        i = at[k]
        w[k], log_det[k], least[k], name[k] = w[i], log_det[i], least[i], name[i]
        nearest[k] = UNKNOWN if nearest[i] == UNKNOWN else place[nearest[i]]
        for q in range(len(means)):
            means[q, k] = means[q, i]
        for q in range(len(entries)):
            entries[q, k] = entries[q, i]
        for r in range(k):
            table[k, r] = table[i, at[r]]
    return left


@leaf_kernel
def first_least(row, n):
    """Index of the least of the first n, the first among equals. Eight at a time are compared in pairs: a
    running minimum, which the compiler does not vectorise, takes five times as long."""
    least, at, start = np.inf, 0, 0
    while start + 8 <= n:
        x = row[start : start + 8]
        a = x[0] if x[0] < x[1] else x[1]
        b = x[2] if x[2] < x[3] else x[3]
        c = x[4] if x[4] < x[5] else x[5]
        d = x[6] if x[6] < x[7] else x[7]
        a, c = a if a < b else b, c if c < d else d
        a = a if a < c else c
        if a < least:
            least, at = a, start
        start += 8
    for j in range(start, n):
        if row[j] < least:
            least, at = row[j], j
    for j in range(at, n):
        if row[j] == least:
            return j
    return 0


@kernel(inline="always")
def _by_component(n, columns, name, into):
    """Inverse of `components_last` for the first n components; origin from the chain of merges `into`."""
    w, means, entries, _ = columns
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
