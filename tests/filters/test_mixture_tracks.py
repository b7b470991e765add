"""Tracks updated jointly, against the enumeration of every association event."""

from itertools import product

import numpy as np
import pytest
from scipy.optimize import linear_sum_assignment
from scipy.stats import multivariate_normal

from gmr_gym.filters import mixture_tracks
from gmr_gym.filters.marginals import marginals as exact
from gmr_gym.filters.mixture_tracks import MixtureTracks, associate, collapsed, collapsing, reduce
from gmr_gym.filters.registry import make_tracker
from gmr_gym.filters.target_densities import Densities
from gmr_gym.mixture import gaussian, mixture, moments
from gmr_gym.models.clutter import no_components, uniform_clutter
from gmr_gym.models.kalman import position_sensor, sensor
from gmr_gym.models.model import model as single
from gmr_gym.models.motions import constant_velocity
from gmr_gym.models.multi_target import multi_target_model
from gmr_gym.models.switching import sticky_switching

SENSOR = position_sensor(3.0)
CORNER = np.array([-300.0, -300.0])


def told(detection=0.9, modes=1, **kwargs):
    motions = tuple(constant_velocity(1.0, 1.0 + 4.0 * q) for q in range(modes))
    return multi_target_model(
        motions, SENSOR, detection, 0.98, no_components(4), uniform_clutter(CORNER, -CORNER, 10.0),
        switching=sticky_switching(0.9, modes), **kwargs,
    )  # fmt: skip


def drawn(seed, n=3, modes=1, rows=1, reach=8.0, existence=None):
    """n tracks of `rows` hypotheses about the origin."""
    rng = np.random.default_rng(seed)
    A = rng.normal(0, 2, (n * rows, modes, 4, 4))
    densities = Densities(
        rng.dirichlet(np.ones(modes), n * rows), rng.normal(0, reach, (n * rows, modes, 4)),
        A @ A.swapaxes(2, 3) + np.eye(4),
    )  # fmt: skip
    there = rng.uniform(0.3, 1.0, n) if existence is None else np.full(n, existence)
    weight = rng.dirichlet(np.ones(rows), n).ravel()
    return MixtureTracks(there, np.arange(n), densities, weight, np.repeat(np.arange(n), rows))


def updated(tracks, model, z, kappa=1e-3):
    found = associate(tracks, model, z, np.log(np.full(len(z), kappa)))
    return reduce(found.tracks, None), found


def outcomes(tracks, i, model, z, kappa):
    """Of one track the parts (weight, mode, mean, covariance) for every choice: -2 (there is no target), -1
    (missed) and each detection."""
    out = {choice: [] for choice in range(-2, len(z))}
    out[-2].append((1 - tracks.existence[i], 0, np.zeros(4), np.eye(4)))
    H, R = SENSOR
    for h in np.flatnonzero(tracks.track == i):
        seen = model.detection_probability
        for q, w in enumerate(tracks.densities.w[h]):
            m, P = tracks.densities.m[h, q], tracks.densities.P[h, q]
            there = tracks.existence[i] * tracks.weight[h] * w
            out[-1].append((there * (1 - seen), q, m, P))
            S = H @ P @ H.T + R
            K = P @ H.T @ np.linalg.inv(S)
            for j, one in enumerate(z):
                g = multivariate_normal(H @ m, S).pdf(one)
                out[j].append((there * seen * g / kappa, q, m + K @ (one - H @ m), P - K @ S @ K.T))
    return out


