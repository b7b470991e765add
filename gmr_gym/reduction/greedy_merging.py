"""Greedy merging by Runnalls' cost B.

For three components let F be the least of the sum of w KL(component || N) over all Gaussians N. It is the
same for any order of merging, F = B(i, j) + B(ij, k). Each of B(i, j), B(i, k) and B(j, k) minimises two of
the three terms of that sum, so F is at least each of them, and at least half of their sum. Hence

    B(ij, k) >= max(B(i, k), B(j, k), 1/2 (B(i, j) + B(i, k) + B(j, k))) - B(i, j)

which holds also where B(i, k) and B(j, k) are themselves lower bounds. After a merge, the cheapest of all,
few pairs with the merged component need their exact cost: of those that the plain form computes again, 4 % in
400 hypotheses of a tracker reduced to 50, and a third in random mixtures. The cost of a pair is computed
before it is merged, so the merges are the same as when every cost is computed.

Tried and rejected: bounds from single states instead of the first costs take 4.8 ns a pair, the costs
themselves 4 to 5 ns. Without a table, where each row whose nearest is gone is computed anew, merging takes as
long, and costs that are equal but for rounding come in another order.
"""

from typing import NamedTuple

import numpy as np

from gmr_gym.kernels import ZERO, kernel, leaf_kernel
from gmr_gym.reduction.merge_cost import components_last, cost_row, empty_columns, merge_pair, whole

ROUNDING = 1e-15  # relative to weight times log determinant: margin of the bounds
SOON = 2.0  # times the cost of the last merge: pairs with a bound below it are computed as a batch
FULL = 0.6  # fraction of the slots in use below which the gaps between them are closed
UNKNOWN, GONE = -1, -2


class Search(NamedTuple):
    """What is known of the costs of merging n components, and workspace."""

    table: np.ndarray  # [i, j], j < i: lower bound of the cost of merging the two; infinite once one is gone
    # (n,), the least of each row and its column; or a lower bound of it and UNKNOWN; or infinite and GONE
    least: np.ndarray
    nearest: np.ndarray
    merged: np.ndarray  # (n,), whether the component is a merge of others
    name: np.ndarray  # (n,), the index of its first member
    row: np.ndarray  # workspace from here on
    costs: np.ndarray
    listed: np.ndarray
    place: np.ndarray


@kernel(inline="always")  # else the compiler would go through `_merge` once more
def merge_greedily(w, m, P, components, budget):
    """Merges the cheapest pair while more than `components` remain or its cost is within `budget`, which
    every merge reduces. Returns w, m, P and origin (n,) of the components that remain, in the order of
    their first members. At equal cost the pair with the lower later component comes first, then the
    one with the lower earlier component."""
    n, d = m.shape
    columns, room = components_last(w, m, P)
    near = empty_columns(n, d)
    wide = columns.shape[1]
    search = Search(
        np.empty((n, wide)), np.full(n, np.inf), np.full(n, UNKNOWN), np.zeros(n, np.bool_), np.arange(n),
        np.empty(wide), np.empty(wide), np.empty(n, np.int64), np.empty(n, np.int64),
    )  # fmt: skip
    into = np.arange(n)
    left = _merge(d, columns, near, room, search, into, components, budget)
    if left == 0:
        raise ValueError("components lie too far apart to compute the cost of merging them")
    return _by_component(left, d, columns, search.name, into)


@leaf_kernel
def _merge(d, columns, near, room, search, into, components, budget):
    """The merges of `merge_greedily`: into[i] becomes what i was merged into. Returns the number
    of components that remain, moved to the first columns; 0 where they lie too far apart."""
    w, log_det, means, entries = columns[0], columns[1], columns[2 : 2 + d], columns[2 + d :]
    n, (table, least, nearest, merged, name, row, costs, listed, _) = len(into), search
    largest = 0.0
    for i in range(n):
        largest = max(largest, abs(log_det[i]))
    rounding = ROUNDING * (10.0 + largest)
    table[0, 0] = np.inf
    for i in range(1, n):
        cost_row(i, ZERO, whole(i), columns, room, table[i])
        nearest[i] = first_least(table[i], i)
        least[i] = table[i, nearest[i]]
    left = n
    while left > 1:
        i = first_least(least, n)
        if least[i] == np.inf:
            if left <= components and budget < np.inf:
                break
            return 0
        if nearest[i] != UNKNOWN:
            j = nearest[i]
            cost = least[i]
            if merged[i] or merged[j]:  # it may be a bound, or computed from j to i, which rounds otherwise
                cost_row(i, j, j + 1, columns, room, table[i])
                cost = table[i, j]
            if cost <= least[i]:
                budget -= cost
                if left <= components and budget < 0.0:
                    break
                _bound_costs(i, j, n, w, cost, rounding, table, row)
                into[name[i]] = name[j]
                log_det[j] = merge_pair(j, i, w, means, entries, room)
                merged[j] = True
                least[i], nearest[i] = np.inf, GONE
                left -= 1
                k = _below(SOON * cost, row, n, listed)
                _compute_costs(j, listed, k, columns, near, costs, room, row)
                for r in range(j):
                    table[j, r] = row[r]
                for r in range(np.uint64(j + 1), np.uint64(n)):
                    table[r, j] = row[r]
                    if row[r] < least[r]:
                        least[r], nearest[r] = row[r], j
                    elif nearest[r] == i or nearest[r] == j:
                        nearest[r] = UNKNOWN
                i = j
        nearest[i] = first_least(table[i], i)
        least[i] = table[i, nearest[i]]
        if left < FULL * n:
            n = _close_gaps(n, columns, search)
    return _close_gaps(n, columns, search)


