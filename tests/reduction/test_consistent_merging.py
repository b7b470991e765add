"""Pairs merged by one measure throughout, by chi-square, and pruned or merged; where merging stops."""

from functools import partial
from itertools import combinations

import numpy as np
import pytest
from reference import random_mixture
from scipy.integrate import quad

from gmr_gym.evaluation.mixture_problems import crouse
from gmr_gym.mixture import Mixture, collapsed, log_density, mixture, take
from gmr_gym.reduction.adaptive_merging import adaptive_2023
from gmr_gym.reduction.barycentres import barycentre
from gmr_gym.reduction.chi_square import chi_square_costs
from gmr_gym.reduction.consistent_merging import consistent, greedy_chi_square, greedy_wasserstein
from gmr_gym.reduction.distances import integral_squared_difference, kullback_leibler, wasserstein
from gmr_gym.reduction.measures import COSTS, MEASURES
from gmr_gym.reduction.merge_cost import components_last
from gmr_gym.reduction.pair_costs import PAIR_COSTS
from gmr_gym.reduction.prune_or_merge import prune_or_merge
from gmr_gym.reduction.runnalls import adaptive, runnalls, total_merge_cost

every = pytest.mark.parametrize("measure", MEASURES)
GREEDY = {measure: partial(consistent, measure=measure) for measure in MEASURES} | {
    "greedy-wasserstein": greedy_wasserstein, "greedy-chi-square": greedy_chi_square,
}  # fmt: skip


def drawn(seed, n, d, spread=1.5):
    return Mixture(*random_mixture(np.random.default_rng(seed), n, d, spread))


def pair_cost(measure, p, i, j):
    """The least sum of w D(component, q) for two components."""
    pair = take(p, np.array([i, j]))
    q = barycentre(pair, measure)
    cost = COSTS[MEASURES.index(measure)]
    return sum(w * cost(m, P, q.m[0], q.P[0]) for w, m, P in zip(*pair, strict=True))


def slowly(p, components, cost, merged):
    """Groups of greedy merging with every cost computed at every step, and the costs."""
    groups, costs = [{i} for i in range(len(p.w))], []
    while len(p.w) > components:
        least, i, j = min((cost(p, i, j), i, j) for i, j in combinations(range(len(p.w)), 2))
        both, rest = take(p, np.array([i, j])), take(p, np.delete(np.arange(len(p.w)), j))
        for a, b in zip(rest, merged(both), strict=True):
            a[i] = b[0]
        p, costs = rest, [*costs, least]
        groups[i] |= groups.pop(j)
    return {frozenset(group) for group in groups}, costs


def groups_of(origin):
    return {frozenset(np.flatnonzero(origin == g)) for g in range(origin.max() + 1)}


# ---- one measure throughout ----