def enumerated(tracks, model, z, kappa=1e-3):
    """Existence (n,), and for each track its modes, means and covariances, that all association events
    leave."""
    n, modes = len(tracks.existence), tracks.densities.w.shape[1]
    of = [outcomes(tracks, i, model, z, kappa) for i in range(n)]
    total, parts = 0.0, [[] for _ in range(n)]
    for event in product(range(-2, len(z)), repeat=n):
        taken = [j for j in event if j >= 0]
        if len(set(taken)) < len(taken):
            continue
        whole = [sum(part[0] for part in of[i][choice]) for i, choice in enumerate(event)]
        total += np.prod(whole)
        for i, choice in enumerate(event):
            if choice > -2:
                others = np.prod(np.delete(whole, i))
                parts[i] += [(w * others, *rest) for w, *rest in of[i][choice]]
    existence = np.array([sum(part[0] for part in own) for own in parts]) / total
    states = []
    for own in parts:
        by_mode = [[part for part in own if part[1] == q] for q in range(modes)]
        weights = np.array([sum(part[0] for part in found) for found in by_mode])
        matched = [
            moments(mixture(*zip(*[(w, m, P) for w, _, m, P in found], strict=True))) for found in by_mode
        ]
        states.append((weights / weights.sum(), *zip(*matched, strict=True)))
    return existence, states


