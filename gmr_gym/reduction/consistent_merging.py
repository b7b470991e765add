"""Greedy merging by one measure throughout: pairs are chosen by it, and merged into its barycentre."""

import numpy as np

from gmr_gym.checks import check_choice, check_count
from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, half_log_determinant
from gmr_gym.mixture import Mixture, moments
from gmr_gym.reduction.agglomeration import absorb, cheapest_pair, nearest_others, relabelled
from gmr_gym.reduction.barycentres import barycentre_of
from gmr_gym.reduction.greedy_merging import first_least
from gmr_gym.reduction.measures import KL, MEASURES, REVERSE_KL, WASSERSTEIN
from gmr_gym.reduction.merge_cost import components_last, empty_columns
from gmr_gym.reduction.overlap_descent import STEPS
from gmr_gym.reduction.pair_costs import UNWEIGHTED, least_costs, pair_cost, pair_of
from gmr_gym.reduction.protocol import TOO_FAR, Reduced, definite, through, warn_unfinished
from gmr_gym.reduction.pruning import weighing


def consistent(p: Mixture, components: int, measure: str) -> Reduced:
    check_choice("measure", measure, MEASURES)
    return _merged(p, components, MEASURES.index(measure))


def greedy_wasserstein(p: Mixture, components: int) -> Reduced:
    return _merged(p, components, UNWEIGHTED)


def _merged(p: Mixture, components: int, code: int) -> Reduced:
    components = check_count(components)
    q, place = weighing(p)
    if len(q.w) <= components:
        return q, place
    mean, _ = moments(q)  # about it, differences of merged means keep their digits
    group, m, P, longest = merge_by_measure(code, *q._replace(m=q.m - mean), components)
    if longest >= STEPS:
        warn_unfinished(f"the barycentre by {MEASURES[code]}", STEPS)
    return definite(Mixture(np.bincount(group, q.w), mean + m, P)), through(place, group)


@kernel
def merge_by_measure(code, w, m, P, components):
    """Groups (n,) of greedy merging by the measure, the means and covariances of their barycentres, and the most
    steps of an iteration."""
    n, exact = len(w), code == KL or code == REVERSE_KL
    w, m, P, group, alive, longest = w.copy(), m.copy(), P.copy(), np.arange(n), np.arange(n), 0
    columns, room = components_last(w, m, P)
    table, known, row = np.empty((n, n)), np.full((n, n), exact), np.empty(columns.shape[1])
    for i in range(1, n):
        least_costs(code, i, i, columns, room, row)
        for j in range(i):
            table[i, j] = table[j, i] = row[j]
    nearest, least = nearest_others(table)
    while len(alive) > components:
        i, j = cheapest_pair(nearest, least)
        if not known[i, j]:
            cost, steps = pair_cost(code, i, j, w, m, P)
            longest = max(longest, steps)
            known[i, j] = known[j, i] = True
            table[i, j] = table[j, i] = max(cost, table[i, j])
            for k in (i, j):
                nearest[k] = first_least(table[k], n)
                least[k] = table[k, nearest[k]]
            continue
        longest = max(longest, _merge(code, i, j, w, m, P, columns))
        alive = alive[alive != j]
        near = alive[alive != i]
        _costs_of(code, i, near, columns, room, row)
        for k in range(len(near)):
            known[i, near[k]] = known[near[k], i] = exact
            table[i, near[k]] = table[near[k], i] = row[k]
        absorb(i, j, group, table, nearest, least)
    return relabelled(group), m[alive], P[alive], longest


@kernel
def _merge(code, i, j, w, m, P, columns):
    """Merges j into i; returns the steps of the barycentre."""
    d = m.shape[1]
    m[i], P[i], steps = barycentre_of(WASSERSTEIN if code == UNWEIGHTED else code, *pair_of(i, j, w, m, P))
    w[i] += w[j]
    L = np.zeros((d, d))
    if not cholesky_into(L, P[i]):
        raise ValueError(TOO_FAR)
    columns[0, i], columns[1, i], q = w[i], 2.0 * half_log_determinant(L), 2 + d
    for r in range(d):
        columns[2 + r, i] = m[i, r]
        for c in range(r + 1):
            columns[q, i] = P[i, r, c]
            q += 1
    return steps


@kernel
def _costs_of(code, i, others, columns, room, row):
    """Writes what it costs at least to merge i with each of `others` (k,) to row."""
    k = len(others)
    near = empty_columns(k + 1, len(columns) - 1 - len(room))
    for q in range(len(columns)):
        for j in range(k):
            near[q, j] = columns[q, others[j]]
        near[q, k] = columns[q, i]
    least_costs(code, k, k, near, room, row)
