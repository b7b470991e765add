"""Williams' greedy reduction: each step leaves the least integral squared error it can."""

from typing import NamedTuple

import numpy as np
from numba import njit

from gmr_gym.distances import dimension, pack, products, products_of_columns, products_with, unpack
from gmr_gym.mixture import Mixture
from gmr_gym.reduction import at_least_one

# <u, v> is the integral of u v, f the original mixture, s g the reduced one with
# g = sum_a q[a] M[a], and r = f - s g the error. An action that turns r into r + v costs
# 2 <r, v> + <v, v>:
#   to delete a               v = (s - s') g + s' q[a] M[a],  s' the scale afterwards
#   to merge a and b into c   v = s delta,  delta = q[a] M[a] + q[b] M[b] - q[c] M[c]
# <delta, delta> stays what it is while a and b live, and |<r, delta>| <= |r| |delta|, so many
# merges lose without a look at <f, q[c] M[c]> and <g, q[c] M[c]>. Once looked at, the first
# stays and the second changes by at most three products per action.

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
    h = p.w * (E @ p.w)
    if not np.isfinite(h.sum()):
        raise ValueError("the square of p must have a finite integral; check p with mixture(w, m, P)")
    g = h.copy()
    unknown = (np.full((n, n), np.nan) for _ in range(4))
    work = _Work._make([p.w.copy(), f, p.w.copy(), f.copy(), h, g, E, *unknown, np.arange(n)])
    n, s = _reduce(work, components, renormalise)
    return Mixture(s * work.q[:n], *unpack(work.M[:, :n], d)), work.origin


class _Work(NamedTuple):
    """f, and g with what is known of it in the first n of N slots, always in input order."""

    w: np.ndarray  # (N,) weights of f
    f: np.ndarray  # (T, N) its components, packed
    q: np.ndarray  # (N,) weights of g
    M: np.ndarray  # (T, N) its components, packed
    h: np.ndarray  # (N,) <f, q[a] M[a]>
    g: np.ndarray  # (N,) <g, q[a] M[a]>
    E: np.ndarray  # (N, N) <M[a], M[b]>
    D: np.ndarray  # (N, N) <delta, delta> of the pair a < b
    reach: np.ndarray  # (N, N) |delta|, rounded up
    fc: np.ndarray  # (N, N) <f, q[c] M[c]>, where gc is known
    gc: np.ndarray  # (N, N) <g, q[c] M[c]>, nan while unknown
    origin: np.ndarray  # (N,) slot of each input component, -1 once deleted


@njit(cache=True, error_model="numpy")
def _reduce(work, components, renormalise):
    """Act on `work` until n <= components; that n, and the scale s."""
    n = len(work.q)
    for a in range(n):
        _score_pairs(work, a, a)
    W = work.q.sum()  # weight of g
    s = 1.0
    J = 0.0  # <r, r>
    rounding = ROUNDING * work.h.sum()
    while n > components:
        for a in range(n):  # from scratch: rounding does not pile up
            work.g[a] = work.q[a] * (work.E[a, :n] * work.q[:n]).sum()
        error = np.sqrt(max(J, 0.0) + rounding)
        delete_cost, k, after = _cheapest_deletion(work, n, s, W, renormalise)
        merge_cost, a, b = _cheapest_merge(work, n, s, error, delete_cost)
        if merge_cost < delete_cost:
            J += merge_cost
            _merge(work, a, b, n)
        else:
            J += delete_cost
            W -= work.q[k]
            s = after
            _carry(work, k, -1.0, n)
            _close(work, k, n)
        n -= 1
    return n, s


@njit(cache=True, error_model="numpy")
def _cheapest_deletion(work, n, s, W, renormalise):
    """Cost and slot of the cheapest deletion, and the scale after it."""
    G = work.g[:n].sum()
    rg = work.h[:n].sum() - s * G  # <r, g>
    least, slot, scale = np.inf, 0, s
    for a in range(n):
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
def _cheapest_merge(work, n, s, error, limit):
    """Cost and slots a < b of the cheapest merge below `limit`, or an infinite cost.

    The least lower bound is made exact until it already is.
    """
    bound, at = np.empty(n - 1), np.empty(n - 1, np.int64)
    for a in range(n - 1):
        bound[a], at[a] = _least_bound(work, a, n, s, error)
    while True:
        a = int(np.argmin(bound))
        b = at[a]
        if not bound[a] < limit:
            return np.inf, a, b
        if not np.isnan(work.gc[a, b]):
            return bound[a], a, b
        c, qc = _moment_match(work, np.full(1, a), np.full(1, b))
        work.fc[a, b] = qc[0] * _product(c, work.w, work.f, len(work.w))
        work.gc[a, b] = qc[0] * _product(c, work.q, work.M, n)
        bound[a], at[a] = _least_bound(work, a, n, s, error)


