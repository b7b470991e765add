"""Radar in space: conversions against sampling and their limits, updates against the linear filter."""

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st

from gmr_gym.baselines.pda import Pda
from gmr_gym.filters.association import expand
from gmr_gym.mixture import Mixture, gaussian
from gmr_gym.models import radar
from gmr_gym.models import spherical as kernels
from gmr_gym.models.gating import gates
from gmr_gym.models.kalman import position_sensor
from gmr_gym.models.model import model
from gmr_gym.models.motions import constant_velocity

DRAWS = 1_000_000
# range, azimuth, elevation, and deviations of the noise: near and sharp, far, extreme, steep and behind
GEOMETRIES = {
    "near": ([12_000.0, 0.7, 0.1], [20.0, 0.002, 0.002]),
    "far": ([57_000.0, -1.2, 0.3], [20.0, 0.025, 0.025]),
    "extreme": ([150_000.0, 2.9, -0.05], [5.0, 0.04, 0.04]),
    "steep": ([8_000.0, -2.5, 1.2], [30.0, 0.1, 0.08]),
}
each = pytest.mark.parametrize(("z", "deviations"), GEOMETRIES.values(), ids=GEOMETRIES)


def drawn(middle, deviations, seed):
    return np.asarray(middle) + np.random.default_rng(seed).standard_normal((DRAWS, 3)) * deviations


def assert_moments(error, mean, second):
    """Mean and second moment about zero of the errors (DRAWS, 3), within four standard errors."""
    squares = error[:, :, None] * error[:, None]
    assert (np.abs(error.mean(axis=0) - mean) < 4 * error.std(axis=0) / np.sqrt(DRAWS)).all()
    assert (np.abs(squares.mean(axis=0) - second) < 4 * squares.std(axis=0) / np.sqrt(DRAWS)).all()


@each
def test_the_average_true_bias_and_covariance_are_those_of_sampled_truths(z, deviations):
    truth = drawn(z, deviations, 0)
    found = drawn(truth, deviations, 1)
    converted = radar.debiased(np.array([z]), np.array(deviations))
    bias = radar.cartesian(np.array(z)) - converted.z[0]
    # what a detection of each truth scatters, about its mean given that truth
    D = np.exp(-(np.array(deviations[1:]) ** 2) / 2)
    shrunk = radar.cartesian(truth) * [D[0] * D[1], D[0] * D[1], D[1]]
    scatter = radar.cartesian(found) - shrunk
    assert_moments(scatter, 0.0, converted.R[0])
    wrong = radar.cartesian(found) - radar.cartesian(truth)
    assert (np.abs(wrong.mean(axis=0) - bias) < 4 * wrong.std(axis=0) / np.sqrt(DRAWS)).all()


@each
def test_modified_unbiased_is_mean_and_covariance_of_the_truth_given_the_detection(z, deviations):
    converted = radar.modified_unbiased(np.array([z]), np.array(deviations))
    assert_moments(radar.cartesian(drawn(z, deviations, 2)) - converted.z[0], 0.0, converted.R[0])


@each
def test_unbiased_is_so_given_the_truth_with_the_mean_square_error_given_the_detection(z, deviations):
    noise = np.array(deviations)
    # of draws beyond the zenith too, which no radar would report so
    found, _ = kernels.unbiased_of(drawn(z, deviations, 3), noise)
    off = found - radar.cartesian(np.array(z))
    assert (np.abs(off.mean(axis=0)) < 4 * off.std(axis=0) / np.sqrt(DRAWS)).all()
    converted = radar.unbiased(np.array([z]), noise)
    error = radar.cartesian(drawn(z, deviations, 4)) - converted.z[0]
    squares = error[:, :, None] * error[:, None]
    assert (np.abs(squares.mean(axis=0) - converted.R[0]) < 4 * squares.std(axis=0) / np.sqrt(DRAWS)).all()


@each
def test_the_decorrelated_covariance_is_the_scatter_about_predicted_truths(z, deviations):
    noise, spread = np.array(deviations), np.array([[60.0, 0.03, 0.02]])
    truth = drawn(z, spread, 5)
    found = drawn(truth, deviations, 6)
    converted = radar.decorrelated(found[:1], noise, np.array([z]), spread)
    error = kernels.unbiased_of(found, noise)[0] - radar.cartesian(truth)
    assert_moments(error, 0.0, converted.R[0])


