"""Fitted weights are the optimum of their quadratic programme, and no error rises."""

from itertools import combinations

import numpy as np
import pytest
from test_refinement import crouse, same
from test_runnalls import random_mixture

from gmr_gym.mixture import Mixture, moments, take
from gmr_gym.reduction.distances import integral_squared_difference, pack, products
from gmr_gym.reduction.registry import reducer
from gmr_gym.reduction.weight_fit import cowa, fit_weights, refit


def programme(f, g):
    """H and c of the quadratic programme in the weights of g."""
    a, b = pack(g.m, g.P), pack(f.m, f.P)
    return products(a, a), products(a, b) @ f.w


def best_of_every_support(H, c, total):
    """The least of v'Hv - 2c'v with v >= 0 of that sum, over which of the v are positive."""
    best = np.inf, None
    for k in range(1, len(c) + 1):
        for support in map(list, combinations(range(len(c)), k)):
            A = np.block(
                [[H[np.ix_(support, support)], np.ones((k, 1))], [np.ones((1, k)), np.zeros((1, 1))]]
            )
            v = np.zeros(len(c))
            v[support] = np.linalg.solve(A, np.append(c[support], total))[:-1]
            if (v >= 0).all():
                best = min(best, (v @ H @ v - 2 * c @ v, tuple(v)))
    return np.array(best[1])


# ---- the quadratic programme ----


@pytest.mark.parametrize("seed", range(8))
def test_weights_are_the_best_of_every_choice_of_components(seed):
    f, g = random_mixture(seed, 9, 2, spread=1.0), random_mixture(100 + seed, 5, 2, spread=1.0)
    H, c = programme(f, g)
    v = fit_weights(H, c, g.w, np.ones((1, 5)))
    np.testing.assert_allclose(v, best_of_every_support(H, c, g.w.sum()), atol=1e-9)


