"""Williams' greedy reduction: every step the least integral squared error from the original."""

from typing import NamedTuple

import numpy as np
from numba import njit

from gmr_gym.distances import dimension, pack, products, products_of_columns, products_with, unpack
from gmr_gym.mixture import Mixture

# f is the original and g = s sum_a q[a] M[a] the reduced mixture, <u, v> the integral of u v.
# An action turns the error r = f - g into r + v and so costs 2 <r, v> + <v, v>:
#   merging a and b into c   v = s delta,  delta = q[a] M[a] + q[b] M[b] - q[c] M[c]
#   deleting a               v = (1 - s'/s) g + s' q[a] M[a],  s' the scale afterwards
# <delta, delta> stays what it is while a and b live. <r, delta>, the expensive part, changes by
# at most |v| |delta| per action (Cauchy-Schwarz), so its last value and the |v| summed since
# bound the cost from below, and it is computed anew only where the bound does not already lose.

ROUNDING = 1e-14  # relative error granted to an integral: the bounds stay on the safe side of it


def integral_squared_error(
    mixture: Mixture, components: int, renormalise: bool = True
) -> tuple[Mixture, np.ndarray]:
    """At most `components` components, and where each input went (n,): its output index, or -1
    (Williams and Maybeck 2006; Maybeck, eqs. 7-9).

    Each step makes the pair merge or the deletion whose result has the least integral squared
    error from the original mixture. A deletion rescales what is left to the original total
    weight if `renormalise`. At equal cost deletions come first, then lower indices. A cost is
    exact to about 1e-15 of the overlaps <f, q[a] M[a]> it is made of; between actions closer
    than that the choice is repeatable but arbitrary.
    """
    if components < 1:
        raise ValueError(f"components must be at least 1, got {components}")
    n, d = mixture.m.shape
    if n <= components:
        return mixture, np.arange(n)
    f = pack(mixture.m, mixture.P)
    E = products(f, f)
    if not np.isfinite(mixture.w @ E @ mixture.w):
        raise ValueError(
            "the mixture has no finite integrated square; check w and P with mixture(w, m, P)"
        )
    w, M, origin = _reduce(mixture.w, f, E, components, renormalise)
    return Mixture(w, *unpack(M, d)), origin


class _Work(NamedTuple):
    """g and what is known about it: slots 0..n-1 of each axis of length N, in input order."""

    p: np.ndarray  # (N,) weights of f
    f: np.ndarray  # (T, N) its components, packed
    q: np.ndarray  # (N,) weights of g / s
    M: np.ndarray  # (T, N) its components, packed
    E: np.ndarray  # (N, N) <M[a], M[b]>
    h: np.ndarray  # (N,) <f, q[a] M[a]>
    D: np.ndarray  # (N, N) <delta, delta> of each pair
    reach: np.ndarray  # (N, N) |delta|, rounded up
    rd: np.ndarray  # (N, N) <r, delta> as last computed
    then: np.ndarray  # (N, N) `moved` at that time
    origin: np.ndarray  # (N,) slot of each input component
    merged: np.ndarray  # (T, N) scratch: one component merged with each of the others
    out: np.ndarray  # (3, N) scratch
    bordered: np.ndarray  # (T + 1, N) scratch


@njit(cache=True, error_model="numpy")
def _reduce(p, f, E, components, renormalise):
    n = len(p)
    work = _start(p, f, E)
    s = 1.0
    W = p.sum()
    J = 0.0  # <r, r>
    moved = 0.0  # |v| summed over the actions so far
    rounding = ROUNDING * work.h.sum()
    while n > components:
        g = _products_with_all(work, n)
        delete_cost, k, s_after, step = _cheapest_deletion(work, g, n, s, W, renormalise)
        merge_cost, a, b = _cheapest_merge(work, g, n, s, moved, delete_cost)
        if merge_cost < delete_cost:
            J += merge_cost
            moved += s * work.reach[a, b]
            _merge(work, a, b, n)
            n -= 1
            # nothing is known of the new pairs but |<r, delta>| <= |r| |delta|
            _score_pairs(work, a, n, moved - np.sqrt(max(J, 0.0) + rounding))
        else:
            J += delete_cost
            moved += step
            W -= work.q[k]
            s = s_after
            _redirect(work, k, -1)
            _close_slot(work, k, n)
            n -= 1
    return work.q[:n] * s, work.M[:, :n], work.origin


