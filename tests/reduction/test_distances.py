"""Closed forms against quadrature, matrix functions and what a distance must obey."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from reference import gaussian_density, random_mixture
from scipy.integrate import dblquad, quad
from scipy.linalg import sqrtm

from gmr_gym.mixture import Mixture, take
from gmr_gym.reduction.distances import (
    bhattacharyya,
    correlation,
    hellinger,
    inner_product,
    integral_squared_difference,
    kullback_leibler,
    normalised_integral_squared_difference,
    pack,
    products,
    unpack,
    wasserstein,
)

SYMMETRIC = [bhattacharyya, hellinger, wasserstein, correlation]
seeds = st.integers(0, 2**32 - 1)


def two_gaussians(seed, d):
    _, m, P = random_mixture(np.random.default_rng(seed), 2, d, spread=1.0)
    return m[0], P[0], m[1], P[1]


def two_mixtures(seed, d, sizes=(4, 3), total=2.5):
    rng = np.random.default_rng(seed)
    return [Mixture(*random_mixture(rng, n, d, spread=1.5, total=total)) for n in sizes]


def on_a_line(function):
    """Integral of function(x) over the real line, split where Gaussians of spread 1 may stand."""
    edges = [-60.0, -10.0, -3.0, 0.0, 3.0, 10.0, 60.0]
    parts = (quad(function, a, b, epsabs=1e-13, epsrel=1e-12, limit=200) for a, b in pairwise(edges))
    return sum(part for part, _ in parts)


def densities(m1, P1, m2, P2):
    """The two as functions of x (d,)."""
    return lambda x: gaussian_density(x, m1, P1), lambda x: gaussian_density(x, m2, P2)


@pytest.mark.parametrize("seed", range(4))
def test_kullback_leibler_is_the_expected_log_ratio(seed):
    pair = two_gaussians(seed, 1)
    m1, P1, m2, P2 = (a.item() for a in pair)

    def integrand(x):
        log_ratio = 0.5 * ((x - m2) ** 2 / P2 - (x - m1) ** 2 / P1 + np.log(P2 / P1))
        return np.exp(-0.5 * (x - m1) ** 2 / P1) / np.sqrt(2 * np.pi * P1) * log_ratio

    assert kullback_leibler(*pair) == pytest.approx(on_a_line(integrand), rel=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_overlaps_on_a_line_are_their_integrals(seed):
    pair = two_gaussians(seed, 1)
    f, g = densities(*pair)
    shared = on_a_line(lambda x: np.sqrt(f([x]) * g([x])))
    assert bhattacharyya(*pair) == pytest.approx(-np.log(shared), rel=1e-8)
    assert hellinger(*pair) == pytest.approx(np.sqrt(1 - shared), rel=1e-8)
    fg, ff, gg = (on_a_line(lambda x, a=a, b=b: a([x]) * b([x])) for a, b in [(f, g), (f, f), (g, g)])
    assert correlation(*pair) == pytest.approx(fg / np.sqrt(ff * gg), rel=1e-9)


def test_overlap_in_the_plane_is_its_integral():
    pair = two_gaussians(1, 2)
    f, g = densities(*pair)
    shared, _ = dblquad(lambda y, x: np.sqrt(f([x, y]) * g([x, y])), -15, 15, -15, 15, epsabs=1e-9)
    assert bhattacharyya(*pair) == pytest.approx(-np.log(shared), rel=1e-6)


@given(seeds, st.integers(1, 5))
@settings(max_examples=60, deadline=None)
def test_wasserstein_is_the_trace_formula(seed, d):
    m1, P1, m2, P2 = two_gaussians(seed, d)
    root = sqrtm(P1).real
    bures = np.trace(P1 + P2 - 2 * sqrtm(root @ P2 @ root).real)
    # the trace cancels: its square root keeps half the digits
    assert wasserstein(m1, P1, m2, P2) ** 2 == pytest.approx((m1 - m2) @ (m1 - m2) + bures, rel=1e-9)


def test_wasserstein_between_parallel_ellipses_subtracts_deviations():
    P1, P2 = np.diag([4.0, 9.0]), np.diag([1.0, 1.0])
    assert wasserstein([3.0, 0.0], P1, [0.0, 0.0], P2) == pytest.approx(np.sqrt(9 + 1 + 4))


def test_wasserstein_keeps_its_digits_between_near_equals():
    P = np.diag([1.0, 4.0])
    far = wasserstein([0, 0], P, [0, 0], P * (1 + 1e-9) ** 2)
    assert far == pytest.approx(1e-9 * np.sqrt(5), rel=1e-6)


@given(seeds, st.integers(1, 6))
@settings(max_examples=60, deadline=None)
def test_distances_between_gaussians_obey_the_rules(seed, d):
    m1, P1, m2, P2 = two_gaussians(seed, d)
    for distance in SYMMETRIC:
        there, back = distance(m1, P1, m2, P2), distance(m2, P2, m1, P1)
        assert there == pytest.approx(back, rel=1e-9)
    assert 0 < hellinger(m1, P1, m2, P2) <= 1
    assert 0 < correlation(m1, P1, m2, P2) < 1
    for distance in (kullback_leibler, bhattacharyya, wasserstein):
        assert distance(m1, P1, m2, P2) > 0
    # a change of coordinates leaves what depends on the densities alone
    A, b = np.random.default_rng(seed).standard_normal((d, d)) + 3 * np.eye(d), np.arange(d)
    moved = A @ m1 + b, A @ P1 @ A.T, A @ m2 + b, A @ P2 @ A.T
    for distance in (kullback_leibler, bhattacharyya, hellinger, correlation):
        assert distance(*moved) == pytest.approx(distance(m1, P1, m2, P2), rel=1e-6)


@given(seeds, st.integers(1, 6))
@settings(max_examples=60, deadline=None)
def test_equal_gaussians_are_at_no_distance(seed, d):
    m, P, _, _ = two_gaussians(seed, d)
    assert kullback_leibler(m, P, m, P) == pytest.approx(0, abs=1e-12)
    assert bhattacharyya(m, P, m, P) == pytest.approx(0, abs=1e-12)
    assert hellinger(m, P, m, P) == pytest.approx(0, abs=1e-6)  # a square root of rounding
    assert wasserstein(m, P, m, P) == pytest.approx(0, abs=1e-12 * np.trace(P))
    assert correlation(m, P, m, P) == pytest.approx(1, abs=1e-12)


def test_inner_product_is_its_integral_on_a_line():
    p, q = two_mixtures(0, 1)

    def density(a, x):
        return sum(w * gaussian_density([x], m, P) for w, m, P in zip(*a, strict=True))

    expected = on_a_line(lambda x: density(p, x) * density(q, x))
    assert inner_product(p, q) == pytest.approx(expected, rel=1e-9)
    expected = on_a_line(lambda x: (density(p, x) - density(q, x)) ** 2)
    assert integral_squared_difference(p, q) == pytest.approx(expected, rel=1e-9)


@given(seeds, st.integers(1, 9))
@settings(max_examples=40, deadline=None)
def test_products_are_densities_of_one_mean_about_the_other(seed, d):
    rng = np.random.default_rng(seed)
    # above and below the number that are factored together
    _, m1, P1 = random_mixture(rng, 2, d)
    _, m2, P2 = random_mixture(rng, 131, d)
    got = products(pack(m1, P1), pack(m2, P2))
    assert got.shape == (2, 131)
    for i, j in [(0, 0), (1, 5), (0, 127), (1, 128), (0, 130)]:
        expected = gaussian_density(m1[i], m2[j], P1[i] + P2[j])
        assert got[i, j] == pytest.approx(expected, rel=1e-8)


@given(seeds, st.integers(1, 6))
@settings(max_examples=20, deadline=None)
def test_unpack_undoes_pack(seed, d):
    _, m, P = random_mixture(np.random.default_rng(seed), 5, d)
    got_m, got_P = unpack(pack(m, P), d)
    np.testing.assert_array_equal(got_m, m)
    np.testing.assert_array_equal(np.tril(got_P), np.tril(P))
    np.testing.assert_array_equal(got_P, got_P.transpose(0, 2, 1))


@given(seeds, st.integers(1, 5))
@settings(max_examples=60, deadline=None)
def test_squared_differences_obey_the_rules(seed, d):
    p, q = two_mixtures(seed, d)
    order = np.random.default_rng(seed).permutation(len(p.w))
    squared = integral_squared_difference(p, q)
    assert squared > 0
    assert squared == pytest.approx(integral_squared_difference(q, p), rel=1e-9)
    assert squared == pytest.approx(integral_squared_difference(take(p, order), q), rel=1e-9)
    assert integral_squared_difference(p, p) == 0
    assert integral_squared_difference(p, take(p, order)) <= 1e-14 * inner_product(p, p)
    assert 0 < normalised_integral_squared_difference(p, q) <= 1
    assert normalised_integral_squared_difference(p, p) == 0
    # Cauchy-Schwarz
    assert inner_product(p, q) ** 2 <= inner_product(p, p) * inner_product(q, q)


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_splitting_a_component_changes_nothing(seed):
    p, q = two_mixtures(seed, 2)
    split = Mixture(*(np.concatenate([a, a]) for a in p))._replace(w=np.tile(p.w / 2, 2))
    assert inner_product(split, q) == pytest.approx(inner_product(p, q), rel=1e-12)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # from numpy, where nothing is compiled
@pytest.mark.parametrize("shift", [1e3, 1e8, 1e200])
@pytest.mark.parametrize("total", [1.0, 1e-300, 1e150])
def test_mixtures_out_of_reach_differ_wholly(shift, total):
    p, q = two_mixtures(0, 3, total=1.0)
    p, q = p._replace(w=total * p.w), q._replace(w=total * q.w, m=q.m + shift)
    assert inner_product(p, q) == 0
    assert normalised_integral_squared_difference(p, q) == 1


def test_weights_count_in_the_normalised_difference():
    p, _ = two_mixtures(0, 2)
    double = p._replace(w=2 * p.w)
    # (1 - 2)^2 / (1 + 4)
    assert normalised_integral_squared_difference(p, double) == pytest.approx(0.2, rel=1e-12)


@pytest.mark.parametrize("d", [2, 6])
def test_products_out_of_reach_vanish_and_those_of_no_density_are_nan(d):
    m, P = np.zeros((3, d)), np.stack([np.eye(d), np.eye(d), -np.diag([3.0] * 2 + [0.0] * (d - 2))])
    m[1] = 1e3
    to_first = products(pack(m[:1], P[:1]), pack(m, P))[0]
    assert to_first[0] == pytest.approx((4 * np.pi) ** (-d / 2), rel=1e-14)
    assert to_first[1] == 0.0 and np.isnan(to_first[2])  # two negative pivots, whose product is positive
