"""Distances between sets: every assignment tried, the axioms of a metric, and transport by other means."""

from decimal import Decimal, localcontext
from itertools import combinations, permutations, product
from math import lcm
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment, linprog
from scipy.spatial.distance import cdist

from gmr_gym.evaluation.metrics import gospa, ospa, wasserstein

NONE = np.empty((0, 2))
# whole metres, so that ties, pairs at the cutoff and points on top of one another come up
POINT = st.tuples(st.integers(-120, 120), st.integers(-120, 120))
SETS = st.lists(POINT, max_size=5).map(lambda rows: np.array(rows, float).reshape(-1, 2))
SOME = st.lists(POINT, min_size=1, max_size=5).map(lambda rows: np.array(rows, float))
DISTANCES = (ospa, lambda x, y, *how: gospa(x, y, *how).total)
PAIRS = [
    (seed, j, k, order) for seed, (j, k, order) in enumerate(product(range(4), range(5), (1.0, 2.0, 3.0)))
]
ALIKE = settings(derandomize=True, deadline=None, max_examples=150)


def points(seed, j, k):
    """Two sets of so many points in a square of 300 m, and their distances (j, k)."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-150, 150, (j, 2)), rng.uniform(-150, 150, (k, 2))
    return x, y, np.sqrt(((x[:, None] - y[None]) ** 2).sum(axis=2))


def injections(j, k):
    """Every way of pairing all of the smaller side, as lists of pairs."""
    if j <= k:
        return [list(zip(range(j), to, strict=True)) for to in permutations(range(k), j)]
    return [[(a, b) for b, a in pairs] for pairs in injections(k, j)]


@pytest.mark.parametrize(("seed", "j", "k", "order"), PAIRS)
def test_ospa_is_the_best_of_all_assignments(seed, j, k, order):
    x, y, d = points(seed, j, k)
    most, cutoff = max(j, k), 100.0
    costs = [sum(min(d[pair], cutoff) ** order for pair in pairs) for pairs in injections(j, k)]
    wanted = ((min(costs) + cutoff**order * abs(j - k)) / most) ** (1 / order) if most else 0.0
    assert ospa(x, y, cutoff, order) == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize(("seed", "j", "k", "order"), PAIRS)
def test_gospa_is_the_best_of_all_partial_assignments_with_its_parts(seed, j, k, order):
    x, y, d = points(seed, j, k)
    half = 100.0**order / 2
    tried = {
        tuple(kept)
        for pairs in injections(j, k)
        for size in range(len(pairs) + 1)
        for kept in combinations(pairs, size)
    }
    # no cutoff on a pair: one beyond it is better left apart
    cost, best = min(
        (sum(d[pair] ** order for pair in kept) + half * (j + k - 2 * len(kept)), kept) for kept in tried
    )
    got = gospa(x, y, 100.0, order)
    assert got.total**order == pytest.approx(cost, rel=1e-12)
    wanted = sum(d[p] ** order for p in best), half * (k - len(best)), half * (j - len(best))
    np.testing.assert_allclose(got[1:], wanted, rtol=1e-12)


@pytest.mark.parametrize("distance", DISTANCES)
@ALIKE
@given(x=SETS, y=SETS, z=SETS, cutoff=st.sampled_from([5.0, 100.0]), order=st.sampled_from([1.0, 2.0]))
def test_ospa_and_gospa_are_metrics(distance, x, y, z, cutoff, order):
    def d(a, b):
        return distance(a, b, cutoff, order)

    assert d(x, y) == pytest.approx(d(y, x), rel=1e-12)
    assert d(x, x[::-1]) == 0
    assert (d(x, y) > 0) == (sorted(map(tuple, x)) != sorted(map(tuple, y)))
    assert d(x, z) <= (d(x, y) + d(y, z)) * (1 + 1e-12)


@ALIKE
@given(x=SETS, y=SETS, cutoff=st.floats(1, 300), order=st.floats(1, 4))
def test_parts_of_gospa_make_up_the_whole(x, y, cutoff, order):
    got = gospa(x, y, cutoff, order)
    assert got.localisation + got.missed + got.false == pytest.approx(got.total**order, rel=1e-9)
    half = cutoff**order / 2
    assert got.missed / half - got.false / half == pytest.approx(len(y) - len(x), abs=1e-9)
    assert min(got) >= 0 and ospa(x, y, cutoff, order) <= cutoff * (1 + 1e-12)


@ALIKE
@given(x=SOME, y=SOME, order=st.sampled_from([1.0, 2.0]))
def test_wasserstein_is_the_assignment_of_copies_of_the_points(x, y, order):
    """Each point as often as makes the sets equal: masses of 1 / lcm, which an assignment moves whole."""
    size = lcm(len(x), len(y))
    cost = cdist(np.repeat(x, size // len(x), axis=0), np.repeat(y, size // len(y), axis=0)) ** order
    wanted = cost[linear_sum_assignment(cost)].mean() ** (1 / order)
    for copies in (0, 10_000):  # by linear programming, and by an assignment
        with patch("gmr_gym.evaluation.metrics.MOST_COPIES", copies):
            # metres: of what the solver leaves the root is taken
            assert wasserstein(x, y, order) == pytest.approx(wanted, rel=1e-6, abs=1e-4)
            assert wasserstein(y, x, order) == pytest.approx(wasserstein(x, y, order), rel=1e-6, abs=1e-4)


def dual(cost, a, b):
    """Most that prices u (j,) and v (k,) earn with u_i + v_j <= cost: the cheapest transport of a to b."""
    j, k = cost.shape
    A = np.array([np.r_[np.eye(j)[i], np.eye(k)[c]] for i in range(j) for c in range(k)])
    bounds = [(0, 0)] + [(None, None)] * (j + k - 1)  # one price is free to choose
    found = linprog(-np.r_[a, b], A_ub=A, b_ub=cost.ravel(), bounds=bounds, method="highs-ds")
    return max(-found.fun, 0.0)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("order", [1.0, 2.0])
def test_wasserstein_is_the_dual_programme_for_sets_of_any_size(seed, order):
    rng = np.random.default_rng(seed)
    x, y, d = points(seed, *rng.integers(1, 9, 2))
    wanted = dual(d**order, np.full(len(x), 1 / len(x)), np.full(len(y), 1 / len(y))) ** (1 / order)
    assert wasserstein(x, y, order) == pytest.approx(wanted, rel=1e-9)


@pytest.mark.parametrize("seed", range(10))
def test_wasserstein_of_equal_sizes_is_the_best_association(seed):
    x, y, d = points(seed, 4, 4)
    best = min(sum(d[pair] ** 2 for pair in pairs) for pairs in injections(4, 4))
    assert wasserstein(x, y) == pytest.approx(np.sqrt(best / 4), rel=1e-12)
    # a metric where nothing is empty
    assert wasserstein(x, y) <= wasserstein(x, y[:3]) + wasserstein(y[:3], y)


# far below and far above one another, so that powers leave the range of floats at either end
WIDE = st.lists(st.integers(0, 60), min_size=1, max_size=3).map(
    lambda steps: np.array([[10.0 ** (step / 10 - 3), 0.0] for step in steps])
)
ORDERS = st.sampled_from([1.0, 2.0, 2.5, 30.0, 155.0, 400.0, 3e4])


def root_of_least(costs, order):
    """(min of the sums of costs) ** (1 / order), of Decimals, each cost a (distance, share)."""
    with localcontext(prec=60, Emin=-(10**9), Emax=10**9):
        p = Decimal(order)
        sums = [sum((w * d**p for d, w in cost if d), Decimal(0)) for cost in costs]
        return float(min(sums) ** (1 / p)) if min(sums) else 0.0


def plans(x, y, distance):
    """Every assignment of all of the smaller set: distances of its pairs, exactly as `distance` has them."""
    return [[Decimal(float(distance[pair])) for pair in pairs] for pairs in injections(len(x), len(y))]


@settings(derandomize=True, deadline=None, max_examples=100)
@given(x=WIDE, y=WIDE, cutoff=st.sampled_from([1e-3, 1.0, 100.0, 1e4]), order=ORDERS)
def test_ospa_of_any_order_is_what_exact_arithmetic_gives(x, y, cutoff, order):
    most, c = max(len(x), len(y)), Decimal(cutoff)
    surplus = [(c, Decimal(abs(len(x) - len(y))) / most)]
    costs = [[(min(d, c), Decimal(1) / most) for d in plan] + surplus for plan in plans(x, y, cdist(x, y))]
    assert ospa(x, y, cutoff, order) == pytest.approx(root_of_least(costs, order), rel=1e-12)


@settings(derandomize=True, deadline=None, max_examples=100)
@given(x=WIDE, y=WIDE, cutoff=st.sampled_from([1e-3, 1.0, 50.0]), order=ORDERS)
def test_gospa_of_any_order_is_what_exact_arithmetic_gives(x, y, cutoff, order):
    if order * np.log(cutoff) > 700:
        with pytest.raises(ValueError, match="leave cutoff \\*\\* order a float, got order"):
            gospa(x, y, cutoff, order)
        return
    c = Decimal(cutoff)
    surplus = [(c, Decimal(abs(len(x) - len(y))) / 2)]
    costs = [[(min(d, c), Decimal(1)) for d in plan] + surplus for plan in plans(x, y, cdist(x, y))]
    assert gospa(x, y, cutoff, order).total == pytest.approx(root_of_least(costs, order), rel=1e-12)


@settings(derandomize=True, deadline=None, max_examples=60)
@given(x=WIDE, y=WIDE, order=ORDERS)
def test_wasserstein_of_any_order_is_what_exact_arithmetic_gives(x, y, order):
    size = lcm(len(x), len(y))
    distance = cdist(np.repeat(x, size // len(x), axis=0), np.repeat(y, size // len(y), axis=0))
    whole = {tuple(sorted(distance[range(size), to])) for to in permutations(range(size))}
    costs = [[(Decimal(float(d)), Decimal(1) / size) for d in plan] for plan in whole]
    assert wasserstein(x, y, order) == pytest.approx(root_of_least(costs, order), rel=1e-12)


@settings(derandomize=True, deadline=None, max_examples=40)
@given(x=SOME, y=SOME, cutoff=st.sampled_from([5.0, 100.0]))
def test_order_inf_is_what_orders_tend_to(x, y, cutoff):
    # a share of 1 / lcm or more of the mass goes as far as that
    assert wasserstein(x, y, 1e6) == pytest.approx(wasserstein(x, y, np.inf), rel=1e-5)
    assert ospa(x, y, cutoff, 1e6) == pytest.approx(ospa(x, y, cutoff, np.inf), rel=1e-5)
    if len(x) != len(y):
        assert ospa(x, y, cutoff, np.inf) == cutoff  # of two sets unequal in size (Schuhmacher, Vo and Vo)


def test_high_orders_by_hand():
    here, there = [[0.006, 0.008]], [[0.0, 0.0]]
    for order in (155, 400, 1e5, np.inf):
        assert ospa(here, there, order=order) == pytest.approx(0.01, rel=1e-12)
        assert ospa(here, there, cutoff=1.0, order=order) == pytest.approx(0.01, rel=1e-12)
        assert wasserstein(here, there, order=order) == pytest.approx(0.01, rel=1e-12)
    assert gospa(here, there, cutoff=1.0, order=400) == pytest.approx((0.01, 0.0, 0.0, 0.0), rel=1e-12)
    # two plans whose costs both vanish beside the cutoff's are told apart
    assert ospa([[0.0], [0.02]], [[0.017], [0.005]], 1.0, 300) == pytest.approx(0.005 / 2 ** (1 / 300))


@pytest.mark.parametrize("size", [1e-200, 1e-160, 1e160, 1e250])
def test_sets_of_any_size_are_measured(size):
    x, y, _ = points(1, 3, 3)
    for distance in (wasserstein, lambda x, y: ospa(x, y, 1e280), lambda x, y: gospa(x, y, 1e150).total):
        if size < 1:
            assert distance(size * x, size * y) == pytest.approx(size * distance(x, y), rel=1e-12)
    assert wasserstein(size * x, size * y) == pytest.approx(size * wasserstein(x, y), rel=1e-12)
    assert ospa(1e200 * x, 1e200 * y) == 100


def test_values_by_hand():
    there = np.array([[0.0, 0.0], [500.0, 0.0]])
    here = np.array([[3.0, 4.0]])
    assert ospa(here, there) == pytest.approx(np.sqrt((25 + 100**2) / 2))
    assert gospa(here, there) == pytest.approx((np.sqrt(25 + 5000), 25, 5000, 0))
    assert wasserstein(here, there) == pytest.approx(np.sqrt((25 + 497**2 + 16) / 2))
    # a pair at the cutoff is a miss and a false estimate
    assert gospa([[100.0, 0.0]], [[0.0, 0.0]]) == pytest.approx((100, 0, 5000, 5000))
    # wherever else a target is lost or made up, it costs no more than beyond the cutoff
    assert ospa([[1e6, 0.0]], [[0.0, 0.0]]) == 100 == gospa([[1e6, 0.0]], [[0.0, 0.0]]).total


def test_empty_sets():
    two = np.array([[0.0, 0.0], [5.0, 5.0]])
    assert ospa(NONE, NONE) == 0 == gospa(NONE, NONE).total
    assert ospa(two, NONE) == 100 == ospa(NONE, two)
    assert gospa(NONE, two) == pytest.approx((100, 0, 10_000, 0))
    assert gospa(two, NONE) == pytest.approx((100, 0, 0, 10_000))
    assert ospa(two, NONE, order=np.inf) == 100 and ospa(NONE, NONE, order=np.inf) == 0
    # neither is a distance of mass to nowhere, nor is one of nothing 0
    assert np.isnan([wasserstein(*sets) for sets in ((two, NONE), (NONE, two), (NONE, NONE))]).all()


def test_other_dimensions_and_far_coordinates():
    x = np.array([[1.0], [7.0]])
    assert gospa(x, x + 2).localisation == pytest.approx(8)
    far = 1e6 * np.ones((2, 3))
    assert wasserstein(far, far[:1] + np.array([3.0, 4.0, 0.0])) == pytest.approx(5)


@pytest.mark.parametrize("distance", [ospa, gospa, wasserstein])
@pytest.mark.parametrize(
    ("x", "y", "message"),
    [
        ([0.0, 0.0], NONE, r"estimates must be finite positions \(k, d\), got shape \(2,\)"),
        ([], NONE, r"estimates must be finite positions \(k, d\), got shape \(0,\)"),
        (NONE, [[0.0, np.nan]], "targets must be finite"),
        (NONE, [[0.0, np.inf]], "targets must be finite"),
        (NONE, np.empty((0, 3)), "estimates have 2 coordinates, but targets have 3"),
        ([[0.0, 0.0], [1.0]], NONE, r"estimates must be numbers of shape \(k, d\)"),
        (NONE, "here", "targets must be numbers"),
        ([[1j, 0.0]], NONE, "estimates must be numbers"),
        (NONE, [["1", "2"]], "targets must be numbers"),
    ],
)
def test_bad_sets_are_refused_by_name(distance, x, y, message):
    with pytest.raises(ValueError, match=message):
        distance(x, y)


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ({"cutoff": 0.0}, "cutoff must be positive and finite, got 0"),
        ({"cutoff": np.inf}, "cutoff must be"),
        ({"cutoff": np.nan}, "cutoff must be"),
        ({"order": 0.5}, "order must be at least 1, got 0.5"),
        ({"order": np.nan}, "order must be"),
        ({"cutoff": None}, "cutoff must be positive and finite, got None"),
        ({"cutoff": 1j}, "cutoff must be"),
        ({"order": "two"}, "order must be at least 1, got 'two'"),
        ({"order": 2 + 0j}, "order must be"),
    ],
)
def test_bad_settings_are_refused_by_name(setting, message):
    for distance in (ospa, gospa, wasserstein) if "order" in setting else (ospa, gospa):
        with pytest.raises(ValueError, match=message):
            distance(NONE, NONE, **setting)


@pytest.mark.parametrize("distance", [ospa, gospa, wasserstein])
def test_masked_positions_are_absent(distance):
    rng = np.random.default_rng(0)
    x, y = rng.uniform(0, 50, (4, 2)), rng.uniform(0, 50, (5, 2))
    masked = [np.ma.array(points, mask=np.zeros(points.shape, bool)) for points in (x, y)]
    masked[0][1, 0] = masked[1][0] = masked[1][4, 1] = np.ma.masked
    assert distance(*masked) == distance(x[[0, 2, 3]], y[1:4])
    assert distance(masked[0], y) == distance(x[[0, 2, 3]], y)
    np.testing.assert_equal(distance(np.ma.masked_all((3, 2)), y), distance(np.empty((0, 2)), y))


@pytest.mark.parametrize(("order", "cutoff"), [(np.inf, 100.0), (155.0, 100.0), (1e3, 2.1)])
def test_gospa_refuses_an_order_whose_parts_are_no_floats(order, cutoff):
    with pytest.raises(ValueError, match=rf"got order {order}, cutoff {cutoff}"):
        gospa([[0.0, 0.0]], NONE, cutoff, order)


def test_positions_whose_differences_are_no_floats_are_refused():
    with pytest.raises(ValueError, match="farther apart than floats reach"):
        ospa([[1.5e308, 0.0]], [[-1.5e308, 0.0]])
