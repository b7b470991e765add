"""Williams' greedy reduction: each step leaves the least integral squared error it can."""

from typing import NamedTuple

import numpy as np
from numba import njit

from gmr_gym.distances import BLOCK, dimension, pack, products, products_of_columns, products_with, unpack
from gmr_gym.merging import first_least
from gmr_gym.mixture import Mixture
from gmr_gym.reduction import at_least_one

# <u, v> is the integral of u v, f the original mixture, s g the reduced one with
# g = sum_a q[a] M[a], and r = f - s g the error. An action that turns r into r + v costs
# 2 <r, v> + <v, v>:
#   to delete a               v = (s - s') g + s' q[a] M[a],  s' the scale afterwards
#   to merge a and b into c   v = s delta,  delta = A + B - C,  A = q[a] M[a], B = q[b] M[b], C = q[c] M[c]
# <delta, delta> stays what it is while a and b live. <r, A> is known at any time for every a, and for any
# x and y
#   <r, delta> = (1 - x) <r, A> + (1 - y) <r, B> - <r, C - x A - y B>
# where the last is at most |r| |C - x A - y B| in size, least where x A + y B is the projection of C. So
# many merges lose without a look at <r, C>. For those that do not
#   <r, delta> = (1 - s) <f, delta> + s <e, delta>,  e = f - g
# in which e has few terms at first, the inputs that went and the merges made of them, and <e, C> changes by
# at most three products per action. <f, C> stays; as s is near 1 a bound as above, of |f| for |r|, often
# does in its place.

RIDGE = 1e-6  # keeps x and y small where A and B are alike
ROUNDING = 1e-14  # relative error granted to a sum of products; bounds stay on its safe side


def integral_squared_error(
    p: Mixture, components: int, renormalise: bool = True
) -> tuple[Mixture, np.ndarray]:
    """At most `components` components, and where each input went (n,): its output index, or -1
    if deleted (Williams and Maybeck 2006; Maybeck, eqs. 7-9).

    Each step makes the pair merge or the deletion whose result has the least integral squared
    error from the original mixture. A deletion rescales what is left to the original total
    weight if `renormalise`. At equal cost deletions come first, then lower indices. Costs are
    good to about 1e-15 of the products <f, q[a] M[a]> they are made of; between actions closer
    than that the choice is repeatable but arbitrary.
    """
    components = at_least_one(components)
    n, d = p.m.shape
    if n <= components:
        return p, np.arange(n)
    f = pack(p.m, p.P)
    E = products(f, f)
    if not np.isfinite(p.w @ E @ p.w):
        raise ValueError("the square of p must have a finite integral; check p with mixture(w, m, P)")
    work = _begun(p.w, f, E)
    s = _reduce(work, components, renormalise)
    alive = np.flatnonzero(work.place >= 0)
    return Mixture(s * work.q[alive], *unpack(work.M[:, work.place[alive]], d)), _numbered(work)


class _Work(NamedTuple):
    """f, and g with what is known of it. A merge takes the place of its first component, so that
    the components of g keep the order of the inputs; nothing is moved when one goes."""

    M: np.ndarray  # (T, L) packed Gaussians: the N of f, then the merges that g holds
    w: np.ndarray  # (L,) their weights in f
    u: np.ndarray  # (L,) their weights in g
    place: np.ndarray  # (N,) column of component a of g, -1 once it is gone
    q: np.ndarray  # (N,) its weight, 0 once it is gone
    h: np.ndarray  # (N,) <f, q[a] M[a]>
    g: np.ndarray  # (N,) <g, q[a] M[a]>
    E: np.ndarray  # (N, N) <M[a], M[b]>
    D: np.ndarray  # (N, N) <delta, delta> of the pair a < b, infinite once one of them is gone
    x: np.ndarray  # (N, N) the multiple of A, and
    y: np.ndarray  # (N, N) that of B, which come nearest to C
    reach: np.ndarray  # (N, N) |C - x A - y B|, rounded up
    ec: np.ndarray  # (N, N) <e, C>, nan while unknown
    fc: np.ndarray  # (N, N) <f, C>, nan while unknown
    bound: np.ndarray  # (N, N) at most what it costs to merge a < b
    origin: np.ndarray  # (N,) component of g that each input went into, -1 once deleted


