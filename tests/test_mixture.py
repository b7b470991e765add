"""A Mixture is checked where it is made, and its moments and density are the textbook's."""

import numpy as np
import pytest
import reference

from gmr_gym.linalg import pairwise_sum
from gmr_gym.mixture import (
    Mixture,
    collapsed,
    gaussian,
    log_density,
    matched,
    mixture,
    moments,
    normalised,
    rescaled,
    take,
)

GOOD = {"w": [0.5, 0.5], "m": [[0, 0], [1, 1]], "P": [np.eye(2), np.eye(2)]}


@pytest.mark.parametrize("d", [1, 2, 4, 6])
@pytest.mark.parametrize("total", [1.0, 1e-200, 40.0])
def test_moments_are_the_textbooks_whatever_the_weights_sum_to(d, total):
    w, m, P = reference.random_mixture(np.random.default_rng(d), 7, d, total=total)
    mean, covariance = moments(Mixture(w, m, P))
    _, wanted_mean, wanted_covariance = reference.moment_match(w, m, P)
    # sums of seven terms of order 10: rounding alone
    np.testing.assert_allclose(mean, wanted_mean, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(covariance, wanted_covariance, rtol=1e-12, atol=1e-12)
    one = collapsed(Mixture(w, m, P))
    assert one.w == pytest.approx(total, rel=1e-12)
    assert (one.m[0] == mean).all() and (one.P[0] == covariance).all()


@pytest.mark.parametrize("d", [1, 2, 4])
@pytest.mark.parametrize("total", [1.0, 1e-200, 40.0])
def test_every_group_is_matched_in_weight_mean_and_covariance(d, total):
    w, m, P = reference.random_mixture(np.random.default_rng(d), 12, d, total=total)
    group = np.array([2, 0, -1, 2, 1, 0, 0, -1, 2, 0, 0, 2])  # -1 belongs to none
    got = matched(Mixture(w, m, P), group, 3)
    for g in range(3):
        members = group == g
        weight, mean, covariance = reference.moment_match(w[members], m[members], P[members])
        # sums of a few terms of order 10: rounding alone
        assert got.w[g] == pytest.approx(weight, rel=1e-12)
        np.testing.assert_allclose(got.m[g], mean, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(got.P[g], covariance, rtol=1e-12, atol=1e-12)
        assert (got.P[g] == got.P[g].T).all()


def test_group_of_one_is_left_as_it_was():
    p = Mixture(*reference.random_mixture(np.random.default_rng(5), 3, 2))
    got = matched(p, np.array([1, 2, 0]), 3)
    for a, b in zip(got, take(p, np.array([2, 0, 1])), strict=True):
        np.testing.assert_array_equal(a, b)


def test_group_that_weighs_nothing_is_matched_as_if_of_equal_weight():
    w, m, P = reference.random_mixture(np.random.default_rng(6), 5, 2)
    got = matched(Mixture(w * [0, 1, 0, 1, 0], m, P), np.array([0, 1, 0, 1, 0]), 2)
    _, mean, covariance = reference.moment_match(np.ones(3), m[::2], P[::2])
    assert got.w.tolist() == [0, w[1] + w[3]]
    np.testing.assert_allclose(got.m[0], mean, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(got.P[0], covariance, rtol=1e-12, atol=1e-12)


def test_covariance_far_from_the_origin_keeps_its_digits():
    p = mixture([0.5, 0.5], [[1e8], [1e8 + 2]], [[[1.0]], [[1.0]]])
    assert moments(p)[1][0, 0] == 2.0  # 1 + 1^2, which E[x^2] - E[x]^2 would lose


def test_moments_match_the_sample_moments_of_draws():
    w, m, P = reference.random_mixture(np.random.default_rng(3), 3, 2)
    rng = np.random.default_rng(4)
    which = rng.choice(3, 200_000, p=w)
    x = m[which] + np.einsum("nij,nj->ni", np.linalg.cholesky(P)[which], rng.standard_normal((200_000, 2)))
    mean, covariance = moments(Mixture(w, m, P))
    # five standard errors of a mean
    np.testing.assert_allclose(x.mean(axis=0), mean, atol=5 * np.sqrt(covariance.max() / 200_000))
    # two per cent of the largest entry: five standard errors of a variance, tails no heavier
    np.testing.assert_allclose(np.cov(x.T), covariance, atol=0.02 * covariance.max())


@pytest.mark.parametrize("d", [1, 2, 4])
def test_log_density_is_the_log_of_the_sum_of_gaussians(d):
    rng = np.random.default_rng(d)
    w, m, P = reference.random_mixture(rng, 5, d, total=2.5)
    x = 3 * rng.standard_normal((6, d))
    wanted = [np.log(sum(w[i] * reference.gaussian_density(y, m[i], P[i]) for i in range(5))) for y in x]
    np.testing.assert_allclose(log_density(Mixture(w, m, P), x), wanted, rtol=1e-10)


def test_log_density_does_not_underflow_far_away_nor_count_weight_zero():
    p = mixture([1.0, 0.0], [[0.0], [1e6]], [[[1.0]], [[1.0]]])
    got = log_density(p, np.array([[1e6]]))
    assert got[0] == pytest.approx(-0.5e12 - 0.5 * np.log(2 * np.pi), rel=1e-14)


def test_log_density_at_infinity_is_minus_infinity_and_a_nan_is_refused():
    p = mixture([0.5, 0.5], np.zeros((2, 2)), [[[1.0, 0.5], [0.5, 1.0]], [[1e-8, 0.0], [0.0, 1.0]]])
    far = [[np.inf, 0.0], [np.inf, np.inf], [-np.inf, np.inf], [1e308, -1e308], [0.0, 1e200]]
    assert (log_density(p, np.array(far)) == -np.inf).all()
    with pytest.raises(ValueError, match=r"x must have no nan; row 1 is \[0.0, nan\]"):
        log_density(p, np.array([[0.0, 0.0], [0.0, np.nan]]))


def test_normalised_rescales_weights_alone_and_take_selects():
    p = mixture([1, 3], [[0.0], [1.0]], [[[1.0]], [[2.0]]])
    assert normalised(p).w.tolist() == [0.25, 0.75]
    assert normalised(p).m is p.m and p.w.tolist() == [1, 3]
    assert take(p, np.array([1])).P.tolist() == [[[2.0]]]
    assert take(p, np.array([True, False])).m.tolist() == [[0.0]]
    with pytest.raises(ValueError, match="sum to 0"):
        normalised(p._replace(w=np.zeros(2)))


@pytest.mark.parametrize("n", [*range(1, 20), 127, 128, 129, 250, 1000, 5001])
def test_sums_are_numpys_to_the_last_bit(n):
    w = np.random.default_rng(n).random(n) ** 9
    assert pairwise_sum(w) == w.sum()
    np.testing.assert_array_equal(rescaled(w), w / w.sum())


def test_mixture_copies_what_it_is_given():
    w = np.array([1.0])
    p = mixture(w, np.zeros((1, 1)), np.ones((1, 1, 1)))
    w[0] = 5
    assert p.w[0] == 1


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"w": []}, r"w must have shape \(n,\)"),
        ({"w": [[1.0]]}, r"w must have shape \(n,\)"),
        ({"m": [[0.0, 0.0]]}, "m must have shape"),
        ({"m": [0.0, 0.0]}, "m must have shape"),
        ({"P": np.eye(2)}, "P must have shape"),
        ({"w": [1.5, -0.5]}, "w must be finite and non-negative"),
        ({"w": [0.0, 0.0]}, "w must be finite and non-negative"),
        ({"w": [np.nan, 1.0]}, "w must be finite and non-negative"),
        ({"m": [[0, 0], [np.inf, 1]]}, "m must be finite"),
        ({"P": [np.eye(2), np.full((2, 2), np.nan)]}, r"P\[1\] must be finite"),
        ({"P": [np.eye(2), [[1, 0.5], [0, 1]]]}, r"P\[1\] must be symmetric.*\(P \+ P.T\) / 2"),
        ({"P": [[[1, 2], [2, 1]], np.eye(2)]}, r"P\[0\] must be positive definite.*eigenvalue is -1"),
    ],
)
def test_bad_mixture_is_refused_by_name(bad, message):
    mixture(**GOOD)
    with pytest.raises(ValueError, match=message):
        mixture(**GOOD | bad)


def test_gaussian_is_a_mixture_of_one_and_checked_like_it():
    p = gaussian([1, 2], np.diag([3, 4]))
    assert p.w.tolist() == [1] and p.m.tolist() == [[1, 2]] and p.P[0].tolist() == [[3, 0], [0, 4]]
    with pytest.raises(ValueError, match="positive definite"):
        gaussian([1, 2], np.zeros((2, 2)))


@pytest.mark.parametrize(
    "w", [[0.5, -0.1], [0.5, np.inf], [[0.5, 0.5]], [0.5, 1j], ["1", "2"], np.ma.masked_equal([0.5, 0], 0)]
)
def test_weights_that_are_none_are_not_normalised(w):
    p = Mixture(np.array(w) if isinstance(w, list) else w, np.zeros((2, 1)), np.ones((2, 1, 1)))
    with pytest.raises(ValueError, match=r"p\.w must"):
        normalised(p)


def test_weights_of_less_precision_sum_to_1_in_full():
    w = np.array([0.1, 0.2, 0.4], np.float32)
    p = normalised(Mixture(w, np.zeros((3, 1)), np.ones((3, 1, 1))))
    np.testing.assert_array_equal(p.w, w.astype(float) / w.astype(float).sum())
