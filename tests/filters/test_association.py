"""Gates hold what they promise, and the posterior of a scan is the formula's, term by term."""

import numpy as np
import pytest
import reference

from gmr_gym.filters.association import expand
from gmr_gym.filters.joint_gating import expected_false_alarms, gate_jointly
from gmr_gym.mixture import Mixture, gaussian, mixture, normalised
from gmr_gym.models.gating import Gates, gate_threshold, gated_distances_kernel, gates, volumes
from gmr_gym.models.kalman import motion, sensor
from gmr_gym.models.model import model


def random_case(seed, n=4, k=7, d=4, p=2):
    rng = np.random.default_rng(seed)
    predicted = Mixture(*reference.random_mixture(rng, n, d))
    R = reference.random_mixture(rng, 1, p)[2][0]
    return predicted, sensor(rng.standard_normal((p, d)), R), 6 * rng.standard_normal((k, p))


def gated_distances(gates, z):
    return gated_distances_kernel(
        gates.z, gates.S, z[None], np.empty((0, *gates.S.shape[1:])), gates.threshold
    )


@pytest.mark.parametrize("p", [1, 2, 3])
@pytest.mark.parametrize("probability", [0.5, 0.9, 0.999])
def test_gate_holds_the_targets_detection_with_its_probability(p, probability):
    predicted, see, _ = random_case(p, n=1, p=p)
    looked = gates(predicted, see, probability)
    S = see.H @ predicted.P[0] @ see.H.T + see.R
    z = np.random.default_rng(p).multivariate_normal(see.H @ predicted.m[0], S, 100_000)
    share = np.isfinite(gated_distances(looked, z)).mean()
    # five standard errors of a share
    assert abs(share - probability) < 5 * np.sqrt(probability * (1 - probability) / 100_000)


def test_gate_of_probability_one_is_the_whole_space():
    assert gate_threshold(1.0, 2) == np.inf
    looked = gates(gaussian([0.0, 0.0], np.eye(2)), sensor(np.eye(2), np.eye(2)), 1.0)
    assert gated_distances(looked, np.array([[1e9, -1e9]])) == pytest.approx(1e18)
    assert volumes(looked)[0] == np.inf


@pytest.mark.parametrize("p", [1, 2, 3])
def test_gated_distance_is_the_squared_mahalanobis_distance_and_infinite_outside(p):
    predicted, see, z = random_case(p, k=200, p=p)
    looked = gates(predicted, see, 0.8)
    got = gated_distances(looked, z)
    for i in range(len(got)):
        for j in range(len(z)):
            wanted = reference.mahalanobis_squared(z[j], looked.z[i], looked.S[i])
            inside = wanted <= looked.threshold
            assert got[i, j] == (pytest.approx(wanted, rel=1e-9) if inside else np.inf)
    assert 0 < np.isfinite(got).mean() < 1  # else the loop has checked one side only


def test_gate_reaches_its_own_edge():
    edge = 2.0 * np.linalg.cholesky([[4, 1.9], [1.9, 1]])  # points at distance 2 along either axis
    looked = Gates(np.zeros((1, 2)), np.array([[[4, 1.9], [1.9, 1]]]), 4.0)
    for angle in np.linspace(0, 2 * np.pi, 100):
        point = edge @ [np.cos(angle), np.sin(angle)]
        inside, outside = gated_distances(looked, np.array([point * (1 - 1e-9), point * (1 + 1e-9)]))[0]
        assert np.isfinite(inside) and np.isinf(outside)


def test_volume_is_that_of_the_interval_the_ellipse_and_the_ellipsoid():
    for p, unit in ((1, 2), (2, np.pi), (3, 4 / 3 * np.pi)):
        S = np.array([np.diag(np.arange(1.0, p + 1) ** 2), 9 * np.eye(p)])
        half_axes = [np.prod(np.arange(1.0, p + 1)), 3.0**p]
        looked = Gates(np.zeros((2, p)), S, 4.0)
        np.testing.assert_allclose(volumes(looked), unit * 2.0**p * np.array(half_axes), rtol=1e-12)


@pytest.mark.parametrize("p", [1, 2, 3])
def test_a_detection_is_listed_when_at_least_one_gate_holds_it(p):
    predicted, see, z = random_case(p, k=200, p=p)
    predicted = normalised(predicted)
    told = model(motion(np.eye(4), np.eye(4)), see, 0.9, 0.6, 1e-3, predicted)
    looked = gates(predicted, see, 0.6)
    _, near, used, alive = gate_jointly(predicted, told, z, np.inf)
    held = [
        any(
            reference.mahalanobis_squared(row, c, S) <= looked.threshold
            for c, S in zip(*looked[:2], strict=True)
        )
        for row in z
    ]
    np.testing.assert_array_equal(near, held)
    assert alive and used.threshold == looked.threshold and 0 < np.mean(held) < 1
    assert gate_jointly(predicted, told, np.empty((0, p)), np.inf)[1].shape == (0,)
    assert not gate_jointly(predicted, told, z, 0.0)[3]