@leaf_kernel(inline="always")
def _bound_costs(i, j, n, w, cost, rounding, table, row):
    """Lower bounds of the costs of merging each of the first n with the merge of i and j, written to row;
    the costs of i become infinite in the table."""
    for r in range(j):
        row[r] = table[j, r]
    for r in range(np.uint64(j + 1), np.uint64(n)):
        row[r] = table[r, j]
    other = table[i]
    for r in range(np.uint64(i + 1), np.uint64(n)):
        other[r], table[r, i] = table[r, i], np.inf
    row[i] = row[j] = other[i] = other[j] = np.inf
    weight = w[i] + w[j]
    for r in range(whole(n)):
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


@leaf_kernel(inline="always")
def _compute_costs(i, listed, k, columns, near, costs, room, row):
    """Writes the costs of merging component i with each of the first k listed to their columns of row."""
    for r in range(k + 1):
        c = listed[r] if r < k else i
        for q in range(len(columns)):
            near[q, r] = columns[q, c]
    cost_row(k, ZERO, whole(k), near, room, costs)
    for r in range(k):
        row[listed[r]] = costs[r]


@leaf_kernel
def _close_gaps(n, columns, search):
    """Moves the components that remain to the first slots, in order; returns their number."""
    table, least, nearest, merged, name, _, _, at, place = search
    left = 0
    for i in range(n):
        if nearest[i] != GONE:
            place[i], at[left] = left, i
            left += 1
    for k in range(left):
        i = at[k]
        least[k], merged[k], name[k] = least[i], merged[i], name[i]
        nearest[k] = UNKNOWN if nearest[i] == UNKNOWN else place[nearest[i]]
        for q in range(len(columns)):
            columns[q, k] = columns[q, i]
        for r in range(k):
            table[k, r] = table[i, at[r]]
    return left


@leaf_kernel
def first_least(row, n):
    """Index of the least of the first n, the first among equals. Eight at a time are compared in pairs: a
    running minimum, which the compiler does not vectorise, takes five times as long."""
    least, at = np.inf, 0
    for k in range(n // 8):
        a = row[8 * k] if row[8 * k] < row[8 * k + 1] else row[8 * k + 1]
        b = row[8 * k + 2] if row[8 * k + 2] < row[8 * k + 3] else row[8 * k + 3]
        c = row[8 * k + 4] if row[8 * k + 4] < row[8 * k + 5] else row[8 * k + 5]
        d = row[8 * k + 6] if row[8 * k + 6] < row[8 * k + 7] else row[8 * k + 7]
        a, c = a if a < b else b, c if c < d else d
        a = a if a < c else c
        if a < least:
            least, at = a, 8 * k
    for j in range(n // 8 * 8, n):
        if row[j] < least:
            least, at = row[j], j
    for j in range(at, n):
        if row[j] == least:
            return j
    return 0


@kernel(inline="always")
def _by_component(n, d, columns, name, into):
    """Inverse of `components_last` for the first n components; origin from the chain of merges `into`."""
    m, P = np.empty((n, d)), np.empty((n, d, d))
    place, origin = np.empty(len(into), np.int64), np.empty(len(into), np.int64)
    for i in range(n):
        place[name[i]], q = i, 2 + d
        for r in range(d):
            m[i, r] = columns[2 + r, i]
            for c in range(r + 1):
                P[i, r, c] = P[i, c, r] = columns[q, i]
                q += 1
    for i in range(len(into)):
        root = i
        while into[root] != root:
            root = into[root]
        origin[i] = place[root]
    return columns[0, :n].copy(), m, P, origin
