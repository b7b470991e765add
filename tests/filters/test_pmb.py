"""Poisson multi-Bernoulli tracks: an update, and trackers made of them."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from gmr_gym.baselines.learning_pmb import learning_pmb, pmb
from gmr_gym.filters import pmb as multi_bernoulli
from gmr_gym.filters.pmb import MultiBernoulli
from gmr_gym.mixture import Mixture, mixture
from gmr_gym.models.clutter import no_components, uniform_clutter
from gmr_gym.models.kalman import position_sensor, predict
from gmr_gym.models.motions import constant_velocity
from gmr_gym.models.multi_target import multi_target_model

CORNER = np.array([-300.0, -300.0])
DETECTION, SURVIVAL = 0.9, 0.98
TRACKERS = [pmb, learning_pmb]
BIRTHS = ([0.1, 0.05], [[100.0, 0, 0, 5], [-100, 50, 5, 0]], [np.diag([100.0, 100, 9, 9])] * 2)


def told(births=None, expected=10.0, detection=DETECTION, survival=SURVIVAL, **kwargs):
    """Targets of the plane that are born about two places."""
    births = mixture(*BIRTHS) if births is None else births
    return multi_target_model(
        constant_velocity(1.0, 1.0), position_sensor(3.0), detection, survival, births,
        uniform_clutter(CORNER, -CORNER, expected), **kwargs,
    )  # fmt: skip


def spawning(**kwargs):
    return told(spawn_weight=0.05, spawn_covariance=np.diag([25.0, 25, 1, 1]), **kwargs)


def of_tracks(w, places, undetected=None):
    """Tracks at places (n, 2) at rest."""
    n = len(w)
    m = np.hstack([np.reshape(places, (n, 2)), np.zeros((n, 2))])
    P = np.tile(np.diag([25.0, 16.0, 4.0, 4.0]), (n, 1, 1))
    return MultiBernoulli(
        Mixture(np.array(w, float), m, P),
        np.arange(n),
        no_components(4) if undetected is None else undetected,
        n,
    )


def updated(belief, z, people, least=0.0):
    z = np.reshape(z, (-1, 2)).astype(float)
    kappa = people.clutter.density(z)
    return multi_bernoulli.update(belief, people.sensor, z, people.detection_probability, kappa, least)


def likelihoods(p, z, people):
    """N(z; H m, H P H' + R) (n, k), by another route."""
    H, R = people.sensor
    return np.array(
        [
            [multivariate_normal(H @ m, H @ P @ H.T + R).pdf(one) for one in z]
            for _, m, P in zip(*p, strict=True)
        ]
    )


def followed(tracker, scans):
    belief, accounts = tracker.init(), []
    for z in scans:
        belief, said = tracker.step(belief, z)
        accounts.append(said)
    return belief, accounts


def two_walks(scans, seed, false=10):
    """Two targets from the places of birth, always seen, in clutter."""
    rng = np.random.default_rng(seed)
    x, out = np.array([[100.0, 0, 0, 5], [-100, 50, 5, 0]]), []
    for _ in range(scans):
        z = x[:, :2] + 3 * rng.standard_normal((2, 2))
        out.append(rng.permutation(np.vstack([z, rng.uniform(-300, 300, (rng.poisson(false), 2))])))
        x[:, :2] += x[:, 2:]
    return out


# ---- one update ----


@pytest.mark.parametrize("z", [np.empty((0, 2)), [[280.0, 280.0]]])
def test_existence_after_a_miss_is_the_formula_s(z):
    posterior, _ = updated(of_tracks([0.7, 0.2], [(0, 0), (50, 0)]), z, told())
    r = np.array([0.7, 0.2])
    np.testing.assert_allclose(posterior.tracks.w, r * (1 - DETECTION) / (1 - r * DETECTION), rtol=1e-12)


def test_a_new_track_is_the_formula_s():
    people, z = told(), np.array([[95.0, 8.0]])
    undetected = mixture([0.1, 0.3], [[100.0, 0, 0, 5], [80, 20, 5, 0]], [np.diag([100.0, 100, 9, 9])] * 2)
    posterior, false = updated(of_tracks([], [], undetected), z, people)
    parts = DETECTION * undetected.w * likelihoods(undetected, z, people)[:, 0]
    rho, kappa = parts.sum(), people.clutter.density(z)[0]
    np.testing.assert_allclose(posterior.tracks.w, [rho / (rho + kappa)], rtol=1e-10)
    np.testing.assert_allclose(false, [kappa / (rho + kappa)], rtol=1e-10)
    H, R = people.sensor
    K = [P @ H.T @ np.linalg.inv(H @ P @ H.T + R) for P in undetected.P]
    m = [m + k @ (z[0] - H @ m) for k, m in zip(K, undetected.m, strict=True)]
    P = [P - k @ H @ P for k, P in zip(K, undetected.P, strict=True)]
    share = parts / rho
    mean = share @ np.array(m)
    spread = sum(a * (b + np.outer(c - mean, c - mean)) for a, b, c in zip(share, P, m, strict=True))
    np.testing.assert_allclose(posterior.tracks.m[0], mean, rtol=1e-9)
    np.testing.assert_allclose(posterior.tracks.P[0], spread, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(posterior.undetected.w, (1 - DETECTION) * undetected.w)


def test_one_track_and_two_detections_are_bayes():
    people, z = told(), np.array([[3.0, 2.0], [-5.0, 6.0]])
    belief = of_tracks([0.6], [(0, 0)])
    posterior, false = updated(belief, z, people)
    detected = DETECTION * 0.6 * likelihoods(belief.tracks, z, people)[0] / people.clutter.density(z)
    total = 1 - 0.6 * DETECTION + detected.sum()
    exists = (detected.sum() + 0.6 * (1 - DETECTION)) / total
    np.testing.assert_allclose(posterior.tracks.w, [exists], rtol=1e-9)
    np.testing.assert_allclose(false, 1 - detected / total, rtol=1e-5)


@pytest.mark.parametrize("kappa", [10.0**power for power in (-300, -270, -200, -100, -10, -3, 0, 6)])
@pytest.mark.parametrize("existence", [1.0, 0.6])
def test_one_track_is_bayes_in_clutter_of_any_density(kappa, existence):
    people, z = told(), np.array([[0.3, 0.0], [21.0, 0.0]])
    belief = of_tracks([existence], [(0, 0)])
    posterior, false = multi_bernoulli.update(belief, people.sensor, z, DETECTION, np.full(2, kappa))
    P = belief.tracks.P[0]
    S = P[:2, :2] + 9 * np.eye(2)
    hit = multivariate_normal(cov=S).logpdf(z) + np.log(DETECTION * existence) - np.log(kappa)
    log_w = np.append(hit, np.log(1 - DETECTION * existence))
    w = np.exp(log_w - np.logaddexp.reduce(log_w))
    np.testing.assert_allclose(false, 1 - w[:2], rtol=1e-9, atol=1e-15)
    absent = w[2] * existence * (1 - DETECTION) / (1 - DETECTION * existence)
    np.testing.assert_allclose(posterior.tracks.w, [w[:2].sum() + absent], rtol=1e-9)
    shares = w[:2] / (w[:2].sum() + absent)
    mean = shares @ (z @ np.linalg.solve(S, P[:2]))
    np.testing.assert_allclose(posterior.tracks.m[0], mean, rtol=1e-9, atol=1e-12)


def test_a_track_and_a_new_target_share_a_detection_as_bayes_has_it():
    people, z = told(), np.array([[3.0, 2.0]])
    undetected = mixture([0.3], [[8.0, 0, 0, 0]], [np.diag([100.0, 100, 9, 9])])
    belief = of_tracks([0.6], [(0, 0)], undetected)
    posterior, false = updated(belief, z, people)
    kappa = people.clutter.density(z)[0]
    rho = DETECTION * 0.3 * likelihoods(undetected, z, people)[0, 0]
    detected = DETECTION * 0.6 * likelihoods(belief.tracks, z, people)[0, 0]
    total = detected + (1 - 0.6 * DETECTION) * (rho + kappa)
    r = [(detected + 0.6 * (1 - DETECTION) * (rho + kappa)) / total, (1 - 0.6 * DETECTION) * rho / total]
    np.testing.assert_allclose(posterior.tracks.w, r, rtol=1e-5)
    np.testing.assert_allclose(false, [(1 - 0.6 * DETECTION) * kappa / total], rtol=1e-5)


@pytest.mark.parametrize("seed", range(5))
def test_probabilities_lie_between_nothing_and_certainty(seed):
    rng = np.random.default_rng(seed)
    belief = of_tracks(rng.random(4), rng.uniform(-20, 20, (4, 2)), mixture(*BIRTHS))
    posterior, false = updated(belief, rng.uniform(-30, 30, (5, 2)), told())
    assert (posterior.tracks.w <= 1 + 1e-12).all() and (false > 0).all() and (false <= 1).all()
    assert len(set(posterior.label)) == len(posterior.label)


def test_two_identical_detections_are_alike():
    belief = of_tracks([0.9], [(0, 0)], mixture([0.5], [[0.0, 0, 0, 0]], [np.diag([25.0, 25, 4, 4])]))
    posterior, false = updated(belief, [[1.0, 1.0], [1.0, 1.0]], told())
    assert false[0] == pytest.approx(false[1], rel=1e-9)
    assert posterior.tracks.w[1] == pytest.approx(posterior.tracks.w[2], rel=1e-9)


def test_the_order_of_detections_does_not_matter():
    rng = np.random.default_rng(0)
    belief = of_tracks([0.9, 0.5, 0.3], [(0, 0), (15, 5), (-10, 5)], mixture(*BIRTHS))
    z = np.vstack([rng.uniform(-25, 25, (6, 2)), [[98.0, 3.0], [105.0, -4.0]]])
    order = rng.permutation(len(z))
    one, false = updated(belief, z, told(), 1e-4)
    other, shuffled = updated(belief, z[order], told(), 1e-4)
    np.testing.assert_allclose(shuffled, false[order], rtol=1e-6)
    assert (one.label == other.label).all()
    for a, b in zip(one.tracks, other.tracks, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-6)


def test_tracks_spawn_the_undetected():
    people = spawning()
    belief = of_tracks([0.8], [(10, 0)])
    predicted = multi_bernoulli.predict(belief, people)
    moved = predict(belief.tracks, people.motion)
    np.testing.assert_allclose(predicted.tracks.w, [0.8 * SURVIVAL])
    np.testing.assert_allclose(predicted.undetected.w, [*people.births.w, 0.8 * 0.05])
    np.testing.assert_allclose(predicted.undetected.P[-1], moved.P[0] + people.spawn_covariance)


def test_a_target_certain_to_be_seen_that_is_not_has_gone():
    posterior, _ = updated(of_tracks([1.0], [(0, 0)]), np.empty((0, 2)), told(detection=1.0))
    assert posterior.tracks.w[0] == 0
    assert len(multi_bernoulli.prune(posterior, 0.0, 0.0, 10).label) == 0


def test_what_rounding_adds_to_certainty_does_not_grow():
    people, belief = told(detection=0.1, survival=1.0), of_tracks([1 + 1e-12], [[0.0, 0.0]])
    for _ in range(400):  # misses, of which each would multiply it by 1.11
        belief, _ = updated(belief, np.empty((0, 2)), people)
    assert 1 - 1e-12 <= belief.tracks.w[0] <= 1


def test_a_certain_target_in_no_clutter_to_speak_of_stays_a_number():
    posterior, _ = updated(of_tracks([1.0], [(0, 0)]), [[1.0, 0.0]], told(detection=1.0, expected=1e-300))
    np.testing.assert_allclose(posterior.tracks.w[0], 1)


def test_no_more_than_the_heaviest_undetected_are_kept():
    undetected = mixture([0.1, 0.3, 0.2, 1e-6], np.zeros((4, 4)), [np.eye(4)] * 4)
    belief = multi_bernoulli.prune(of_tracks([], [], undetected), 1e-3, 1e-5, 2)
    np.testing.assert_allclose(np.sort(belief.undetected.w), [0.2, 0.3])


def test_no_more_than_the_surest_are_kept():
    belief = multi_bernoulli.prune(of_tracks([0.2, 0.9, 1e-4, 0.5], np.zeros((4, 2))), 1e-3, 1e-5, 2)
    np.testing.assert_allclose(belief.tracks.w, [0.9, 0.5])
    assert belief.label.tolist() == [1, 3]


# ---- trackers ----


def test_one_target_certainly_seen_without_clutter_is_a_kalman_filter():
    births = mixture([1.0], [[0.0, 0, 3, 0]], [np.diag([100.0, 100, 9, 9])])
    people = told(births, expected=1e-9, detection=1.0, survival=1.0)
    rng, tracker = np.random.default_rng(0), pmb(people)
    (F, Q, _), (H, R) = people.motion, people.sensor
    m, P = births.m[0], births.P[0]
    belief = tracker.init()
    for t in range(20):
        z = np.array([3.0 * t, 0.0]) + 3 * rng.standard_normal(2)
        if t > 0:
            m, P = F @ m, F @ P @ F.T + Q
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        m, P = m + K @ (z - H @ m), P - K @ H @ P
        belief, said = tracker.step(belief, z[None])
        # births go on at the first place, and could have what is seen there, at 1e-8 of the odds or less
        # where nobody else is expected
        np.testing.assert_allclose(said.x[0], m, atol=1e-5)
        np.testing.assert_allclose(said.intensity.P[0], P, atol=1e-5)
        assert said.label.tolist() == [0] and said.existence[0] == pytest.approx(1, abs=1e-6)


def test_hardly_any_clutter_leaves_numbers_finite():
    births = mixture([1.0], [[0.0, 0, 3, 0]], [np.diag([100.0, 100, 9, 9])])
    people = told(births, expected=1e-290, detection=1.0, survival=1.0)
    scans = [np.array([[3.0 * t, 0.0], [3.0 * t, 4.0]]) for t in range(5)]
    for said in followed(pmb(people), scans)[1]:
        assert said.expected_targets == pytest.approx(2, abs=1e-3) and len(said.x) == 2


@pytest.mark.parametrize("make", TRACKERS)
@pytest.mark.parametrize("seed", range(3))
def test_two_targets_are_found_and_keep_their_labels(make, seed):
    people = told(mixture([0.01, 0.01], *BIRTHS[1:]))  # rare enough for clutter not to be taken for them
    _, accounts = followed(make(people), two_walks(15, seed))
    late = accounts[5:]
    assert all(len(said.x) == 2 for said in late)
    assert len({tuple(sorted(said.label)) for said in late}) == 1
    truth = np.array([[100.0, 70], [-30, 50]])
    assert np.linalg.norm(late[-1].x[:, None, :2] - truth, axis=2).min(axis=0).max() < 12  # four deviations


@pytest.mark.parametrize("make", TRACKERS)
def test_an_account_adds_up(make):
    for said in followed(make(spawning()), two_walks(10, 1))[1]:
        assert said.expected_targets == pytest.approx(said.intensity.w.sum())
        assert ((said.existence > 0.5) & (said.existence <= 1)).all() and (np.diff(said.existence) <= 0).all()
        assert len(set(said.label)) == len(said.x) == len(said.existence)


@pytest.mark.parametrize("make", TRACKERS)
def test_a_hundred_empty_scans_leave_only_the_undetected(make):
    people = spawning()
    belief, accounts = followed(make(people), [*two_walks(5, 2), *[np.empty((0, 2))] * 100])
    targets = belief if make is pmb else belief.targets
    assert len(accounts[-1].x) == len(targets.tracks.w) == 0
    births = people.births.w.sum()
    # those born and never seen
    steady = births * (1 - DETECTION) / (1 - SURVIVAL * (1 - DETECTION))
    assert accounts[-1].expected_targets == pytest.approx(steady, rel=1e-3)


@pytest.mark.parametrize(("make", "most"), [(pmb, 400), (learning_pmb, 200)])
def test_ten_thousand_detections_are_followed_within_bounds(make, most):
    z = np.random.default_rng(0).uniform(-300, 300, (10_000, 2))
    belief, accounts = followed(make(told(expected=10_000.0)), [z, z])
    assert np.isfinite(accounts[-1].intensity.m).all() and np.isfinite(accounts[-1].expected_targets)
    targets = belief if make is pmb else belief.targets
    assert len(targets.tracks.w) <= most and accounts[-1].expected_targets < 5


def test_what_is_learned_is_where_the_clutter_is():
    rng = np.random.default_rng(0)
    scans = [rng.normal(-150.0, 30.0, (20, 2)) for _ in range(20)]
    _, accounts = followed(learning_pmb(told()), scans)
    crowded, empty = accounts[-1].clutter.density(np.array([[-150.0, -150.0], [200.0, 200.0]]))
    assert crowded > 20 / (2 * np.pi * 30**2) / 2 and empty < crowded / 50
    assert len(accounts[-1].x) == 0


@pytest.mark.parametrize("make", TRACKERS)
@pytest.mark.parametrize(
    ("z", "message"),
    [
        (np.zeros((2, 3)), r"shape \(k, 2\)"),
        (np.zeros(2), r"shape \(k, 2\)"),
        ([[0.0, 1.0], [np.nan, 0.0]], "row 1"),
        ([[np.inf, 1.0]], "row 0"),
    ],
)
def test_a_bad_scan_is_refused(make, z, message):
    tracker = make(told())
    with pytest.raises(ValueError, match=message):
        tracker.step(tracker.init(), z)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"prune_existence": -0.1}, "prune_existence must be"),
        ({"prune_existence": 0.5}, "prune_existence must be"),
        ({"prune_weight": -1.0}, "prune_weight must be"),
        ({"report_threshold": 0.0}, "report_threshold must lie"),
        ({"report_threshold": 1.5}, "report_threshold must lie"),
        ({"tracks": 0}, "tracks must be"),
        ({"tracks": 2.5}, "tracks must be"),
    ],
)
@pytest.mark.parametrize("make", TRACKERS)
def test_a_wrong_limit_is_named(make, wrong, message):
    with pytest.raises(ValueError, match=message):
        make(told(), **wrong)


