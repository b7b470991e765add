"""Barycentres are minima of their sums, found by another method or in closed form, and survive extremes."""

import numpy as np
import pytest
from reference import random_mixture
from scipy.optimize import minimize

from gmr_gym.mixture import Mixture, collapsed, gaussian, mixture, take
from gmr_gym.reduction.barycentres import barycentre
from gmr_gym.reduction.distances import (
    correlation,
    integral_squared_difference,
    kullback_leibler,
    wasserstein,
)
from gmr_gym.reduction.measures import CAUCHY_SCHWARZ, COSTS, ISD, MEASURES
from gmr_gym.reduction.overlap_descent import STEPS, descend
from gmr_gym.reduction.protocol import TOO_FAR

every = pytest.mark.parametrize("measure", MEASURES)
AFFINE = ("kl", "reverse-kl", "symmetrised-kl", "cauchy-schwarz")


def drawn(seed, n, d, spread=1.5):
    return Mixture(*random_mixture(np.random.default_rng(seed), n, d, spread))


def total(measure, p, m, P):
    """Sum of w D(component, N(m, P))."""
    cost = COSTS[MEASURES.index(measure)]
    return sum(w * cost(*f, m, P) for w, *f in zip(*p, strict=True))


def symmetric_pair(x, s, at=0.0):
    return mixture([0.5, 0.5], [[at - x], [at + x]], [[[s]], [[s]]])


@pytest.mark.parametrize("d", [1, 3])
def test_the_cost_of_a_component_is_its_measure(d):
    p = drawn(d, 2, d)
    f, q = ((p.m[i], p.P[i]) for i in (0, 1))
    forward, backward = kullback_leibler(*f, *q), kullback_leibler(*q, *f)
    expected = {
        "kl": forward,
        "reverse-kl": backward,
        "symmetrised-kl": (forward + backward) / 2,
        "wasserstein": wasserstein(*f, *q) ** 2,
        "cauchy-schwarz": -np.log(correlation(*f, *q)),
        "isd": integral_squared_difference(gaussian(*f), gaussian(*q)),
    }
    found = {measure: cost(*f, *q) for measure, cost in zip(MEASURES, COSTS, strict=True)}
    assert found == pytest.approx(expected, rel=1e-12)


@every
def test_equal_gaussians_cost_nothing_and_a_matrix_that_is_not_definite_infinitely_much(measure):
    cost, p = COSTS[MEASURES.index(measure)], drawn(5, 1, 3)
    # the Wasserstein distance is in the unit of the state, others in nats
    assert 0 <= cost(p.m[0], p.P[0], p.m[0], p.P[0]) < 1e-14
    assert cost(p.m[0], p.P[0], p.m[0], -np.eye(3)) == np.inf
    assert cost(p.m[0], -np.eye(3), p.m[0], p.P[0]) == np.inf


@pytest.mark.parametrize(("x", "s"), [(0.3, 2.0), (2.0, 1.0)])
def test_barycentres_of_a_symmetric_pair_are_those_in_closed_form(x, s):
    expected = {
        "kl": s + x**2,
        "reverse-kl": s,
        "symmetrised-kl": np.sqrt(s * (s + x**2)),
        "wasserstein": s,
        "cauchy-schwarz": x**2 + np.sqrt(x**4 + s**2),
    }
    for measure, covariance in expected.items():
        q = barycentre(symmetric_pair(x, s, at=5.0), measure)
        assert q.m[0, 0] == pytest.approx(5.0) and q.w.tolist() == [1.0]
        assert q.P[0, 0, 0] == pytest.approx(covariance, rel=1e-8)


@every
@pytest.mark.parametrize(("n", "d", "spread"), [(2, 1, 1.0), (2, 3, 2.0), (4, 2, 1.5)])
def test_a_barycentre_is_the_minimum_that_a_general_method_finds(measure, n, d, spread):
    p, lower = drawn(n + d, n, d, spread), np.tril_indices(d)

    def at(v):
        L = np.zeros((d, d))
        L[lower] = v[d:]
        return v[:d].copy(), L @ L.T

    start = collapsed(p)
    v = np.concatenate([start.m[0], np.linalg.cholesky(start.P[0])[lower]])
    found = minimize(lambda v: total(measure, p, *at(v)), v, method="BFGS", options={"gtol": 1e-9})
    q = barycentre(p, measure)
    m, P = at(found.x)
    assert total(measure, p, q.m[0], q.P[0]) <= found.fun * (1 + 1e-12)
    np.testing.assert_allclose(q.m[0], m, atol=3e-6)  # differences end the general method at 1e-9 of the sum
    np.testing.assert_allclose(q.P[0], P, atol=3e-5)


@every
def test_the_barycentre_of_equal_components_is_that_component(measure):
    p = take(drawn(1, 1, 3), np.zeros(3, int))
    q = barycentre(p, measure)
    np.testing.assert_allclose(q.m[0], p.m[0], rtol=1e-12)
    np.testing.assert_allclose(q.P[0], p.P[0], rtol=1e-9)
    assert q.w[0] == pytest.approx(3 * p.w[0])


