"""What merging keeps, what pruning drops, and that the fast forms are the slow ones."""

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st

from gmr_gym.mixture import Mixture, take
from gmr_gym.reduction.pruning import capping, prune, prune_and_cap, prune_density
from gmr_gym.reduction.runnalls import adaptive, runnalls, total_merge_cost
from gmr_gym.reduction.salmond_west import salmond, west
from gmr_gym.reduction.vo_ma import vo_ma

MERGING = {
    "runnalls": lambda p: runnalls(p, 3),
    "runnalls to one": lambda p: runnalls(p, 1),
    "adaptive": lambda p: adaptive(p, 0.3),
    "adaptive and capped": lambda p: adaptive(p, 0.01, components=2),
    "salmond": lambda p: salmond(p, 3),
    "salmond by distance": lambda p: salmond(p, 50, distance=0.1 * p.w.sum()),
    "west": lambda p: west(p, 3),
}
DROPPING = {
    "capping": lambda p: capping(p, 3),
    "prune": lambda p: prune(p, 0.1 * p.w.sum()),
    "heaviest": lambda p: prune_and_cap(p, 0.05 * p.w.sum(), 4),
    "prune_density": lambda p: prune_density(p, 0.05 * p.w.sum()),
}
EVERY = MERGING | DROPPING


def random_mixture(seed, n=12, d=2, **kwargs):
    return Mixture(*reference.random_mixture(np.random.default_rng(seed), n, d, **kwargs))


def groups(origin):
    """Sets of inputs that flowed into one output."""
    return {frozenset(np.flatnonzero(origin == i).tolist()) for i in range(origin.max() + 1)}


