"""Greedy merging by one measure throughout: pairs are chosen by it, and merged into its barycentre."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_choice, check_count
from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, half_log_determinant
from gmr_gym.mixture import Mixture, mean_and_covariance
from gmr_gym.reduction.agglomeration import absorb, nearest_others, relabelled
from gmr_gym.reduction.barycentres import BARYCENTRES, moment_match, transported
from gmr_gym.reduction.chi_square import chi_square_costs
from gmr_gym.reduction.greedy_merging import first_least
from gmr_gym.reduction.measures import COSTS, KL, MEASURES, WASSERSTEIN
from gmr_gym.reduction.merge_cost import components_last
from gmr_gym.reduction.overlap_descent import EXACT, STEPS
from gmr_gym.reduction.pair_costs import (
    PAIR_COSTS,
    kl_costs,
    no_more,
    pair_of,
    unweighted_bounds,
    unweighted_pair,
)
from gmr_gym.reduction.protocol import TOO_FAR, Reduced, definite, through, warn_unfinished
from gmr_gym.reduction.pruning import weighing

EPSILON = float(np.finfo(float).eps)


def consistent(p: Mixture, components: int, measure: str) -> Reduced:
    """Greedy merging by one measure D: of the pair with the least w_i D(i, q) + w_j D(j, q), into that q.

    Merging goes on until `components` remain; q is the barycentre of the pair by D. At equal cost the lowest
    indices come first. With "kl" it is `runnalls`. Where a pair is chosen by one measure and merged by
    another, as by moments, the result may be far from the best by either.

    Parameters
    ----------
    p : Mixture
    components : int
        Upper limit of the number of components that remain.
    measure : {"kl", "reverse-kl", "symmetrised-kl", "wasserstein", "cauchy-schwarz", "isd"}
        D, see `gmr_gym.reduction.measures`; "wasserstein" is in the unit of the states, so that their units
        decide.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,). The total weight is kept; by "kl" and "wasserstein" the mean
        too, and by "kl" the covariance.

    Raises
    ------
    ValueError
        For an unknown measure, `components` below 1, components too far apart to be merged, or a mixture that
        fails `checked`.

    Warns
    -----
    UserWarning
        Where the iteration for a barycentre stops at its limit.

    Warnings
    --------
    By "reverse-kl" and "wasserstein" a pair far apart becomes a narrow Gaussian between the two, where the
    mixture has no weight: not for trackers, whose target may be at either.

    References
    ----------
    D'Ortenzio, Manes and Orguner 2021, arXiv:2104.12586.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> p = mixture([0.25, 0.25, 0.5], [[0.0], [2.0], [9.0]], [[[1.0]]] * 3)
    >>> q, origin = consistent(p, 2, "reverse-kl")
    >>> q.m.tolist(), q.P.ravel().tolist(), origin.tolist()
    ([[1.0], [9.0]], [1.0, 1.0], [0, 0, 1])
    """
    check_choice("measure", measure, MEASURES)
    return merged_within(p, check_count(components), measure)


def greedy_wasserstein(p: Mixture, components: int) -> Reduced:
    """Greedy merging of the pair with the least Wasserstein distance, whatever the weights, into its
    barycentre.

    `consistent` by "wasserstein" differs: it weighs the distance, so that light components are merged first.

    Parameters
    ----------
    p : Mixture
    components : int
        Upper limit of the number of components that remain.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,). The total weight and the mean are kept; the covariance is
        never widened by the spread of the means.

    Raises
    ------
    ValueError
        For `components` below 1, or a mixture that fails `checked`.

    Warnings
    --------
    As of `consistent` by "wasserstein".

    References
    ----------
    Assa and Plataniotis 2018.
    """
    return _merged(p, check_count(components), _BY_DISTANCE)


def greedy_chi_square(p: Mixture, components: int) -> Reduced:
    """Greedy merging of the pair with the least chi-square divergence from its moment match.

    The divergence is infinite for a light wide component beside a heavy narrow one. Where all pairs left are
    such, the one with the least cost B of `runnalls` is merged.

    Parameters
    ----------
    p : Mixture
    components : int
        Upper limit of the number of components that remain.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,). The total weight, mean and covariance are kept.

    Raises
    ------
    ValueError
        For `components` below 1, components too far apart to be merged, or a mixture that fails `checked`.

    References
    ----------
    Kitagawa 2019.
    """
    return _merged(p, check_count(components), _BY_CHI_SQUARE)


def merged_within(
    p: Mixture, components: int, measure: str, loss_bound: float = -1.0, ratio: float = np.inf
) -> Reduced:
    """Greedy merging by a measure to `components`; beyond, for a bound that is not negative, while the
    relative loss stays within it and the next cost within `ratio` times 2 / m of the cost of merging all m
    that are left."""
    return _merged(p, components, _BY[MEASURES.index(measure)], loss_bound, ratio)


class _By(NamedTuple):
    """Kernels of a measure, compiled for it alone."""

    merge: Callable
    barycentre: Callable
    cost: Callable  # D of a component and the barycentre
    name: str  # of D


def _merged(p: Mixture, components: int, by: _By, loss_bound: float = -1.0, ratio: float = np.inf) -> Reduced:
    q, place = weighing(p)
    if len(q.w) <= (components if loss_bound < 0 else 1):
        return q, place
    mean, _ = mean_and_covariance(q)  # about it, differences of merged means keep their digits
    about = q._replace(m=q.m - mean)
    whole = 0.0 if loss_bound < 0 else _whole_cost(by, about)
    loss_bound = np.inf if loss_bound == 1 else float(loss_bound)  # rounding must not prevent the last merge
    group, m, P, longest = by.merge(*about, components, loss_bound, ratio, whole)
    if longest >= STEPS:
        warn_unfinished(f"the barycentre by {by.name}", STEPS)
    return definite(Mixture(np.bincount(group, q.w), mean + m, P)), through(place, group)


def _whole_cost(by: _By, p: Mixture) -> float:
    """The sum of w D(component, barycentre of all)."""
    mean, S, _ = by.barycentre(*p, EXACT)
    return sum((w * by.cost(m, P, mean, S) for w, m, P in zip(*p, strict=True)), 0.0)


def _merging(costs: Callable, pair_cost: Callable, barycentre: Callable) -> Callable:
    """The kernel of greedy merging by costs, or bounds of them and the costs of pairs, into barycentres."""

    @kernel
    def merge(w, m, P, components, loss_bound, ratio, whole):
        """Groups (n,), the means and covariances of their barycentres, and the most steps of an iteration.
        `whole` is the cost of merging all, for which a bound is needed."""
        n = len(w)
        w, m, P, group, alive, longest = w.copy(), m.copy(), P.copy(), np.arange(n), np.arange(n), 0
        columns, room = components_last(w, m, P)
        table, known, row = np.empty((n, n)), np.zeros((n, n), np.bool_), np.empty(columns.shape[1])
        for i in range(1, n):
            costs(i, i, columns, room, row)
            for j in range(i):
                table[i, j] = table[j, i] = row[j]
        nearest, least = nearest_others(table)
        left, spent = n, 0.0
        while left > (1 if loss_bound >= 0.0 else components):
            i = first_least(least, n)
            j = nearest[i]
            if least[i] == np.inf:
                i, j = _cheapest_by_kl(left, alive, columns, room, row)
            elif not known[i, j]:
                cost, steps = pair_cost(i, j, w, m, P)
                longest = max(longest, steps)
                known[i, j] = known[j, i] = True
                if cost > table[i, j]:
                    table[i, j] = table[j, i] = cost
                    for k in (i, j):
                        nearest[k] = first_least(table[k], n)
                        least[k] = table[k, nearest[k]]
                    continue
            slack = 4.0 * EPSILON * whole
            high = min(loss_bound * whole - spent, ratio * (whole - spent) * 2.0 / left)
            if left <= components and table[i, j] > high + slack:
                break
            spent += table[i, j]
            m[i], P[i], steps = barycentre(*pair_of(i, j, w, m, P), EXACT)
            w[i] += w[j]
            longest = max(longest, steps)
            left -= 1
            at = _renew(i, j, left, w, m, P, alive, columns)
            costs(at, left, columns, room, row)
            for k in range(left):
                other = alive[k]
                known[i, other] = known[other, i] = False
                table[i, other] = table[other, i] = row[k] if k != at else np.inf
            absorb(i, j, group, table, nearest, least)
        alive = alive[:left]
        return relabelled(group), m[alive], P[alive], longest

    return merge


_BY = [
    _By(_merging(*costs, barycentre), barycentre, cost, name)
    for costs, barycentre, cost, name in zip(PAIR_COSTS, BARYCENTRES, COSTS, MEASURES, strict=True)
]
_BY_DISTANCE = _BY[WASSERSTEIN]._replace(merge=_merging(unweighted_bounds, unweighted_pair, transported))
_BY_CHI_SQUARE = _BY[KL]._replace(merge=_merging(chi_square_costs, no_more, moment_match))


@kernel
def _cheapest_by_kl(left, alive, columns, room, row):
    """The pair i < j that costs least by the Kullback-Leibler divergence."""
    best, first, second = np.inf, -1, -1
    for i in range(1, left):
        kl_costs(i, i, columns, room, row)
        j = first_least(row, i)
        if row[j] < best:
            best, first, second = row[j], j, i
    if first < 0:
        raise ValueError(TOO_FAR)
    return alive[first], alive[second]


@kernel
def _renew(i, j, left, w, m, P, alive, columns):
    """Drops the column of j and writes that of i anew; returns its place."""
    d, at, gap = m.shape[1], 0, 0
    L = np.zeros((d, d))
    if not cholesky_into(L, P[i]):
        raise ValueError(TOO_FAR)
    while alive[at] != i:
        at += 1
    while alive[gap] != j:
        gap += 1
    for k in range(gap, left):
        alive[k] = alive[k + 1]
    for column in columns:
        for k in range(gap, left):
            column[k] = column[k + 1]
    columns[0, at], columns[1, at], q = w[i], 2.0 * half_log_determinant(L), 2 + d
    for r in range(d):
        columns[2 + r, at] = m[i, r]
        for c in range(r + 1):
            columns[q, at] = P[i, r, c]
            q += 1
    return at
