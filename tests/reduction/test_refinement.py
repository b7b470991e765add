"""Refinement descends to known minima, in any coordinates, and never ends above where it starts."""

from functools import partial

import numpy as np
import pytest
import reference
from test_runnalls import random_mixture

from gmr_gym.mixture import Mixture, collapsed, mixture, moments, take
from gmr_gym.reduction.distances import integral_squared_difference, kullback_leibler
from gmr_gym.reduction.ise_descent import descend
from gmr_gym.reduction.ise_gradient import (
    error_of,
    matched,
    matched_objective,
    moved,
    objective,
    problem_of,
)  # fmt: skip
from gmr_gym.reduction.refinement import gmrc, refine
from gmr_gym.reduction.registry import reducer
from gmr_gym.reduction.runnalls import runnalls
from gmr_gym.reduction.units import into, out_of, standard


def crouse():
    """The mixture of Crouse et al. 2011, figure 1."""
    w = [0.03, 0.18, 0.12, 0.19, 0.02, 0.16, 0.06, 0.10, 0.08, 0.06]
    m = [1.45, 2.20, 0.67, 0.48, 1.49, 0.91, 1.01, 1.42, 2.77, 0.89]
    P = [0.0487, 0.0305, 0.1171, 0.0174, 0.0295, 0.0102, 0.0323, 0.0380, 0.0115, 0.0679]
    return mixture(w, np.reshape(m, (-1, 1)), np.reshape(P, (-1, 1, 1)))


def ends(p, components, reduction="runnalls"):
    """Errors of a reduction before and after it is refined."""
    before, after = reducer(reduction, components)(p)[0], refine(p, components, reduction)[0]
    return integral_squared_difference(p, before), integral_squared_difference(p, after)


def same(q, r, rtol=1e-6):
    """The same components to rtol of the spread, in any order."""
    order = [np.abs(r.m - m).max(axis=1).argmin() for m in q.m]
    assert sorted(order) == list(range(len(r.w)))
    r, size = take(r, np.array(order)), np.abs(moments(r)[1]).max()
    np.testing.assert_allclose(q.w, r.w, rtol=0, atol=rtol * r.w.sum())
    np.testing.assert_allclose(q.m, r.m, rtol=0, atol=rtol * np.sqrt(size))
    np.testing.assert_allclose(q.P, r.P, rtol=0, atol=rtol * size)


# ---- the error and its gradient ----


@pytest.mark.parametrize("d", [1, 2, 4])
@pytest.mark.parametrize("of", [objective, matched_objective])
def test_the_gradient_is_that_of_differences(d, of):
    units, f = standard(random_mixture(d, 7, d, spread=1.0))
    problem = problem_of(f, matched(into(units, runnalls(out_of(units, f), 3)[0])))
    x = 0.1 * np.random.default_rng(d).standard_normal((3, 1 + d + d * d))
    x[:, 1 + d :] = symmetrised(x[:, 1 + d :], d)
    _, gradient = of(problem, x)
    for way in np.random.default_rng(0).standard_normal((10, *x.shape)):
        way[:, 1 + d :] = symmetrised(way[:, 1 + d :], d)
        h = 1e-4  # the error of five points is h^4, 1e-16 / h of rounding
        ahead = [of(problem, x + k * h * way)[0] for k in (-2, -1, 1, 2)]
        slope = np.dot([1, -8, 8, -1], ahead) / (12 * h)
        assert np.vdot(gradient, way) == pytest.approx(slope, abs=1e-9 * np.abs(gradient).max())


def symmetrised(rows, d):
    B = rows.reshape(-1, d, d)
    return (B + B.transpose(0, 2, 1)).reshape(len(B), -1)


@pytest.mark.parametrize("d", [1, 3])
def test_the_error_is_the_integral_squared_difference_and_the_sum_of_weights_stays(d):
    p = random_mixture(d, 6, d, spread=1.0)
    problem = problem_of(p, runnalls(p, 3)[0])
    x = 0.1 * np.random.default_rng(d).standard_normal((3, 1 + d + d * d))
    x[:, 1 + d :] = symmetrised(x[:, 1 + d :], d)
    g, error = moved(problem, x), objective(problem, x)[0] * problem.square
    assert error == pytest.approx(integral_squared_difference(p, g), rel=1e-10)
    assert error_of(problem, g) == pytest.approx(error, rel=1e-13)
    assert g.w.sum() == pytest.approx(p.w.sum(), rel=1e-14)
    np.testing.assert_allclose(moved(problem, 0 * x).P, problem.start.P, rtol=1e-13, atol=1e-14)


# ---- where it ends ----