@njit(cache=True, error_model="numpy")
def _start(p, f, E):
    T, n = f.shape
    nothing = np.zeros((n, n))
    work = _Work(
        p, f, p.copy(), f.copy(), E.copy(), np.zeros(n),
        nothing, nothing.copy(), nothing.copy(), nothing.copy(), np.arange(n),
        np.empty((T, n)), np.empty((3, n)), np.empty((T + 1, n)),
    )  # fmt: skip
    work.h[:] = _products_with_all(work, n)
    for a in range(n):
        _score_pairs(work, a, a, 0.0)
    return work


@njit(cache=True, error_model="numpy")
def _products_with_all(work, n):
    """<g / s, q[a] M[a]> of every a (n,)."""
    g = np.zeros(n)
    for e in range(n):
        row = work.E[e]
        for a in range(n):
            g[a] += work.q[e] * row[a]
    return g * work.q[:n]


@njit(cache=True, error_model="numpy")
def _cheapest_deletion(work, g, n, s, W, renormalise):
    """Cost, slot, scale afterwards and |v| of the cheapest deletion; W is the weight of g / s."""
    G = g.sum()
    rg = work.h[:n].sum() - s * G  # <r, g / s>
    cost, slot, scale, step = np.inf, 0, s, 0.0
    for a in range(n):
        # a deletion that leaves no weight at all has nothing to rescale
        after = s * (W / (W - work.q[a])) if renormalise and W > work.q[a] else s
        own = after * after * work.q[a] * work.q[a] * work.E[a, a]
        rest = (s - after) * (s - after) * G
        vv = own + rest + 2.0 * (s - after) * after * g[a]
        c = 2.0 * ((s - after) * rg + after * (work.h[a] - s * g[a])) + vv
        if c < cost:
            cost, slot, scale = c, a, after
            step = np.sqrt(max(vv, 0.0) + ROUNDING * (own + rest))
    return cost, slot, scale, step


@njit(cache=True, error_model="numpy")
def _cheapest_merge(work, g, n, s, moved, limit):
    """Cost and slots a < b of the cheapest merge; infinite cost when none is below `limit`.

    The pair with the least bound is brought up to date until that pair already is.
    """
    least = np.empty(n - 1)
    at = np.empty(n - 1, np.int64)
    for a in range(n - 1):
        least[a], at[a] = _least_bound(work, a, n, s, moved)
    while True:
        a = np.argmin(least)
        b = at[a]
        if not least[a] < limit:
            return np.inf, 0, 0
        if work.then[a, b] == moved:
            return least[a], a, b
        work.rd[a, b] = _error_product(work, g, a, b, n, s)
        work.then[a, b] = moved
        least[a], at[a] = _least_bound(work, a, n, s, moved)


@njit(cache=True, error_model="numpy")
def _least_bound(work, a, n, s, moved):
    """Least lower bound on the cost of merging a with any b > a, and that b."""
    D, reach, rd, then = work.D[a], work.reach[a], work.rd[a], work.then[a]
    least, at = np.inf, a + 1
    for b in range(a + 1, n):
        bound = 2.0 * s * (rd[b] - (moved - then[b]) * reach[b]) + s * s * D[b]
        if bound < least:
            least, at = bound, b
    return least, at


@njit(cache=True, error_model="numpy")
def _error_product(work, g, a, b, n, s):
    """<r, delta> of the pair a, b."""
    _moment_match(work, a, b, b + 1)
    with_f, with_g = work.out[0], work.out[1]
    products_with(with_f, work.bordered, work.merged, b, work.f, len(work.p))
    products_with(with_g, work.bordered, work.merged, b, work.M, n)
    total = 0.0
    for i in range(len(work.p)):
        total += work.p[i] * with_f[i]
    for e in range(n):
        total -= s * work.q[e] * with_g[e]
    return work.h[a] + work.h[b] - s * (g[a] + g[b]) - (work.q[a] + work.q[b]) * total


