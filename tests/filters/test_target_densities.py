"""Densities of single targets over several motions, against the same recursions written out."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from gmr_gym.filters import target_densities as densities_of
from gmr_gym.filters.association import expand
from gmr_gym.filters.filter_bank import as_bank, imm_mix, predict_bank
from gmr_gym.filters.target_densities import Densities
from gmr_gym.mixture import Mixture, mixture, moments
from gmr_gym.models.gating import Gates
from gmr_gym.models.kalman import Sensor, position_sensor
from gmr_gym.models.motions import constant_velocity
from gmr_gym.models.radar import UPDATES, radar
from gmr_gym.models.switching import sticky_switching

MOTIONS = constant_velocity(1.0, 0.5), constant_velocity(1.0, 8.0)
SWITCHING = sticky_switching(0.9, 2)
SENSOR = position_sensor(3.0)
WIDE = -200.0  # log of a ratio to the clutter that every pair surpasses


def drawn(seed, n=3, r=2, d=4, reach=10.0):
    rng = np.random.default_rng(seed)
    A = rng.normal(0, 3, (n, r, d, d))
    return Densities(
        rng.dirichlet(np.ones(r), n), rng.normal(0, reach, (n, r, d)), A @ A.swapaxes(2, 3) + np.eye(d)
    )


def paired(p, z, sensor=SENSOR, log_negligible=WIDE):
    return densities_of.pair(p, sensor, z, np.zeros(len(z)), np.ones(len(p.w)), log_negligible)


def test_a_prediction_is_that_of_a_bank_of_filters():
    p = drawn(0)
    got = densities_of.predict(p, MOTIONS, SWITCHING)
    for i in range(len(p.w)):
        bank = as_bank(Mixture(p.w[i], p.m[i], p.P[i]), 2)
        w, m, P = predict_bank(imm_mix(bank, SWITCHING), MOTIONS)
        np.testing.assert_allclose(got.w[i], w, rtol=1e-14)
        np.testing.assert_allclose(got.m[i], m, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(got.P[i], P, rtol=1e-12, atol=1e-10)


def test_likelihoods_and_posteriors_are_bayes():
    p, rng = drawn(1), np.random.default_rng(2)
    z, (H, R) = rng.normal(0, 10, (4, 2)), SENSOR
    pairs = paired(p, z)
    assert pairs.row.tolist() == np.repeat(range(3), 4).tolist()
    assert pairs.detection.tolist() == list(range(4)) * 3
    got = densities_of.posteriors(p, pairs, np.arange(12))
    for a, (i, j) in enumerate(zip(pairs.row, pairs.detection, strict=True)):
        S = [H @ P @ H.T + R for P in p.P[i]]
        parts = p.w[i] * [multivariate_normal(H @ p.m[i, q], S[q]).pdf(z[j]) for q in range(2)]
        assert pairs.log_likelihood[a] == pytest.approx(np.log(parts.sum()), rel=1e-10)
        np.testing.assert_allclose(got.w[a], parts / parts.sum(), rtol=1e-9)
        for q in range(2):
            K = p.P[i, q] @ H.T @ np.linalg.inv(S[q])
            np.testing.assert_allclose(got.m[a, q], p.m[i, q] + K @ (z[j] - H @ p.m[i, q]), rtol=1e-9)
            np.testing.assert_allclose(got.P[a, q], p.P[i, q] - K @ S[q] @ K.T, rtol=1e-8, atol=1e-9)
    chosen = np.array([7, 2])
    for one, other in zip(densities_of.posteriors(p, pairs, chosen), got, strict=True):
        np.testing.assert_array_equal(one, other[chosen])


def test_pairs_that_are_negligible_in_every_mode_are_left_out():
    p, z = drawn(3, n=5, reach=40.0), np.random.default_rng(4).normal(0, 40, (30, 2))
    every, weight = paired(p, z), np.linspace(0.1, 1.0, 5)
    log_kappa = np.log(np.linspace(1e-6, 1e-3, 30))
    pairs = densities_of.pair(p, SENSOR, z, log_kappa, weight, np.log(1e-4))
    ratio = every.of_mode.max(axis=1) + np.log(weight)[every.row] - log_kappa[every.detection]
    expected = ratio >= np.log(1e-4)
    assert 5 < expected.sum() < 100
    np.testing.assert_array_equal(pairs.row, every.row[expected])
    np.testing.assert_array_equal(pairs.detection, every.detection[expected])
    np.testing.assert_array_equal(pairs.log_likelihood, every.log_likelihood[expected])


def test_what_does_not_exist_has_no_pairs():
    assert len(densities_of.pair(drawn(0), SENSOR, np.zeros((2, 2)), np.zeros(2), np.zeros(3)).row) == 0


@pytest.mark.parametrize("update", UPDATES)
def test_a_radar_is_compared_as_by_the_trackers_of_one_target(update):
    sensor, rng = radar([10.0, 0.02, 0.02], 6, update), np.random.default_rng(5)
    p = drawn(6, n=2, d=6)
    p.m[:, :, :3] += [1000.0, 500.0, 300.0]
    z = sensor.measure(p.m[:, 0]) + rng.normal(0, [10.0, 0.02, 0.02], (2, 3))
    pairs = paired(p, z, sensor)
    flat = densities_of.as_mixture(p)
    full = expand(flat, Gates(*sensor.gates(flat), np.inf), sensor, z, 0.9, 1.0, 1e-6)
    seen = full.detection >= 0
    parts = np.log(flat.w[full.parent[seen]]) + full.log_density[seen]
    expected = parts.reshape(2, 2, 2).swapaxes(1, 2)  # density, mode, detection to density, detection, mode
    np.testing.assert_allclose(pairs.of_mode.reshape(2, 2, 2), expected, rtol=1e-10)
    got = densities_of.posteriors(p, pairs, np.arange(4))
    m = full.mixture.m[seen].reshape(2, 2, 2, 6).swapaxes(1, 2).reshape(4, 2, 6)
    np.testing.assert_allclose(got.m, m, rtol=1e-12)


def test_a_merge_keeps_the_moments_of_every_mode():
    p, weight, group = drawn(7, n=4), np.array([0.1, 0.3, 2.0, 5.0]), np.array([1, 0, 1, -1])
    got = densities_of.merge(p, weight, group, 2)
    for g, members, share in ((0, [1], [1.0]), (1, [0, 2], [0.1 / 2.1, 2.0 / 2.1])):
        joint = np.array(share)[:, None] * p.w[members]
        np.testing.assert_allclose(got.w[g], joint.sum(axis=0), rtol=1e-14)
        for q in range(2):
            mean, covariance = moments(mixture(joint[:, q], p.m[members, q], p.P[members, q]))
            np.testing.assert_allclose(got.m[g, q], mean, rtol=1e-12)
            np.testing.assert_allclose(got.P[g, q], covariance, rtol=1e-12, atol=1e-12)
    even = densities_of.merge(p, np.zeros(4), np.zeros(4, int), 1)
    for one, other in zip(even, densities_of.merge(p, np.ones(4), np.zeros(4, int), 1), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("r", [1, 2])
def test_outputs_are_moments_over_the_modes(r):
    p = drawn(8, r=r)
    x, P = densities_of.outputs(p)
    for i in range(3):
        mean, covariance = moments(mixture(p.w[i], p.m[i], p.P[i]))
        np.testing.assert_allclose(x[i], mean, rtol=1e-12)
        np.testing.assert_allclose(P[i], covariance, rtol=1e-12, atol=1e-12)


def test_a_birth_is_in_every_mode():
    births = mixture([0.1, 0.3], np.arange(8.0).reshape(2, 4), [np.eye(4), 2 * np.eye(4)])
    p = densities_of.of_mixture(births, np.array([0.25, 0.75]))
    assert p.w.tolist() == [[0.25, 0.75]] * 2
    for q in range(2):
        np.testing.assert_array_equal(p.m[:, q], births.m)
        np.testing.assert_array_equal(p.P[:, q], births.P)


@pytest.mark.parametrize("sensor", [SENSOR, radar([10.0, 0.01, 0.01])])
def test_without_densities_or_without_detections_there_are_no_pairs(sensor):
    p = sensor.H.shape[1]
    wide = 3 if not isinstance(sensor, Sensor) else 2
    none = Densities(np.empty((0, 2)), np.empty((0, 2, p)), np.empty((0, 2, p, p)))
    assert len(paired(none, np.ones((3, wide)), sensor).row) == 0
    assert len(paired(drawn(0, d=p), np.empty((0, wide)), sensor).row) == 0
