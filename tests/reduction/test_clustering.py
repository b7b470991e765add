"""Clusters are those of SciPy and of slow forms; every reduction keeps the moments of the mixture."""

from functools import partial
from itertools import combinations

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.integrate import quad
from scipy.spatial.distance import squareform
from test_runnalls import groups, mixtures, random_mixture

from gmr_gym.mixture import Mixture, collapsed, mixture, take
from gmr_gym.reduction.agglomeration import greedy_isd
from gmr_gym.reduction.clustering import LINKAGES, hierarchical, k_means, k_medoids
from gmr_gym.reduction.dissimilarity import MEASURES, dissimilarity
from gmr_gym.reduction.distances import correlation, integral_squared_difference

HIERARCHICAL = {
    f"{name} {measure}": partial(hierarchical, linkage=name, measure=measure)
    for name in LINKAGES
    for measure in MEASURES
}
MEDOIDS = {f"k_medoids {measure}": partial(k_medoids, measure=measure) for measure in MEASURES}
EVERY = HIERARCHICAL | MEDOIDS | {"k_means": k_means, "greedy_isd": greedy_isd}
every = pytest.mark.parametrize("reduce", EVERY.values(), ids=EVERY)


def whitened(p):
    """Means in coordinates where the whole mixture has unit covariance."""
    _, mean, P = reference.moment_match(*p)
    return np.linalg.solve(np.linalg.cholesky(P), (p.m - mean).T).T


def centres(w, y, labels):
    clusters = [labels == g for g in range(labels.max() + 1)]
    return np.array([np.average(y[c], axis=0, weights=w[c]) for c in clusters])


def scatter(w, y, labels):
    """Weighted sum of the squared distances from the centre of each cluster."""
    return w @ ((y - centres(w, y, labels)[labels]) ** 2).sum(axis=1)


def clumps(d, sizes=(4, 3, 5)):
    """Components of equal shape in clumps some 30 deviations apart, shuffled; and the clump of each."""
    rng = np.random.default_rng(d)
    which = rng.permutation(np.repeat(np.arange(len(sizes)), sizes))
    m = 30.0 * which[:, None] * np.ones(d) + 0.2 * rng.standard_normal((len(which), d))
    w = rng.uniform(0.8, 1.2, len(which))
    return mixture(w / w.sum(), m, np.tile(np.eye(d), (len(which), 1, 1))), which


# ---- dissimilarity ----


@pytest.mark.parametrize("seed", range(3))
def test_isd_is_the_integral_of_the_squared_change_of_the_whole_density(seed):
    p = random_mixture(seed, 4, 1, spread=1.5, total=2.0)
    table = dissimilarity(p, "isd")
    for i, j in combinations(range(len(p.w)), 2):
        both = np.array([i, j])
        rest, merged = take(p, np.delete(np.arange(4), both)), collapsed(take(p, both))

        def change(x, parts=(rest, merged)):
            before = sum(a * reference.gaussian_density([x], m, P) for a, m, P in zip(*p, strict=True))
            after = sum(
                a * reference.gaussian_density([x], m, P)
                for part in parts
                for a, m, P in zip(*part, strict=True)
            )
            return (before - after) ** 2

        # the quadrature is good to 1e-10 of a density of order one
        whole, _ = quad(change, -25, 25, points=sorted(p.m[:, 0]), epsabs=1e-12, limit=300)
        assert table[i, j] == pytest.approx(whole, rel=1e-8, abs=1e-10)