@njit(cache=True, error_model="numpy")
def _score_pairs(work, a, n, then):
    """Set D, reach and an <r, delta> of 0 as of `then` for the pairs of a with slots 0..n-1."""
    q, E = work.q, work.E
    _moment_match(work, a, 0, n)
    cc, ca, cb = work.out[0], work.out[1], work.out[2]
    products_of_columns(cc, work.bordered, work.merged, work.merged, n)
    products_with(ca, work.bordered, work.M, a, work.merged, n)
    products_of_columns(cb, work.bordered, work.merged, work.M, n)
    for b in range(n):
        qc = q[a] + q[b]
        before = q[a] * q[a] * E[a, a] + q[b] * q[b] * E[b, b] + 2.0 * q[a] * q[b] * E[a, b]
        after = qc * qc * cc[b]
        D = max(before + after - 2.0 * qc * (q[a] * ca[b] + q[b] * cb[b]), 0.0)
        work.D[a, b] = work.D[b, a] = D
        work.reach[a, b] = work.reach[b, a] = np.sqrt(D + ROUNDING * (before + after))
        work.rd[a, b] = work.rd[b, a] = 0.0
        work.then[a, b] = work.then[b, a] = then


@njit(cache=True, error_model="numpy")
def _moment_match(work, a, start, stop):
    """Slot a merged with each of the slots start..stop-1 (eq. 9), into those columns of `merged`.

    Two zero weights leave nan, which never is the cheapest: deleting either is free.
    """
    M, merged = work.M, work.merged
    d = dimension(len(M))
    mean = len(M) - d  # the row where the means begin
    share = work.q[a] / (work.q[a] + work.q[:stop])
    for r in range(d):
        ma, mb, m = M[mean + r, a], M[mean + r], merged[mean + r]
        for b in range(start, stop):
            m[b] = share[b] * ma + (1.0 - share[b]) * mb[b]
        for c in range(r + 1):
            t = r * (r + 1) // 2 + c
            na, nb = M[mean + c, a], M[mean + c]
            Pa, Pb, P = M[t, a], M[t], merged[t]
            for b in range(start, stop):
                spread = (1.0 - share[b]) * (ma - mb[b]) * (na - nb[b])
                P[b] = share[b] * (Pa + spread) + (1.0 - share[b]) * Pb[b]


@njit(cache=True, error_model="numpy")
def _merge(work, a, b, n):
    """Put the merge of a and b into slot a, and close slot b."""
    _moment_match(work, a, b, b + 1)
    work.M[:, a] = work.merged[:, b]
    work.q[a] += work.q[b]
    _redirect(work, b, a)
    _close_slot(work, b, n)
    out = work.out[0]
    products_with(out, work.bordered, work.M, a, work.f, len(work.p))
    total = 0.0
    for i in range(len(work.p)):
        total += work.p[i] * out[i]
    work.h[a] = work.q[a] * total
    products_with(out, work.bordered, work.M, a, work.M, n - 1)
    for e in range(n - 1):
        work.E[a, e] = work.E[e, a] = out[e]


@njit(cache=True, error_model="numpy")
def _redirect(work, old, new):
    """Send the inputs of slot `old` to `new`."""
    for i in range(len(work.origin)):
        if work.origin[i] == old:
            work.origin[i] = new


@njit(cache=True, error_model="numpy")
def _close_slot(work, k, n):
    """Move the slots after k down by one, so that they stay compact and in input order."""
    for i in range(len(work.origin)):
        if work.origin[i] > k:
            work.origin[i] -= 1
    for row in work.M:
        row[k : n - 1] = row[k + 1 : n]
    for vector in (work.q, work.h):
        vector[k : n - 1] = vector[k + 1 : n]
    for matrix in (work.E, work.D, work.reach, work.rd, work.then):
        for i in range(n - 1):
            source, target = matrix[i + (i >= k)], matrix[i]
            if i >= k:
                target[:k] = source[:k]
            target[k : n - 1] = source[k + 1 : n]