@pytest.mark.parametrize(
    ("components", "reduction", "least"),
    [
        (6, "runnalls", 3.2354e-6), (5, "runnalls", 1.70321e-4), (4, "runnalls", 0.0254551),
        (3, "runnalls", 0.0363147),  # not the least of all, but no descent leaves it
        (6, "greedy-isd", 3.2354e-6), (5, "greedy-isd", 1.70321e-4), (4, "greedy-isd", 0.0113286),
        (3, "greedy-isd", 0.0228101),
    ],
)  # fmt: skip
def test_the_mixture_of_crouse_is_refined_to_the_known_errors(components, reduction, least):
    assert ends(crouse(), components, reduction)[1] == pytest.approx(least, rel=1e-5)
    if reduction == "runnalls":  # from which the clustering moves nothing
        same(gmrc(crouse(), components)[0], refine(crouse(), components)[0], 1e-3)


def test_five_components_for_the_mixture_of_crouse_are_the_known_ones():
    q, origin = gmrc(crouse(), 5)
    order = np.argsort(q.m[:, 0])
    np.testing.assert_allclose(q.m[order, 0], [0.4925, 0.9109, 1.3628, 2.2026, 2.7696], atol=6e-5)
    np.testing.assert_allclose(q.w[order], [0.2748, 0.2535, 0.2122, 0.1781, 0.0814], atol=6e-5)
    np.testing.assert_allclose(q.P[order, 0, 0], [0.02322, 0.0133, 0.05915, 0.02944, 0.0118], atol=6e-6)
    assert np.argsort(order)[origin].tolist() == [2, 3, 0, 0, 2, 1, 1, 2, 4, 1]


def test_where_nothing_can_be_gained_nothing_moves():
    p = random_mixture(1, 5, 2)
    problem = problem_of(p, p)
    x, finished = descend(partial(objective, problem), problem.own, 7, 10)
    assert finished
    same(moved(problem, x), p, 1e-12)
    for reduce in (refine, gmrc):
        q, origin = reduce(p, 5)
        assert origin.tolist() == [0, 1, 2, 3, 4] and all((a == b).all() for a, b in zip(q, p, strict=True))
        assert all((a == b).all() for a, b in zip(reduce(p, 9)[0], p, strict=True))


def test_two_pairs_of_equals_far_apart_are_found_exactly():
    p = mixture([0.2, 0.3, 0.1, 0.4], [[0.0], [50.0], [0.0], [50.0]], [[[1.0]], [[4.0]]] * 2)
    assert ends(p, 2)[1] < 1e-12
    q, origin = gmrc(p, 2)
    assert q.w == pytest.approx([0.3, 0.7]) and origin.tolist() == [0, 1, 0, 1]


@pytest.mark.parametrize("d", [1, 2, 4])
@pytest.mark.parametrize("reduction", ["runnalls", "west", "capping"])
def test_the_error_never_ends_above_that_of_the_start(d, reduction):
    for seed in range(4):
        p = random_mixture(seed, 8, d, spread=1.5, total=3.0)
        before, after = ends(p, 3, reduction)
        assert after < before
        assert refine(p, 3, reduction)[0].w.sum() == pytest.approx(reducer(reduction, 3)(p)[0].w.sum())


@pytest.mark.parametrize("match", [False, True])
def test_turning_shifting_stretching_and_shuffling_change_nothing(match):
    p, rng = random_mixture(3, 9, 3, spread=1.5), np.random.default_rng(3)
    A, order = rng.standard_normal((3, 3)), rng.permutation(9)
    there = Mixture(5 * p.w, p.m @ A.T + 100, A @ p.P @ A.T)
    q, origin = gmrc(p, 4, match)
    other, where = gmrc(take(there, order), 4, match)
    back = np.linalg.inv(A)
    same(Mixture(other.w / 5, (other.m - 100) @ back.T, back @ other.P @ back.T), q, 1e-4)
    parts = {frozenset(order[where == j]) for j in range(4)}
    assert parts == {frozenset(np.flatnonzero(origin == j)) for j in range(4)}


@pytest.mark.parametrize("d", [1, 3])
def test_matching_keeps_total_weight_mean_and_covariance(d):
    p = random_mixture(d, 10, d, spread=2.0, total=2.0)
    for reduction in ("runnalls", "capping"):
        q = refine(p, 4, reduction, match=True)[0]
        before, after = reference.moment_match(*p), reference.moment_match(*q)
        for ours, theirs in zip(after, before, strict=True):
            np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-10)
    before, after = ends(p, 4)
    assert after < integral_squared_difference(p, refine(p, 4, match=True)[0]) < before


def test_a_component_far_from_the_others_stays_there():
    near = random_mixture(2, 6, 2, spread=1.0)
    p = Mixture(np.append(near.w, 0.3), np.vstack([near.m, [[1e4, 0]]]), np.append(near.P, [np.eye(2)], 0))
    q, origin = refine(p, 4)
    far = origin[-1]
    assert (origin == far).sum() == 1 and q.w[far] == pytest.approx(0.3, rel=0.1)
    np.testing.assert_allclose(q.m[far], [1e4, 0], rtol=1e-12, atol=1e-8)
    np.testing.assert_allclose(q.P[far], np.eye(2), atol=0.1)