@st.composite
def mixtures(draw):
    """Of every size, total weight and spread; some components repeated, some of weight zero."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n, d = draw(st.integers(1, 15)), draw(st.sampled_from([1, 2, 3, 4, 6]))
    total, spread = draw(st.sampled_from([1.0, 1e-300, 1e-9, 40.0])), draw(st.sampled_from([0.0, 3.0, 1e4]))
    p = Mixture(*reference.random_mixture(rng, n, d, spread, total))
    if draw(st.booleans()):
        p = take(p, rng.integers(n, size=n))
    if draw(st.booleans()) and n > 1:
        w = p.w.copy()
        w[rng.integers(n)] = 0.0
        p = p._replace(w=w)
    return p


@settings(derandomize=True, deadline=None, max_examples=40)
@pytest.mark.parametrize("reduce", MERGING.values(), ids=MERGING)
@given(p=mixtures())
def test_merging_keeps_total_weight_mean_and_covariance(reduce, p):
    reduced, _ = reduce(p)
    before, after = reference.moment_match(*p), reference.moment_match(*reduced)
    size = np.abs(before[2]).max()  # rounding is relative to the spread of the mixture
    assert after[0] == pytest.approx(before[0], rel=1e-12)
    np.testing.assert_allclose(after[1], before[1], rtol=0, atol=1e-10 * np.sqrt(size))
    np.testing.assert_allclose(after[2], before[2], rtol=0, atol=1e-10 * size)


@settings(derandomize=True, deadline=None, max_examples=25)
@pytest.mark.parametrize("reduce", EVERY.values(), ids=EVERY)
@given(p=mixtures())
def test_origin_names_the_inputs_of_every_output(reduce, p):
    reduced, origin = reduce(p)
    assert origin.shape == p.w.shape
    assert set(origin) - {-1} == set(range(len(reduced.w)))  # none empty, none beyond
    assert (origin[p.w == 0] == -1).all()
    for i, (w, m, P) in enumerate(zip(*reduced, strict=True)):
        total, mean, covariance = reference.moment_match(*take(p, origin == i))
        size = np.abs(covariance).max()
        assert w == pytest.approx(total, rel=1e-12)
        np.testing.assert_allclose(m, mean, rtol=0, atol=1e-10 * np.sqrt(size))
        np.testing.assert_allclose(P, covariance, rtol=0, atol=1e-10 * size)


@pytest.mark.parametrize("reduce", EVERY.values(), ids=EVERY)
def test_input_is_left_alone_and_weights_are_not_rescaled_behind_your_back(reduce):
    p = random_mixture(0, total=7.0)
    copies = [a.copy() for a in p]
    once, _ = reduce(p)
    for a, b in zip(p, copies, strict=True):
        assert (a == b).all()
    scaled, _ = reduce(p._replace(w=p.w * 4))  # a power of two: exact
    np.testing.assert_array_equal(scaled.w, 4 * once.w)


@pytest.mark.parametrize("reduce", EVERY.values(), ids=EVERY)
def test_order_of_components_does_not_matter(reduce):
    p = random_mixture(1)
    order = np.random.default_rng(1).permutation(len(p.w))
    _, origin = reduce(p)
    _, shuffled = reduce(take(p, order))
    there = {frozenset(order[list(group)].tolist()) for group in groups(shuffled)}
    assert there == groups(origin)


@pytest.mark.parametrize("d", [1, 2, 3, 4, 6])
@pytest.mark.parametrize(("n", "components"), [(20, 1), (20, 5), (35, 12)])
def test_runnalls_makes_the_merges_of_the_naive_search(d, n, components):
    p = random_mixture(100 * n + d, n, d, spread=1.5, total=3.0)
    reduced, origin = runnalls(p, components)
    wanted, mix, _ = reference.runnalls(*p, components)
    assert groups(origin) == wanted
    assert sorted(reduced.w) == pytest.approx(sorted(mix[0]), rel=1e-12)


def test_runnalls_makes_the_naive_merges_across_a_block_of_costs():
    p = random_mixture(7, 140, 2, spread=8.0)
    p.m[120:] *= 0.02  # the cheapest pairs lie on both sides of 128, where a block of costs ends
    wanted = reference.runnalls(*p, 137)[0]
    assert {len({i // 128 for i in group}) for group in wanted if len(group) > 1} == {1, 2}
    assert groups(runnalls(p, 137)[1]) == wanted


@pytest.mark.parametrize("d", [1, 2, 4])
@pytest.mark.parametrize("loss_bound", [0.01, 0.1, 0.4, 0.9])
@pytest.mark.parametrize("components", [None, 4])
def test_adaptive_makes_the_merges_of_algorithm_1(d, loss_bound, components):
    p = random_mixture(d, 15, d, total=0.3)
    wanted, _, costs = reference.adaptive(*p, loss_bound, components)
    assert groups(adaptive(p, loss_bound, components)[1]) == wanted
    if components is None:
        assert sum(costs) <= loss_bound * total_merge_cost(p)


@pytest.mark.parametrize("d", [1, 2, 4])
@pytest.mark.parametrize("components", [1, 4, 9])
def test_salmond_and_west_make_the_merges_of_their_slow_forms(d, components):
    p = random_mixture(d, 15, d)
    assert groups(salmond(p, components)[1]) == reference.salmond(*p, components)
    assert groups(west(p, components)[1]) == reference.west(*p, components)
    by_distance = reference.salmond(*p, 12, distance=0.02)
    assert groups(salmond(p, 12, distance=0.02)[1]) == by_distance and len(by_distance) < 12


@pytest.mark.parametrize("d", [1, 2, 4])
def test_runnalls_costs_add_up_to_the_total_merge_cost_in_any_order_of_merging(d):
    p = random_mixture(d, 10, d, total=5.0)
    whole = total_merge_cost(p)
    assert whole == pytest.approx(reference.merge_cost(*p), rel=1e-10)
    paid, at = 0.0, p
    for components in range(9, 0, -1):
        reduced, origin = runnalls(at, components)
        (pair,) = (g for g in groups(origin) if len(g) == 2)
        paid += reference.merge_cost(*take(at, np.array(sorted(pair))))
        at = reduced
    assert paid == pytest.approx(whole, rel=1e-10)
    paid, at, rng = 0.0, p, np.random.default_rng(d)
    while len(at.w) > 1:
        i, j = rng.choice(len(at.w), 2, replace=False)
        pair = take(at, np.array([i, j]))
        paid += reference.merge_cost(*pair)
        merged = [np.array([a]) for a in reference.moment_match(*pair)]
        rest = take(at, np.delete(np.arange(len(at.w)), [i, j]))
        at = Mixture(*map(np.concatenate, zip(rest, merged, strict=True)))
    assert paid == pytest.approx(whole, rel=1e-10)


@settings(derandomize=True, deadline=None, max_examples=40)
@given(p=mixtures())
def test_adaptive_with_loss_bound_one_leaves_one_component(p):
    assert len(adaptive(p, 1.0)[0].w) == 1


@pytest.mark.parametrize("d", [1, 2, 4])
def test_adaptive_with_loss_bound_zero_merges_no_distinct_components(d):
    p = random_mixture(d, 20, d)
    reduced, origin = adaptive(p, 0.0)
    assert sorted(origin.tolist()) == list(range(20))
    np.testing.assert_array_equal(np.sort(reduced.w), np.sort(p.w))


def test_adaptive_keeps_fewer_the_more_it_may_lose_and_goes_on_past_the_bound_to_a_cap():
    p = random_mixture(2, 30, 4)
    sizes = [len(adaptive(p, bound)[0].w) for bound in (0, 0.01, 0.05, 0.2, 0.5, 1)]
    assert sizes == sorted(sizes, reverse=True) and len(set(sizes)) > 3
    assert len(adaptive(p, 0.0, components=5)[0].w) == 5
    # within the cap the bound alone decides
    np.testing.assert_array_equal(adaptive(p, 0.2, components=29)[1], adaptive(p, 0.2)[1])


def test_merging_two_equal_components_costs_nothing_and_comes_first():
    p = random_mixture(3, 6, 4)
    twice = take(p, np.array([0, 1, 2, 3, 4, 5, 2]))
    assert frozenset({2, 6}) in groups(runnalls(twice, 6)[1])
    assert groups(adaptive(twice, 1e-12)[1]) == groups(runnalls(twice, 6)[1])
    assert total_merge_cost(take(p, np.array([1, 1, 1]))) == pytest.approx(0, abs=1e-14)


@pytest.mark.parametrize("d", [1, 2, 4, 6])
def test_runnalls_stands_degenerate_mixtures(d):
    base = random_mixture(d, 8, d)
    vanishing = base._replace(w=base.w * np.array([1, 1e-300, 1, 1e-300, 1, 1e-250, 1, 1]))
    stretch = np.diag(np.logspace(-3, 3, d))  # the square: condition number 1e12
    stretched = base._replace(m=base.m @ stretch, P=stretch @ base.P @ stretch)
    assert groups(runnalls(stretched, 3)[1]) == reference.runnalls(*base, 3)[0]  # B is invariant
    for p in (vanishing, stretched, take(base, np.zeros(8, int)), take(base, np.array([2]))):
        reduced, _ = runnalls(p, 3)
        assert len(reduced.w) == min(3, len(p.w)) and np.isfinite(reduced.P).all()
        np.linalg.cholesky(reduced.P)
        # ties leave open which merge, not what they cost in all
        costs = reference.runnalls(*p, 3)[2]
        paid = total_merge_cost(p) - total_merge_cost(reduced)
        assert paid == pytest.approx(sum(costs), rel=1e-6, abs=1e-9)


def test_total_merge_cost_is_the_weighted_divergence_from_the_one_gaussian():
    p = random_mixture(5, 6, 3, total=2.0)
    _, mean, P = reference.moment_match(*p)
    divergence = [
        0.5 * (np.trace(np.linalg.solve(P, A)) - 3 + (m - mean) @ np.linalg.solve(P, m - mean)
               + np.linalg.slogdet(P)[1] - np.linalg.slogdet(A)[1])
        for m, A in zip(p.m, p.P, strict=True)
    ]  # fmt: skip
    assert total_merge_cost(p) == pytest.approx(p.w @ divergence, rel=1e-12)


def test_runnalls_leaves_a_mixture_within_its_number_alone():
    p = random_mixture(6, 5, 2)
    reduced, origin = runnalls(p, 5)
    assert origin.tolist() == [0, 1, 2, 3, 4]
    for a, b in zip(reduced, p, strict=True):
        np.testing.assert_array_equal(a, b)


def test_capping_keeps_the_heaviest_in_their_order_and_the_earlier_of_equals():
    p = random_mixture(0, 5, 1)._replace(w=np.array([0.1, 0.3, 0.2, 0.3, 0.1]))
    reduced, origin = capping(p, 2)
    assert origin.tolist() == [-1, 0, -1, 1, -1] and reduced.w.tolist() == [0.3, 0.3]
    assert capping(p, 4)[1].tolist() == [0, 1, 2, 3, -1]
    np.testing.assert_array_equal(reduced.m, p.m[[1, 3]])
    many = random_mixture(0, 200, 1)._replace(w=np.tile([0.001, 0.002], 100))
    kept = np.flatnonzero(capping(many, 130)[1] >= 0)
    assert kept.tolist() == sorted([*range(1, 200, 2), *range(0, 60, 2)])


def test_prune_drops_what_is_lighter_but_never_the_heaviest():
    p = random_mixture(0, 4, 1)._replace(w=np.array([0.1, 0.4, 0.2, 0.0]))
    assert prune(p, 0.2)[1].tolist() == [-1, 0, 1, -1]  # the bound itself stays
    assert prune(p, 0.5)[1].tolist() == [-1, 0, -1, -1]
    assert prune(p, 0.0)[1].tolist() == [0, 1, 2, -1]
    assert prune(p, 0.2)[0].w.tolist() == [0.4, 0.2]


def test_heaviest_prunes_first_and_caps_what_is_left():
    p = random_mixture(0, 6, 1)._replace(w=np.array([0.05, 0.3, 0.15, 0.3, 0.0, 0.2]))
    for weight, most, wanted in (
        (0.1, 2, [-1, 0, -1, 1, -1, -1]),
        (0.1, 3, [-1, 0, -1, 1, -1, 2]),
        (0.1, 9, [-1, 0, 1, 2, -1, 3]),
        (0.0, 9, [0, 1, 2, 3, -1, 4]),
        (0.25, 1, [-1, 0, -1, -1, -1, -1]),
        (0.5, 3, [-1, 0, -1, -1, -1, -1]),  # never nothing
    ):
        kept, origin = prune_and_cap(p, weight, most)
        assert origin.tolist() == wanted
        for a, b in zip(kept, take(p, origin >= 0), strict=True):
            np.testing.assert_array_equal(a, b)


def test_prune_density_compares_the_peak_of_each_component():
    p = random_mixture(0, 3, 2)._replace(
        w=np.array([0.5, 0.1, 0.4]), P=np.array([100.0, 0.01, 1.0])[:, None, None] * np.eye(2)
    )  # w / sqrt|P| is 0.005, 10 and 0.4
    assert prune_density(p, 1.0)[1].tolist() == [-1, 0, -1]
    assert prune_density(p, 0.4)[1].tolist() == [-1, 0, 1]
    assert prune_density(p, 100.0)[1].tolist() == [0, -1, -1]  # the heaviest, not the highest
    assert prune_density(p, 0.0)[1].tolist() == [0, 1, 2]


@pytest.mark.parametrize("reduce", [runnalls, capping, salmond, west])
def test_fewer_than_one_component_is_refused(reduce):
    with pytest.raises(ValueError, match="components must be at least 1, got 0"):
        reduce(random_mixture(0), 0)


@pytest.mark.parametrize("bound", [-0.1, 1.1, np.nan])
def test_loss_bound_is_a_share(bound):
    with pytest.raises(ValueError, match=r"loss_bound must lie in \[0, 1\]"):
        adaptive(random_mixture(0), bound)
    with pytest.raises(ValueError, match="components must be at least 1"):
        adaptive(random_mixture(0), 0.5, components=0)


def test_a_budget_of_two_and_a_half_components_is_refused():
    with pytest.raises(ValueError, match=r"components must be a whole number, got 2\.5"):
        runnalls(Mixture(np.full(2, 0.5), np.eye(2), np.array([np.eye(2)] * 2)), 2.5)


@pytest.mark.parametrize("value", [np.nan, -1e-9, "x", None, 1j])
@pytest.mark.parametrize(
    ("reduce", "name"),
    [
        (lambda p, value: prune(p, value), "weight"),
        (lambda p, value: prune_density(p, value), "density"),
        (lambda p, value: prune_and_cap(p, value, 3), "weight"),
        (lambda p, value: prune_and_cap(p, 0.0, value), "max_components"),
        (lambda p, value: salmond(p, 1, value), "distance"),
        (lambda p, value: vo_ma(p, 1, value), "distance"),
    ],
)
def test_a_threshold_that_is_none_is_refused_by_name(reduce, name, value):
    p = Mixture(*reference.random_mixture(np.random.default_rng(0), 4, 2))
    with pytest.raises(ValueError, match=f"^{name} must be"):
        reduce(p, value)