@each
def test_debiased_at_the_prediction_takes_the_predicted_bias_and_scatter(z, deviations):
    noise, spread = np.array(deviations), np.array([[60.0, 0.03, 0.02]])
    truth = drawn(z, spread, 7)
    found = drawn(truth, deviations, 8)
    converted = radar.debiased_at(found[:1], noise, np.array([z]), spread)
    bias = radar.cartesian(found[0]) - converted.z[0, 0]
    wrong = radar.cartesian(found) - radar.cartesian(truth)
    assert (np.abs(wrong.mean(axis=0) - bias) < 4 * wrong.std(axis=0) / np.sqrt(DRAWS)).all()
    D = np.exp(-(np.array(deviations[1:]) ** 2) / 2)
    scatter = radar.cartesian(found) - radar.cartesian(truth) * [D[0] * D[1], D[0] * D[1], D[1]]
    assert_moments(scatter, 0.0, converted.R[0])


@pytest.mark.parametrize("convert", [radar.debiased, radar.unbiased, radar.modified_unbiased])
def test_conversions_tend_to_the_raw_one_as_the_angles_noise_vanishes(convert):
    z = np.array([[30_000.0, 0.4, -0.6]])
    for angle in (1e-4, 1e-6, 1e-8):
        noise = np.array([20.0, angle, 2 * angle])
        one, plain = convert(z, noise), radar.raw(z, noise)
        off = (one.z - plain.z)[0] / np.sqrt(np.diag(plain.R[0]))
        assert np.abs(off).max() < 100 * angle
        whitened = np.linalg.solve(np.linalg.cholesky(plain.R[0]), np.eye(3))
        np.testing.assert_allclose(whitened @ one.R[0] @ whitened.T, np.eye(3), atol=1e-6 + 1e4 * angle)


def detections(limit=np.pi / 2 - 0.02):
    azimuth = st.floats(-np.pi, np.pi)
    return st.tuples(st.floats(100.0, 3e5), azimuth, st.floats(-limit, limit))


@given(detections(), st.floats(0.1, 50.0), st.floats(1e-7, radar.WIDEST), st.floats(1e-7, radar.WIDEST))
@settings(max_examples=200, deadline=None)
def test_covariances_are_positive_definite_wherever_a_conversion_is_said_to_be_valid(z, near, wide, high):
    z, noise = np.array([z]), np.array([near, wide, high])
    spread = np.array([[50.0, 0.01, 0.02]])
    for one in (
        radar.raw(z, noise), radar.debiased(z, noise), radar.unbiased(z, noise),
        radar.modified_unbiased(z, noise), radar.decorrelated(z, noise, z, spread),
        radar.debiased_at(z, noise, z, spread),
    ):  # fmt: skip
        R = one.R[0]
        np.testing.assert_array_equal(R, R.T)
        scale = np.sqrt(np.diag(R))
        # an axis 10^8 times as narrow as another is zero to the precision of the numbers
        assert np.linalg.eigvalsh(R / np.outer(scale, scale))[0] > -8 * np.finfo(float).eps


@given(detections())
@settings(max_examples=100, deadline=None)
def test_there_and_back_and_the_derivatives_are_differences(z):
    z = np.array(z)
    back = radar.spherical(radar.cartesian(z))
    np.testing.assert_allclose(back[[0, 2]], z[[0, 2]], rtol=1e-9, atol=1e-9)
    assert abs(radar.wrapped(back[1] - z[1])) < 1e-8
    J = kernels.jacobian_of(z[None])[0]
    steps = np.array([1e-3, 1e-7, 1e-7])
    for i, step in enumerate(steps):
        change = radar.cartesian(z + step * np.eye(3)[i]) - radar.cartesian(z - step * np.eye(3)[i])
        np.testing.assert_allclose(J[:, i], change / (2 * step), rtol=1e-5, atol=1e-5 * z[0])


