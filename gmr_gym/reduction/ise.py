"""Williams' greedy reduction: each step leaves the least integral squared error it can."""

import numpy as np

from gmr_gym.checks import check_count
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture
from gmr_gym.reduction.distances import known, pack, products, unpack
from gmr_gym.reduction.greedy_merging import first_least
from gmr_gym.reduction.ise_pairs import (
    ROUNDING,
    Work,
    add_products,
    carry,
    count_merges,
    pair,
    products_with_all,
    score_pairs,
    stands_out,
    weighted,
)
from gmr_gym.reduction.protocol import at_unit, through
from gmr_gym.reduction.pruning import weighing

# <u, v> is the integral of u v, f the original mixture, s g the reduced one with
# g = sum_a q[a] M[a], and r = f - s g the error. An action that turns r into r + v costs
# 2 <r, v> + <v, v>:
#   to delete a               v = s A, or v = s (A - q[a] / R (g - A)) with the rest, of weight R, rescaled
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


def integral_squared_error(
    p: Mixture, components: int, renormalise: bool = True
) -> tuple[Mixture, np.ndarray]:
    """At most `components` components, and where each input went (n,): its output index, or -1
    if deleted (Williams and Maybeck 2006; Maybeck, eqs. 7-9).

    Each step makes the pair merge or the deletion whose result has the least integral squared
    error from the original mixture. A deletion rescales what is left to the original total
    weight if `renormalise`. At equal cost deletions come first, then lower indices. Costs are
    good to about 1e-15 of the products <f, q[a] M[a]> they are made of; between actions closer
    than that the choice is repeatable but arbitrary. A pair so many standard deviations apart, some
    1e8, that the covariance of its merge is lost in rounding is not merged.
    """
    components = check_count(components)
    p, place = weighing(p)
    if len(p.w) <= components:
        return p, place
    f, w = pack(p.m, p.P), at_unit(p.w)
    E = products(f, f)
    if not (np.isfinite(E).all() and (E.diagonal() > 0).all()):
        raise ValueError(
            "the square of p has parts whose integral lies outside the range of floats: choose units nearer "
            "to the spread of the states"
        )
    work = _begun(w, f, E)
    s = _reduce(work, components, renormalise)
    alive = np.flatnonzero(work.place >= 0)
    left = s * work.q[alive] * (p.w.max() / w.max())
    return Mixture(left, *unpack(work.M[:, work.place[alive]], p.m.shape[1])), through(place, _numbered(work))


def _begun(w, f, E):
    """Where the reduction starts: g is f."""
    T, n = f.shape
    room = n // 2  # for merges, each of two inputs or more
    M, weight = np.hstack([f, np.empty((T, room))]), np.append(w, np.zeros(room))
    place = np.arange(n)
    ec, fc = np.full((2, n, n), np.nan)
    D, x, y, reach, bound = np.full((5, n, n), np.inf)
    h, g, u, q, origin = np.empty(n), np.empty(n), weight.copy(), w.copy(), place.copy()
    return Work(M, weight, u, place, q, h, g, E, D, x, y, reach, ec, fc, bound, origin)


def _numbered(work):
    """Where each input went (n,), with the components of g numbered in order."""
    number = np.append(np.cumsum(work.place >= 0) - 1, -1)  # the last for those deleted, at index -1
    return number[work.origin]


@kernel
def _reduce(work, components, renormalise):
    """Act on `work` until `components` are left; the scale s."""
    n = len(work.q)
    _overlap(work)
    work.h[:] = work.g  # to the last bit: no difference yet, no cost
    for a in range(n):
        score_pairs(work, a, np.arange(a))
    s = 1.0
    J = 0.0  # <r, r>
    size = np.sqrt(work.h.sum())  # |f|
    while n > components:
        _overlap(work)
        error = np.sqrt(max(J, 0.0) + ROUNDING * size**2)
        delete_cost, k, after = _cheapest_deletion(work, s, renormalise)
        merge_cost, a, b = _cheapest_merge(work, s, error, size, delete_cost)
        if merge_cost < delete_cost:
            J += merge_cost
            _merge(work, a, b)
        else:
            J += delete_cost
            s = after
            _delete(work, k)
        n -= 1
    return s


@kernel
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