def _begun(w, f, E):
    """Where the reduction starts: g is f."""
    T, n = f.shape
    room = n // 2  # for merges, each of two inputs or more
    M, weight = np.hstack([f, np.empty((T, room))]), np.append(w, np.zeros(room))
    place = np.arange(n)
    ec, fc = np.full((2, n, n), np.nan)
    D, x, y, reach, bound = np.full((5, n, n), np.inf)
    h, g, u, q, origin = np.empty(n), np.empty(n), weight.copy(), w.copy(), place.copy()
    return _Work(M, weight, u, place, q, h, g, E, D, x, y, reach, ec, fc, bound, origin)


def _numbered(work):
    """Where each input went (n,), with the components of g numbered in order."""
    number = np.append(np.cumsum(work.place >= 0) - 1, -1)  # the last for those deleted, at index -1
    return number[work.origin]


@njit(cache=True, error_model="numpy")
def _reduce(work, components, renormalise):
    """Act on `work` until `components` are left; the scale s."""
    n = len(work.q)
    _overlap(work)
    work.h[:] = work.g  # to the last bit: no difference yet, no cost
    for a in range(n):
        _score_pairs(work, a, np.arange(a))
    W = work.q.sum()  # weight of g
    s = 1.0
    J = 0.0  # <r, r>
    size = np.sqrt(work.h.sum())  # |f|
    while n > components:
        _overlap(work)
        error = np.sqrt(max(J, 0.0) + ROUNDING * size**2)
        delete_cost, k, after = _cheapest_deletion(work, s, W, renormalise)
        merge_cost, a, b = _cheapest_merge(work, s, error, size, delete_cost)
        if merge_cost < delete_cost:
            J += merge_cost
            _merge(work, a, b)
        else:
            J += delete_cost
            W -= work.q[k]
            s = after
            _delete(work, k)
        n -= 1
    return s


@njit(cache=True, error_model="numpy")
def _overlap(work):
    """Set <g, q[a] M[a]> from scratch: rounding does not pile up."""
    g, q, n = work.g, work.q, len(work.q)
    g[:] = 0.0
    for b in range(n):
        if work.place[b] >= 0:
            row = work.E[b]
            for a in range(n):
                g[a] += row[a] * q[b]
    for a in range(n):
        g[a] *= q[a]


@njit(cache=True, error_model="numpy")
def _cheapest_deletion(work, s, W, renormalise):
    """Cost and component of the cheapest deletion, and the scale after it."""
    H, G = 0.0, 0.0
    alive = np.flatnonzero(work.place >= 0)
    for a in alive:
        H += work.h[a]
        G += work.g[a]
    rg = H - s * G  # <r, g>
    least, slot, scale = np.inf, alive[0], s
    for a in alive:
        q = work.q[a]
        # a deletion that leaves no weight leaves nothing to rescale
        after = s * (W / (W - q)) if renormalise and W > q else s
        lost = s - after
        rv = lost * rg + after * (work.h[a] - s * work.g[a])
        vv = lost * lost * G + 2.0 * lost * after * work.g[a] + (after * q) ** 2 * work.E[a, a]
        if 2.0 * rv + vv < least:
            least, slot, scale = 2.0 * rv + vv, a, after
    return least, slot, scale


@njit(cache=True, error_model="numpy")
def _cheapest_merge(work, s, error, size, limit):
    """Cost and components a < b of the cheapest merge, or `limit` where none costs less.

    Of what could be cheapest by its bound one pair is looked at, to learn how little a merge may cost,
    then all the others together.
    """
    n, total = len(work.q), len(work.q) + _count_merges(work)
    f, f_weights = work.M[:, :n].copy(), work.w[:n]
    changed = np.flatnonzero(work.w[:total] != work.u[:total])
    e, e_weights = work.M[:, changed].copy(), work.w[changed] - work.u[changed]
    r_with = work.h - s * work.g
    bound, cost = np.full(n, np.inf), np.full(n, np.inf)  # the least of each row
    bound_at, cost_at = np.zeros(n, np.int64), np.zeros(n, np.int64)
    out_of_date, alone = work.place >= 0, True
    while True:
        for a in np.flatnonzero(out_of_date):
            bound[a], bound_at[a], cost[a], cost_at[a] = _bound_row(work, a, s, error, size, r_with)
        a, i = first_least(cost, n), first_least(bound, n)
        least = min(cost[a], limit)
        if not bound[i] < least:
            return least, a, cost_at[a]
        least = bound[i] if alone else least
        out_of_date = bound <= least
        first, second = _unknown(work.ec, work.bound, out_of_date, least)
        _add_products(work, work.ec, first, second, e, e_weights)
        if alone or len(first) == 0:
            first, second = _unknown(work.fc, work.bound, out_of_date, least)
            _add_products(work, work.fc, first, second, f, f_weights)
        alone = False