@pytest.mark.parametrize("update", radar.UPDATES)
def test_with_tiny_angles_and_no_clutter_every_update_is_the_linear_filter(update):
    deviations = np.array([5.0, 1e-6, 1e-6])
    start = np.array([20_000.0, -8_000.0, 3_000.0, -150.0, 90.0, 10.0])
    prior = gaussian(start, np.diag([100.0, 100, 100, 25, 25, 25]))
    motion = constant_velocity(1.0, 3.0, 3)
    told = model(motion, radar.radar(deviations, 6, update), 1.0, 1.0, 1e-300, prior)
    tracker, rng = Pda(told), np.random.default_rng(0)
    belief, m, P, x = tracker.init(), start.copy(), prior.P[0], start.copy()
    H = position_sensor(1.0, 3).H
    for _ in range(5):
        x = motion.F @ x
        z = radar.spherical(x[:3]) + deviations * rng.standard_normal(3)
        belief, report = tracker.step(belief, z[None])
        m, P = reference.kalman_predict(m, P, *motion)
        m, P = reference.kalman_update(m, P, H, radar.raw(z[None], deviations).R[0], radar.cartesian(z))
        # the direction of the noise turns by an angle of metres in kilometres
        np.testing.assert_allclose(report.x[0], m, rtol=1e-4, atol=0.05)
        np.testing.assert_allclose(report.P[0], P, rtol=2e-2, atol=0.05)


def test_the_linearised_update_is_the_textbooks_with_the_azimuth_the_shorter_way_round():
    deviations = np.array([20.0, 0.02, 0.03])
    told = radar.radar(deviations, 6, "extended")
    m = np.array([-9_000.0, 50.0, 1_000.0, 100.0, 50.0, 0.0])
    P = np.diag([300.0**2, 300.0**2, 200.0**2, 50.0, 50.0, 50.0])
    z = np.array([[9_050.0, -np.pi + 0.02, 0.1]])  # on the other side of the seam
    p = Mixture(np.ones(1), m[None], P[None])
    look = told.predict_detections(p, *told.gates(p), z)
    J = np.linalg.inv(kernels.jacobian_of(radar.spherical(m[None, :3])))[0]
    H = np.hstack([J, np.zeros((3, 3))])
    np.testing.assert_allclose(look.S[0], H @ P @ H.T + np.diag(deviations**2), rtol=1e-9, atol=1e-14)
    np.testing.assert_allclose(look.C[0], H @ P, rtol=1e-9, atol=1e-12)
    away = look.z[0, 0] - look.z_hat[0]
    assert abs(away[1]) < 0.1 and away[1] == pytest.approx(z[0, 1] + 2 * np.pi - look.z_hat[0, 1])


def test_points_find_the_moments_that_sampling_finds():
    m = np.array([[8_000.0, 3_000.0, 2_000.0, 0, 0, 0]])
    P = np.diag([800.0**2, 600.0**2, 700.0**2, 1, 1, 1]) + 0.0
    P[0, 3] = P[3, 0] = 300.0
    p = Mixture(np.ones(1), m, P[None])
    x = np.random.default_rng(0).multivariate_normal(m[0], P, DRAWS)
    z = radar.spherical(x[:, :3])
    for update in ("unscented", "cubature"):
        told = radar.radar([20.0, 0.01, 0.01], 6, update)
        look = told.predict_detections(p, *told.gates(p), z[:1])
        spread = np.sqrt(np.diag(np.cov(z.T)))
        assert (np.abs(look.z_hat[0] - z.mean(axis=0)) < 0.02 * spread).all()
        np.testing.assert_allclose(
            (look.S[0] - told.R) / np.outer(spread, spread), np.cov(z.T) / np.outer(spread, spread), atol=0.03
        )
        joint = ((z - z.mean(axis=0))[:, :, None] * (x - m)[:, None]).mean(axis=0)
        scale = np.outer(spread, np.sqrt(np.diag(P)))
        np.testing.assert_allclose(look.C[0] / scale, joint / scale, atol=0.03)


def test_unscented_covariances_are_sums_over_seven_points_weighed_a_quarter_and_eighths():
    m, P = np.array([8_000.0, 3_000.0, 2_000.0]), np.diag([900.0, 500.0, 700.0]) ** 2 + 1e5
    L = 2.0 * np.linalg.cholesky(P)
    points = radar.spherical(np.vstack([m, m + L.T, m - L.T]))
    weights = np.array([2, 1, 1, 1, 1, 1, 1]) / 8
    mean = weights @ points
    told = radar.radar([20.0, 0.01, 0.01], 3, "unscented")
    p = Mixture(np.ones(1), m[None], P[None])
    look = told.predict_detections(p, *told.gates(p), mean[None])
    np.testing.assert_allclose(look.z_hat[0], mean, rtol=1e-12)
    scatter = (weights[:, None] * (points - mean)).T @ (points - mean)
    np.testing.assert_allclose(look.S[0] - told.R, scatter, rtol=1e-9, atol=1e-12)