@pytest.mark.parametrize(("p", "ball"), [(1, 2), (2, np.pi), (3, 4 / 3 * np.pi)])
def test_false_detections_are_expected_within_one_deviation_of_the_predictions_by_weight(p, ball):
    S = np.array([9 * np.eye(p), 4 * np.eye(p), 25 * np.eye(p)])
    looked, w = Gates(np.zeros((3, p)), S, 30.0), np.array([3.0, 1.0, 0.0])
    expected = 0.01 * ball * (3 * 3.0**p + 2.0**p) / 4
    assert expected_false_alarms(looked, w, 0.01) == pytest.approx(expected, rel=1e-12)
    assert expected_false_alarms(looked._replace(threshold=np.inf), w, 0.01) == expected_false_alarms(
        looked, w, 0.01
    )


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("detection", "gate"), [(0.9, 0.99), (0.3, 0.6), (1.0, 0.99), (0.9, 1.0)])
def test_expanded_weights_are_the_formulas_hypothesis_by_hypothesis(seed, detection, gate):
    predicted, see, z = random_case(seed)
    clutter = 0.02
    looked = gates(predicted, see, gate)
    wanted = {}
    for i, (w, m, P) in enumerate(zip(*predicted, strict=True)):
        wanted[i, -1] = w * (1 - detection * gate), m, P
        S = see.H @ P @ see.H.T + see.R
        for j, row in enumerate(z):
            if reference.mahalanobis_squared(row, see.H @ m, S) <= looked.threshold:
                weight = w * detection * reference.gaussian_density(row, see.H @ m, S) / clutter
                wanted[i, j] = weight, *reference.kalman_update(m, P, *see, row)
    total = sum(weight for weight, _, _ in wanted.values())
    got = expand(predicted, looked, see, z, detection, gate, clutter)
    pairs = list(zip(got.parent.tolist(), got.detection.tolist(), strict=True))
    assert sorted(pairs) == sorted(wanted) and len(pairs) > len(predicted.w)
    for at, pair in enumerate(pairs):
        weight, m, P = wanted[pair]
        assert got.mixture.w[at] == pytest.approx(weight / total, rel=1e-9, abs=1e-300)
        np.testing.assert_allclose(got.mixture.m[at], m, rtol=1e-8, atol=1e-8)
        np.testing.assert_allclose(got.mixture.P[at], P, rtol=1e-8, atol=1e-8)


def test_empty_scan_leaves_the_prediction_as_it_was():
    predicted, see, _ = random_case(0)
    for probability in (0.9, 1.0):
        looked = gates(predicted, see, 0.99)
        got = expand(predicted, looked, see, np.empty((0, 2)), probability, probability, 1e-4)
        np.testing.assert_allclose(got.mixture.w, predicted.w, rtol=1e-14)
        assert (got.mixture.m == predicted.m).all() and (got.mixture.P == predicted.P).all()
        assert got.parent.tolist() == [0, 1, 2, 3] and (got.detection == -1).all()


def test_a_sure_target_is_never_missed_unless_every_gate_is_empty():
    see = sensor([[1.0]], [[1.0]])
    predicted = mixture([0.999, 0.001], [[0.0], [50.0]], [[[1.0]], [[1.0]]])
    looked = gates(predicted, see, 0.99)
    sure = expand(predicted, looked, see, np.array([[50.0], [500.0]]), 1.0, 1.0, 1e-3)
    assert (sure.parent.tolist(), sure.detection.tolist()) == ([1], [0])
    assert sure.mixture.w.tolist() == [1.0]
    coasting = expand(predicted, looked, see, np.array([[500.0]]), 1.0, 1.0, 1e-3)
    assert (coasting.detection == -1).all() and coasting.mixture.w == pytest.approx([0.999, 0.001])


def test_weights_survive_likelihoods_that_underflow():
    see = sensor([[1.0]], [[1.0]])
    predicted = mixture([0.5, 0.5], [[0.0], [1.0]], [[[1.0]], [[1.0]]])
    got = expand(predicted, gates(predicted, see, 1.0), see, np.array([[100.0]]), 1.0, 1.0, 1e-3)
    # densities near exp(-2500); their ratio is exp((100^2 - 99^2) / 4)
    assert got.mixture.w[0] / got.mixture.w[1] == pytest.approx(np.exp(-(100**2 - 99**2) / 4), rel=1e-9)


def test_more_clutter_makes_a_detection_count_less():
    see = sensor([[1.0]], [[1.0]])
    predicted = gaussian([0.0], [[1.0]])
    looked = gates(predicted, see, 0.99)
    shares = [
        expand(predicted, looked, see, np.array([[0.5]]), 0.9, 0.99, clutter).mixture.w[1]
        for clutter in (1e-300, 1e-3, 1.0, 1e3)
    ]
    assert shares[0] == 1.0 and shares == sorted(shares, reverse=True) and shares[-1] < 1e-2
