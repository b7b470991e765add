"""Williams' greedy reduction: each step is the one with the least integral squared error."""

import numpy as np

from gmr_gym.checks import check_count, check_flag
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture
from gmr_gym.reduction.distances import known, pack, products, unpack
from gmr_gym.reduction.greedy_merging import first_least
from gmr_gym.reduction.ise_pairs import (
    ROUNDING,
    Work,
    add_products,
    count_merges,
    pair,
    products_with_all,
    score_pairs,
    stands_out,
    update_known,
    weighted,
)
from gmr_gym.reduction.protocol import at_unit, through
from gmr_gym.reduction.pruning import weighing

# <u, v> is the integral of u v, f the original mixture, s g the reduced one with
# g = sum_a q[a] M[a], and r = f - s g the error. An action that turns r into r + v costs
# 2 <r, v> + <v, v>:
#   to delete a               v = s A, or v = s (A - q[a] / R (g - A)) with the rest, of weight R, rescaled
#   to merge a and b into c   v = s delta,  delta = A + B - C,  A = q[a] M[a], B = q[b] M[b], C = q[c] M[c]
# <delta, delta> is constant while a and b remain. <r, A> is known at any time for every a, and for any
# x and y
#   <r, delta> = (1 - x) <r, A> + (1 - y) <r, B> - <r, C - x A - y B>
# where the last is at most |r| |C - x A - y B| in size, least where x A + y B is the projection of C. So
# many merges are ruled out without computing <r, C>. For the others
#   <r, delta> = (1 - s) <f, delta> + s <e, delta>,  e = f - g
# in which e has few terms at first, the inputs removed and the merges made of them, and <e, C> changes by
# at most three products per action. <f, C> is constant; as s is near 1, a bound as above, with |f| for |r|,
# often suffices in its place.


def integral_squared_error(
    p: Mixture, components: int, renormalise: bool = True
) -> tuple[Mixture, np.ndarray]:
    r"""Greedy reduction by the integral squared error: each step merges a pair or deletes a component.

    The step is the one whose result has the least integral squared error from the original mixture. At equal
    cost deletions come first, then lower indices. Costs are accurate to about 1e-15 of the products <f, q[a]
    M[a]> that they are sums of; between steps closer than that the choice is repeatable but arbitrary. A pair
    more than about 1e8 standard deviations apart, whose merged covariance is lost in rounding, is not merged.

    Parameters
    ----------
    p : Mixture
    components : int
        Upper limit of the number of components that remain.
    renormalise : bool
        Whether a deletion rescales the rest to the original total weight.

    Returns
    -------
    mixture : Mixture
        The reduced mixture.
    origin : ndarray (n,)
        Output index of each input component, -1 if deleted.

    Raises
    ------
    ValueError
        For `components` below 1, a mixture that fails `checked`, or a square whose integral is outside the
        range of floats.

    Notes
    -----
    With f the original mixture and g the reduced one:

    .. math::

        J = \int (f(x) - g(x))^2 \, dx = J_{ff} - 2 J_{fg} + J_{gg}

    References
    ----------
    Williams and Maybeck 2006; Maybeck, eqs. 7-9.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> p = mixture([0.25, 0.25, 0.5], [[0.0], [1.0], [9.0]], [[[1.0]]] * 3)
    >>> q, origin = integral_squared_error(p, 2)
    >>> q.m.tolist(), origin.tolist()
    ([[0.5], [9.0]], [0, 0, 1])
    """
    components, renormalise = check_count(components), check_flag("renormalise", renormalise)
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
    work = _initial_work(w, f, E)
    s = _reduce(work, components, renormalise)
    alive = np.flatnonzero(work.place >= 0)
    left = s * work.q[alive] * (p.w.max() / w.max())
    reduced = Mixture(left, *unpack(work.M[:, work.place[alive]], p.m.shape[1]))
    return reduced, through(place, _output_index(work))


def _initial_work(w, f, E):
    """The state before the first step: g is f."""
    T, n = f.shape
    room = n // 2  # columns for merges, each of two inputs or more
    M, weight = np.hstack([f, np.empty((T, room))]), np.append(w, np.zeros(room))
    place = np.arange(n)
    ec, fc = np.full((2, n, n), np.nan)
    D, x, y, reach, bound = np.full((5, n, n), np.inf)
    h, g, u, q, origin = np.empty(n), np.empty(n), weight.copy(), w.copy(), place.copy()
    return Work(M, weight, u, place, q, h, g, E, D, x, y, reach, ec, fc, bound, origin)


def _output_index(work):
    """Output index of each input (n,), the components of g numbered in order."""
    number = np.append(np.cumsum(work.place >= 0) - 1, -1)  # the last for those deleted, at index -1
    return number[work.origin]


@kernel
def _reduce(work, components, renormalise):
    """Merge or delete in `work` until `components` are left; returns the scale s."""
    n = len(work.q)
    _overlap(work)
    work.h[:] = work.g  # equal to the last bit: there is no error yet
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
    """Set <g, q[a] M[a]> from scratch, so that rounding does not accumulate."""
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
            if q > R:  # the differences would be lost in rounding
                R, r_rest, A_rest, rest_rest = _rest(work, s, a, alive)
            lost, after = q / R, s * (W / R)
            rv, vv = rA - lost * r_rest, AA - 2.0 * lost * A_rest + lost * lost * rest_rest
            cost = 2.0 * s * rv + s * s * vv
        if cost < least:  # false where nothing would be left to rescale
            least, slot, scale = cost, a, after
    return least, slot, scale


@kernel
def _rest(work, s, a, alive):
    """Weight of all but a, and the products of these with r, with A and with themselves, term by term."""
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

    First the cost of the one pair with the least bound is computed, then the costs of all pairs whose bound
    is not above it, as a batch.
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
            work.D[a, cost_at[a]] = np.inf  # excluded from merging
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
    """Sets the lower bounds of the costs of merging a with every b > a. Returns the least bound and its
    b, and the least known cost and its b."""
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
        e_delta = (f_two - ec[i]) - (g_a + g[i])  # accurate to the rounding of its terms, as every cost
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
def _unknown(table, bound, rows, limit):
    """Components a < b (k,) of the pairs in the masked rows that are unknown and whose bound is at most
    `limit`."""
    n = len(rows)
    a, b, count = np.empty(n * n // 2 + 1, np.int64), np.empty(n * n // 2 + 1, np.int64), 0
    for i in range(n):
        if rows[i]:
            for j in range(i + 1, n):
                a[count], b[count] = i, j
                count += bound[i, j] <= limit and np.isnan(table[i, j])
    return a[:count], b[:count]


@kernel
def _delete(work, k):
    change, weights = work.M[:, work.place[k] : work.place[k] + 1].copy(), np.full(1, -work.q[k])
    work.origin[work.origin == k] = -1
    _vacate(work, k)
    update_known(work, change, weights)


@kernel
def _merge(work, a, b):
    """Replaces a by the merge of a and b."""
    n = len(work.q)
    c, qc = pair(work, a, b)
    change, weights = np.empty((len(c), 3)), np.array([-work.q[a], -work.q[b], qc])
    change[:, 0], change[:, 1], change[:, 2] = work.M[:, work.place[a]], work.M[:, work.place[b]], c
    work.origin[work.origin == b] = a
    _vacate(work, a)
    _vacate(work, b)
    update_known(work, change, weights)
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
    """Removes component a from g; the last merge moves into a column that becomes free."""
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
