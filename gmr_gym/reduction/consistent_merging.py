"""Greedy merging by one measure throughout: pairs are chosen by it, and merged into its barycentre."""

import numpy as np

from gmr_gym.checks import check_choice, check_count
from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, half_log_determinant
from gmr_gym.mixture import Mixture, mean_and_covariance
from gmr_gym.reduction.agglomeration import absorb, nearest_others, relabelled
from gmr_gym.reduction.barycentres import barycentre_of
from gmr_gym.reduction.greedy_merging import first_least
from gmr_gym.reduction.measures import KL, MEASURES, REVERSE_KL, WASSERSTEIN
from gmr_gym.reduction.merge_cost import components_last
from gmr_gym.reduction.overlap_descent import STEPS
from gmr_gym.reduction.pair_costs import CHI_SQUARE, UNWEIGHTED, least_costs, pair_cost, pair_of
from gmr_gym.reduction.protocol import TOO_FAR, Reduced, definite, through, warn_unfinished
from gmr_gym.reduction.pruning import weighing


def consistent(p: Mixture, components: int, measure: str) -> Reduced:
    check_choice("measure", measure, MEASURES)
    return _merged(p, components, MEASURES.index(measure))


def greedy_chi_square(p: Mixture, components: int) -> Reduced:
    return _merged(p, components, CHI_SQUARE)


def greedy_wasserstein(p: Mixture, components: int) -> Reduced:
    return _merged(p, components, UNWEIGHTED)


def _merged(p: Mixture, components: int, code: int) -> Reduced:
    components = check_count(components)
    q, place = weighing(p)
    if len(q.w) <= components:
        return q, place
    mean, _ = mean_and_covariance(q)  # about it, differences of merged means keep their digits
    group, m, P, longest = merge_by_measure(code, *q._replace(m=q.m - mean), components)
    if longest >= STEPS:
        warn_unfinished(f"the barycentre by {MEASURES[code]}", STEPS)
    return definite(Mixture(np.bincount(group, q.w), mean + m, P)), through(place, group)


@kernel
def merge_by_measure(code, w, m, P, components):
    """Groups (n,) of greedy merging by the measure, the means and covariances of their barycentres, and the most
    steps of an iteration."""
    n, exact = len(w), code == KL or code == REVERSE_KL or code == CHI_SQUARE
    w, m, P, group, alive, longest = w.copy(), m.copy(), P.copy(), np.arange(n), np.arange(n), 0
    columns, room = components_last(w, m, P)
    table, known, row = np.empty((n, n)), np.full((n, n), exact), np.empty(columns.shape[1])
    for i in range(1, n):
        least_costs(code, i, i, columns, room, row)
        for j in range(i):
            table[i, j] = table[j, i] = row[j]
    nearest, least = nearest_others(table)
    left = n
    while left > components:
        i = first_least(least, n)
        j = nearest[i]
        if least[i] == np.inf:
            i, j = _cheapest_by_kl(left, alive, columns, room, row)
        elif not known[i, j]:
            cost, steps = pair_cost(code, i, j, w, m, P)
            longest = max(longest, steps)
            known[i, j] = known[j, i] = True
            table[i, j] = table[j, i] = max(cost, table[i, j])
            for k in (i, j):
                nearest[k] = first_least(table[k], n)
                least[k] = table[k, nearest[k]]
            continue
        longest = max(longest, _merge(code, i, j, w, m, P))
        left -= 1
        at = _renew(i, j, left, w, m, P, alive, columns)
        least_costs(code, at, left, columns, room, row)
        for k in range(left):
            other = alive[k]
            known[i, other] = known[other, i] = exact
            table[i, other] = table[other, i] = row[k] if k != at else np.inf
        absorb(i, j, group, table, nearest, least)
    alive = alive[:left]
    return relabelled(group), m[alive], P[alive], longest


@kernel
def _merge(code, i, j, w, m, P):
    """Merges j into i; returns the steps of the barycentre."""
    if code == UNWEIGHTED or code == CHI_SQUARE:
        code = WASSERSTEIN if code == UNWEIGHTED else KL
    m[i], P[i], steps = barycentre_of(code, *pair_of(i, j, w, m, P))
    w[i] += w[j]
    return steps


@kernel
def _cheapest_by_kl(left, alive, columns, room, row):
    """The pair i < j that costs least by the Kullback-Leibler divergence."""
    best, first, second = np.inf, -1, -1
    for i in range(1, left):
        least_costs(KL, i, i, columns, room, row)
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