@njit(cache=True, error_model="numpy")
def _bound_row(work, a, s, error, size, r_with):
    """Sets the bounds of a with every b > a. The least bound and its b, the least cost that is known and its
    b."""
    n, b = len(work.q), a + 1
    h_a, g_a, r_a = work.h[a], work.g[a], r_with[a]
    h, g, r = work.h[b:], work.g[b:], r_with[b:]
    D, x, y, reach = work.D[a, b:], work.x[a, b:], work.y[a, b:], work.reach[a, b:]
    ec, fc, bound, cost = work.ec[a, b:], work.fc[a, b:], work.bound[a, b:], np.empty(n - b)
    for i in range(n - b):
        f_delta = (1.0 - x[i]) * h_a + (1.0 - y[i]) * h[i] + size * reach[i]
        f_two = h_a + h[i]
        f_delta = f_delta if f_delta < f_two else f_two
        f_delta = f_delta if np.isnan(fc[i]) else f_two - fc[i]
        e_delta = (f_two - ec[i]) - (g_a + g[i])  # to the rounding of what it is made of: no cost below that
        r_delta = (1.0 - s) * f_delta + s * e_delta  # s is at least 1
        below = (1.0 - x[i]) * r_a + (1.0 - y[i]) * r[i] - error * reach[i]
        r_delta = below if np.isnan(ec[i]) else r_delta
        least = 2.0 * s * r_delta + s * s * D[i]
        least = np.inf if np.isnan(least) else least
        known = not np.isnan(ec[i]) and (s == 1.0 or not np.isnan(fc[i]))
        bound[i] = least
        cost[i] = least if known else np.inf
    if b == n:
        return np.inf, a, np.inf, a
    i, j = first_least(bound, n - b), first_least(cost, n - b)
    return bound[i], b + i, cost[j], b + j


