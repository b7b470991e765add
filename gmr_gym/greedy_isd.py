"""Greedy merging by the integral squared difference, and what it shares with clustering.

Merging i and j, of weights wi and wj, into their moment match c of weight wc = wi + wj makes

    D = integral of (wi Ni + wj Nj - wc Nc)^2
      = wi^2 <Ni, Ni> + wj^2 <Nj, Nj> + 2 wi wj <Ni, Nj> + wc^2 <Nc, Nc> - 2 wc <wi Ni + wj Nj, Nc>

of difference to the whole mixture (Zhang, eq. 3), whatever the other components are: a merge changes
one row of a table of D. Groups are kept by the lowest index of their members.
"""

from collections.abc import Callable

import numpy as np
from numba import njit

from gmr_gym.distances import dimension, pack, products_of_columns, products_with
from gmr_gym.merging import _first_least, _merge_pair, _pair_covariances
from gmr_gym.mixture import Mixture, matched, moments
from gmr_gym.reduction import Reduced, at_least_one, prune


def greedy_isd(p: Mixture, components: int) -> Reduced:
    """Merges the pair that makes the least integral squared difference to the mixture as it then
    stands, until `components` remain (Zhang, section 3; compared with the original mixture, and
    with deletions, it is Williams' error in `ise`). At equal cost the lowest indices come first."""

    def groups(q, components):
        # about the mean, merged means keep the digits that their differences are made of
        return _merge_nearest(q.w, pack(q.m - moments(q)[0], q.P), components)

    return merged_by(groups, p, components)


def merged_by(groups: Callable[[Mixture, int], np.ndarray], p: Mixture, components: int) -> Reduced:
    """Moment match of groups of the components that weigh anything; groups(q, components) (n,) are
    the groups 0..components-1 of those, called with q when it has more components than that."""
    components = at_least_one(components)
    q, place = prune(p, 0.0)
    if len(q.w) <= components:
        return q, place
    # squares of tiny weights would underflow; weights above 1 stay, lest tiny ones beside them vanish
    group = groups(q._replace(w=q.w / min(q.w.max(), 1.0)), components)
    return matched(q, group, components), np.where(place < 0, -1, group[place])


@njit(cache=True, error_model="numpy")
def isd_table(w, M):
    """D (n, n) of merging any two of the Gaussians packed in M (T, n)."""
    n = len(w)
    table, own = np.zeros((n, n)), own_products(M)
    for i in range(1, n):
        row = _differences(i, np.arange(i), w, M, own)
        for j in range(i):
            table[i, j] = table[j, i] = row[j]
    return table


@njit(cache=True, error_model="numpy")
def own_products(M):
    """Integrals (n,) of the squares of the Gaussians packed in M (T, n)."""
    own = products_of_columns(M, M, M.shape[1])
    for x in own:
        if not 0.0 < x < np.inf:
            raise ValueError(
                "a covariance of the mixture is not positive definite, or the square of its density "
                "lies outside the range of floats: choose units nearer to the spread of the states"
            )
    return own


@njit(cache=True, error_model="numpy")
def nearest_others(table):
    """The first nearest other (n,) of each row of a table of costs, and its cost (n,); the diagonal
    becomes infinite."""
    n = len(table)
    nearest, least = np.empty(n, np.int64), np.empty(n)
    for i in range(n):
        table[i, i] = np.inf
        nearest[i] = _first_least(table[i], n)
        least[i] = table[i, nearest[i]]
    return nearest, least


@njit(cache=True, error_model="numpy")
def cheapest_pair(nearest, least):
    """Rows i < j of least cost, the first among equals."""
    i = _first_least(least, len(least))
    if least[i] == np.inf:
        raise ValueError("components lie too far apart to tell what merging them costs")
    return i, nearest[i]


