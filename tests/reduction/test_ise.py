"""The cached greedy choices are those of evaluating every candidate from nothing."""

from functools import lru_cache
from itertools import combinations

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference import moment_match, random_mixture

from gmr_gym.mixture import Mixture, checked, mixture, moments, take
from gmr_gym.reduction.distances import inner_product, integral_squared_difference
from gmr_gym.reduction.ise import integral_squared_error


def scattered(rng, n, d):
    return Mixture(*random_mixture(rng, n, d, spread=1.5))


def clustered(rng, n, d):
    """Three clumps far apart, which do not feel each other."""
    p = scattered(rng, n, d)
    return p._replace(m=0.3 * p.m + 40.0 * (np.arange(n) % 3)[:, None])


def level(rng, n, d):
    """Weights that differ by a thousandth: hardly a cost stands out."""
    return scattered(rng, n, d)._replace(w=(1 + 1e-3 * rng.random(n)) / n)


def uneven(rng, n, d):
    """Weights over six decades, as after many missed detections."""
    return scattered(rng, n, d)._replace(w=10.0 ** -rng.uniform(0, 6, n))


def crowded(rng, n, d):
    """One covariance and nearly one mean, as after a short time in dense clutter."""
    p = scattered(rng, n, d)
    return Mixture(p.w, 0.4 * p.m, np.broadcast_to(p.P[0], p.P.shape).copy())


