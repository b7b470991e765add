"""Agglomerative merging: a table of the cost of merging every pair, its nearest pairs, and groups named
by the lowest index of their members."""

from collections.abc import Callable

import numpy as np

from gmr_gym.checks import check_count
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture, moments
from gmr_gym.reduction.dissimilarity import isd_row, isd_table, own_products
from gmr_gym.reduction.distances import dimension, pack, products_of_columns
from gmr_gym.reduction.greedy_merging import first_least
from gmr_gym.reduction.merge_cost import merge_pair
from gmr_gym.reduction.protocol import Reduced, grouped, through
from gmr_gym.reduction.pruning import weighing

LARGE = 1e100  # a weight whose square is still a float


def merged_by(groups: Callable[[Mixture, int], np.ndarray], p: Mixture, components: int) -> Reduced:
    """Moment match of groups of the components of positive weight.

    Parameters
    ----------
    groups : callable
        groups(q, components) returns the group (n,), 0 to components - 1, of every component of q. Called
        only when q, the mixture without components of weight zero, has more than `components`.
    p : Mixture
    components : int
        Upper limit of the number of components that remain.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,).
    """
    components = check_count(components)
    q, place = weighing(p)
    if len(q.w) <= components:
        return q, place
    # squares of tiny weights would underflow and of huge ones overflow; all others stay as they are, or tiny
    # weights beside them would vanish
    top = q.w.max()
    group = groups(q._replace(w=q.w / max(min(top, 1.0), top / LARGE)), components)
    return grouped(q, group, components), through(place, group)


@kernel
def nearest_others(table):
    """The nearest other (n,) of each row of a table of costs, the first among equals, and its cost (n,).
    The diagonal becomes infinite."""
    n = len(table)
    nearest, least = np.empty(n, np.int64), np.empty(n)
    for i in range(n):
        table[i, i] = np.inf
        nearest[i] = first_least(table[i], n)
        least[i] = table[i, nearest[i]]
    return nearest, least


@kernel
def cheapest_pair(nearest, least):
    """Rows i < j of least cost, the first among equals."""
    i = first_least(least, len(least))
    if least[i] == np.inf:
        raise ValueError("components lie too far apart to compute the cost of merging them")
    return i, nearest[i]


@kernel
def absorb(i, j, group, table, nearest, least):
    """Removes row j, whose members go to i. Row i of the table must hold the new costs."""
    n = len(table)
    for k in range(n):
        group[k] = i if group[k] == j else group[k]
        table[j, k] = table[k, j] = np.inf
    nearest[j], least[j] = -1, np.inf
    for k in range(n):
        if k == i or nearest[k] == i or nearest[k] == j:
            nearest[k] = first_least(table[k], n)
            least[k] = table[k, nearest[k]]
        elif table[k, i] < least[k] or (table[k, i] == least[k] and i < nearest[k]):
            nearest[k], least[k] = i, table[k, i]


@kernel
def relabelled(group):
    """Groups (n,), each named by its first member, numbered in the order of these members."""
    number, count = np.full(len(group), -1), 0
    for i in range(len(group)):
        number[i] = count if group[i] == i else number[group[i]]
        count += group[i] == i
    return number


def greedy_isd(p: Mixture, components: int) -> Reduced:
    """Greedy merging by the integral squared difference.

    Each step merges the pair whose merge has the least integral squared difference from the mixture before
    that merge, until `components` remain. At equal cost the lowest indices come first. `ise` differs: it
    compares with the original mixture, and also deletes.

    Parameters
    ----------
    p : Mixture
    components : int
        Upper limit of the number of components that remain.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,).

    Raises
    ------
    ValueError
        For `components` below 1, or a mixture that fails `checked`.

    References
    ----------
    Zhang, section 3.
    """

    def groups(q, components):
        # about the mean: differences of merged means keep their digits
        return _merge_nearest(q.w.copy(), pack(q.m - moments(q)[0], q.P), components)

    return merged_by(groups, p, components)


@kernel
def _merge_nearest(w, M, components):
    """Groups (n,) of greedy merging of the Gaussians packed in M (T, n); w and M are overwritten."""
    T, n = M.shape
    means, entries = M[T - dimension(T) :], M[: T - dimension(T)]
    room = np.empty((1 + len(entries), 1))
    own, table = own_products(M), isd_table(w, M)
    nearest, least = nearest_others(table)
    group, alive = np.arange(n), np.arange(n)
    while len(alive) > components:
        i, j = cheapest_pair(nearest, least)
        merge_pair(i, j, w, means, entries, room)
        merged = M[:, i : i + 1].copy()
        own[i] = products_of_columns(merged, merged, 1)[0]
        alive = alive[alive != j]
        others = alive[alive != i]
        row = isd_row(i, others, w, M, own)
        for k in range(len(others)):
            table[i, others[k]] = table[others[k], i] = row[k]
        absorb(i, j, group, table, nearest, least)
    return relabelled(group)