@kernel
def _cheapest_deletion(work, s, renormalise):
    """Cost and component of the cheapest deletion, and the scale after it."""
    W, H, G = 0.0, 0.0, 0.0
    alive = np.flatnonzero(work.place >= 0)
    for a in alive:
        W += work.q[a]
        H += work.h[a]
        G += work.g[a]
    least, slot, scale = np.inf, alive[np.argmin(work.q[alive])], s
    for a in alive:
        q, AA, rA = work.q[a], work.q[a] ** 2 * work.E[a, a], work.h[a] - s * work.g[a]
        cost, after = 2.0 * s * rA + s * s * AA, s
        if renormalise:
            R, r_rest = W - q, (H - work.h[a]) - s * (G - work.g[a])
            A_rest, rest_rest = work.g[a] - AA, G - 2.0 * work.g[a] + AA
            if q > R:  # the sums would drown in what is taken from them
                R, r_rest, A_rest, rest_rest = _rest(work, s, a, alive)
            lost, after = q / R, s * (W / R)
            rv, vv = rA - lost * r_rest, AA - 2.0 * lost * A_rest + lost * lost * rest_rest
            cost = 2.0 * s * rv + s * s * vv
        if cost < least:  # not where nothing would be left to rescale
            least, slot, scale = cost, a, after
    return least, slot, scale


@kernel
def _rest(work, s, a, alive):
    """Weight of all but a, and its products with r, with A and with itself, term by term."""
    R, r_rest, A_rest, rest_rest = 0.0, 0.0, 0.0, 0.0
    for b in alive:
        if b != a:
            R += work.q[b]
            r_rest += work.h[b] - s * work.g[b]
            A_rest += work.q[a] * work.q[b] * work.E[a, b]
            for c in alive:
                if c != a:
                    rest_rest += work.q[b] * work.q[c] * work.E[b, c]
    return R, r_rest, A_rest, rest_rest


@kernel
def _cheapest_merge(work, s, error, size, limit):
    """Cost and components a < b of the cheapest merge, or `limit` where none costs less.

    Of what could be cheapest by its bound one pair is looked at, to learn how little a merge may cost,
    then all the others together.
    """
    n, total = len(work.q), len(work.q) + count_merges(work)
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
            if not cost[a] < limit or stands_out(pair(work, a, cost_at[a])[0]):
                return least, a, cost_at[a]
            work.D[a, cost_at[a]] = np.inf  # never to be merged
            out_of_date[:] = False
            out_of_date[a] = True
            continue
        least = bound[i] if alone else least
        out_of_date = bound <= least
        first, second = _unknown(work.ec, work.bound, out_of_date, least)
        add_products(work, work.ec, first, second, e, e_weights)
        if alone or len(first) == 0:
            first, second = _unknown(work.fc, work.bound, out_of_date, least)
            add_products(work, work.fc, first, second, f, f_weights)
        alone = False


@kernel
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


@kernel
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


@kernel
def _delete(work, k):
    change, weights = work.M[:, work.place[k] : work.place[k] + 1].copy(), np.full(1, -work.q[k])
    work.origin[work.origin == k] = -1
    _vacate(work, k)
    carry(work, change, weights)


@kernel
def _merge(work, a, b):
    """Put the merge of a and b into a."""
    n = len(work.q)
    c, qc = pair(work, a, b)
    change, weights = np.empty((len(c), 3)), np.array([-work.q[a], -work.q[b], qc])
    change[:, 0], change[:, 1], change[:, 2] = work.M[:, work.place[a]], work.M[:, work.place[b]], c
    work.origin[work.origin == b] = a
    _vacate(work, a)
    _vacate(work, b)
    carry(work, change, weights)
    column = n + count_merges(work)
    work.M[:, column], work.u[column] = c, qc
    work.place[a], work.q[a] = column, qc
    with_c = products_with_all(work, c)
    work.h[a] = qc * weighted(work.w, with_c)
    alive = np.flatnonzero(work.place >= 0)
    for e in alive:
        work.E[a, e] = work.E[e, a] = known(with_c[work.place[e]])
    score_pairs(work, a, alive[alive != a])


@kernel
def _vacate(work, a):
    """Take component a out of g; the last merge moves into the column of one that goes."""
    n, hole = len(work.q), work.place[a]
    if hole >= n:
        last = n + count_merges(work) - 1
        work.M[:, hole], work.u[hole] = work.M[:, last], work.u[last]
        work.place[work.place == last] = hole
        hole = last
    work.u[hole] = 0.0
    work.place[a], work.q[a] = -1, 0.0
    for table, gone in ((work.D, np.inf), (work.ec, np.nan), (work.fc, np.nan)):
        table[a] = gone
        table[:, a] = gone