@each
def test_gates_hold_positions_of_detections_about_predicted_truths(z, deviations):
    place = radar.cartesian(np.array(z))
    P = np.diag([30.0, 40.0, 20.0]) ** 2
    told = radar.radar(deviations, 3)
    (at,), (S,) = told.gates(Mixture(np.ones(1), place[None], P[None]))
    np.testing.assert_allclose(at, place)
    found = kernels.cartesian_of(drawn(z, deviations, 9))
    found += np.random.default_rng(10).standard_normal((DRAWS, 3)) * [30.0, 40.0, 20.0]
    error = found - found.mean(axis=0)
    assert_moments(error, 0.0, S)


@pytest.mark.parametrize("update", ["decorrelated", "debiased-at-prediction"])
def test_what_is_predicted_spreads_in_range_and_angles_as_its_covariance_says(update):
    """The covariance at the prediction, by the draws of a truth and of a detection of each."""
    noise = np.array([20.0, 0.03, 0.02])
    m, P = np.array([30_000.0, 9_000.0, 4_000.0]), np.diag([300.0, 900.0, 800.0]) ** 2
    told, p = radar.radar(noise, 3, update), Mixture(np.ones(1), m[None], P[None])
    truth = np.random.default_rng(11).multivariate_normal(m, P, DRAWS)
    found = drawn(radar.spherical(truth), noise, 12)
    look = told.predict_detections(p, *told.gates(p), radar.spherical(m[None]))
    D = np.array([np.exp(-(noise[1] ** 2 + noise[2] ** 2) / 2)] * 2 + [np.exp(-(noise[2] ** 2) / 2)])
    shrunk = radar.cartesian(found) - D * truth
    R = np.cov(shrunk.T, bias=True) / (np.outer(D, D) if update == "decorrelated" else 1.0)
    scale = np.sqrt(np.diag(R))
    # 1 % for the draws; the spread of the prediction is taken to first order
    unit = np.outer(scale, scale)
    np.testing.assert_allclose((look.S[0] - P) / unit, R / unit, atol=0.01)


def test_near_by_all_updates_weigh_and_measure_the_detections_alike():
    """Densities are per unit of range, azimuth and elevation, whatever space an update works in."""
    m = np.array([11_000.0, 4_000.0, 1_500.0])
    p = Mixture(np.ones(1), m[None], np.diag([40.0, 40.0, 40.0])[None] ** 2)
    z = radar.spherical(m) + np.array([[0.0, 0.0, 0.0], [15.0, 0.002, 0.001], [-30.0, -0.003, 0.002]])
    weights, densities = [], []
    for update in radar.UPDATES:
        told = radar.radar([20.0, 0.002, 0.002], 3, update)
        posterior = expand(p, gates(p, told, 1.0), told, z, 0.9, 0.999, 1e-3)
        weights.append(posterior.mixture.w)
        densities.append(posterior.log_density[1:])
    np.testing.assert_allclose(weights, np.tile(weights[0], (9, 1)), rtol=0.02)
    np.testing.assert_allclose(densities, np.tile(densities[0], (9, 1)), atol=0.02)


@pytest.mark.parametrize("update", radar.UPDATES[4:])
def test_a_prediction_at_the_radar_itself_is_refused(update):
    told, p = radar.radar([20.0, 0.01, 0.01], 3, update), gaussian(np.zeros(3), 1e8 * np.eye(3))
    with pytest.raises(ValueError, match="predicted position is that of the radar itself"):
        told.predict_detections(p, *told.gates(p), np.array([[1000.0, 0.0, 0.0]]))


def test_clutter_fills_what_a_conversion_stretches():
    z, noise = np.array([[30_000.0, 0.4, -0.6]]), np.array([20.0, 0.3, 0.3])
    p = gaussian(radar.cartesian(z)[0], 1e6 * np.eye(3))
    for update in radar.CONVERSIONS[:5]:
        told = radar.radar(noise, 3, update)
        moved = [
            told.predict_detections(p, *told.gates(p), z + step * np.eye(3)[i]).z[0, 0]
            for i, step in enumerate((1e-2, 1e-6, 1e-6)) for step in (step, -step)
        ]  # fmt: skip
        J = (np.array(moved[::2]) - moved[1::2]) / np.array([2e-2, 2e-6, 2e-6])[:, None]
        look = told.predict_detections(p, *told.gates(p), z)
        assert look.log_jacobian[0] == pytest.approx(np.log(abs(np.linalg.det(J))), abs=1e-4)


