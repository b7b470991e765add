"""Stacks of Gaussians move and are conditioned as the textbook's single one."""

import numpy as np
import pytest
import reference
from scipy.stats import multivariate_normal

from gmr_gym.filters.association import expand
from gmr_gym.mixture import Mixture, gaussian, joined, take
from gmr_gym.models.gating import Gates
from gmr_gym.models.kalman import motion, position_sensor, predict, sensor
from gmr_gym.models.motions import constant_velocity

SHAPES = [(1, 1), (2, 1), (4, 2), (6, 3), (3, 3)]


def random_case(d, p, n=5):
    rng = np.random.default_rng(10 * d + p)
    _, _, (Q, R_full) = reference.random_mixture(rng, 2, max(d, p))
    move = motion(rng.standard_normal((d, d)), Q[:d, :d], rng.standard_normal(d))
    see = sensor(rng.standard_normal((p, d)), R_full[:p, :p])
    return Mixture(*reference.random_mixture(rng, n, d)), move, see, rng.standard_normal((n, p))


def condition(p, see, z):
    """Each component updated by its own detection, of which it is sure, and the log density of that."""
    each = [
        expand(take(p, [i]), Gates(*see.gates(take(p, [i])), np.inf), see, z[[i]], 1.0, 1.0, 1.0)
        for i in range(len(z))
    ]
    updated = joined([one.mixture for one in each])._replace(w=p.w)
    return updated, np.concatenate([one.log_density for one in each])


@pytest.mark.parametrize(("d", "p"), SHAPES)
def test_predict_is_the_textbooks_for_every_component(d, p):
    mix, move, _, _ = random_case(d, p)
    moved = predict(mix, move)
    for i in range(len(mix.w)):
        m, P = reference.kalman_predict(mix.m[i], mix.P[i], *move)
        np.testing.assert_allclose(moved.m[i], m, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(moved.P[i], P, rtol=1e-12, atol=1e-12)
    assert (moved.w == mix.w).all() and (moved.P == moved.P.transpose(0, 2, 1)).all()


@pytest.mark.parametrize(("d", "p"), SHAPES)
def test_condition_is_the_textbooks_for_every_component(d, p):
    mix, _, see, z = random_case(d, p)
    updated, log_likelihood = condition(mix, see, z)
    z_hat, S = see.gates(mix)
    for i in range(len(mix.w)):
        m, P = reference.kalman_update(mix.m[i], mix.P[i], *see, z[i])
        # the inverses in the textbook's form cost it a few digits
        np.testing.assert_allclose(updated.m[i], m, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(updated.P[i], P, rtol=1e-9, atol=1e-9)
        wanted = multivariate_normal(z_hat[i], S[i]).logpdf(z[i])
        assert log_likelihood[i] == pytest.approx(wanted, rel=1e-10)
        np.testing.assert_allclose(z_hat[i], see.H @ mix.m[i], atol=1e-12)
        np.testing.assert_allclose(S[i], see.H @ mix.P[i] @ see.H.T + see.R, atol=1e-11)
    assert (updated.w == mix.w).all() and (updated.P == updated.P.transpose(0, 2, 1)).all()


def test_a_filter_over_ten_scans_equals_conditioning_the_joint_gaussian_at_once():
    rng = np.random.default_rng(0)
    move, see = constant_velocity(0.5, 2.0), position_sensor(3.0)
    start = gaussian([0, 0, 1, -1], np.diag([9.0, 9, 4, 4]))
    z = np.cumsum(rng.standard_normal((10, 2)), axis=0)
    belief, log_evidence = start, 0.0
    for row in z:
        belief, log_likelihood = condition(predict(belief, move), see, row[None])
        log_evidence += log_likelihood[0]
    mean, covariance = reference.joint_states(start.m[0], start.P[0], move, 10)
    G = np.kron(np.eye(10), see.H)
    S = G @ covariance @ G.T + np.kron(np.eye(10), see.R)
    K = covariance @ G.T @ np.linalg.inv(S)
    wanted = mean + K @ (z.ravel() - G @ mean), covariance - K @ S @ K.T
    np.testing.assert_allclose(belief.m[0], wanted[0][-4:], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(belief.P[0], wanted[1][-4:, -4:], rtol=1e-9, atol=1e-9)
    assert log_evidence == pytest.approx(multivariate_normal(G @ mean, S).logpdf(z.ravel()), rel=1e-10)


def test_an_exact_sensor_pins_the_position_and_a_blind_one_teaches_nothing():
    p, z = gaussian(np.zeros(4), 100 * np.eye(4)), np.array([[5.0, -7.0]])
    exact, _ = condition(p, position_sensor(1e-6), z)
    np.testing.assert_allclose(exact.m[0, :2], z[0], rtol=1e-12)  # 1e-12 / 100 of the way short
    assert np.linalg.eigvalsh(exact.P[0])[0] > 0
    blind, _ = condition(p, position_sensor(1e9), z)
    np.testing.assert_allclose(blind.P[0], p.P[0], rtol=1e-12)


def test_constant_velocity_carries_positions_by_velocities_and_shakes_them_by_acceleration():
    move = constant_velocity(2.0, 3.0)
    assert (move.F @ [1, 2, 10, 20] == [21, 42, 10, 20]).all()
    rng = np.random.default_rng(1)
    a = 3.0 * rng.standard_normal((400_000, 2))  # m/s^2, held over the 2 s
    shake = np.hstack([2.0 * a, 2.0 * a])  # T^2 / 2 and T are both 2 here
    np.testing.assert_allclose(move.Q, np.cov(shake.T), atol=0.4)  # 36: seven standard errors
    assert constant_velocity(1.0, 1.0, axes=3).F.shape == (6, 6)
    assert constant_velocity(1.0, 2.0, axes=1).Q.tolist() == [[1, 2], [2, 4]]


def test_position_sensor_sees_positions_with_its_deviation():
    see = position_sensor(4.0, axes=3)
    assert (see.H @ np.arange(6) == [0, 1, 2]).all()
    assert (see.R == 16 * np.eye(3)).all()


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: motion(np.ones((2, 3)), np.eye(2)), "F must be a finite square"),
        (lambda: motion(np.full((2, 2), np.nan), np.eye(2)), "F must be a finite square"),
        (lambda: motion(np.eye(2), np.eye(3)), "Q must be finite with the shape of F"),
        (lambda: motion(np.eye(2), -np.eye(2)), "Q must be symmetric positive semidefinite"),
        (lambda: motion(np.eye(2), [[1, 1], [0, 1]]), "Q must be symmetric positive semidefinite"),
        (lambda: motion(np.eye(2), np.eye(2), [0.0]), "offset must be finite with shape"),
        (lambda: sensor([1.0, 0.0], np.eye(1)), "H must be a finite matrix"),
        (lambda: sensor(np.eye(2), np.eye(1)), "R must have shape"),
        (lambda: sensor(np.eye(2), np.zeros((2, 2))), "R must be positive definite"),
    ],
)
def test_bad_motion_or_sensor_is_refused_by_name(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_motion_may_be_without_noise():
    assert (motion(np.eye(2), np.zeros((2, 2))).offset == 0).all()