@njit(cache=True, error_model="numpy")
def _unknown(table, bound, rows, most):
    """Components a < b (k,) of the pairs in these rows that are unknown and whose bound is at most this."""
    n = len(rows)
    a, b, count = np.empty(n * n // 2 + 1, np.int64), np.empty(n * n // 2 + 1, np.int64), 0
    for i in range(n):
        if rows[i]:
            for j in range(i + 1, n):
                a[count], b[count] = i, j
                count += bound[i, j] <= most and np.isnan(table[i, j])
    return a[:count], b[:count]


@njit(cache=True, error_model="numpy")
def _products_with_all(work, c):
    """Products of the Gaussian packed in c (T,) with every column in use."""
    return products_with(c, work.M, len(work.q) + _count_merges(work))


@njit(cache=True, error_model="numpy")
def _count_merges(work):
    return (work.place >= len(work.q)).sum()


@njit(cache=True, error_model="numpy")
def _weighted(weights, products):
    total = 0.0
    for i in range(len(products)):
        total += weights[i] * products[i]
    return total


@njit(cache=True, error_model="numpy")
def _score_pairs(work, a, others):
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
        work.D[i, j] = max(AA + BB + CC + 2.0 * (AB - AC - BC), 0.0)
        work.x[i, j], work.y[i, j] = (x, y) if a < b else (y, x)
        work.reach[i, j] = np.sqrt(max(apart, 0.0) + ROUNDING * (AA + BB + CC + x * x * AA + y * y * BB))
        work.ec[i, j] = work.fc[i, j] = np.nan


@njit(cache=True, error_model="numpy")
def _projection(AA, AB, BB, AC, BC):
    """The x and y with which x A + y B comes about nearest to C."""
    if not (AA > 0.0 and BB > 0.0):
        return 1.0, 1.0
    a, b = (1.0 + RIDGE) * AA, (1.0 + RIDGE) * BB
    det = 1.0 - (AB / a) * (AB / b)
    return (AC / a - (AB / a) * (BC / b)) / det, (BC / b - (AB / b) * (AC / a)) / det


@njit(cache=True, error_model="numpy")
def _moment_match(work, a, b):
    """Packed merges (T, k) of the components a (k,) with b (k,), and their weights (eq. 9)."""
    # indices without a sign need no look at whether they count from the end, which takes half the time
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


@njit(cache=True, error_model="numpy")
def _pair(work, a, b):
    """The merge of a and b, packed (T,), and its weight."""
    c, qc = _moment_match(work, np.full(1, a), np.full(1, b))
    return c.reshape(-1), qc[0]


@njit(cache=True, error_model="numpy")
def _add_products(work, table, a, b, columns, weights):
    """Add the products of C with the Gaussians packed in columns (T, L), weighted, to the table, which holds
    nan where none are counted yet, for the pairs of a (k,) with b (k,)."""
    for start in range(0, len(a), BLOCK):
        left, right = a[start : start + BLOCK], b[start : start + BLOCK]
        c, qc = _moment_match(work, left, right)
        total = np.zeros(len(left))
        if len(left) < len(weights):
            for i in range(len(left)):
                total[i] = _weighted(weights, products_with(c[:, i].copy(), columns, len(weights)))
        else:
            for k in range(len(weights)):
                with_c = products_with(columns[:, k].copy(), c, len(left))
                for i in range(len(left)):
                    total[i] += weights[k] * with_c[i]
        for i in range(len(left)):
            so_far = table[left[i], right[i]]
            table[left[i], right[i]] = qc[i] * total[i] + (0.0 if np.isnan(so_far) else so_far)


@njit(cache=True, error_model="numpy")
def _carry(work, change, weights):
    """Take the Gaussians packed in change (T, k), weighted, out of e in every <e, C> known."""
    a, b = _known_pairs(work)
    _add_products(work, work.ec, a, b, change, -weights)


@njit(cache=True, error_model="numpy")
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


@njit(cache=True, error_model="numpy")
def _delete(work, k):
    change, weights = work.M[:, work.place[k] : work.place[k] + 1].copy(), np.full(1, -work.q[k])
    work.origin[work.origin == k] = -1
    _vacate(work, k)
    _carry(work, change, weights)


@njit(cache=True, error_model="numpy")
def _merge(work, a, b):
    """Put the merge of a and b into a."""
    n = len(work.q)
    c, qc = _pair(work, a, b)
    change, weights = np.empty((len(c), 3)), np.array([-work.q[a], -work.q[b], qc])
    change[:, 0], change[:, 1], change[:, 2] = work.M[:, work.place[a]], work.M[:, work.place[b]], c
    work.origin[work.origin == b] = a
    _vacate(work, a)
    _vacate(work, b)
    _carry(work, change, weights)
    column = n + _count_merges(work)
    work.M[:, column], work.u[column] = c, qc
    work.place[a], work.q[a] = column, qc
    with_c = _products_with_all(work, c)
    work.h[a] = qc * _weighted(work.w, with_c)
    alive = np.flatnonzero(work.place >= 0)
    for e in alive:
        work.E[a, e] = work.E[e, a] = with_c[work.place[e]]
    _score_pairs(work, a, alive[alive != a])


@njit(cache=True, error_model="numpy")
def _vacate(work, a):
    """Take component a out of g; the last merge moves into the column of one that goes."""
    n, hole = len(work.q), work.place[a]
    if hole >= n:
        last = n + _count_merges(work) - 1
        work.M[:, hole], work.u[hole] = work.M[:, last], work.u[last]
        work.place[work.place == last] = hole
        hole = last
    work.u[hole] = 0.0
    work.place[a], work.q[a] = -1, 0.0
    for table, gone in ((work.D, np.inf), (work.ec, np.nan), (work.fc, np.nan)):
        table[a] = gone
        table[:, a] = gone