def test_clutter_uniform_in_what_the_radar_says_thins_with_the_volume_in_space():
    told = radar.radar([20.0, 0.01, 0.01])
    at = radar.cartesian(np.array([[10_000.0, 0.5, 0.3], [20_000.0, 0.5, 0.3], [10_000.0, 0.5, 1.2]]))
    density = told.density(2.0, at)
    np.testing.assert_allclose(density, 2 / (np.array([1e4, 2e4, 1e4]) ** 2 * np.cos([0.3, 0.3, 1.2])))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"deviations": [20.0, 0.6, 0.1]}, "deviations of angles must be at most 0.5 rad"),
        ({"deviations": [0.0, 0.1, 0.1]}, "deviations must be three positive numbers"),
        ({"deviations": [1.0, 0.1]}, "deviations must be three positive numbers"),
        ({"update": "debias"}, "update must be one of raw, debiased"),
        ({"states": 2}, "states must be at least 3"),
    ],
)
def test_a_wrong_radar_is_refused_by_name(wrong, message):
    with pytest.raises(ValueError, match=message):
        radar.radar(**{"deviations": [20.0, 0.01, 0.01], **wrong})


@pytest.mark.parametrize(
    ("z", "message"),
    [
        ([[-1.0, 0, 0]], "positive ranges; row 0 has -1"),
        ([[1.0, 0, 0], [0.0, 0, 0]], "positive ranges; row 1 has 0"),
        ([[1.0, 0, 1.6]], "elevations within a right angle; row 0 has 1.6"),
        ([[1.0, np.nan, 0]], "z must be finite"),
        ([[1.0, 2.0]], r"shape \(k, 3\)"),
    ],
)
def test_a_wrong_detection_is_refused_by_row(z, message):
    with pytest.raises(ValueError, match=message):
        radar.check_detections(np.array(z))


@pytest.mark.parametrize("name", ["spherical", "cartesian"])
@pytest.mark.parametrize(
    "wrong",
    [np.ones((2, 4)), np.ones((2, 3, 1)), [[1.0, np.nan, 0.0]], [[1.0, 0.0, np.inf]], [["1", "0", "0"]]],
)
def test_what_are_no_coordinates_in_space_is_refused_by_name(name, wrong):
    argument = {"spherical": "x", "cartesian": "z"}[name]
    with pytest.raises(ValueError, match=f"^{argument} must be"):
        getattr(radar, name)(wrong)


@pytest.mark.parametrize("value", [1j, "x", None])
@pytest.mark.parametrize(("name", "i"), [("z", 0), ("deviations", 1), ("at", 2), ("spread", 3)])
def test_what_is_no_number_is_refused_by_name(name, i, value):
    given = [np.array([[1e3, 0.1, 0.2]]), np.array([10.0, 0.01, 0.01]), np.array([[1e3, 0.1, 0.2]])]
    given.append(np.array([[10.0, 0.01, 0.01]]))
    given[i] = given[i].astype(object)
    given[i].flat[1] = value
    given[i] = given[i].astype(complex) if value == 1j else given[i]
    with pytest.raises(ValueError, match=f"^{name} must be an array of real numbers"):
        radar.decorrelated(*given)


def test_masked_detections_are_absent():
    z, deviations = np.array([[1e3, 0.1, 0.2], [2e3, 0.3, -0.4], [3e3, 1.0, 0.0]]), [10.0, 0.01, 0.01]
    masked = np.ma.array(z, mask=np.eye(3) * [0, 1, 0])
    for convert in (radar.raw, radar.debiased, radar.unbiased, radar.modified_unbiased):
        for one, other in zip(convert(masked, deviations), convert(z[[0, 2]], deviations), strict=True):
            np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(radar.cartesian(masked), radar.cartesian(z[[0, 2]]))
    np.testing.assert_array_equal(radar.spherical(masked), radar.spherical(z[[0, 2]]))
