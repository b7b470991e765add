"""Clutter is learned: the fit against a plain one, and what is learned against what was drawn."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from gmr_gym.evaluation.multi_target_runs import density_error, places
from gmr_gym.filters.clutter_estimation import (
    fit_gaussians,
    initial_estimate,
    new_gaussian,
    options,
    responsibilities,
    update_estimate,
)
from gmr_gym.mixture import Mixture
from gmr_gym.models.clutter import uniform_clutter
from gmr_gym.scenarios.lv import unknown_clutter
from gmr_gym.simulation.multi_target import draw_clutter

LOW, HIGH = np.array([-1000.0, -1000.0]), np.array([1000.0, 1000.0])
FLAT = 1 / 4e6
TOLD = uniform_clutter(LOW, HIGH, 50.0)
GRID = np.stack(np.meshgrid(*[np.linspace(-990, 990, 100)] * 2), axis=-1).reshape(-1, 2)
GROUPS = TOLD._replace(
    uniform=20.0,
    gaussians=Mixture(
        np.array([20.0, 10.0]), np.array([[400.0, 200.0], [-300.0, 300.0]]),
        np.array([np.diag([120.0, 80.0]) ** 2, [[8000.0, 3000.0], [3000.0, 6000.0]]]),
    ),
)  # fmt: skip


def points(rng, clutter):
    parts = [rng.uniform(LOW, HIGH, (rng.poisson(clutter.uniform), 2))]
    for w, m, P in zip(*clutter.gaussians, strict=True):
        parts.append(rng.multivariate_normal(m, P, rng.poisson(w)))
    return rng.permutation(np.concatenate(parts))


def taught(clutter_of, scans, seed=0, how=None, told=TOLD):
    rng, lessons = np.random.default_rng(seed), initial_estimate(told)
    for t in range(scans):
        z = points(rng, clutter_of(t))
        lessons = update_estimate(told, lessons, z, np.ones(len(z)), how or options())
    return lessons.clutter


def off(learned, true):
    """Integral of the difference over the box, as a share of what is expected."""
    return np.abs(learned.density(GRID) - true.density(GRID)).sum() * 20.0**2 / true.expected


def plainly_responsible(z, a, m, P):
    joint = [np.full(len(z), a[0] * FLAT)]
    joint += [w * multivariate_normal(*one).pdf(z) for w, *one in zip(a[1:], m, P, strict=True)]
    joint = np.array(joint).T
    return joint / joint.sum(axis=1, keepdims=True)


def case(seed, n=200, k=3):
    rng = np.random.default_rng(seed)
    z = np.concatenate([points(rng, GROUPS) for _ in range(1 + n // 50)])[:n]
    m = z[:k] + rng.normal(0, 30, (k, 2))
    P = np.array([100.0**2 * np.eye(2) + 2000.0 * np.ones((2, 2))] * k)
    return z, rng.uniform(0, 1, len(z)), np.append(60.0, rng.uniform(5, 40, k)), m, P


@pytest.mark.parametrize("seed", range(5))
def test_a_step_of_the_fit_is_weighted_expectation_maximisation_less_the_cost_of_a_gaussian(seed):
    z, weight, a, m, P = case(seed)
    share = plainly_responsible(z, a, m, P)
    ours = responsibilities(z, a, m, P, FLAT)
    np.testing.assert_allclose(ours, share, rtol=1e-9, atol=1e-12)
    number = weight @ share
    a_out, m_out, P_out = fit_gaussians(z, weight, ours, 15.0)
    kept = [i for i in range(3) if number[i + 1] > 2.5]  # two of the mean, three of the covariance, halved
    assert len(kept) == len(m_out) and a_out.sum() == pytest.approx(weight.sum())
    for at, i in enumerate(kept):
        r = weight * share[:, i + 1] / number[i + 1]
        mean = r @ z
        np.testing.assert_allclose(m_out[at], mean, rtol=1e-9)
        scatter = (r[:, None] * (z - mean)).T @ (z - mean)
        np.testing.assert_allclose(P_out[at], scatter + 225.0 * np.eye(2), rtol=1e-9)
        assert a_out[at + 1] == pytest.approx(number[i + 1] - 2.5)


def test_without_its_cost_the_likelihood_would_never_fall():
    """Of many points the cost is next to nothing: the likelihood of the mixture must then rise."""
    rng = np.random.default_rng(3)
    z = np.concatenate([points(rng, GROUPS) for _ in range(400)])
    a, m, P = (
        np.array([1e4, 3e3, 3e3]),
        np.array([[300.0, 0.0], [-100.0, 400.0]]),
        np.array([1e4 * np.eye(2)] * 2),
    )
    weight, before = np.ones(len(z)), -np.inf
    for _ in range(15):
        a, m, P = fit_gaussians(z, weight, responsibilities(z, a, m, P, FLAT), 1e-3)
        density = a[0] * FLAT
        for w, mean, covariance in zip(a[1:], m, P, strict=True):
            density = density + w * multivariate_normal(mean, covariance).pdf(z)
        likelihood = np.log(density).sum()
        # a cost of 2.5 points of thousands moves a log likelihood of 1e5 by no more
        assert likelihood > before - 1.0
        before = likelihood
    order = np.argsort(-a[1:])
    np.testing.assert_allclose(a[1:][order] / 400, GROUPS.gaussians.w, rtol=0.1)
    np.testing.assert_allclose(m[order], GROUPS.gaussians.m, atol=10.0)
    np.testing.assert_allclose(P[order], GROUPS.gaussians.P, rtol=0.2, atol=600.0)


def test_groups_are_learned_within_thirty_scans():
    assert off(TOLD, GROUPS) > 0.9
    learned = taught(lambda t: GROUPS, 30)
    assert off(learned, GROUPS) < 0.25 and len(learned.gaussians.w) in (2, 3)
    # 1500 points: four standard errors of their number
    assert abs(learned.expected - GROUPS.expected) < 4 * np.sqrt(50 / 15)


def test_clutter_that_is_uniform_is_left_so():
    learned = taught(lambda t: TOLD, 60, seed=1)
    assert off(learned, TOLD) < 0.15


def test_a_rate_that_was_told_wrong_is_learned():
    learned = taught(lambda t: TOLD, 40, seed=2, told=uniform_clutter(LOW, HIGH, 200.0))
    assert abs(learned.expected - 50.0) < 12.0


def test_what_is_no_clutter_teaches_nothing():
    lessons, rng = initial_estimate(TOLD), np.random.default_rng(4)
    for _ in range(30):
        z = np.concatenate([points(rng, TOLD), rng.normal(500.0, 10.0, (5, 2))])
        false = np.append(np.ones(len(z) - 5), np.zeros(5))
        lessons = update_estimate(TOLD, lessons, z, false, options())
    here = lessons.clutter.density(np.array([[500.0, 500.0]]))[0]
    assert here < 3 * TOLD.density(np.zeros((1, 2)))[0]
    assert abs(lessons.clutter.expected - 50.0) < 4 * np.sqrt(50 / 15)


def test_a_slow_drift_is_followed():
    def drifting(t):
        m = GROUPS.gaussians.m + np.array([0.0, -4.0 * t])
        return GROUPS._replace(gaussians=GROUPS.gaussians._replace(m=m))

    learned = taught(drifting, 80, how=options(memory=8))
    # behind by the memory, half a deviation of the narrower group
    assert off(learned, drifting(79)) < 0.4 < off(learned, drifting(0))


def test_what_is_gone_is_forgotten():
    learned = taught(lambda t: GROUPS if t < 40 else TOLD, 100, how=options(memory=8))
    assert off(learned, TOLD) < 0.25


@pytest.mark.parametrize(
    "scans",
    [
        [np.empty((0, 2))] * 60,
        [np.zeros((1, 2))] * 30,
        [np.full((40, 2), 100.0)] * 30,  # all in one place
        [np.array([[5000.0, 5000.0]])] * 10,  # outside the box
        [np.random.default_rng(0).uniform(-1000, 1000, (10_000, 2))],
    ],
    ids=["none", "one", "the same", "outside", "ten thousand"],
)
def test_odd_scans_leave_an_intensity_that_is_one(scans):
    lessons = initial_estimate(TOLD)
    for z in scans:
        lessons = update_estimate(TOLD, lessons, z, np.ones(len(z)), options())
    kappa = lessons.clutter.density(GRID)
    assert np.isfinite(kappa).all() and (kappa > 0).all()
    for P in lessons.clutter.gaussians.P:
        assert np.linalg.eigvalsh(P)[0] >= 15.0**2 * (1 - 1e-9)


@pytest.mark.parametrize("seed", [0, 6, 8, 14])  # of all but 6 two places for a Gaussian tie
def test_the_order_of_detections_is_irrelevant(seed):
    rng, one, other = np.random.default_rng(seed), initial_estimate(TOLD), initial_estimate(TOLD)
    for _ in range(10):
        z = points(rng, GROUPS)
        one = update_estimate(TOLD, one, z, np.ones(len(z)), options())
        other = update_estimate(TOLD, other, z[::-1], np.ones(len(z)), options())
    np.testing.assert_allclose(one.clutter.density(GRID), other.clutter.density(GRID), rtol=1e-6)


def test_a_gaussian_is_added_where_the_points_are_and_not_by_chance():
    rng = np.random.default_rng(7)
    even = rng.uniform(LOW, HIGH, (500, 2))
    assert len(new_gaussian(even, even, np.ones(500), FLAT, 15.0).w) == 0
    heap = np.concatenate([even, rng.normal([300.0, -400.0], 40.0, (60, 2))])
    (w,), (m,), (P,) = new_gaussian(heap, heap, np.ones(560), FLAT, 15.0)
    assert np.linalg.norm(m - [300.0, -400.0]) < 60.0 and w == pytest.approx(60.0, rel=0.2)
    np.testing.assert_allclose(P, (2000.0**2 / 12**3 + 225.0) * np.eye(2))  # a square of that side, widened


def test_a_new_gaussian_is_where_most_is_left_within_a_square():
    z, left, *_ = case(8)
    near = (np.abs(z - z[:, None]) <= 2000.0 / 12 / 2).all(axis=2) @ left
    (w,), (m,), _ = new_gaussian(z, z, left, FLAT, 15.0)
    np.testing.assert_array_equal(m, z[near.argmax()])
    assert w == pytest.approx(near.max() - left.sum() / 144)


def test_of_no_detection_no_gaussian_is_made():
    z, left, *_ = case(9)
    assert (
        len(new_gaussian(z[:0], z, left, FLAT, 15.0).w)
        == len(new_gaussian(z[:0], z[:0], left[:0], FLAT, 15.0).w)
        == 0
    )


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"memory": 0}, "memory must be a whole number, at least 1, got 0"),
        ({"deviation": -1.0}, "deviation must be positive, got -1.0"),
        ({"max_gaussians": 2.5}, "max_gaussians must be a whole number"),
        ({"iterations": True}, "iterations must be a whole number"),
        ({"iterations": np.nan}, "iterations must be a whole number"),
        ({"memory": np.inf}, "memory must be a whole number"),
        ({"max_gaussians": "x"}, "max_gaussians must be a whole number, at least 1, got 'x'"),
    ],
)
def test_a_wrong_parameter_is_refused_by_name(wrong, message):
    with pytest.raises(ValueError, match=message):
        options(**wrong)


def test_who_is_told_the_truth_learns_no_worse_than_who_is_told_that_it_is_uniform():
    true, errors = unknown_clutter().clutter(0), {}
    for told in ("true", "uniform"):
        rng, given = np.random.default_rng(0), unknown_clutter(told=told).model.clutter
        lessons = initial_estimate(given)
        for _ in range(30):
            z = draw_clutter(true, rng)
            lessons = update_estimate(given, lessons, z, np.ones(len(z)), options())
        # 20 scans' worth of 50 points: a deviation of 1.6
        assert abs(lessons.clutter.expected - 50) < 6
        errors[told] = density_error(lessons.clutter, true, places(true))
    assert errors["true"] < 1.1 * errors["uniform"] < 0.4
