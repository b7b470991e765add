"""The k best assignments, against the enumeration of all."""

from itertools import permutations, product

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment

from gmr_gym.filters.ranked_assignments import ranked_assignments, ranked_events

ROUNDED = 1e-10


def enumerated(cost):
    """Costs of all possible assignments, sorted."""
    n, m = cost.shape
    totals = np.array([cost[np.arange(n), list(p)].sum() for p in permutations(range(m), n)])
    return np.sort(totals[totals < np.inf])


def assert_best(cost, count):
    columns, costs = ranked_assignments(cost, count)
    n = len(cost)
    np.testing.assert_allclose(costs, enumerated(cost)[:count], atol=ROUNDED)
    np.testing.assert_allclose(cost[np.arange(n), columns].sum(axis=1), costs, atol=ROUNDED)
    assert all(len(set(c)) == n for c in columns.tolist())  # no column has two rows
    assert len({tuple(c) for c in columns.tolist()}) == len(columns)


def drawn(seed):
    """Up to 5 rows and 6 columns, costs of either sign, some infinite, some equal."""
    rng = np.random.default_rng(seed)
    n = rng.integers(1, 6)
    m = rng.integers(n, 7)
    cost = 10 * rng.standard_normal((n, m))
    cost = np.round(cost / 5) if seed % 3 == 0 else cost
    cost[rng.random((n, m)) < rng.uniform(0, 0.6)] = np.inf
    return cost


@pytest.mark.parametrize("count", [1, 2, 7, 40, 800])
@pytest.mark.parametrize("seed", range(60))
def test_the_best_assignments_are_those_of_the_enumeration(seed, count):
    assert_best(drawn(seed), count)


@pytest.mark.parametrize("shape", [(1, 1), (1, 6), (3, 3), (6, 6), (2, 9)])
def test_of_any_shape(shape):
    assert_best(np.random.default_rng(0).standard_normal(shape), 50)


@pytest.mark.parametrize("n", [1, 4])
def test_of_equal_costs_all_assignments_come_once(n):
    columns, costs = ranked_assignments(np.ones((n, n + 1)), 1000)
    assert len(columns) == len(enumerated(np.ones((n, n + 1)))) and (costs == n).all()
    assert len({tuple(c) for c in columns.tolist()}) == len(columns)


@pytest.mark.parametrize("m", [30, 45])
def test_the_best_of_many_rows_is_that_of_scipy(m):
    cost = np.random.default_rng(m).standard_normal((30, m))
    costs = ranked_assignments(cost, 20)[1]
    assert costs[0] == pytest.approx(cost[linear_sum_assignment(cost)].sum(), abs=ROUNDED)
    assert (np.diff(costs) >= -ROUNDED).all() and len(costs) == 20


def test_the_second_best_is_the_best_that_differs_in_a_row():
    cost = np.random.default_rng(3).standard_normal((12, 15))
    columns, costs = ranked_assignments(cost, 2)
    others = []
    for i in range(12):
        without = cost.copy()
        without[i, columns[0, i]] = 1e6
        others.append(without[linear_sum_assignment(without)].sum())
    assert costs[1] == pytest.approx(min(others), abs=ROUNDED)


@pytest.mark.parametrize(
    "cost", [np.full((2, 3), np.inf), np.array([[1.0, np.inf], [2.0, np.inf]]), np.ones((3, 2))]
)
def test_where_no_assignment_is_possible_there_is_none(cost):
    columns, costs = ranked_assignments(cost, 5)
    assert columns.shape == (0, cost.shape[0]) and len(costs) == 0


def test_no_rows_have_one_assignment():
    columns, costs = ranked_assignments(np.empty((0, 3)), 5)
    assert columns.shape == (1, 0) and costs.tolist() == [0.0]


@pytest.mark.parametrize("seed", range(20))
def test_the_spread_leaves_out_what_costs_more(seed):
    cost = drawn(seed)
    costs = ranked_assignments(cost, 800)[1]
    if len(costs):
        near = ranked_assignments(cost, 800, 8.0)[1]
        assert len(near) == (costs <= costs[0] + 8.0).sum()


def test_costs_far_apart_keep_their_order():
    cost = np.array([[0.0, 1e15], [1e-3, 0.0], [0.0, 2e-3]]).T
    assert ranked_assignments(cost, 6)[1] == pytest.approx(enumerated(cost), rel=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_the_best_events_are_those_of_the_enumeration(seed):
    rng = np.random.default_rng(seed)
    psi = 10 ** rng.uniform(-3, 3, (3, 4)) * (rng.random((3, 4)) < 0.7)
    weights = []
    for event in product(range(-1, 4), repeat=3):
        taken = [j for j in event if j >= 0]
        if len(set(taken)) == len(taken):
            weights.append(np.prod([psi[i, j] for i, j in enumerate(event) if j >= 0]))
    weights = np.sort([w for w in weights if w > 0])[::-1]
    with np.errstate(divide="ignore"):
        detection, log_weight = ranked_events(np.log(psi), 12)
    np.testing.assert_allclose(np.exp(log_weight), weights[:12], rtol=ROUNDED)
    with_pairs = [np.prod([psi[i, j] for i, j in enumerate(event) if j >= 0]) for event in detection]
    np.testing.assert_allclose(np.exp(log_weight), with_pairs, rtol=ROUNDED)