def test_kl_matches_moments_and_wasserstein_averages_standard_deviations_along_the_axes():
    p = drawn(2, 5, 3)
    for found, expected in zip(barycentre(p, "kl"), collapsed(p), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-13)
    deviations = np.array([[1.0, 2.0], [3.0, 0.5], [4.0, 4.0]])
    along = mixture([0.2, 0.3, 0.5], [[0.0, 1.0]] * 3, [np.diag(s**2) for s in deviations])
    expected = np.diag((along.w @ deviations) ** 2)
    np.testing.assert_allclose(barycentre(along, "wasserstein").P[0], expected, atol=1e-12)


@pytest.mark.parametrize(("x", "middle"), [(4.0, True), (8.0, False)])
def test_the_lower_of_the_minima_of_isd_is_found(x, middle):
    p = symmetric_pair(x, 1.0)
    q = barycentre(p, "isd")
    assert (abs(q.m[0, 0]) < 1e-6) == middle
    if not middle:  # a start in the middle ends at 0.111
        assert integral_squared_difference(p, q) == pytest.approx(0.104, abs=5e-4)


@every
def test_barycentres_move_with_affine_maps_or_with_rigid_ones(measure):
    p, rng = drawn(3, 3, 2), np.random.default_rng(0)
    A = rng.standard_normal((2, 2)) if measure in AFFINE else np.linalg.qr(rng.standard_normal((2, 2)))[0]
    shift = np.array([1e3, -50.0])
    q = barycentre(p, measure)
    moved = barycentre(Mixture(7.0 * p.w, p.m @ A.T + shift, A @ p.P @ A.T), measure)
    assert moved.w[0] == pytest.approx(7.0 * q.w[0])
    np.testing.assert_allclose(moved.m[0], A @ q.m[0] + shift, rtol=1e-7)
    np.testing.assert_allclose(moved.P[0], A @ q.P[0] @ A.T, rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("code", [CAUCHY_SCHWARZ, ISD])
def test_a_descent_never_ends_above_its_start(code):
    for seed in range(20):
        p, start = drawn(seed, 4, 4), drawn(seed + 100, 1, 4, spread=3.0)
        m, P, steps, _ = descend(code, p.w, p.m, p.P, start.m[0], start.P[0], 1e-10)
        before, after = (total(MEASURES[code], p, *q) for q in ((start.m[0], start.P[0]), (m, P)))
        assert after <= before and steps < STEPS


@every
@pytest.mark.parametrize("size", [1e-12, 1e12])
def test_barycentres_survive_tiny_weights_and_extreme_covariances(measure, size):
    p = mixture(
        [1.0, 1e-300, 1e-3], np.sqrt(size) * np.arange(6.0).reshape(3, 2), size * np.eye(2)[[[0, 1]] * 3]
    )
    q = barycentre(p, measure)
    assert all(np.isfinite(a).all() for a in q) and (np.linalg.eigvalsh(q.P[0]) > 0.5 * size).all()


@every
def test_covariances_of_extremely_different_size_have_a_barycentre_perhaps_with_a_warning(measure):
    p = mixture([0.5, 0.5], [[0.0, 0.0], [1.0, 1.0]], [1e-12 * np.eye(2), 1e12 * np.eye(2)])
    if measure == "cauchy-schwarz":  # the sum is flat to rounding
        with pytest.warns(UserWarning, match="by cauchy-schwarz has stopped at its limit of 500 iterations"):
            q = barycentre(p, measure)
    else:
        q = barycentre(p, measure)
    assert (np.linalg.eigvalsh(q.P[0]) > 0).all() and (np.linalg.eigvalsh(q.P[0]) < 1.1e12).all()


@every
def test_components_far_apart_have_a_barycentre_or_are_refused_in_one_line(measure):
    for apart in (1e7, 1e8, 1e20):
        p = mixture([0.5, 0.5], [[0.0, 0.0], [apart, 2 * apart]], [np.eye(2), np.diag([1.0, 3.0])])
        try:
            q = barycentre(p, measure)
        except ValueError as error:
            assert (
                str(error) == TOO_FAR and apart > 1e7 and measure not in ("reverse-kl", "wasserstein", "isd")
            )
        else:
            assert all(np.isfinite(a).all() for a in q)


def test_what_has_no_barycentre_is_refused():
    with pytest.raises(ValueError, match="measure must be one of kl, reverse-kl"):
        barycentre(drawn(0, 2, 1), "hellinger")
    with pytest.raises(ValueError, match="p must have a component of positive weight"):
        barycentre(drawn(0, 2, 1)._replace(w=np.zeros(2)))
    with pytest.raises(ValueError, match=r"p.w must be finite"):
        barycentre(drawn(0, 2, 1)._replace(w=np.array([-1.0, 1.0])))
