"""Motions against the differential equations they solve: integrals, exponentials, their limits."""

from decimal import Decimal, localcontext

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.linalg import expm

from gmr_gym.filters.imm import mix_and_predict
from gmr_gym.filters.mixing import borrowed_states
from gmr_gym.mixture import Mixture
from gmr_gym.models.kalman import motion, predict
from gmr_gym.models.motions import (
    constant_acceleration,
    constant_velocity,
    coordinated_turn,
    singer,
    with_accelerations,
)

# period over time constant, on both sides of every change of formula
RATIOS = [1e-8, 1e-6, 1e-4, 1e-2, 0.1, 0.5, 0.999, 1.0, 1.001, 2.0, 5.0, 7.999, 8.0, 8.001, 12.0, 25.0, 50.0]


def of_one_axis(move):
    """F and Q (n, n) of the first axis of a motion of three, alike on all and apart."""
    n = len(move.F) // 3
    for A in (move.F, move.Q):
        blocks = A.reshape(n, 3, n, 3)
        np.testing.assert_array_equal(blocks, blocks[:, :1, :, :1] * np.eye(3)[None, :, None])
    return move.F[::3, ::3], move.Q[::3, ::3]


def singer_exactly(period, time_constant, deviation):
    """F and Q (3, 3) of one axis, by integrals of t^k exp(-j t) in numbers of 150 digits.

    With t in time constants, an impulse of acceleration at 0 has come at t to the acceleration exp(-t), to
    the velocity that is its integral, and the position that is the velocity's. Sums are {(k, j): factor}."""
    with localcontext() as context:
        context.prec = 150
        acceleration = {(0, 1): Decimal(1)}
        velocity = integral(acceleration)
        position = integral(velocity)
        tau = Decimal(time_constant)
        x = Decimal(period) / tau
        f = [(position, tau**2), (velocity, tau), (acceleration, Decimal(1))]
        F = [[Decimal(1), Decimal(period), tau**2 * value(position, x)]]
        F += [[Decimal(0), Decimal(1), tau * value(velocity, x)], [Decimal(0), Decimal(0), (-x).exp()]]
        strength = 2 * Decimal(deviation) ** 2
        Q = [[strength * a * b * value(integral(product(u, v)), x) for v, b in f] for u, a in f]
        return np.array(F, float), np.array(Q, float)


def product(u, v):
    out = {}
    for (k, i), a in u.items():
        for (n, j), b in v.items():
            out[k + n, i + j] = out.get((k + n, i + j), 0) + a * b
    return out


def integral(u):
    """From 0: of t^k exp(-j t) it is k/j times that of t^(k-1) exp(-j t), less t^k exp(-j t) / j."""
    out = {}

    def add(term, a):
        out[term] = out.get(term, 0) + a

    for (k, j), a in u.items():
        if j == 0:
            add((k + 1, 0), a / (k + 1))
            continue
        while k > 0:
            add((k, j), -a / j)
            a, k = a * k / j, k - 1
        add((0, j), -a / j)
        add((0, 0), a / j)
    return out


def value(u, x):
    return sum(a * x**k * (-j * x).exp() for (k, j), a in u.items())


def van_loan(A, W, period):
    """F and Q of x' = A x + white noise of density W, from exponentials (Van Loan 1978)."""
    d = len(A)
    E = expm(np.block([[-A, W], [np.zeros((d, d)), A.T]]) * period)
    F = expm(A * period)
    return F, F @ E[:d, d:]


@pytest.mark.parametrize("ratio", RATIOS)
@pytest.mark.parametrize("period", [0.1, 3.0])
def test_singers_motion_has_every_digit_of_its_integrals(ratio, period):
    # the ratio as it comes out of the two times, whose rounding is not the motion's
    F, Q = singer_exactly(period, period / ratio, 30.0)
    got_F, got_Q = of_one_axis(singer(period, period / ratio, 30.0))
    np.testing.assert_allclose(got_F, F, rtol=1e-13, atol=0)
    # the closed form subtracts some hundreds where it sets in
    np.testing.assert_allclose(got_Q, Q, rtol=1e-12, atol=0)


@pytest.mark.parametrize("ratio", [0.3, 1.0, 3.0, 7.0, 9.0, 20.0])
def test_singers_motion_solves_its_differential_equation(ratio):
    period, deviation = 2.0, 5.0
    alpha = ratio / period
    A = np.array([[0, 1, 0], [0, 0, 1], [0, 0, -alpha]])
    F, Q = van_loan(A, np.diag([0, 0, 2 * alpha * deviation**2]), period)
    got_F, got_Q = of_one_axis(singer(period, 1 / alpha, deviation))
    np.testing.assert_allclose(got_F, F, rtol=1e-10)
    # an exponential that grows, times one that shrinks, costs it digits
    np.testing.assert_allclose(got_Q, Q, rtol=1e-10 + 1e-13 * np.exp(ratio), atol=0)
    for i in range(3):
        for j in range(3):
            integrand = lambda t, i=i, j=j: expm(A * t)[i, 2] * expm(A * t)[j, 2]  # noqa: E731
            area = quad(integrand, 0, period, epsabs=0, epsrel=1e-11)[0]
            assert got_Q[i, j] == pytest.approx(2 * alpha * deviation**2 * area, rel=1e-9)