@njit(cache=True, error_model="numpy")
def _least_bound(work, a, n, s, error):
    """Least lower bound on the cost of a merge of a with any b > a, and that b."""
    h, g, D, reach, fc, gc = work.h, work.g, work.D[a], work.reach[a], work.fc[a], work.gc[a]
    least, at = np.inf, a + 1
    for b in range(a + 1, n):
        if np.isnan(gc[b]):
            rd = -error * reach[b]
        else:
            rd = h[a] + h[b] - fc[b] - s * (g[a] + g[b] - gc[b])
        bound = 2.0 * s * rd + s * s * D[b]
        if bound < least:
            least, at = bound, b
    return least, at


@njit(cache=True, error_model="numpy")
def _product(c, weights, columns, n):
    """<M, u> of the Gaussian M packed in c (T, 1) and the first n components of a mixture u."""
    return (weights[:n] * products_with(c[:, 0], columns, n)).sum()


@njit(cache=True, error_model="numpy")
def _score_pairs(work, a, n):
    """Set D and reach of slot a with each of 0..n-1; their other products become unknown."""
    q, E = work.q, work.E
    c, qc = _moment_match(work, np.full(n, a), np.arange(n))
    cc = products_of_columns(c, c, n)
    ac = products_with(work.M[:, a], c, n)
    bc = products_of_columns(work.M, c, n)
    for b in range(n):
        two = q[a] * q[a] * E[a, a] + q[b] * q[b] * E[b, b] + 2.0 * q[a] * q[b] * E[a, b]
        one = qc[b] * qc[b] * cc[b]
        i, j = min(a, b), max(a, b)
        work.D[i, j] = max(two + one - 2.0 * qc[b] * (q[a] * ac[b] + q[b] * bc[b]), 0.0)
        work.reach[i, j] = np.sqrt(work.D[i, j] + ROUNDING * (two + one))
        work.gc[i, j] = np.nan


@njit(cache=True, error_model="numpy")
def _carry(work, slot, sign, n):
    """Add sign q[slot] M[slot] to g in every <g, q[c] M[c]> that is known."""
    a, b = np.nonzero(~np.isnan(work.gc[:n, :n]))
    c, qc = _moment_match(work, a, b)
    with_c = products_with(work.M[:, slot], c, len(a))
    for i in range(len(a)):
        work.gc[a[i], b[i]] += sign * work.q[slot] * qc[i] * with_c[i]


@njit(cache=True, error_model="numpy")
def _moment_match(work, a, b):
    """Packed merges (T, k) of the slots a (k,) with the slots b (k,), and their weights (eq. 9)."""
    M = work.M
    T, k = len(M), len(a)
    c, qc, share = np.empty((T, k)), np.empty(k), np.empty(k)
    for i in range(k):
        qc[i] = work.q[a[i]] + work.q[b[i]]
        share[i] = work.q[a[i]] / qc[i] if qc[i] > 0.0 else 0.5
    mean = T - dimension(T)  # the row where the means begin
    t = 0
    for row in range(mean, T):
        for i in range(k):
            c[row, i] = share[i] * M[row, a[i]] + (1.0 - share[i]) * M[row, b[i]]
        for col in range(mean, row + 1):
            for i in range(k):
                spread = (M[row, a[i]] - M[row, b[i]]) * (M[col, a[i]] - M[col, b[i]])
                P = M[t, a[i]] + (1.0 - share[i]) * spread
                c[t, i] = share[i] * P + (1.0 - share[i]) * M[t, b[i]]
            t += 1
    return c, qc


@njit(cache=True, error_model="numpy")
def _merge(work, a, b, n):
    """Put the merge of a and b into slot a and close b."""
    _carry(work, a, -1.0, n)
    _carry(work, b, -1.0, n)
    c, qc = _moment_match(work, np.full(1, a), np.full(1, b))
    for t in range(len(c)):
        work.M[t, a] = c[t, 0]
    work.q[a] = qc[0]
    work.h[a] = qc[0] * _product(c, work.w, work.f, len(work.w))
    for i in range(len(work.origin)):
        if work.origin[i] == b:
            work.origin[i] = a
    _close(work, b, n)
    with_c = products_with(c[:, 0], work.M, n - 1)
    for e in range(n - 1):
        work.E[a, e] = work.E[e, a] = with_c[e]
    _score_pairs(work, a, n - 1)
    _carry(work, a, 1.0, n - 1)


@njit(cache=True, error_model="numpy")
def _close(work, k, n):
    """Delete slot k; the slots after it move down by one."""
    for i in range(len(work.origin)):
        if work.origin[i] == k:
            work.origin[i] = -1
        elif work.origin[i] > k:
            work.origin[i] -= 1
    for i in range(k, n - 1):
        work.q[i] = work.q[i + 1]
        work.h[i] = work.h[i + 1]
        for t in range(len(work.M)):
            work.M[t, i] = work.M[t, i + 1]
    for table in (work.E, work.D, work.reach, work.fc, work.gc):
        for i in range(n - 1):
            for j in range(n - 1):
                table[i, j] = table[i + (i >= k), j + (j >= k)]
