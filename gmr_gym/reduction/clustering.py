"""Reduction by clustering: compare all components once, partition them into groups, merge each group.

Zhang, section 3, after Schieferdecker and Huber 2009. Every group is replaced by its moment match, so the
total weight, mean and covariance are kept. Components of weight zero are dropped first.
"""

import numpy as np

from gmr_gym.checks import check_choice
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture
from gmr_gym.reduction.agglomeration import absorb, cheapest_pair, merged_by, nearest_others, relabelled
from gmr_gym.reduction.dissimilarity import MEASURES, dissimilarities
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.reduction.salmond_west import whitened

LINKAGES = ("average", "complete", "single")
ROUNDS = 100  # of k-means and of k-medoids; both converge within about ten
ROUNDING = 1e-12  # relative: a swap of medoids must gain more, or rounding could make it swap forever


def hierarchical(p: Mixture, components: int, linkage: str = "average", measure: str = "isd") -> Reduced:
    """Agglomerative clustering: merges the two nearest clusters until `components` remain.

    Every component is a cluster at first. Members count the same, whatever their weights. The first pair
    comes first among equals.

    Parameters
    ----------
    p : Mixture
    components : int
        Upper limit of the number of components that remain.
    linkage : {"average", "complete", "single"}
        Distance of two clusters: the mean, the largest or the least of the distances of their members.
    measure : {"isd", "correlation", "runnalls"}
        Distance of two components, see `dissimilarity`.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,).

    Raises
    ------
    ValueError
        For an unknown linkage or measure, or a mixture that fails `checked`.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> p = mixture([1.0, 1.0, 2.0], [[0.0], [2.0], [9.0]], [[[1.0]]] * 3)
    >>> q, origin = hierarchical(p, 2)
    >>> q.m.tolist(), origin.tolist()
    ([[1.0], [9.0]], [0, 0, 1])
    """
    check_choice("linkage", linkage, LINKAGES)
    check_choice("measure", measure, MEASURES)

    def groups(q, components):
        return _agglomerate(dissimilarities(q, measure), components, LINKAGES.index(linkage))

    return merged_by(groups, p, components)


def k_means(p: Mixture, components: int) -> Reduced:
    """Lloyd's weighted k-means on the means, in coordinates where the whole mixture has unit covariance.

    Runs until nothing moves, at most 100 rounds. The first start is the heaviest component; each next one has
    the largest weight times squared distance from the starts so far. A component moves only to a centre that
    is strictly nearer, and never out of a cluster of one.

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
    """
    return merged_by(lambda q, components: _lloyd(q.w, whitened(q), components), p, components)


def k_medoids(p: Mixture, components: int, measure: str = "isd") -> Reduced:
    """Partitioning around medoids.

    Medoids are added one by one, each where it lowers the sum of dissimilarities to the nearest medoid most.
    Then the best swap of a medoid for another component is made while that lowers the sum, at most 100 times.

    For "correlation" the terms of the sum are multiplied by the weights, which that measure does not contain:
    a light component should not attract a medoid as a heavy one does. The other two measures grow with the
    weights of the pair, and another factor would count the weights twice.

    Parameters
    ----------
    p : Mixture
    components : int
        Upper limit of the number of components that remain.
    measure : {"isd", "correlation", "runnalls"}
        See `dissimilarity`.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,).

    Raises
    ------
    ValueError
        For an unknown measure, or a mixture that fails `checked`.

    References
    ----------
    Kaufman and Rousseeuw 1990.
    """
    check_choice("measure", measure, MEASURES)

    def groups(q, components):
        weight = q.w if measure == "correlation" else np.ones(len(q.w))
        return _around_medoids(dissimilarities(q, measure), weight, components)

    return merged_by(groups, p, components)


@kernel
def _agglomerate(table, components, linkage):
    """Groups (n,) of the clusters that remain; the table is overwritten."""
    n = len(table)
    nearest, least = nearest_others(table)
    group, size = np.arange(n), np.ones(n)
    for _ in range(n - components):
        i, j = cheapest_pair(nearest, least)
        for k in range(n):
            a, b = table[i, k], table[j, k]
            if linkage == 0:
                cost = (size[i] * a + size[j] * b) / (size[i] + size[j])
            else:
                cost = max(a, b) if linkage == 1 else min(a, b)
            table[i, k] = table[k, i] = cost
        table[i, i] = np.inf
        size[i] += size[j]
        absorb(i, j, group, table, nearest, least)
    return relabelled(group)


