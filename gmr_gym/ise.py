"""Williams' greedy reduction: each step leaves the least integral squared error it can."""

from typing import NamedTuple

import numpy as np
from numba import njit

from gmr_gym.distances import (
    dimension,
    pack,
    products,
    products_of_columns,
    products_with,
    unpack,
)
from gmr_gym.mixture import Mixture

# <u, v> is the integral of u v, f the original mixture, s g the reduced one with g = sum_a
# q[a] M[a], and r = f - s g the error. An action that turns r into r + v costs
# 2 <r, v> + <v, v>:
#   to merge a and b into c   v = s delta,  delta = q[a] M[a] + q[b] M[b] - q[c] M[c]
#   to delete a               v = (s - s') g + s' q[a] M[a],  s' the scale afterwards
# <delta, delta> stays what it is while a and b live, and |<r, delta>| <= |r| |delta|, so most
# pairs lose without a look at <r, delta>. For the others, with L = f - g, the sum of all that
# the actions took out of g,
#   <r, delta> = (1 - s) <f, delta> + s <L, delta>
# where <f, delta> never changes and <L, delta> changes by at most three products per action.

ROUNDING = 1e-14  # relative error granted to a sum of products; bounds stay on its safe side


def integral_squared_error(
    mixture: Mixture, components: int, renormalise: bool = True
) -> tuple[Mixture, np.ndarray]:
    """At most `components` components, and where each input went (n,): its output index, or -1
    if deleted (Williams and Maybeck 2006; Maybeck, eqs. 7-9).

    Each step makes the pair merge or the deletion whose result has the least integral squared
    error from the original mixture. A deletion rescales what is left to the original total
    weight if `renormalise`. At equal cost deletions come first, then lower indices. Costs are
    good to about 1e-15 of the products <f, q[a] M[a]> they are made of; between actions closer
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
            "the integral of the squared mixture must be finite; build it with mixture(w, m, P)"
        )
    w, M, origin = _reduce(mixture.w, f, E, components, renormalise)
    return Mixture(w, *unpack(M, d)), origin


class _Work(NamedTuple):
    """g and what is known of it, in the first n of N slots, always in input order."""

    p: np.ndarray  # (N,) weights of f
    f: np.ndarray  # (T, N) its components, packed
    x: np.ndarray  # (3 N,) weights of L
    L: np.ndarray  # (T, 3 N) its components, packed
    q: np.ndarray  # (N,) weights of g
    M: np.ndarray  # (T, N) its components, packed
    h: np.ndarray  # (N,) <f, q[a] M[a]>
    E: np.ndarray  # (N, N) <M[a], M[b]>
    D: np.ndarray  # (N, N) <delta, delta> of the pair a < b
    reach: np.ndarray  # (N, N) |delta|, rounded up
    fc: np.ndarray  # (N, N) <f, q[c] M[c]>, nan while unknown
    Lc: np.ndarray  # (N, N) <L, q[c] M[c]>, nan while unknown
    origin: np.ndarray  # (N,) slot of each input component
    merged: np.ndarray  # (T, N) scratch: merges of one slot with others
    out: np.ndarray  # (3, N) scratch
    bordered: np.ndarray  # (T + 1, 3 N) scratch


@njit(cache=True, error_model="numpy")
def _reduce(p, f, E, components, renormalise):
    n = len(p)
    work = _start(p, f, E)
    s = 1.0
    W = p.sum()  # weight of g
    J = 0.0  # <r, r>
    terms = 0  # of L
    Jff = work.h.sum()
    while n > components:
        g = _with_all(work, n)
        error = np.sqrt(max(J, 0.0) + ROUNDING * Jff)
        delete_cost, k, after = _cheapest_deletion(work, g, n, s, W, renormalise)
        merge_cost, a, b = _cheapest_merge(work, g, n, s, error, np.sqrt(Jff), terms, delete_cost)
        if merge_cost < delete_cost:
            _merge(work, a, b, n, terms)
            J += merge_cost
            more = 3
        else:
            W -= work.q[k]
            s = after
            _delete(work, k, n, terms)
            J += delete_cost
            more = 1
        n -= 1
        _carry(work, n, terms, terms + more)
        terms += more
    return work.q[:n] * s, work.M[:, :n], work.origin


@njit(cache=True, error_model="numpy")
def _start(p, f, E):
    T, n = f.shape
    D, reach, fc, Lc = np.empty((4, n, n))
    work = _Work(
        p, f, np.empty(3 * n), np.empty((T, 3 * n)), p.copy(), f.copy(), np.empty(n), E.copy(),
        D, reach, fc, Lc, np.arange(n),
        np.empty((T, n)), np.empty((3, n)), np.empty((T + 1, 3 * n)),
    )  # fmt: skip
    work.h[:] = _with_all(work, n)
    for a in range(n):
        _score_pairs(work, a, a)
    return work