@pytest.mark.parametrize("keep_mean", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_weights_meet_the_conditions_of_karush_kuhn_and_tucker(seed, keep_mean):
    f, g = random_mixture(seed, 20, 2, spread=1.0), random_mixture(50 + seed, 12, 2, spread=1.0)
    H, c = programme(f, g)
    kept = np.vstack([np.ones(12), *(g.m.T if keep_mean else ())])
    v = fit_weights(H, c, g.w, kept)
    slope, top, used = H @ v - c, H.max(), v > 0
    assert 3 < used.sum() < 12  # the bound matters
    np.testing.assert_allclose(kept @ v, kept @ g.w, rtol=0, atol=1e-12)
    price = np.linalg.lstsq(kept[:, used].T, slope[used], rcond=None)[0]
    left = (slope - price @ kept) / top
    np.testing.assert_allclose(left[used], 0, atol=1e-10)
    assert (left[~used] > -1e-10).all() and (v >= 0).all()


def test_of_equal_components_the_sum_is_found_though_the_programme_is_singular():
    f, g = random_mixture(0, 8, 2, spread=1.0), random_mixture(1, 4, 2, spread=1.0)
    alone = fit_weights(*programme(f, g), g.w, np.ones((1, 4)))
    for shift in (0.0, 1e-15, 1e-9):
        twice = take(g, np.array([0, 1, 2, 3, 0, 1]))._replace(w=np.array([0.5, 0.5, 1, 1, 0.5, 0.5]))
        twice = twice._replace(w=twice.w * g.w[[0, 1, 2, 3, 0, 1]], m=twice.m + shift * np.arange(6)[:, None])
        v = fit_weights(*programme(f, twice), twice.w, np.ones((1, 6)))
        np.testing.assert_allclose(np.append(v[:2] + v[4:], v[2:4]), alone, atol=1e-6)


def test_a_search_that_does_not_end_is_told(monkeypatch):
    monkeypatch.setattr("gmr_gym.reduction.weight_fit.CHANGES", 0)
    with pytest.warns(UserWarning, match="the fit of weights has stopped at its limit of 0 iterations"):
        refit(random_mixture(0, 6, 2), 3)


# ---- the reductions ----


@pytest.mark.parametrize(
    ("components", "at_the_end", "each_merge"),
    [
        (6, 0.0006863, 0.0006485),
        (5, 0.0202042, 0.0197343),
        (4, 0.0277188, 0.0257926),
        (3, 0.0342587, 0.0368421),
    ],
)
def test_cowa_reduces_the_mixture_of_crouse_to_the_known_errors(components, at_the_end, each_merge):
    for when, error in (("end", at_the_end), ("each-merge", each_merge)):
        q, origin = cowa(crouse(), components, when)
        assert integral_squared_difference(crouse(), q) == pytest.approx(error, abs=5.1e-8)
        assert set(origin) == set(range(components))


@pytest.mark.parametrize("reduction", ["runnalls", "west", "capping", "ise-unscaled"])
@pytest.mark.parametrize("keep_mean", [False, True])
def test_fitting_never_raises_the_error_and_keeps_the_sum(reduction, keep_mean):
    for seed in range(5):
        p = random_mixture(seed, 9, 2, spread=1.5, total=3.0)
        start, q = reducer(reduction, 4)(p)[0], refit(p, 4, reduction, keep_mean)[0]
        before, after = (integral_squared_difference(p, r) for r in (start, q))
        assert after <= before * (1 + 1e-12)
        assert q.w.sum() == pytest.approx(start.w.sum(), rel=1e-13)
        shift = np.abs(moments(q)[0] - moments(start)[0]).max()
        assert shift < 1e-12 if keep_mean else shift > 1e-6


def test_cowa_keeps_the_mean_where_that_is_asked():
    p = random_mixture(3, 12, 2, spread=1.5)
    for when in ("each-merge", "end"):
        shift = [
            np.abs(moments(cowa(p, 4, when, keep)[0])[0] - moments(p)[0]).max() for keep in (True, False)
        ]
        assert shift[0] < 1e-12 and shift[1] > 1e-4


@pytest.mark.parametrize("reduce", [refit, cowa])
def test_where_there_is_room_the_mixture_stays(reduce):
    p = random_mixture(1, 5, 2)
    q, origin = reduce(p, 5)
    assert origin.tolist() == [0, 1, 2, 3, 4] and all((a == b).all() for a, b in zip(q, p, strict=True))


@pytest.mark.parametrize("reduce", [refit, cowa])
def test_turning_shifting_stretching_and_shuffling_change_nothing(reduce):
    p, rng = random_mixture(3, 9, 3, spread=1.5), np.random.default_rng(3)
    A, order = rng.standard_normal((3, 3)), rng.permutation(9)
    there = Mixture(5 * p.w, p.m @ A.T + 100, A @ p.P @ A.T)
    q, origin = reduce(p, 4)
    other, where = reduce(take(there, order), 4)
    back = np.linalg.inv(A)
    same(Mixture(other.w / 5, (other.m - 100) @ back.T, back @ other.P @ back.T), q, 1e-8)
    parts = {frozenset(order[where == j]) for j in range(-1, len(q.w))}
    assert parts == {frozenset(np.flatnonzero(origin == j)) for j in range(-1, len(q.w))}


def test_components_without_weight_leave_and_their_members_with_them():
    found = 0
    for seed in range(20):
        p = random_mixture(seed, 12, 1, spread=1.0)
        group = reducer("capping", 8)(p)[1]
        for reduce in (lambda p: refit(p, 8, "capping"), lambda p: cowa(p, 8)):
            q, origin = reduce(p)
            assert (q.w > 0).all() and set(origin) - {-1} == set(range(len(q.w)))
            found += len(q.w) < 8
        kept = refit(p, 8, "capping")[1]
        assert ((kept >= 0) <= (group >= 0)).all()
    assert found > 5


def test_wrong_arguments_are_refused_in_words():
    p = random_mixture(0, 4, 2)
    with pytest.raises(ValueError, match="when must be one of each-merge, end, got 'always'"):
        cowa(p, 2, "always")
    with pytest.raises(ValueError, match="unknown reduction 'wets'; did you mean 'west'"):
        refit(p, 2, "wets")
    far = Mixture(np.ones(3), np.array([[0.0], [1e200], [-1e200]]), np.ones((3, 1, 1)))
    with pytest.raises(ValueError, match="too far apart"):
        cowa(far, 2)
