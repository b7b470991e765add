"""GOSPA and OSPA in compiled loops, equal to `gmr_gym.evaluation.metrics` to the last bit."""

import math
from typing import NamedTuple

import numpy as np

from gmr_gym.evaluation.metrics import gospa, ospa
from gmr_gym.kernels import kernel, leaf_kernel
from gmr_gym.linalg import pairwise_sum

ORDERS = 1.0, 2.0  # whose powers are products
SAFE = 1e-100, 1e100  # m, of distances whose powers are safely within floats


class Rule(NamedTuple):
    """How two sets are compared; `rule_of` makes it."""

    cutoff: float  # m
    squared: bool  # whether the order is 2, else it is 1
    root: float  # one over the order
    price: float  # cutoff ** order


class Workspace(NamedTuple):
    """Arrays for sets of n points or fewer; `workspace` makes it."""

    cost: np.ndarray  # (n, n), of the pairs, those of the smaller set first
    paired: np.ndarray  # (n,), distances of the assigned pairs
    dual: np.ndarray  # (2, n), of the rows and of the columns
    shortest: np.ndarray  # (n,), cost of the shortest path to each column
    match: np.ndarray  # (2, n), the column of each row and the row of each column, -1 for none
    path: np.ndarray  # (n,), the row before each column on its shortest path
    left: np.ndarray  # (n,), columns that are not reached yet


def set_distances(x: np.ndarray, y: np.ndarray, cutoff: float, order: float) -> tuple[float, ...]:
    """GOSPA, its localisation, missed and false, and OSPA of two sets, as `gmr_gym.evaluation.metrics` has
    them.

    Parameters
    ----------
    x : ndarray (j, p)
        Estimated positions, m.
    y : ndarray (k, p)
        True positions, m.
    cutoff, order : float
        As for `gmr_gym.evaluation.metrics.gospa`.

    Returns
    -------
    tuple of five floats
    """
    rule = rule_of(cutoff, order)
    if rule is not None:
        found = compared(x, y, rule)
        if not math.isnan(found[0]):
            return found
    return *gospa(x, y, cutoff, order), ospa(x, y, cutoff, order)


def rule_of(cutoff: float, order: float) -> Rule | None:
    """How sets are compared; None where only `gmr_gym.evaluation.metrics` can."""
    if order not in ORDERS or not SAFE[0] < cutoff < SAFE[1]:
        return None
    return Rule(float(cutoff), order == 2, 1 / order, float(cutoff**order))


@kernel
def compared(x, y, rule):
    """`distances_by` of two sets, in a workspace of its own."""
    return distances_by(x, y, rule, workspace(max(len(x), len(y))))


@kernel
def workspace(n):
    """Arrays to compare sets of n points or fewer."""
    columns = np.empty((4, n), np.int64)
    return Workspace(
        np.empty((n, n)), np.empty(n), np.empty((2, n)), np.empty(n), columns[:2], columns[2], columns[3]
    )


@leaf_kernel
def distances_by(x, y, rule, work):
    """GOSPA, its localisation, missed and false, and OSPA of the estimates x (j, p) and the targets y (k, p).

    All are nan where distances are too short or too long to be squared.
    """
    few, most = min(len(x), len(y)), max(len(x), len(y))
    if not costs_into(work.cost, x, y, rule):
        return np.nan, np.nan, np.nan, np.nan, np.nan
    assign(few, most, work)
    near, powers = 0, work.shortest[:few]
    paired_into(work.paired, x, y, work.match)
    for i in range(few):
        powers[i] = power(min(work.paired[i], rule.cutoff), rule)
    total = pairwise_sum(powers)
    for i in range(few):
        if work.paired[i] < rule.cutoff:
            powers[near] = power(work.paired[i], rule)
            near += 1
    localised = pairwise_sum(powers[:near])
    missed, false = rule.price / 2 * (len(y) - near), rule.price / 2 * (len(x) - near)
    # the root is an argument: of one that it knew the compiler would take another function than Python does
    ospa = ((total + rule.price * (most - few)) / most) ** rule.root if most else 0.0
    return (localised + missed + false) ** rule.root, localised, missed, false, ospa


@leaf_kernel
def power(distance, rule):
    """The distance to the power of the rule's order."""
    return distance * distance if rule.squared else distance


@leaf_kernel
def distance(x, y):
    """Distance of two points (p,)."""
    square = 0.0
    for c in range(len(x)):
        square += (x[c] - y[c]) * (x[c] - y[c])
    return math.sqrt(square)


@leaf_kernel
def costs_into(cost, x, y, rule):
    """Writes the powers of the distances, at most the cutoff, with the smaller set in the rows; returns
    whether the distances are in range."""
    for i in range(len(x)):
        for j in range(len(y)):
            off = distance(x[i], y[j])
            if off != 0 and not (SAFE[0] < off and off < SAFE[1]):
                return False
            paid = power(min(off, rule.cutoff), rule)
            if len(x) <= len(y):
                cost[i, j] = paid
            else:
                cost[j, i] = paid
    return True


@leaf_kernel
def paired_into(paired, x, y, match):
    """Writes the distances of the assigned pairs in the order of x."""
    n = 0
    for i in range(len(x)):
        j = match[0, i] if len(x) <= len(y) else match[1, i]
        if j >= 0:
            paired[n] = distance(x[i], y[j])
            n += 1


@leaf_kernel
def assign(few, most, work):
    """Writes the cheapest assignment of all rows to different columns to `work.match`.

    By shortest augmenting paths (Crouse 2016). Where several are cheapest it is the one that SciPy's
    `linear_sum_assignment` finds.
    """
    dual, match = work.dual, work.match
    for i in range(most):
        dual[0, i] = dual[1, i] = 0.0
        match[0, i] = match[1, i] = -1
    for row in range(few):
        sink, length, left = shortest_path(row, most, work)
        dual[0, row] += length
        # the columns reached are those that are not left
        for place in range(left, most):
            column = work.left[place]
            if match[1, column] >= 0:
                dual[0, match[1, column]] += length - work.shortest[column]
            dual[1, column] -= length - work.shortest[column]
        column = sink
        while True:
            i = work.path[column]
            match[1, column] = i
            match[0, i], column = column, match[0, i]
            if i == row:
                break


@leaf_kernel
def shortest_path(row, most, work):
    """The free column that is cheapest to reach from the row, its cost, and how many columns are left; the
    others stand behind them."""
    cost, dual, shortest, match, left = work.cost, work.dual, work.shortest, work.match, work.left
    for place in range(most):
        left[place] = most - 1 - place  # so that equal costs give the identity
    shortest[:most] = np.inf
    length, i = 0.0, row
    for remaining in range(most - 1, -1, -1):
        lowest, nearest = np.inf, 0
        for place in range(remaining + 1):
            column = left[place]
            reached = length + cost[i, column] - dual[0, i] - dual[1, column]
            if reached < shortest[column]:
                work.path[column], shortest[column] = i, reached
            free = match[1, column] < 0
            if shortest[column] < lowest or (shortest[column] == lowest and free):
                lowest, nearest = shortest[column], place
        length, column = lowest, left[nearest]
        left[nearest], left[remaining] = left[remaining], column
        i = match[1, column]
        if i < 0:
            return column, length, remaining
    return -1, length, 0  # not reached: rows are no more than columns