@pytest.mark.parametrize(("n", "k", "modes", "rows"), [
    (1, 5, 1, 1), (2, 3, 1, 1), (3, 4, 1, 1), (4, 5, 1, 1), (3, 3, 2, 1), (2, 4, 2, 2), (3, 3, 1, 3),
])  # fmt: skip
@pytest.mark.parametrize("existence", [None, 1.0])
def test_tracks_are_what_all_association_events_leave(n, k, modes, rows, existence):
    model, z = told(modes=modes), np.random.default_rng(k).normal(0, 8, (k, 2))
    tracks = drawn(n, n, modes, rows, existence=existence)
    got, _ = updated(tracks, model, z)
    there, states = enumerated(tracks, model, z)
    np.testing.assert_allclose(got.existence, there, rtol=1e-10)
    for i, (w, m, P) in enumerate(states):
        np.testing.assert_allclose(got.densities.w[i], w, rtol=1e-9)
        np.testing.assert_allclose(got.densities.m[i], m, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(got.densities.P[i], P, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("k", [0, 1, 4])
def test_one_certain_target_is_tracked_as_by_pda(k):
    z, kappa = np.random.default_rng(k).normal(0, 6, (k, 2)), 1e-3
    prior = gaussian([0.0, 0.0, 2.0, -1.0], np.diag([30.0, 20.0, 4.0, 4.0]))
    model = told()
    alone = make_tracker("pda", single(model.motions[0], SENSOR, 0.9, 1.0, kappa, prior))
    _, report = alone.step(alone.init(), z)
    one = np.zeros(1, int)
    tracks = MixtureTracks(
        np.ones(1), one, Densities(np.ones((1, 1)), prior.m[:, None], prior.P[:, None]), np.ones(1), one
    )
    model = model._replace(survival_probability=1.0)
    x, P = collapsed(updated(mixture_tracks.predict(tracks, model), model, z, kappa)[0])
    np.testing.assert_allclose(x, report.x, rtol=1e-12)
    np.testing.assert_allclose(P, report.P, rtol=1e-12, atol=1e-12)


def test_targets_far_apart_are_tracked_each_alone():
    model, tracks, z = told(), drawn(0, 4), np.random.default_rng(1).normal(0, 8, (8, 2))
    places = 200.0 * np.array([[-1, -1], [1, -1], [-1, 1], [1, 1]])
    tracks.densities.m[:, 0, :2] += places
    z += np.repeat(places, 2, axis=0)
    together, _ = updated(tracks, model, z)
    for i in range(4):
        one, _ = updated(mixture_tracks.take(tracks, np.array([i])), model, z[2 * i : 2 * i + 2])
        np.testing.assert_allclose(together.existence[i], one.existence[0], rtol=1e-12)
        np.testing.assert_allclose(together.densities.m[i], one.densities.m[0], rtol=1e-12)
        np.testing.assert_allclose(together.densities.P[i], one.densities.P[0], rtol=1e-11, atol=1e-12)


def test_all_detected_without_clutter_is_the_best_assignment():
    # detections so exact that one assignment has all the probability
    model, tracks = (
        told(1.0)._replace(sensor=sensor(SENSOR.H, 1e-4 * np.eye(2))),
        drawn(5, existence=1.0, reach=20.0),
    )
    tracks = tracks._replace(densities=tracks.densities._replace(P=tracks.densities.P * 1e-3))
    z = tracks.densities.m[[2, 0, 1], 0, :2] + 0.01
    got, _ = updated(tracks, model, z, 1e-200)
    rows, columns = linear_sum_assignment(((tracks.densities.m[:, 0, None, :2] - z) ** 2).sum(axis=2))
    for i, j in zip(rows, columns, strict=True):
        m, P, H = tracks.densities.m[i, 0], tracks.densities.P[i, 0], SENSOR.H
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + 1e-4 * np.eye(2))
        np.testing.assert_allclose(got.densities.m[i, 0], m + K @ (z[j] - H @ m), rtol=1e-9)


def test_two_targets_in_one_place_are_alike():
    tracks = drawn(2, 1, existence=0.8)
    twice = mixture_tracks.added(tracks, tracks._replace(label=np.array([7])))
    got, _ = updated(twice, told(), np.random.default_rng(3).normal(0, 5, (3, 2)))
    assert got.label.tolist() == [0, 7]
    for part in (got.existence, *got.densities):
        np.testing.assert_allclose(part[0], part[1], rtol=1e-10, atol=1e-12)


def test_detections_in_one_place_are_alike():
    z = np.array([[1.0, 2.0], [1.0, 2.0]])
    _, found = updated(drawn(1), told(), z)
    assert found.unassigned[0] == pytest.approx(found.unassigned[1], rel=1e-12)


def test_the_order_of_tracks_and_of_detections_does_not_matter():
    model, tracks, rng = told(modes=2), drawn(3, 4, 2), np.random.default_rng(4)
    z, order, rows = rng.normal(0, 8, (5, 2)), rng.permutation(5), rng.permutation(4)
    one, found = updated(tracks, model, z)
    other, shuffled = updated(
        tracks._replace(
            existence=tracks.existence[rows], densities=Densities(*(part[rows] for part in tracks.densities))
        ),
        model, z[order],
    )  # fmt: skip
    np.testing.assert_allclose(shuffled.unassigned, found.unassigned[order], rtol=1e-9)
    np.testing.assert_allclose(other.existence, one.existence[rows], rtol=1e-9)
    np.testing.assert_allclose(other.densities.m, one.densities.m[rows], rtol=1e-9, atol=1e-9)


def test_missed_for_certain_is_gone_from_the_mass_and_stays_in_its_place():
    tracks = drawn(4, 1, existence=1.0)
    got, _ = updated(tracks, told(1.0), np.empty((0, 2)))
    assert got.existence.tolist() == [0.0]
    np.testing.assert_array_equal(got.densities.m, tracks.densities.m)


def test_a_probability_of_detection_by_the_state_is_that_of_each_hypothesis():
    def seen(x):
        return np.where(x[:, 0] < 0, 0.2, 0.9)

    tracks, z = drawn(6, 1, rows=2, existence=0.7), np.array([[0.0, 0.0]])
    tracks.densities.m[:, 0, 0] = -5.0, 5.0
    found = associate(tracks, told(seen), z, np.log([1e-3]))
    H, R = SENSOR
    there = 0.7 * tracks.weight
    g = [
        multivariate_normal(H @ m, H @ P @ H.T + R).pdf(z[0])
        for m, P in zip(tracks.densities.m[:, 0], tracks.densities.P[:, 0], strict=True)
    ]
    absent, hit = there * [0.8, 0.1], there * [0.2, 0.9] * g / 1e-3
    total = 0.3 + absent.sum() + hit.sum()
    np.testing.assert_allclose(found.tracks.existence, [1 - 0.3 / total], rtol=1e-12)
    np.testing.assert_allclose(
        found.tracks.weight, np.append(absent, hit) / (absent.sum() + hit.sum()), rtol=1e-10
    )


@pytest.mark.parametrize("modes", [1, 2])
def test_one_component_of_any_moment_matching_reduction_is_the_merge_of_all(modes):
    assert collapsing("runnalls", 1) is None and collapsing("capping", 1) is not None
    tracks = drawn(7, 3, modes, rows=4)
    merged = reduce(tracks, None)
    reduced = reduce(tracks, lambda p: mixture_tracks.reducer("runnalls", 1)(p))
    for one, other in zip(merged.densities, reduced.densities, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("name", ["runnalls", "capping", "k-means", "west"])
@pytest.mark.parametrize("modes", [1, 2])
def test_every_track_is_reduced_by_itself(name, modes):
    tracks = drawn(8, 3, modes, rows=5)
    got = reduce(tracks, collapsing(name, 2), 1e-3)
    assert got.track.tolist() == [0, 0, 1, 1, 2, 2]
    np.testing.assert_allclose(np.bincount(got.track, got.weight), 1.0, rtol=1e-12)
    np.testing.assert_allclose(got.densities.w.sum(axis=1), 1.0, rtol=1e-12)
    if name != "capping":
        for a, b in zip(collapsed(got), collapsed(tracks), strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)


def test_a_cluster_too_large_is_counted():
    n = 30
    tracks = drawn(9, n, reach=1.0, existence=0.9)
    z = np.random.default_rng(0).normal(0, 2, (33, 2))
    assert updated(tracks, told(), z)[1].approximated == 1
    assert updated(drawn(9), told(), z[:3])[1].approximated == 0


def test_later_tracks_have_what_the_first_leave():
    model, tracks, z = told(), drawn(11, 4, existence=1.0), np.random.default_rng(5).normal(0, 8, (6, 2))
    log_kappa, later = np.log(np.full(6, 1e-4)), np.array([True, False, True, False])
    found = associate(tracks, model, z, log_kappa, later=later)
    got = reduce(found.tracks, None)
    first = associate(mixture_tracks.take(tracks, np.array([1, 3])), model, z, log_kappa)
    free = first.unassigned > 0.5
    assert 0 < free.sum() < 6
    then = associate(mixture_tracks.take(tracks, np.array([0, 2])), model, z[free], log_kappa[free])
    for alone, rows in ((first, [1, 3]), (then, [0, 2])):
        np.testing.assert_allclose(reduce(alone.tracks, None).densities.m, got.densities.m[rows], rtol=1e-12)
        np.testing.assert_allclose(alone.missed, found.missed[rows], rtol=1e-12)
    first.unassigned[free] *= then.unassigned
    np.testing.assert_allclose(found.unassigned, first.unassigned, rtol=1e-12)


def test_a_large_cluster_falls_apart_without_its_improbable_pairs():
    rng, blocks = np.random.default_rng(0), 4
    psi = np.full((6 * blocks, 9 * blocks), 1e-8)
    for b in range(blocks):
        psi[6 * b : 6 * b + 6, 9 * b : 9 * b + 9] = np.exp(2 * rng.standard_normal((6, 9)))
    track, detection = np.nonzero(psi)
    log_psi = np.log(psi[track, detection])
    likelier = np.maximum(log_psi, np.log(1e-4))
    assert exact(track, detection, likelier, *psi.shape)[3].all()
    assigned, missed, _, approximated = mixture_tracks._marginals(
        track, detection, log_psi, "exact", *psi.shape
    )
    assert approximated == 0
    of_block = (track < 6) & (detection < 9)
    alone = exact(track[of_block], detection[of_block], log_psi[of_block], 6, 9)
    np.testing.assert_allclose(assigned[of_block], alone[0], rtol=1e-12)
    np.testing.assert_allclose(missed[:6], alone[1], rtol=1e-12)
    assert not assigned[(track < 6) & (detection >= 9)].any()