@pytest.mark.parametrize("d", [1, 2, 4, 6])
def test_every_dissimilarity_is_its_slow_form(d):
    p = random_mixture(d, 12, d, spread=1.5, total=2.0)
    tables = {measure: dissimilarity(p, measure) for measure in MEASURES}
    for i, j in combinations(range(len(p.w)), 2):
        pair = take(p, np.array([i, j]))
        # rounding is relative to the squares whose difference it is, to one, and to the logarithms
        square = sum(integral_squared_difference(take(p, [a]), Mixture(*empty(d))) for a in (i, j))
        slow = integral_squared_difference(pair, collapsed(pair))
        assert tables["isd"][i, j] == pytest.approx(slow, rel=1e-12, abs=1e-14 * square)
        slow = 1 - correlation(p.m[i], p.P[i], p.m[j], p.P[j])
        assert tables["correlation"][i, j] == pytest.approx(slow, abs=1e-14)
        assert tables["runnalls"][i, j] == pytest.approx(reference.merge_cost(*pair), rel=1e-10, abs=1e-14)


def empty(d):
    """A component that weighs nothing: the difference from it is the square of the rest."""
    return np.zeros(1), np.zeros((1, d)), np.eye(d)[None]


@settings(derandomize=True, deadline=None, max_examples=40)
@pytest.mark.parametrize("measure", MEASURES)
@given(p=mixtures())
def test_dissimilarity_is_symmetric_finite_never_negative_and_zero_to_itself(measure, p):
    table = dissimilarity(p, measure)
    assert table.shape == (len(p.w), len(p.w))
    np.testing.assert_array_equal(table, table.T)
    assert np.isfinite(table).all() and (table >= 0).all() and (np.diag(table) == 0).all()
    if measure == "correlation":
        assert (table <= 1).all()


@pytest.mark.parametrize("measure", MEASURES)
def test_equal_components_are_not_unlike_and_a_pair_without_weight_costs_nothing(measure):
    table = dissimilarity(take(random_mixture(0, 3, 4), np.array([0, 1, 1, 2])), measure)
    assert table[1, 2] == pytest.approx(0.0, abs=1e-15)  # a few roundings of numbers below one
    assert table[0, 3] > 1e-5
    weightless = random_mixture(0, 3, 2)._replace(w=np.array([0.0, 1.0, 0.0]))
    assert np.isfinite(dissimilarity(weightless, measure)).all()
    if measure != "correlation":
        # merging with what weighs nothing changes nothing, to a few roundings of numbers near one
        np.testing.assert_allclose(dissimilarity(weightless, measure), 0.0, atol=1e-15)


@pytest.mark.parametrize("measure", MEASURES)
def test_dissimilarity_is_the_same_far_from_the_origin(measure):
    near = random_mixture(2, 20, 4, spread=4.0)
    near = near._replace(m=np.round(near.m * 1024) / 1024, P=10 * near.P)
    far = near._replace(m=near.m + 2e5)  # on this grid the shift is exact, and so is the answer
    np.testing.assert_array_equal(dissimilarity(far, measure), dissimilarity(near, measure))


def test_dissimilarity_follows_the_units():
    p = random_mixture(3, 8, 4, total=1.0)
    heavier = p._replace(w=8 * p.w)
    for measure, factor in {"isd": 64, "correlation": 1, "runnalls": 8}.items():
        np.testing.assert_allclose(
            dissimilarity(heavier, measure), factor * dissimilarity(p, measure), rtol=1e-12
        )  # a power of two is exact but in a sum of logarithms


def test_what_lies_too_far_apart_is_refused_only_where_the_cost_is_unknown():
    m = np.array([[0.0, 0.0], [1.0, 1.0], [1e10, 1e10]])
    p = Mixture(np.full(3, 1 / 3), m, np.array([np.eye(2)] * 3))
    assert np.isposinf(dissimilarity(p, "runnalls")[2, :2]).all()
    assert groups(hierarchical(p, 2, measure="runnalls")[1]) == {frozenset({0, 1}), frozenset({2})}
    for reduce in (partial(hierarchical, components=1), partial(k_medoids, components=2)):
        with pytest.raises(ValueError, match="too far apart"):
            reduce(p, measure="runnalls")
    # merged over such a distance nothing overlaps any more: what is lost are the squares of both
    squares = np.full((2, 1), 2 / 9 / (4 * np.pi))
    np.testing.assert_allclose(dissimilarity(p, "isd")[:2, 2:], squares, rtol=1e-9)
    assert groups(greedy_isd(p, 2)[1]) == {frozenset({0, 1}), frozenset({2})}
    with pytest.raises(ValueError, match="too far apart"):  # of all three there is no definite covariance
        greedy_isd(p, 1)