@every
@pytest.mark.parametrize("d", [1, 3])
def test_merging_is_that_with_every_cost_computed(measure, d):
    p = drawn(d, 9, d)
    slow, _ = slowly(p, 3, partial(pair_cost, measure), partial(barycentre, measure=measure))
    q, origin = consistent(p, 3, measure)
    assert groups_of(origin) == slow
    for j in range(3):
        members = np.flatnonzero(origin == j)
        assert q.w[j] == pytest.approx(p.w[members].sum())
        if len(members) <= 2 or measure in ("kl", "reverse-kl"):  # of more, by the others, the order counts
            expected = barycentre(take(p, members), measure)
            np.testing.assert_allclose(q.m[j], expected.m[0], atol=1e-8)
            np.testing.assert_allclose(q.P[j], expected.P[0], rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("measure", MEASURES)
@pytest.mark.parametrize("d", [1, 2, 4])
def test_bounds_lie_below_the_costs_and_two_are_exact(measure, d):
    p = drawn(10 + d, 8, d)
    columns, room = components_last(*p)
    row = np.empty(columns.shape[1])
    PAIR_COSTS[MEASURES.index(measure)][0](7, 7, columns, room, row)
    exact = [pair_cost(measure, p, 7, j) for j in range(7)]
    assert (row[:7] <= np.array(exact) * (1 + 1e-9)).all()
    assert (row[:7] > 0.15 * np.array(exact)).all()  # not so far below that they would be of no use
    if measure in ("kl", "reverse-kl") or (measure == "wasserstein" and d <= 2):
        np.testing.assert_allclose(row[:7], exact, rtol=1e-8)


def test_kl_throughout_is_runnalls():
    p = drawn(4, 40, 4)
    for ours, theirs in zip((*consistent(p, 9, "kl")[0], consistent(p, 9, "kl")[1]),
                            (*runnalls(p, 9)[0], runnalls(p, 9)[1]), strict=True):  # fmt: skip
        np.testing.assert_allclose(ours, theirs, rtol=1e-11, atol=1e-12)


@every
def test_costs_of_both_divergences_alone_sum_to_the_same_in_any_order(measure):
    p, cost = drawn(2, 6, 3), COSTS[MEASURES.index(measure)]
    whole = barycentre(p, measure)
    at_once = sum(w * cost(m, P, whole.m[0], whole.P[0]) for w, m, P in zip(*p, strict=True))
    _, costs = slowly(p, 1, partial(pair_cost, measure), partial(barycentre, measure=measure))
    if measure in ("kl", "reverse-kl"):
        assert sum(costs) == pytest.approx(at_once, rel=1e-12)
    else:
        assert abs(sum(costs) / at_once - 1) > 1e-4


def test_merged_by_reverse_kl_or_wasserstein_two_far_apart_become_one_where_nothing_is():
    p = mixture([0.5, 0.5], [[-50.0], [50.0]], [[[1.0]], [[1.0]]])
    for measure in ("reverse-kl", "wasserstein"):
        q, _ = consistent(p, 1, measure)
        assert q.P[0, 0, 0] == pytest.approx(1.0) and log_density(p, q.m)[0] < -1000


def test_greedy_wasserstein_takes_the_nearest_and_the_consistent_form_the_light():
    p = mixture([0.49, 0.49, 0.01, 0.01], [[0.0], [1.0], [10.0], [12.0]], [[[1.0]]] * 4)
    assert groups_of(greedy_wasserstein(p, 3)[1]) == {frozenset(g) for g in ({0, 1}, {2}, {3})}
    assert groups_of(consistent(p, 3, "wasserstein")[1]) == {frozenset(g) for g in ({0}, {1}, {2, 3})}
    p = drawn(7, 8, 3)
    slow, _ = slowly(
        p,
        4,
        lambda p, i, j: wasserstein(p.m[i], p.P[i], p.m[j], p.P[j]),
        partial(barycentre, measure="wasserstein"),
    )
    assert groups_of(greedy_wasserstein(p, 4)[1]) == slow


def test_crouses_mixture_by_wasserstein_in_both_forms():
    for q in (consistent(crouse(), 5, "wasserstein")[0], greedy_wasserstein(crouse(), 5)[0]):
        assert integral_squared_difference(crouse(), q) == pytest.approx(0.014235, abs=1e-6)


# ---- chi-square ----


def chi_square(p, i, j, reach=12.0):
    """W times the integral of (mixture / match)^2 match, less 1, of two components in one dimension."""
    pair = take(p, np.array([i, j]))
    q = collapsed(pair)
    middle, deviation = q.m[0, 0], np.sqrt(q.P[0, 0, 0])

    def ratio(x):
        return np.exp(2 * log_density(pair, [[x]])[0] - log_density(q, [[x]])[0]) / q.w[0]

    return q.w[0] * (quad(ratio, middle - reach * deviation, middle + reach * deviation, limit=300)[0] - 1)


def chi_square_row(p, i):
    columns, room = components_last(*p)
    row = np.empty(columns.shape[1])
    chi_square_costs(i, i, columns, room, row)
    return row[:i]


def test_the_chi_square_cost_is_its_integral_and_infinite_where_that_diverges():
    row = chi_square_row(crouse(), 9)
    assert row[5] == np.inf  # a light and wide one beside a heavy and narrow one
    for j in (0, 1, 2, 3, 4, 6, 7, 8):
        assert row[j] == pytest.approx(chi_square(crouse(), 9, j), rel=1e-7)


def test_the_chi_square_cost_in_four_dimensions_is_the_mean_of_a_ratio_under_the_match():
    p = drawn(1, 2, 4, spread=0.7)
    p.P[1] = 0.8 * p.P[0] + 0.1 * np.diag([1.0, 2.0, 3.0, 4.0])  # alike, or the ratio has no variance
    q = collapsed(p)
    x = np.random.default_rng(0).multivariate_normal(q.m[0], q.P[0], 400_000)
    squares = np.exp(2 * (log_density(p, x) - log_density(q, x)))
    found, error = chi_square_row(p, 1)[0], squares.std() / np.sqrt(len(x))
    assert found == pytest.approx(squares.mean() - 1, abs=5 * error) and error < 0.1 * found


def test_chi_square_finds_the_best_partition_of_crouses_mixture():
    q, _ = greedy_chi_square(crouse(), 5)
    assert integral_squared_difference(crouse(), q) == pytest.approx(0.0029520974, abs=1e-10)
    assert integral_squared_difference(crouse(), runnalls(crouse(), 5)[0]) > 0.02


def test_pairs_of_infinite_chi_square_are_merged_at_last_by_the_least_cost_of_kl():
    p = mixture([0.9, 0.05, 0.05], [[0.0], [0.0], [40.0]], [[[1.0]], [[100.0]], [[1e4]]])
    assert chi_square_row(p, 1)[0] == np.inf and (chi_square_row(p, 2) == np.inf).sum() >= 1
    narrow = take(p, np.array([0, 1]))
    q, _ = greedy_chi_square(narrow, 1)
    np.testing.assert_allclose(q.P, collapsed(narrow).P)


# ---- pruning or merging ----


def divergence(p, q, lower, upper):
    """KL(p || q) in one dimension."""

    def integrand(x):
        a, b = log_density(p, [[x]])[0], log_density(q, [[x]])[0]
        return np.exp(a) * (a - b)

    return quad(integrand, lower, upper, limit=400, epsabs=1e-10)[0]


def test_pruning_or_merging_prunes_the_peak_of_crouses_mixture_that_runnalls_merges():
    q, origin = prune_or_merge(crouse(), 5)
    assert np.flatnonzero(origin == -1).tolist() == [8] and crouse().m[8, 0] == 2.77
    assert q.w.sum() == pytest.approx(1.0, rel=1e-14)
    assert divergence(crouse(), q, -1.0, 4.0) == pytest.approx(0.309, abs=5e-4)
    # no component takes over the peak: pruning it costs -log(1 - 0.08), or 0.0834, a bound of the truth
    before, _ = prune_or_merge(crouse(), 6)
    assert 0.07 < divergence(q, before, -1.0, 4.0) < -np.log(0.92)


@pytest.mark.parametrize("sharpened", [False, True])
def test_a_double_is_merged_and_a_light_component_far_away_is_pruned(sharpened):
    p = mixture([0.3, 0.3, 0.39, 0.01], [[0.0], [0.0], [9.0], [500.0]], [[[1.0]]] * 4)
    q, origin = prune_or_merge(p, 3, sharpened)
    assert origin.tolist() == [0, 0, 1, 2]
    q, origin = prune_or_merge(p, 2, sharpened)
    assert origin.tolist() == [0, 0, 1, -1]
    np.testing.assert_allclose(q.w, np.array([0.6, 0.39]) / 0.99)
    np.testing.assert_allclose(q.m, [[0.0], [9.0]], atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_each_step_of_pruning_or_merging_is_the_cheapest_by_its_formulas(seed):
    p = drawn(seed, 5, 2, spread=2.0)

    def kl(i, m, P):
        return kullback_leibler(m, P, p.m[i], p.P[i])

    def pruning(i):
        given_up = -np.log(1 - p.w[i])
        return min(
            given_up - p.w[j] / (1 - p.w[i]) * np.log1p(p.w[i] / p.w[j] * np.exp(-kl(i, p.m[j], p.P[j])))
            for j in range(5) if j != i
        )  # fmt: skip

    def merging(i, j):
        W, m, P = (a[0] for a in collapsed(take(p, np.array([i, j]))))
        return W * np.log(W) - W * np.log(p.w[i] * np.exp(-kl(i, m, P)) + p.w[j] * np.exp(-kl(j, m, P)))

    costs = {(i,): pruning(i) for i in range(5)} | {ij: merging(*ij) for ij in combinations(range(5), 2)}
    cheapest = min(costs, key=costs.get)
    _, origin = prune_or_merge(p, 4)
    dropped = np.flatnonzero(origin == -1)
    alike = [i for i in range(5) if origin[i] >= 0 and (origin == origin[i]).sum() > 1]
    assert tuple(dropped if len(dropped) else alike) == cheapest


# ---- where merging stops by its costs ----


def test_the_rules_of_2022_and_2023_stop_where_they_should_in_crouses_mixture():
    assert total_merge_cost(crouse()) == pytest.approx(1.52183425, abs=5e-9)
    _, costs = slowly(crouse(), 1, partial(pair_cost, "kl"), collapsed)
    ratios = np.array(costs) / total_merge_cost(crouse())
    printed = [0.00041, 0.00085, 0.00540, 0.02214, 0.06830, 0.11996, 0.12166, 0.18783, 0.47346]
    np.testing.assert_allclose(ratios, printed, atol=5e-6)

    def left(rule, **bounds):
        return len(rule(crouse(), **bounds)[0].w)

    assert [left(adaptive, loss_bound=bound) for bound in (0.02, 0.05, 0.1)] == [7, 6, 5]
    assert [left(adaptive_2023, loss_bound=bound) for bound in (0.05, 0.1, 1.0)] == [6, 5, 2]
    assert [left(adaptive_2023, loss_bound=bound, ratio=0.25) for bound in (0.1, 0.5, 1.0)] == [5, 5, 5]
    assert left(adaptive_2023, ratio=1.0) == 1 and left(adaptive_2023, components=1) == 1


@pytest.mark.parametrize("measure", ["kl", "reverse-kl"])
def test_without_its_ratio_the_rule_of_2023_is_that_of_2022(measure):
    for seed, bound in ((0, 0.03), (1, 0.2), (2, 1.0)):
        p = drawn(seed, 12, 2)
        first, second = adaptive(p, bound, measure=measure), adaptive_2023(p, None, bound, np.inf, measure)
        np.testing.assert_array_equal(first[1], second[1])
        np.testing.assert_allclose(first[0].P, second[0].P, rtol=1e-9)
        scaled = adaptive_2023(p._replace(w=7 * p.w), None, bound, 0.5, measure)
        np.testing.assert_array_equal(scaled[1], adaptive_2023(p, None, bound, 0.5, measure)[1])


@pytest.mark.parametrize("measure", ["kl", "reverse-kl"])
def test_the_relative_loss_of_the_result_stays_within_the_bound_and_one_merge_more_would_not(measure):
    p, cost = drawn(3, 10, 2), COSTS[MEASURES.index(measure)]

    def loss(origin):
        parts = [take(p, np.flatnonzero(origin == g)) for g in range(origin.max() + 1)]
        return sum(
            w * cost(m, P, *(a[0] for a in barycentre(part, measure)[1:]))
            for part in parts
            for w, m, P in zip(*part, strict=True)
        )

    whole = loss(np.zeros(10, int))
    q, origin = adaptive(p, 0.1, measure=measure)
    _, further = consistent(p, len(q.w) - 1, measure)
    assert loss(origin) <= 0.1 * whole < loss(further)


def test_two_groups_of_tight_clusters_become_two_components():
    rng = np.random.default_rng(0)
    m = np.repeat([0.0, 100.0], 5)[:, None] + 0.1 * rng.standard_normal((10, 1))
    p = mixture(np.full(10, 0.1), m, np.ones((10, 1, 1)))
    for measure in ("kl", "reverse-kl"):
        assert adaptive_2023(p, measure=measure)[1].tolist() == [0] * 5 + [1] * 5


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            partial(adaptive, loss_bound=0.1, measure="isd"),
            "measure must be one of kl, reverse-kl, got 'isd'",
        ),
        (partial(adaptive_2023, measure="isd"), "measure must be one of kl, reverse-kl, got 'isd'"),
        (partial(adaptive_2023, loss_bound=2), r"loss_bound must lie in \[0, 1\], got 2"),
        (partial(adaptive_2023, ratio=-1), "ratio must be a number, at least 0, got -1"),
        (partial(consistent, components=2, measure="l2"), "measure must be one of kl, reverse-kl"),
        (partial(prune_or_merge, components=0), "components must be at least 1, got 0"),
        (partial(prune_or_merge, components=1, sharpened="?"), "sharpened must be True or False, got '?'"),
    ],
)
def test_wrong_parameters_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call(crouse())


# ---- extremes ----


@pytest.mark.parametrize("name", GREEDY)
def test_weights_down_to_nothing_and_distances_of_1e8_deviations_are_merged_to_finite_numbers(name):
    far = mixture([0.5, 0.3, 0.2, 1e-300], [[0.0], [0.5], [1e8], [0.7]], [[[1.0]], [[2.0]], [[1.0]], [[3.0]]])
    for components in (3, 2):
        q, origin = GREEDY[name](far, components)
        assert all(np.isfinite(a).all() for a in q) and q.w.sum() == pytest.approx(1.0)
        assert origin[2] == components - 1  # the one far away stays alone
    sizes = mixture(np.full(5, 0.2), np.zeros((5, 1)), 10.0 ** np.linspace(-12, 12, 5)[:, None, None])
    q, _ = GREEDY[name](sizes, 2)
    assert len(q.w) == 2 and (q.P > 0).all()