def test_singers_acceleration_keeps_its_deviation_whatever_the_period():
    for ratio in RATIOS:
        F, Q = of_one_axis(singer(2.0, 2.0 / ratio, 7.0))
        assert F[2, 2] ** 2 * 49.0 + Q[2, 2] == pytest.approx(49.0, rel=1e-12)


@pytest.mark.parametrize("ratio", [0.01, 1.0, 9.0])
def test_two_periods_of_singers_motion_are_one_of_twice_the_length(ratio):
    once, twice = singer(1.5, 1.5 / ratio, 3.0, 2), singer(3.0, 1.5 / ratio, 3.0, 2)
    np.testing.assert_allclose(once.F @ once.F, twice.F, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(once.F @ once.Q @ once.F.T + once.Q, twice.Q, rtol=1e-11, atol=1e-14)


@pytest.mark.parametrize("ratio", [1e-8, 1e-5])
def test_singers_acceleration_that_is_hardly_forgotten_is_constant_but_for_white_jerk(ratio):
    T, deviation = 0.7, 4.0
    F, Q = of_one_axis(singer(T, T / ratio, deviation))
    jerk = np.array([
        [T**5 / 20, T**4 / 8, T**3 / 6], [T**4 / 8, T**3 / 3, T**2 / 2], [T**3 / 6, T**2 / 2, T],
    ])  # fmt: skip
    # what is left is of the order of the ratio
    np.testing.assert_allclose(F, of_one_axis(constant_acceleration(T, 1.0, 3))[0], rtol=2 * ratio)
    np.testing.assert_allclose(Q, 2 * deviation**2 * ratio / T * jerk, rtol=2 * ratio)


@pytest.mark.parametrize("ratio", [1e3, 1e5])
def test_singers_acceleration_that_is_forgotten_at_once_is_white(ratio):
    T, deviation = 4.0, 3.0
    F, Q = of_one_axis(singer(T, T / ratio, deviation))
    strength = 2 * deviation**2 * T / ratio
    white = strength * np.array([[T**3 / 3, T**2 / 2], [T**2 / 2, T]])
    np.testing.assert_allclose(Q[:2, :2], white, rtol=4 / ratio)
    assert Q[2, 2] == pytest.approx(deviation**2, rel=1e-12)
    # of the acceleration that there was, a time constant's worth of velocity
    np.testing.assert_allclose(F[:, 2], [T**2 / ratio, T / ratio, 0.0], rtol=2 / ratio)


@given(st.floats(-8, 4), st.floats(-2, 2), st.floats(-3, 3), st.integers(1, 3))
@settings(max_examples=200, deadline=None)
def test_singers_noise_is_positive_definite_for_any_times(ratio, period, deviation, axes):
    Q = singer(10**period, 10 ** (period - ratio), 10**deviation, axes).Q
    scale = np.sqrt(np.diag(Q))
    np.testing.assert_allclose(Q, Q.T, rtol=1e-14, atol=0)  # by matrix products, to the last digit but one
    assert np.linalg.eigvalsh(Q / np.outer(scale, scale))[0] > 0


@pytest.mark.parametrize("name", ["period", "time_constant", "deviation"])
@pytest.mark.parametrize("wrong", [0.0, -1.0, np.inf, np.nan])
def test_singers_numbers_that_are_not_positive_are_refused_by_name(name, wrong):
    right = {"period": 1.0, "time_constant": 5.0, "deviation": 3.0}
    with pytest.raises(ValueError, match=f"{name} must be positive and finite, got {wrong}"):
        singer(**{**right, name: wrong})


@pytest.mark.parametrize("axes", [1, 2, 3])
@pytest.mark.parametrize("period", [0.1, 2.0])
def test_constant_acceleration_carries_a_parabola_and_jumps_once_a_period(axes, period):
    move = constant_acceleration(period, 3.0, axes)
    A = np.kron(np.diag([1.0, 1.0], 1), np.eye(axes))
    np.testing.assert_allclose(move.F, expm(A * period), atol=1e-15)
    # a jump of the acceleration at the start lasts all the period
    G = expm(A * period)[:, 2 * axes :]
    np.testing.assert_allclose(move.Q, 9.0 * G @ G.T, rtol=1e-13)
    assert (move.offset == 0).all()


# ---- motions that know no accelerations among those that do ----


@pytest.mark.parametrize("axes", [1, 2, 3])
def test_a_motion_given_accelerations_moves_the_rest_as_it_did(axes):
    rng, d = np.random.default_rng(axes), 2 * axes
    _, _, (Q,) = reference.random_mixture(rng, 1, d)
    plain = motion(rng.standard_normal((d, d)), Q, rng.standard_normal(d))
    w, m, P = reference.random_mixture(rng, 4, 3 * axes)
    moved = predict(Mixture(w, m, P), with_accelerations(plain, 0.2))
    for i in range(4):
        mean, covariance = reference.kalman_predict(m[i, :d], P[i, :d, :d], *plain)
        np.testing.assert_allclose(moved.m[i], np.append(mean, np.zeros(axes)), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(moved.P[i, :d, :d], covariance, rtol=1e-12, atol=1e-12)
        # the accelerations it was given it forgets
        assert (moved.P[i, d:, :d] == 0).all()
        np.testing.assert_allclose(moved.P[i, d:, d:], 0.04 * np.eye(axes), rtol=1e-12, atol=0)


@given(st.integers(1, 200), st.floats(1e-2, 10), st.floats(0.1, 50))
@settings(max_examples=50, deadline=None)
def test_a_motion_given_accelerations_leaves_covariances_that_have_an_inverse(scans, period, deviation):
    move = with_accelerations(constant_velocity(period, deviation, 3))
    P = np.diag(np.repeat([100.0**2, 50.0**2, 10.0**2], 3))
    for _ in range(scans):
        P = predict(Mixture(np.ones(1), np.zeros((1, 9)), P[None]), move).P[0]
    np.linalg.cholesky(P)


def test_constant_velocity_mixed_with_singer_does_as_if_there_were_no_accelerations():
    period, axes = 0.5, 3
    plain = constant_velocity(period, 2.0, axes)
    told = (with_accelerations(plain), singer(period, 5.0, 30.0, axes))
    F, Q, offset = map(np.array, zip(*told, strict=True))
    as_given = borrowed_states(told, "augmented")
    w, m, P = reference.random_mixture(np.random.default_rng(0), 2, 9, total=0.7)
    switching = np.array([[0.9, 0.2], [0.1, 0.8]])
    others = m.copy()
    others[:, 6:] += 1000.0 * np.random.default_rng(1).standard_normal((2, 3))
    got = mix_and_predict(w, m, P, switching, as_given, F, Q, offset)
    again = mix_and_predict(w, others, P, switching, as_given, F, Q, offset)
    mixing = switching[0] * w
    total, mean, covariance = reference.moment_match(mixing, m[:, :6], P[:, :6, :6])
    mean, covariance = reference.kalman_predict(mean, covariance, *plain)
    for chances, means, covariances in (got, again):
        assert chances[0] == pytest.approx(total, rel=1e-14)
        np.testing.assert_allclose(means[0], np.append(mean, np.zeros(3)), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(covariances[0, :6, :6], covariance, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(covariances[0, 6:], np.eye(3, 9, 6) * 1e-6, rtol=1e-12, atol=0)
    # while Singer's does depend on them: the velocity by tens of metres a second
    assert np.abs(got[1][1] - again[1][1])[3:6].max() > 10


# ---- turns ----


@pytest.mark.parametrize("rate", [-1.2, -0.05, 1e-9, 0.05, 0.3, 3.0])
@pytest.mark.parametrize("period", [0.1, 2.5])
def test_a_turn_is_the_exponential_of_its_dynamics(rate, period):
    A = np.zeros((4, 4))
    A[:2, 2:] = np.eye(2)
    A[2:, 2:] = [[0, -rate], [rate, 0]]
    move = coordinated_turn(period, rate, 2.0)
    np.testing.assert_allclose(move.F, expm(A * period), rtol=1e-12, atol=1e-14)
    np.testing.assert_array_equal(move.Q, constant_velocity(period, 2.0).Q)


def test_a_turn_at_no_rate_is_constant_velocity():
    for got, wanted in zip(coordinated_turn(0.7, 0.0, 3.0), constant_velocity(0.7, 3.0), strict=True):
        np.testing.assert_array_equal(got, wanted)


@given(st.floats(-3, 3), st.floats(0.01, 10), st.floats(0.01, 10))
@settings(max_examples=100, deadline=None)
def test_turns_keep_speed_and_circle_and_follow_one_another(rate, first, second):
    F = coordinated_turn(first, rate, 1.0).F
    x = np.array([100.0, -50.0, 30.0, 40.0])
    moved = F @ x
    assert np.hypot(*moved[2:]) == pytest.approx(50.0, rel=1e-12)
    # the centre of the circle stays: a quarter turn from the velocity, at speed / rate
    if abs(rate) > 0.01:
        centres = [p[:2] + np.array([-p[3], p[2]]) / rate for p in (x, moved)]
        np.testing.assert_allclose(*centres, rtol=1e-9, atol=1e-9 / abs(rate))
    after = coordinated_turn(second, rate, 1.0).F @ F
    np.testing.assert_allclose(coordinated_turn(first + second, rate, 1.0).F, after, rtol=1e-9, atol=1e-11)


def test_a_positive_rate_turns_from_x_towards_y():
    moved = coordinated_turn(1.0, 0.1, 1.0).F @ np.array([0.0, 0.0, 10.0, 0.0])
    assert moved[3] == pytest.approx(10 * np.sin(0.1)) and moved[1] > 0