# ---- hierarchical and greedy ----


@pytest.mark.parametrize("measure", MEASURES)
@pytest.mark.parametrize("name", LINKAGES)
def test_hierarchical_makes_the_clusters_of_scipy(name, measure):
    for seed, (n, d) in enumerate([(2, 1), (7, 2), (25, 4), (60, 3)]):
        p = random_mixture(seed, n, d, spread=1.5)
        tree = linkage(squareform(dissimilarity(p, measure), checks=False), name)
        for components in {1, 2, n // 3, n - 1} - {0}:
            labels = fcluster(tree, components, "maxclust")
            reduced, origin = hierarchical(p, components, name, measure)
            assert groups(origin) == groups(labels - 1)
            assert len(reduced.w) == components


@pytest.mark.parametrize("d", [1, 2, 4])
@pytest.mark.parametrize("components", [1, 3, 6])
def test_greedy_isd_merges_what_changes_the_whole_mixture_least(d, components):
    p = random_mixture(d, 7, d, spread=1.5, total=3.0)
    assert groups(greedy_isd(p, components)[1]) == slow_greedy(p, components)


def slow_greedy(p, components):
    """Every pair tried on every step, the whole mixture compared with what it becomes."""

    def square(f):
        """Integral of the square of a sum of components, weights of either sign."""
        return sum(
            a * b * reference.gaussian_density(x, y, P + Q) for a, x, P in f for b, y, Q in f
        )  # fmt: skip

    parts = [(frozenset([i]), component) for i, component in enumerate(zip(*p, strict=True))]
    while len(parts) > components:
        before, tried = [part for _, part in parts], {}
        for i, j in combinations(range(len(parts)), 2):
            both = [np.array(a) for a in zip(parts[i][1], parts[j][1], strict=True)]
            rest = [part for k, part in enumerate(parts) if k not in (i, j)]
            after = [*rest, (parts[i][0] | parts[j][0], reference.moment_match(*both))]
            minus = [(-w, m, P) for _, (w, m, P) in after]
            tried[i, j] = square(before + minus), after
        parts = min(tried.values(), key=lambda outcome: outcome[0])[1]
    return {group for group, _ in parts}


def test_greedy_isd_sees_that_a_merge_came_nearer_to_an_earlier_component():
    m, P = [[0.0], [-1.0], [1.0], [0.0]], [[[2.0]], [[1.0]], [[1.0]], [[4.75]]]
    p = mixture([0.5, 0.125, 0.125, 0.15], m, P)
    assert dissimilarity(p, "isd")[0].argsort().tolist() == [0, 3, 1, 2]
    assert greedy_isd(p, 3)[1].tolist() == [0, 1, 1, 2]  # whose moment match is N(0, 2), as the first
    assert greedy_isd(p, 2)[1].tolist() == [0, 0, 0, 1]


def test_greedy_isd_merges_about_the_mean_and_not_the_origin():
    near = random_mixture(0, 40, 2, spread=10.0)
    near = near._replace(m=4 * np.round(near.m / 4))
    far = near._replace(m=near.m + 2.0**54)  # exact on this grid, where a merged mean would not be
    np.testing.assert_array_equal(greedy_isd(far, 5)[1], greedy_isd(near, 5)[1])


# ---- k-means and k-medoids ----


def slow_start(w, y, k):
    starts = [int(np.argmax(w))]
    while len(starts) < k:
        d2 = ((y[:, None] - y[starts]) ** 2).sum(axis=2).min(axis=1)
        starts.append(int(np.argmax(w * d2)))
    return np.argmin(((y[:, None] - y[starts]) ** 2).sum(axis=2), axis=1)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("components", [1, 3, 7])
def test_k_means_is_a_fixed_point_no_worse_than_its_start(seed, components):
    p = random_mixture(seed, 40, 1 + seed % 4)
    y, (_, labels) = whitened(p), k_means(p, components)
    start, end = (scatter(p.w, y, a) for a in (slow_start(p.w, y, components), labels))
    assert end <= start * (1 + 1e-12)  # rounding of a sum of forty
    centre = centres(p.w, y, labels)
    d2 = ((y[:, None] - centre) ** 2).sum(axis=2)
    assert (d2[np.arange(40), labels] <= d2.min(axis=1) + 1e-12).all()  # rounding of numbers near one


def test_k_means_improves_on_its_start():
    p = random_mixture(5, 60, 2)
    y = whitened(p)
    assert scatter(p.w, y, k_means(p, 6)[1]) < 0.95 * scatter(p.w, y, slow_start(p.w, y, 6))


def test_k_means_empties_no_cluster_where_means_coincide():
    rng = np.random.default_rng(0)
    for _ in range(3000):  # rounding sends the last one of a cluster away in one of a thousand or so
        n = rng.integers(4, 12)
        m, w = (
            np.round(rng.standard_normal((n, 1)), 1)[rng.integers(n // 2, size=n)],
            10.0 ** rng.integers(-3, 1, n),
        )
        reduced, origin = k_means(Mixture(w, m, np.ones((n, 1, 1))), 4)
        assert sorted(set(origin)) == [0, 1, 2, 3] and np.isfinite(reduced.m).all()


def medoid_cost(table, weight, medoids):
    return weight @ table[:, medoids].min(axis=1)


@pytest.mark.parametrize("measure", MEASURES)
@pytest.mark.parametrize("components", [1, 3, 6])
def test_no_swap_and_no_alternate_step_improves_on_k_medoids(measure, components):
    for seed in range(4):
        p = random_mixture(seed, 14, 2, spread=1.5)
        table, labels = dissimilarity(p, measure), k_medoids(p, components, measure)[1]
        weight = p.w if measure == "correlation" else np.ones(14)
        clusters = [np.flatnonzero(labels == g) for g in range(components)]
        sums = [weight[c] @ table[np.ix_(c, c)] for c in clusters]
        medoids = [int(c[np.argmin(s)]) for c, s in zip(clusters, sums, strict=True)]
        cost = sum(s.min() for s in sums)
        # to a sum of fourteen: the swaps that the reduction makes gain more than 1e-12
        assert medoid_cost(table, weight, medoids) == pytest.approx(cost, rel=1e-11)
        for g in range(components):
            for x in range(14):
                swapped = [*medoids[:g], x, *medoids[g + 1 :]]
                assert medoid_cost(table, weight, swapped) >= cost * (1 - 1e-11)


def test_k_medoids_weighs_components_for_correlation():
    # two share one of the two medoids: the nearest pair, or the pair whose lighter one counts least
    p = mixture([1 / 3] * 3, [[0.0], [0.8], [2.0]], np.ones((3, 1, 1)))
    assert groups(k_medoids(p, 2, "correlation")[1]) == {frozenset({0, 1}), frozenset({2})}
    light = p._replace(w=np.array([0.495, 0.495, 0.01]))
    assert groups(k_medoids(light, 2, "correlation")[1]) == {frozenset({0}), frozenset({1, 2})}


# ---- all of them ----


@settings(derandomize=True, deadline=None, max_examples=25)
@every
@given(p=mixtures(), components=st.integers(1, 8))
def test_reduction_keeps_the_moments_of_the_whole_and_of_every_group(reduce, p, components):
    reduced, origin = reduce(p, components=components)
    alive = p.w > 0
    assert len(reduced.w) == min(alive.sum(), components)
    assert origin.shape == p.w.shape and (origin[~alive] == -1).all()
    assert set(origin[alive]) == set(range(len(reduced.w)))  # none empty, none beyond, none dropped
    parts = [take(p, alive), *(take(p, origin == i) for i in range(len(reduced.w)))]
    merged = [reduced, *(take(reduced, [i]) for i in range(len(reduced.w)))]
    for part, match in zip(parts, merged, strict=True):
        before, after = reference.moment_match(*part), reference.moment_match(*match)
        size = np.abs(before[2]).max()  # rounding is relative to the spread of the group
        assert after[0] == pytest.approx(before[0], rel=1e-12)
        np.testing.assert_allclose(after[1], before[1], rtol=0, atol=1e-10 * np.sqrt(size))
        np.testing.assert_allclose(after[2], before[2], rtol=0, atol=1e-10 * size)


@every
def test_order_of_components_does_not_matter(reduce):
    p = random_mixture(1, 20, 3)
    order = np.random.default_rng(1).permutation(20)
    _, origin = reduce(p, components=5)
    _, shuffled = reduce(take(p, order), components=5)
    assert {frozenset(order[list(group)].tolist()) for group in groups(shuffled)} == groups(origin)


@every
@pytest.mark.parametrize("d", [1, 2, 4])
def test_clumps_far_apart_are_found(reduce, d):
    p, which = clumps(d)
    assert groups(reduce(p, components=3)[1]) == groups(which)
    p, which = clumps(d, sizes=(3, 4))
    assert groups(reduce(p, components=2)[1]) == groups(which)


@every
def test_scans_far_from_the_origin_reduce_alike(reduce):
    near = random_mixture(4, 40, 4, spread=10.0)
    near = near._replace(P=10 * near.P)
    far = near._replace(m=near.m + 2e5)
    (at_origin, origin), (away, origin_away) = reduce(near, components=8), reduce(far, components=8)
    np.testing.assert_array_equal(origin, origin_away)
    # a mean of 2e5 is known to 3e-11, a covariance of 1e2 to that times a deviation of 10
    np.testing.assert_allclose(away.m - 2e5, at_origin.m, rtol=0, atol=1e-9)
    np.testing.assert_allclose(away.P, at_origin.P, rtol=0, atol=1e-8)


@every
def test_input_is_left_alone_and_weights_are_not_rescaled_behind_your_back(reduce):
    p = random_mixture(0, total=7.0)
    copies = [a.copy() for a in p]
    once, _ = reduce(p, components=3)
    for a, b in zip(p, copies, strict=True):
        np.testing.assert_array_equal(a, b)
    scaled, _ = reduce(p._replace(w=p.w * 4), components=3)  # a power of two: exact
    np.testing.assert_array_equal(scaled.w, 4 * once.w)


@every
def test_tiny_total_weight_groups_like_any_other(reduce):
    p = random_mixture(2, 20, 2)
    assert groups(reduce(p._replace(w=1e-300 * p.w), components=4)[1]) == groups(reduce(p, components=4)[1])


@every
def test_equal_components_and_single_ones_reduce_the_same_way_every_time(reduce):
    equal = take(random_mixture(0), np.zeros(6, int))
    reduced, origin = reduce(equal, components=3)
    assert len(reduced.w) == 3 and sorted(set(origin)) == [0, 1, 2]
    np.testing.assert_allclose(reduced.m, equal.m[:3], rtol=1e-14)  # a mean of equals, rounded
    np.testing.assert_array_equal(origin, reduce(equal, components=3)[1])
    one, origin = reduce(take(equal, [0]), components=1)
    assert origin.tolist() == [0]
    np.testing.assert_array_equal(one.P, equal.P[:1])


@every
def test_few_components_stay_as_they_are_but_for_those_that_weigh_nothing(reduce):
    p = random_mixture(6, 5, 2)
    reduced, origin = reduce(p, components=5)
    assert origin.tolist() == [0, 1, 2, 3, 4]
    for a, b in zip(reduced, p, strict=True):
        np.testing.assert_array_equal(a, b)
    reduced, origin = reduce(p._replace(w=np.array([1.0, 0.0, 2.0, 3.0, 0.0])), components=3)
    assert origin.tolist() == [0, -1, 1, 2, -1]
    np.testing.assert_array_equal(reduced.m, p.m[[0, 2, 3]])


@every
def test_a_component_of_almost_no_weight_beside_heavy_ones_stays_harmless(reduce):
    p = random_mixture(3, 8, 2)
    p = p._replace(w=np.array([1e-300, 5e8, 1e-300, 1e9, 1e-320, 2e9, 1e-300, 1e-310]))
    reduced, origin = reduce(p, components=3)
    assert len(reduced.w) == 3 and set(origin) == {0, 1, 2}
    assert all(np.isfinite(a).all() for a in reduced)


def test_greedy_isd_merges_the_lightest_and_not_the_heavy_ones_beside_them():
    p = mixture([1e-320, 1e-320, 1e9, 2e9], [[0.0], [5.0], [20.0], [20.1]], np.ones((4, 1, 1)))
    assert groups(greedy_isd(p, 2)[1]) == {frozenset({0, 1, 2}), frozenset({3})}


@pytest.mark.parametrize("power", [-990, -500, 400, 520, 900, 993])
@pytest.mark.parametrize("name", EVERY)
def test_only_the_ratios_of_weights_matter_to_a_merge(name, power):
    p = random_mixture(3, 8, 2)
    scaled = p._replace(w=np.ldexp(p.w, power))
    (one, origin), (other, again) = EVERY[name](p, components=3), EVERY[name](scaled, components=3)
    np.testing.assert_array_equal(again, origin)
    np.testing.assert_allclose(np.ldexp(other.w, -power), one.w, rtol=1e-14)
    np.testing.assert_allclose(other.P, one.P, rtol=1e-12)


def test_weights_that_no_sum_holds_are_refused_by_name():
    p = random_mixture(3, 8, 2)
    heavy = p._replace(w=np.full(8, 3e299))
    for reduce in EVERY.values():
        with pytest.raises(ValueError, match=r"p\.w must be finite and .* sum to no more than 1e\+300"):
            reduce(heavy, components=3)


def test_bad_arguments_are_refused_by_name():
    p = random_mixture(0, 2, 2)  # refused even where nothing is left to reduce
    for reduce in EVERY.values():
        with pytest.raises(ValueError, match="components must be at least 1, got 0"):
            reduce(p, components=0)
        with pytest.raises(ValueError, match=r"components must be a whole number, got 2\.5"):
            reduce(p, components=2.5)
    wanted = "measure must be one of isd, correlation, runnalls, got 'euclid'"
    for refused in (dissimilarity, partial(hierarchical, components=3), partial(k_medoids, components=3)):
        with pytest.raises(ValueError, match=wanted):
            refused(p, measure="euclid")
    with pytest.raises(ValueError, match="linkage must be one of average, complete, single, got 'ward'"):
        hierarchical(p, 3, linkage="ward")


@pytest.mark.parametrize("measure", MEASURES)
def test_a_covariance_that_is_not_definite_is_refused(measure):
    p = random_mixture(0, 3, 2)._replace(P=np.array([np.eye(2), np.diag([1.0, -1.0]), np.eye(2)]))
    with pytest.raises(ValueError, match=r"p.P\[1\] must be positive definite"):
        dissimilarity(p, measure)


def test_weights_whose_squares_overflow_are_refused_where_squares_are_asked_for():
    p = random_mixture(0, 3, 2)
    heavy = p._replace(w=1e200 * p.w)
    with pytest.raises(ValueError, match=r"isd has squares of weights beyond.*pass normalised\(p\)"):
        dissimilarity(heavy, "isd")
    for measure in ("correlation", "runnalls"):
        assert np.isfinite(dissimilarity(heavy, measure)).all()
