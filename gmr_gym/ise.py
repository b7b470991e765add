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
#   to merge a and b into c   v = s delta,  delta = two - one, two = q[a] M[a] + q[b] M[b], one = q[c] M[c]
# <delta, delta> stays what it is while a and b live. <r, two> is known at any time, and for any share
#   <r, delta> = (1 - share) <r, two> - <r, one - share two> >= (1 - share) <r, two> - |r| |one - share two|
# so many merges lose without a look at <f, one> and <g, one>; the share with the least
# |one - share two| is <one, two> / <two, two>. Once looked at, <f, one> stays and <g, one> changes by
# at most three products per action.

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
    share: np.ndarray  # (N, N) the share of two that comes nearest to one
    reach: np.ndarray  # (N, N) |one - share two|, rounded up
    fc: np.ndarray  # (N, N) <f, q[c] M[c]>, where gc is known
    gc: np.ndarray  # (N, N) <g, q[c] M[c]>, nan while unknown
    origin: np.ndarray  # (N,) component of g that each input went into, -1 once deleted


def _begun(w, f, E):
    """Where the reduction starts: g is f."""
    T, n = f.shape
    room = n // 2  # for merges, each of two inputs or more
    M, weight = np.hstack([f, np.empty((T, room))]), np.append(w, np.zeros(room))
    place = np.arange(n)
    D, share, reach, fc, gc = (np.full((n, n), fill) for fill in (np.inf, 0.0, 0.0, 0.0, np.nan))
    h, g, u, q, origin = np.empty(n), np.empty(n), weight.copy(), w.copy(), place.copy()
    return _Work(M, weight, u, place, q, h, g, E, D, share, reach, fc, gc, origin)


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
    rounding = ROUNDING * work.h.sum()
    while n > components:
        _overlap(work)
        error = np.sqrt(max(J, 0.0) + rounding)
        delete_cost, k, after = _cheapest_deletion(work, s, W, renormalise)
        merge_cost, a, b = _cheapest_merge(work, s, error, delete_cost)
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
def _cheapest_merge(work, s, error, limit):
    """Cost and components a < b of the cheapest merge below `limit`, or an infinite cost.

    The least lower bound is made exact until it already is.
    """
    n = len(work.q)
    bound, at, room = np.full(n, np.inf), np.zeros(n, np.int64), np.empty(n)
    for a in range(n):
        if work.place[a] >= 0:
            bound[a], at[a] = _least_bound(work, a, s, error, room)
    while True:
        a = first_least(bound, n)
        b = at[a]
        if not bound[a] < limit:
            return np.inf, a, b
        if not np.isnan(work.gc[a, b]):
            return bound[a], a, b
        c, qc = _pair(work, a, b)
        with_c = _products_with_all(work, c)
        work.fc[a, b] = qc * _weighted(work.w, with_c)
        work.gc[a, b] = qc * _weighted(work.u, with_c)
        bound[a], at[a] = _least_bound(work, a, s, error, room)


@njit(cache=True, error_model="numpy")
def _least_bound(work, a, s, error, room):
    """Least lower bound on the cost of a merge of a with any b > a, and that b."""
    h, g, n = work.h, work.g, len(work.q)
    D, share, reach, fc, gc = work.D[a], work.share[a], work.reach[a], work.fc[a], work.gc[a]
    r_a = h[a] - s * g[a]
    for b in range(a + 1, n):
        r_two = r_a + (h[b] - s * g[b])
        known = r_two - (fc[b] - s * gc[b])
        rd = (1.0 - share[b]) * r_two - error * reach[b] if np.isnan(gc[b]) else known
        cost = 2.0 * s * rd + s * s * D[b]
        room[b] = np.inf if np.isnan(cost) else cost
    b = a + 1 + first_least(room[a + 1 :], n - a - 1)
    return (room[b], b) if b < n else (np.inf, a)


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
    """Set D, share and reach of a with each of `others`; their other products become unknown."""
    q, E = work.q, work.E
    c, qc = _moment_match(work, np.full(len(others), a), others)
    near = work.M[:, work.place[others]]
    cc = products_of_columns(c, c, len(others))
    ac = products_with(work.M[:, work.place[a]].copy(), c, len(others))
    bc = products_of_columns(near, c, len(others))
    for k in range(len(others)):
        b = others[k]
        two = q[a] * q[a] * E[a, a] + q[b] * q[b] * E[b, b] + 2.0 * q[a] * q[b] * E[a, b]
        one = qc[k] * qc[k] * cc[k]
        across = qc[k] * (q[a] * ac[k] + q[b] * bc[k])
        share = across / two if two > 0.0 else 1.0
        i, j = min(a, b), max(a, b)
        work.D[i, j] = max(two + one - 2.0 * across, 0.0)
        work.share[i, j] = share
        work.reach[i, j] = np.sqrt(max(one - share * across, 0.0) + ROUNDING * (two + one))
        work.gc[i, j] = np.nan


@njit(cache=True, error_model="numpy")
def _moment_match(work, a, b):
    """Packed merges (T, k) of the components a (k,) with b (k,), and their weights (eq. 9)."""
    M, a_at, b_at = work.M, work.place[a], work.place[b]
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
def _carry(work, change, weights):
    """Add the Gaussians packed in change (k, T), weighted, to g in every <g, q[c] M[c]> known."""
    a, b = _known_pairs(work)
    for start in range(0, len(a), BLOCK):
        left, right = a[start : start + BLOCK], b[start : start + BLOCK]
        c, qc = _moment_match(work, left, right)
        for k in range(len(weights)):
            with_c = products_with(change[k], c, len(left))
            for i in range(len(left)):
                work.gc[left[i], right[i]] += weights[k] * qc[i] * with_c[i]


@njit(cache=True, error_model="numpy")
def _known_pairs(work):
    """Components a < b (k,) of the pairs whose <g, q[c] M[c]> is known."""
    alive = np.flatnonzero(work.place >= 0)
    n = len(alive)
    a, b, count = np.empty(n * n // 2 + 1, np.int64), np.empty(n * n // 2 + 1, np.int64), 0
    for i in range(n):
        row = work.gc[alive[i]]
        for j in range(i + 1, n):
            a[count], b[count] = alive[i], alive[j]
            count += not np.isnan(row[alive[j]])
    return a[:count], b[:count]


@njit(cache=True, error_model="numpy")
def _delete(work, k):
    change, weights = np.empty((1, len(work.M))), np.full(1, -work.q[k])
    change[0] = work.M[:, work.place[k]]
    work.origin[work.origin == k] = -1
    _vacate(work, k)
    _carry(work, change, weights)


@njit(cache=True, error_model="numpy")
def _merge(work, a, b):
    """Put the merge of a and b into a."""
    n = len(work.q)
    c, qc = _pair(work, a, b)
    change, weights = np.empty((3, len(c))), np.array([-work.q[a], -work.q[b], qc])
    change[0], change[1], change[2] = work.M[:, work.place[a]], work.M[:, work.place[b]], c
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
    for table, gone in ((work.D, np.inf), (work.gc, np.nan)):
        table[a] = gone
        table[:, a] = gone