@njit(cache=True, error_model="numpy")
def take_in(i, j, group, table, nearest, least):
    """Closes row j, whose members go to i; row i of the table holds its new costs already."""
    n = len(table)
    for k in range(n):
        group[k] = i if group[k] == j else group[k]
        table[j, k] = table[k, j] = np.inf
    nearest[j], least[j] = -1, np.inf
    for k in range(n):
        if k == i or nearest[k] == i or nearest[k] == j:
            nearest[k] = _first_least(table[k], n)
            least[k] = table[k, nearest[k]]
        elif table[k, i] < least[k] or (table[k, i] == least[k] and i < nearest[k]):
            nearest[k], least[k] = i, table[k, i]


@njit(cache=True, error_model="numpy")
def numbered(group):
    """Groups (n,) named by their first member, numbered in the order of these."""
    number, count = np.full(len(group), -1), 0
    for i in range(len(group)):
        number[i] = count if group[i] == i else number[group[i]]
        count += group[i] == i
    return number


@njit(cache=True, error_model="numpy")
def _merge_nearest(w, M, components):
    """Groups (n,) of greedy merging of the Gaussians packed in M (T, n); w and M are overwritten."""
    T, n = M.shape
    means, entries = M[T - dimension(T) :], M[: T - dimension(T)]
    room = np.empty((len(entries), 1)), np.empty(1), np.empty(1), np.empty(1)
    own, table = own_products(M), isd_table(w, M)
    nearest, least = nearest_others(table)
    group, alive = np.arange(n), np.arange(n)
    while len(alive) > components:
        i, j = cheapest_pair(nearest, least)
        _merge_pair(i, j, w, means, entries, room)
        merged = M[:, i : i + 1].copy()
        own[i] = products_of_columns(merged, merged, 1)[0]
        alive = alive[alive != j]
        others = alive[alive != i]
        row = _differences(i, others, w, M, own)
        for k in range(len(others)):
            table[i, others[k]] = table[others[k], i] = row[k]
        take_in(i, j, group, table, nearest, least)
    return numbered(group)


@njit(cache=True, error_model="numpy")
def _differences(i, others, w, M, own):
    """D (k,) of merging i with each of `others` (k,), all packed in M (T, n), with <N, N> in own."""
    T, k = len(M), len(others)
    first = T - dimension(T)  # the row where the means begin
    # the others and last i itself, about the mean of i: no digit is lost far from the origin
    near, weight = np.empty((T, k + 1)), np.empty(k + 1)
    for t in range(T):
        origin = M[t, i] if t >= first else 0.0
        near[t, k] = M[t, i] - origin
        for j in range(k):
            near[t, j] = M[t, others[j]] - origin
    weight[k] = w[i]
    for j in range(k):
        weight[j] = w[others[j]]
    pair, share = np.empty((T, k)), np.empty(k)
    _pair_covariances(k, 0, k, weight, near[first:], near[:first], share, pair)
    for t in range(first, T):
        for j in range(k):
            pair[t, j] = (1 - share[j]) * near[t, j]
    x = near[:, k].copy()
    ij, ic = products_with(x, near, k), products_with(x, pair, k)
    jc, cc = products_of_columns(near, pair, k), products_of_columns(pair, pair, k)
    out = np.empty(k)
    for j in range(k):
        wi, wj = weight[k], weight[j]
        wc = wi + wj
        two = wi * wi * _known(own[i]) + wj * wj * _known(own[others[j]]) + 2 * wi * wj * _known(ij[j])
        one = wc * wc * _known(cc[j])
        # rounding leaves two equal components near -1e-16
        out[j] = max(two + one - 2 * wc * (wi * _known(ic[j]) + wj * _known(jc[j])), 0.0)
    return out


@njit(cache=True, error_model="numpy")
def _known(product):
    """The product, or 0 where a covariance of the pair has drowned in rounding: merged over more
    than 1e8 standard deviations, it lies too low to overlap with anything."""
    return product if product < np.inf else 0.0