@pytest.mark.parametrize("seed", range(5))
def test_a_track_after_a_scan_is_the_mixture_of_its_pairs_by_its_moments(seed):
    rng = np.random.default_rng(seed)
    people, n, k = told(), 4, 6
    H, R = people.sensor
    P = np.array([A @ A.T + np.eye(4) for A in rng.normal(0, 3, (n, 4, 4))])
    m, z = rng.normal(0, 10, (n, 4)), rng.normal(0, 15, (k, 2))
    absent, found = rng.random(n), rng.random((n, k)) * (rng.random((n, k)) < 0.7)
    found[-1] = 0.0  # one that had none
    S, C = H @ P @ H.T + R, H @ P
    tracks = Mixture(absent, m, P)
    predicted_z = people.sensor.predict_detections(tracks, m @ H.T, S, z)
    got = multi_bernoulli.moment_matched(tracks, found, predicted_z)
    for i in range(n):
        K = C[i].T @ np.linalg.inv(S[i])
        means = [m[i], *(m[i] + K @ (row - H @ m[i]) for row in z)]
        covariances = [P[i], *[P[i] - K @ S[i] @ K.T] * k]
        share = np.array([absent[i], *found[i]]) / (absent[i] + found[i].sum())
        mean = share @ means
        covariance = sum(
            b * (V + np.outer(x - mean, x - mean)) for b, x, V in zip(share, means, covariances, strict=True)
        )
        assert got[0][i] == pytest.approx(absent[i] + found[i].sum(), rel=1e-14)
        np.testing.assert_allclose(got[1][i], mean, rtol=1e-11, atol=1e-11)
        np.testing.assert_allclose(got[2][i], covariance, rtol=1e-10, atol=1e-10)


def test_clusters_too_large_for_exact_probabilities_are_reported():
    rng, people = np.random.default_rng(0), told()
    belief = of_tracks([0.9] * 30, rng.normal(0, 3, (30, 2)))
    posterior, _ = updated(belief, rng.normal(0, 5, (33, 2)), people)
    assert posterior.approximated == 1
    kept = multi_bernoulli.prune(posterior, 1e-3, 1e-5, 100)
    assert multi_bernoulli.report(kept, people.clutter).approximated == 1
    assert updated(of_tracks([0.9] * 3, rng.normal(0, 3, (3, 2))), [[0.0, 0.0]], people)[0].approximated == 0