def siblings(rng, n, d):
    """Fours that share a covariance, as the children of one hypothesis do."""
    p = scattered(rng, n, d)
    return p._replace(P=p.P[np.arange(n) // 4])


KINDS = [scattered, clustered, level, uneven, crowded, siblings]


def gram(p, q):
    """Integrals (n, k) of the products of the components of p and q."""
    S = p.P[:, None] + q.P
    e = (p.m[:, None] - q.m)[..., None]
    d2 = (e * np.linalg.solve(S, e)).sum((-2, -1))
    return np.exp(-0.5 * d2) / np.sqrt(np.linalg.det(2 * np.pi * S))


def difference(p, q):
    """Integral of (p - q)^2."""
    return p.w @ gram(p, p) @ p.w - 2 * p.w @ gram(p, q) @ q.w + q.w @ gram(q, q) @ q.w


def candidates(groups):
    """The groups of inputs that one deletion or one merge makes of `groups`."""
    for k in range(len(groups)):
        yield groups[:k] + groups[k + 1 :]
    for a, b in combinations(range(len(groups)), 2):
        yield [*groups[:a], groups[a] + groups[b], *groups[a + 1 : b], *groups[b + 1 :]]


def matched(p, groups, renormalise):
    """One component for each group of inputs, rescaled to the weight of p where asked for."""
    parts = [moment_match(p.w[g], p.m[g], p.P[g]) for g in groups]
    w, m, P = (np.array(a) for a in zip(*parts, strict=True))
    return Mixture(w * (p.w.sum() / w.sum() if renormalise else 1.0), m, P)


def brute_force(p, components, renormalise):
    """Williams' reduction with each candidate's cost evaluated from scratch."""
    groups = [[i] for i in range(len(p.w))]
    while len(groups) > components:
        groups = min(candidates(groups), key=lambda g: difference(p, matched(p, g, renormalise)))
    origin = np.full(len(p.w), -1)
    for slot, group in enumerate(groups):
        origin[group] = slot
    return matched(p, groups, renormalise), origin


def exactly(p):
    """The components of p, each w, m, P, in numbers of 60 digits, more when the work precision is more."""
    return [(mp.mpf(float(w)), mp.matrix(m), mp.matrix(P)) for w, m, P in zip(*p, strict=True)]


def exact_match(parts):
    w = mp.fsum(part[0] for part in parts)
    m = sum((wi / w * mi for wi, mi, _ in parts), 0 * parts[0][1])
    return w, m, sum((wi / w * (Pi + (mi - m) * (mi - m).T) for wi, mi, Pi in parts), 0 * parts[0][2])


def exact_candidates(p, components, renormalise, forbidden=lambda match: False):
    """At each step down to `components`: the groups of every action by its cost, and the cheapest is made."""

    @lru_cache(None)
    def match(group):
        return exact_match([p[i] for i in group])

    @lru_cache(None)
    def product(a, b):
        (_, m1, P1), (_, m2, P2) = match(a), match(b)
        S, e = P1 + P2, m1 - m2
        return mp.exp(-(e.T * S**-1 * e)[0] / 2) / mp.sqrt(mp.det(2 * mp.pi * S))

    def cost(groups):
        total = mp.fsum(w for w, _, _ in p)
        scale = total / mp.fsum(match(g)[0] for g in groups) if renormalise else 1
        terms = [(w, (i,)) for i, (w, _, _) in enumerate(p)] + [(-scale * match(g)[0], g) for g in groups]
        return mp.fsum(u * v * product(a, b) for u, a in terms for v, b in terms)

    groups = [(i,) for i in range(len(p))]
    while len(groups) > components:
        able = [g for g in candidates_of(groups) if not any(len(x) > 1 and forbidden(match(x)) for x in g)]
        groups = yield {tuple(g): cost(g) for g in able}


def candidates_of(groups):
    return [[tuple(g) for g in c] for c in candidates([list(g) for g in groups])]


def drowned(match):
    """Whether floats cannot hold the covariance."""
    P = np.array(match[2].tolist(), float)
    return np.linalg.eigvalsh(P)[0] < 1e-14 * np.linalg.eigvalsh(P)[-1]


def exact_greedy(p, components, renormalise):
    """Groups of Williams' reduction in exact arithmetic, merges left out that floats cannot hold."""
    steps = exact_candidates(exactly(p), components, renormalise, drowned)
    costs = next(steps)
    while True:
        groups = min(costs, key=costs.get)
        try:
            costs = steps.send(list(groups))
        except StopIteration:
            return {frozenset(g) for g in groups}


def rounding(p):
    """What the cancellation in a difference leaves of its terms."""
    return 1e-14 * inner_product(p, p)


@pytest.mark.parametrize("renormalise", [True, False])
@pytest.mark.parametrize("d", [1, 2, 4, 6])
@pytest.mark.parametrize("kind", KINDS)
def test_every_choice_is_that_of_evaluating_all_candidates(kind, d, renormalise):
    for seed in range(3):
        p = kind(np.random.default_rng([seed, d]), 8, d)
        expected, groups = brute_force(p, 3, renormalise)
        q, origin = integral_squared_error(p, 3, renormalise)
        assert origin.tolist() == groups.tolist()
        for got, wanted in zip(q, expected, strict=True):
            np.testing.assert_allclose(got, wanted, rtol=1e-9, atol=1e-12)
        cost = integral_squared_difference(p, q)
        assert cost == pytest.approx(difference(p, expected), rel=1e-9, abs=rounding(p))


@pytest.mark.parametrize("d", [4, 6])
@pytest.mark.parametrize("kind", KINDS)
def test_choices_stay_those_of_all_candidates_over_many_steps(kind, d):
    p = kind(np.random.default_rng(7), 16, d)
    assert integral_squared_error(p, 2)[1].tolist() == brute_force(p, 2, True)[1].tolist()


def test_choices_are_those_of_all_candidates_among_more_pairs_than_a_block_holds():
    p = level(np.random.default_rng(1), 20, 6)
    assert integral_squared_error(p, 18)[1].tolist() == brute_force(p, 18, True)[1].tolist()


@given(st.integers(0, 2**32 - 1), st.sampled_from(KINDS), st.integers(1, 12), st.booleans())
@settings(max_examples=60, deadline=None)
def test_outputs_are_moment_matches_of_their_inputs(seed, kind, components, renormalise):
    p = kind(np.random.default_rng(seed), 12, 3)
    p = p._replace(w=2.5 * p.w)  # an expected number of targets, say
    q, origin = integral_squared_error(p, components, renormalise)
    assert len(q.w) <= components
    assert set(origin) - {-1} == set(range(len(q.w)))
    scale = p.w.sum() / p.w[origin >= 0].sum() if renormalise else 1.0
    for slot in range(len(q.w)):
        inputs = take(p, origin == slot)
        mean, covariance = moments(inputs)
        assert q.w[slot] == pytest.approx(scale * inputs.w.sum(), rel=1e-12)
        np.testing.assert_allclose(q.m[slot], mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(q.P[slot], covariance, rtol=1e-9, atol=1e-9)


@given(st.integers(0, 2**32 - 1), st.sampled_from([scattered, clustered, uneven]))
@settings(max_examples=30, deadline=None)
def test_order_and_total_weight_do_not_matter(seed, kind):
    rng = np.random.default_rng(seed)
    p, order = kind(rng, 12, 2), rng.permutation(12)
    origin = integral_squared_error(p, 4)[1]
    shuffled = integral_squared_error(take(p, order)._replace(w=16.0 * p.w[order]), 4)[1]
    groups = {frozenset(np.flatnonzero(origin == slot)) for slot in range(-1, 4)}
    assert groups == {frozenset(order[shuffled == slot]) for slot in range(-1, 4)}


def test_going_on_from_more_components_is_going_straight_to_fewer():
    p = scattered(np.random.default_rng(3), 20, 4)
    coarse, fine = (integral_squared_error(p, components)[1] for components in (3, 8))
    for slot in range(8):
        assert len(set(coarse[fine == slot])) == 1
    assert (coarse[fine == -1] == -1).all()


@pytest.mark.parametrize("renormalise", [True, False])
@pytest.mark.parametrize("d", [1, 6])
def test_equal_components_collapse_without_loss(d, renormalise):
    one = scattered(np.random.default_rng(d), 1, d)
    p = Mixture(np.full(9, 1 / 9), *(np.repeat(a, 9, axis=0) for a in one[1:]))
    for components in (5, 1):
        q, _ = integral_squared_error(p, components, renormalise)
        assert len(q.w) == components
        # with deletions rescaled, to delete a double is as good as to merge it
        assert integral_squared_difference(p, q) <= rounding(p)


def beside_a_heavy_one(seed, decades):
    """Three on a line, two of which weigh about 10**-decades of the other."""
    rng = np.random.default_rng([seed, decades])
    w = np.array([1.0, *(10.0**-decades * rng.uniform(0.5, 2, 2))])[rng.permutation(3)]
    return mixture(w / w.sum(), rng.normal(0, 8, (3, 1)), rng.uniform(0.3, 3, (3, 1, 1)))


@pytest.mark.parametrize("decades", range(6, 17))
def test_beside_a_heavy_component_a_light_one_goes_or_is_merged(decades):
    for seed in range(50):
        p = beside_a_heavy_one(seed, decades)
        q, origin = integral_squared_error(p, 2)
        heavy, light = np.argmax(p.w), 10.0**-decades
        assert origin[heavy] >= 0
        assert q.w.sum() == pytest.approx(p.w.sum(), rel=1e-15)
        np.testing.assert_allclose(moments(q)[0], moments(p)[0], rtol=0, atol=300 * light + 1e-14)


@pytest.mark.parametrize("decades", [6, 9, 12])
def test_beside_a_heavy_component_the_choice_costs_what_the_cheapest_does_to_rounding(decades):
    with mp.workdps(60):
        for seed in range(8):
            p = beside_a_heavy_one(seed, decades)
            origin = integral_squared_error(p, 2)[1]
            costs = next(exact_candidates(exactly(p), 2, True))
            made = tuple(tuple(np.flatnonzero(origin == slot).tolist()) for slot in range(2))
            assert costs[made] - min(costs.values()) <= rounding(p)


def test_two_very_light_components_do_not_take_the_place_of_the_heaviest():
    w = np.array([3e-16, 1.0, 3e-16])
    p = mixture(w / w.sum(), [[-7.0], [10.0], [-4.0]], [[[1.0]]] * 3)
    q, origin = integral_squared_error(p, 2)
    assert q.w.sum() == pytest.approx(1.0, rel=1e-15) and q.m[origin[1], 0] == pytest.approx(10.0)
    assert moments(q)[0] == pytest.approx([10.0], rel=1e-14)


def test_many_deletions_in_a_row_keep_the_total_weight():
    p = mixture(
        0.7 ** np.arange(120), np.zeros((120, 1)), np.ones((120, 1, 1))
    )  # the first goes at equal cost
    q, _ = integral_squared_error(p, 1)
    assert q.w.sum() == pytest.approx(p.w.sum(), rel=1e-13)


@pytest.mark.parametrize("renormalise", [True, False])
@pytest.mark.parametrize("variance", [1e-8, 1e-17, 1e-18, 1e-24, 1e-60])
def test_components_many_deviations_apart_are_chosen_as_in_exact_arithmetic(variance, renormalise):
    for seed in range(4):
        rng = np.random.default_rng(seed)
        n = 3 + seed % 2
        P = variance * rng.uniform(1, 7, n)[:, None, None] * np.eye(2)
        p = mixture(rng.dirichlet(np.ones(n)), rng.uniform(-8, 8, (n, 2)), P)
        q, origin = integral_squared_error(p, 1, renormalise)
        checked(q)
        with mp.workdps(100):
            assert {frozenset(np.flatnonzero(origin == 0).tolist())} == exact_greedy(p, 1, renormalise)


def test_a_density_whose_square_floats_cannot_hold_is_refused():
    p = Mixture(np.ones(3), np.arange(12.0).reshape(3, 4), np.tile(1e-200 * np.eye(4), (3, 1, 1)))
    with pytest.raises(ValueError, match="outside the range of floats: choose units nearer"):
        integral_squared_error(p, 1)


@pytest.mark.parametrize("renormalise", [True, False])
@pytest.mark.parametrize("weight", [0.0, 1e-300, 1e-20])
def test_weights_too_small_to_matter_cost_nothing(weight, renormalise):
    p = scattered(np.random.default_rng(5), 10, 4)
    p = p._replace(w=np.where(np.arange(10) % 2, p.w, weight))
    q, origin = integral_squared_error(p, 5, renormalise)
    assert np.isfinite(q.w).all() and np.isfinite(q.m).all() and np.isfinite(q.P).all()
    assert sorted(origin[1::2]) == list(range(5))
    assert integral_squared_difference(p, q) <= rounding(p)


@pytest.mark.parametrize("renormalise", [True, False])
def test_weights_that_vanish_beside_the_others_are_deleted_first(renormalise):
    p = scattered(np.random.default_rng(5), 40, 6)
    p = p._replace(w=np.where(np.arange(40) % 2, p.w, 1e-300))
    origin = integral_squared_error(p, 20, renormalise)[1]
    assert origin[1::2].tolist() == list(range(20)) and (origin[::2] == -1).all()


def test_one_weight_among_zeros_is_what_remains():
    p = scattered(np.random.default_rng(6), 4, 2)._replace(w=np.array([0.0, 0.0, 1.0, 0.0]))
    q, origin = integral_squared_error(p, 1)
    np.testing.assert_array_equal(q.m[0], p.m[2])
    assert q.w.tolist() == [1.0] and origin[2] == 0


def test_components_out_of_reach_of_one_another_are_handled():
    p = scattered(np.random.default_rng(8), 6, 4)
    p = p._replace(m=1e4 * p.m)  # every product of two underflows
    q, origin = integral_squared_error(p, 3)
    assert len(q.w) == 3 and np.isfinite(q.P).all()
    assert origin.tolist() == brute_force(p, 3, True)[1].tolist()


def test_few_enough_components_come_back_as_they_are():
    p = scattered(np.random.default_rng(9), 4, 2)
    for components in (4, 9):
        q, origin = integral_squared_error(p, components)
        assert q is p and origin.tolist() == [0, 1, 2, 3]


def test_components_below_one_are_refused():
    p = mixture([1.0], [[0.0]], [[[1.0]]])
    with pytest.raises(ValueError, match="components must be at least 1, got 0"):
        integral_squared_error(p, 0)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # from numpy, where nothing is compiled
def test_a_mixture_without_a_density_is_refused():
    p = scattered(np.random.default_rng(0), 3, 2)
    p.P[1] = -np.eye(2)
    with pytest.raises(ValueError, match=r"p.P\[1\] must be positive definite"):
        integral_squared_error(p, 2)