def test_every_component_left_is_the_origin_of_some_and_they_are_the_most_responsible():
    for seed in range(10):
        p = random_mixture(seed, 7, 2, spread=0.5)
        p.w[2] = 0.0
        q, origin = refine(p, 6 - seed % 2, "k-means")
        assert origin[2] == -1 and set(origin) - {-1} == set(range(len(q.w)))
    q, origin = refine(random_mixture(4, 12, 2), 3)
    p = random_mixture(4, 12, 2)
    scores = [
        [np.log(v) - kullback_leibler(m, P, c, S) for v, c, S in zip(*q, strict=True)]
        for m, P in zip(p.m, p.P, strict=True)
    ]
    assert origin.tolist() == np.argmax(scores, axis=1).tolist()


# ---- what floats can hardly hold ----


def wide(seed, d=3, n=9):
    rng = np.random.default_rng(seed)
    p = random_mixture(seed, n, d)
    return p._replace(w=10.0 ** -rng.uniform(0, 300, n), P=p.P * 10.0 ** rng.uniform(-12, 12, (n, 1, 1)))


HARD = {
    "weights over 300 decades, covariances over 24": wide(0),
    "the same in one dimension": wide(1, 1),
    "covariances over 24 decades": wide(2)._replace(w=np.full(9, 0.1)),
    "1e8 deviations apart": random_mixture(0, 6, 2, spread=1e8),
    "equals": take(random_mixture(1, 3, 2), np.array([0, 1, 0, 2, 1, 0])),
    "equals but for rounding": take(random_mixture(1, 3, 2), np.array([0, 1, 0, 2, 1, 0]))._replace(
        m=random_mixture(1, 3, 2).m[[0, 1, 0, 2, 1, 0]] + 1e-13 * np.arange(6)[:, None]
    ),
}


@pytest.mark.filterwarnings("ignore:refinement has stopped")
@pytest.mark.parametrize("name", HARD)
@pytest.mark.parametrize("reduce", ["gmrc", "refine", "refit", "cowa"])
def test_what_comes_of_hard_numbers_is_finite_and_keeps_the_weight(name, reduce):
    p = HARD[name]
    try:
        q, origin = reducer(reduce, 3)(p)
    except ValueError as error:
        assert "too far apart" in str(error) or "outside the range" in str(error)
        return
    assert 1 <= len(q.w) <= 3 and all(np.isfinite(a).all() for a in q) and (q.w > 0).all()
    assert q.w.sum() == pytest.approx(p.w.sum(), rel=1e-12)
    assert set(origin) - {-1} == set(range(len(q.w)))
    np.linalg.cholesky(q.P)


def test_duplicates_are_one_to_a_refinement():
    p = random_mixture(1, 3, 2)
    doubled = take(p, np.array([0, 0, 1, 1, 2, 2]))._replace(w=np.repeat(p.w, 2) / 2)
    for reduce in ("gmrc", "refine", "refit"):  # cowa merges the lightest, whatever its neighbour
        same(reducer(reduce, 3)(doubled)[0], p, 1e-6)


def test_units_are_taken_back():
    p = random_mixture(5, 4, 3, total=3.0)
    units, f = standard(p)
    same(out_of(units, f), p, 1e-13)
    np.testing.assert_allclose(collapsed(f).P[0], np.eye(3), atol=1e-14)
    assert f.w.sum() == pytest.approx(1.0) and collapsed(f).m == pytest.approx(0.0, abs=1e-14)


def test_stopping_early_is_told_and_leaves_what_was_gained():
    p = random_mixture(0, 9, 2, spread=1.5)
    with pytest.warns(UserWarning, match="refinement has stopped at its limit of 2 iterations"):
        q, _ = refine(p, 3, steps=2)
    before, after = ends(p, 3)
    assert after < integral_squared_difference(p, q) < before


def test_wrong_arguments_are_refused_in_words():
    p = random_mixture(0, 4, 2)
    for steps, message in ((0, "at least 1, got 0"), (2.5, "a whole number, got 2.5")):
        with pytest.raises(ValueError, match=f"steps must be {message}"):
            refine(p, 2, steps=steps)
    same(refine(p, 2, steps=1e308)[0], refine(p, 2)[0], 0.0)
    with pytest.raises(ValueError, match="unknown reduction 'runnals'; did you mean 'runnalls'"):
        refine(p, 2, "runnals")
    for reduce in (refine, gmrc):
        with pytest.raises(ValueError, match="components must be at least 1, got 0"):
            reduce(p, 0)
