"""The cached greedy choices are those of evaluating every candidate from nothing."""

from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference import moment_match, random_mixture

from gmr_gym.distances import inner_product, integral_squared_difference
from gmr_gym.ise import integral_squared_error
from gmr_gym.mixture import Mixture, mixture, moments, take


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