@kernel
def _lloyd(w, y, k):
    """Clusters (n,) of the points y (n, d)."""
    group = _farthest_first(w, y, k)
    for _ in range(ROUNDS):
        if not _reassign(y, _centres(w, y, group, k), group):
            break
    return group


@kernel
def _farthest_first(w, y, k):
    """Index (n,) of the nearest of k starts; every start is at a different point."""
    n = len(w)
    group, d2 = np.zeros(n, np.int64), np.full(n, np.inf)
    start = int(np.argmax(w))
    for g in range(k):
        for i in range(n):
            near = _squared(y[i], y[start])
            if near < d2[i]:
                group[i], d2[i] = g, near
        group[start], d2[start] = g, -1.0  # taken
        largest = -1.0
        for i in range(n):
            if d2[i] >= 0.0 and w[i] * d2[i] > largest:
                start, largest = i, w[i] * d2[i]
    return group


@kernel
def _centres(w, y, group, k):
    total, centre = np.zeros(k), np.zeros((k, y.shape[1]))
    for i in range(len(w)):
        total[group[i]] += w[i]
    for i in range(len(w)):
        share = w[i] / total[group[i]]
        for r in range(y.shape[1]):
            centre[group[i], r] += share * y[i, r]
    return centre


@kernel
def _reassign(y, centre, group):
    """Moves points to the nearest centre, the first among equals; returns whether any has moved."""
    members, moved = np.zeros(len(centre), np.int64), False
    for g in group:
        members[g] += 1
    for i in range(len(y)):
        old = group[i]
        if members[old] > 1:
            least = _squared(y[i], centre[old])
            for g in range(len(centre)):
                d2 = _squared(y[i], centre[g])
                if d2 < least:
                    group[i], least, moved = g, d2, True
            members[old] -= 1
            members[group[i]] += 1
    return moved


@kernel
def _squared(x, y):
    d2 = 0.0
    for r in range(len(x)):
        d2 += (x[r] - y[r]) ** 2
    return d2


@kernel
def _around_medoids(table, weight, k):
    """Clusters (n,) about k medoids."""
    if table.max() == np.inf:
        raise ValueError("components lie too far apart to compute the cost of merging them")
    medoid = _first_medoids(table, weight, k)
    group, nearest, second = _nearest_medoids(table, medoid)
    for _ in range(ROUNDS):
        g, x, change, cost = _best_swap(table, weight, medoid, group, nearest, second)
        if not change < -ROUNDING * cost:
            break
        medoid[g] = x
        group, nearest, second = _nearest_medoids(table, medoid)
    return group


@kernel
def _first_medoids(table, weight, k):
    n = len(table)
    medoid, nearest, taken = np.zeros(k, np.int64), np.full(n, np.inf), np.zeros(n, np.bool_)
    for g in range(k):
        least = np.inf
        for x in range(n):
            cost = 0.0
            for j in range(n):
                cost += weight[j] * min(table[x, j], nearest[j])
            if not taken[x] and cost < least:
                medoid[g], least = x, cost
        taken[medoid[g]] = True
        for j in range(n):
            nearest[j] = min(table[medoid[g], j], nearest[j])
    return medoid


@kernel
def _nearest_medoids(table, medoid):
    """Nearest medoid (n,), the first among equals, and the distances to it (n,) and to the second nearest
    (n,). A medoid is nearest to itself."""
    n = len(table)
    group, nearest, second = np.zeros(n, np.int64), np.full(n, np.inf), np.full(n, np.inf)
    for g in range(len(medoid)):
        row = table[medoid[g]]
        for j in range(n):
            if row[j] < nearest[j] or j == medoid[g]:
                group[j], nearest[j], second[j] = g, row[j], nearest[j]
            elif row[j] < second[j]:
                second[j] = row[j]
    return group, nearest, second


@kernel
def _best_swap(table, weight, medoid, group, nearest, second):
    """The medoid g to replace, the point x that replaces it, the change of cost, and the cost before."""
    n, k = len(table), len(medoid)
    best, slot, point, cost = np.inf, 0, 0, 0.0
    for j in range(n):
        cost += weight[j] * nearest[j]
    for x in range(n):
        if medoid[group[x]] == x:
            continue
        # gain: x as an additional medoid; loss: of the members of each cluster, without their own medoid
        gain, loss = 0.0, np.zeros(k)
        for j in range(n):
            beside = min(table[x, j], nearest[j])
            gain += weight[j] * (nearest[j] - beside)
            loss[group[j]] += weight[j] * (min(table[x, j], second[j]) - beside)
        g = int(np.argmin(loss))
        if loss[g] - gain < best:
            best, slot, point = loss[g] - gain, g, x
    return slot, point, best, cost
