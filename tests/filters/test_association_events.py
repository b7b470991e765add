"""One scan by every tracker of joint association, against the enumeration of all association events: hundreds
of random cases of up to four tracks and five detections."""

from itertools import product
from math import prod

import numpy as np
import pytest

from gmr_gym.filters import multi_bernoulli_mixture as mixtures
from gmr_gym.filters.global_hypotheses import Options, leaf_weights, singles
from gmr_gym.filters.mixture_tracks import MixtureTracks, associate, reduce, started
from gmr_gym.filters.projections import momb, tomb
from gmr_gym.filters.target_densities import Densities, outputs, take
from gmr_gym.filters.undetected_targets import appear, intensity_of
from gmr_gym.mixture import Mixture, mixture, moments
from gmr_gym.models.clutter import uniform_clutter
from gmr_gym.models.kalman import position_sensor
from gmr_gym.models.motions import constant_velocity
from gmr_gym.models.multi_target import multi_target_model

CORNER, P_D, CASES = np.array([-300.0, -300.0]), 0.85, 20
MODEL = multi_target_model(
    constant_velocity(1.0, 1.0), position_sensor(3.0), P_D, 0.98,
    mixture([0.2], [[0.0, 0, 0, 0]], [np.diag([200.0, 200, 9, 9])]), uniform_clutter(CORNER, -CORNER, 10.0),
)  # fmt: skip
ALL = Options(2**62, 0.0, 0, 2**62)  # every hypothesis
NO_SAMPLES = np.random.default_rng(0)


def drawn(rng, certain):
    """Tracks of one Gaussian each, a scan about them, and its clutter."""
    n, k = rng.integers(1, 5), rng.integers(0, 6)
    A, one = rng.normal(0, 2, (n, 4, 4)), np.arange(n)
    P = A @ A.swapaxes(1, 2) + np.eye(4)
    densities = Densities(np.ones((n, 1)), rng.normal(0, 6, (n, 1, 4)), P[:, None])
    existence = np.ones(n) if certain else rng.uniform(0.05, 1.0, n)
    tracks = MixtureTracks(existence, one, densities, np.ones(n), one)
    return tracks, rng.normal(0, 8, (k, 2)), 10 ** rng.uniform(-5, -2, k)


def updated(m, P, z):
    """A Gaussian with a detection: likelihood, mean and covariance."""
    H, R = MODEL.sensor
    S, nu = H @ P @ H.T + R, z - H @ m
    K = np.linalg.solve(S, H @ P).T
    g = np.exp(-0.5 * nu @ np.linalg.solve(S, nu)) / np.sqrt(np.linalg.det(2 * np.pi * S))
    return g, m + K @ nu, P - K @ S @ K.T


def outcomes(tracks, z):
    """Weight, mean and covariance of each track that is absent (-2), missed (-1) or has detection j."""
    out = []
    for r, m, P in zip(tracks.existence, *outputs(tracks.densities), strict=True):
        own = {-2: (1 - r, m, P), -1: (r * (1 - P_D), m, P)}
        for j, detection in enumerate(z):
            g, *posterior = updated(m, P, detection)
            own[j] = r * P_D * g, *posterior
        out.append(own)
    return out


def enumerated(tracks, z, kappa):
    """Probability of each outcome of each track; what each detection that is of none begins; all outcomes."""
    of, births = outcomes(tracks, z), MODEL.births
    new = []
    for detection in z:
        g, *posterior = updated(births.m[0], births.P[0], detection)
        new.append((births.w[0] * P_D * g, *posterior))
    p, free, total = [dict.fromkeys(own, 0.0) for own in of], np.zeros(len(z)), 0.0
    for event in product(*of):
        taken = {j for j in event if j >= 0}
        if len(taken) == sum(j >= 0 for j in event):
            left = [j for j in range(len(z)) if j not in taken]
            weight = prod(own[a][0] for own, a in zip(of, event, strict=True))
            weight *= prod(kappa[j] + new[j][0] for j in left)
            total += weight
            free[left] += weight
            for own, a in zip(p, event, strict=True):
                own[a] += weight
    p = [{a: weight / total for a, weight in own.items()} for own in p]
    begun = [(q * w / (w + c), m, P) for q, c, (w, m, P) in zip(free / total, kappa, new, strict=True)]
    return p, begun, of


def merged(parts):
    """Existence, mean and covariance of (probability, mean, covariance)."""
    w, m, P = (np.array(column) for column in zip(*parts, strict=True))
    return w.sum(), *moments(Mixture(w / w.sum(), m, P))


def by_track(p, begun, of):
    """Of each track, and then of what each detection begins."""
    own = [merged([(p[i][a], *of[i][a][1:]) for a in p[i] if a > -2]) for i in range(len(p))]
    return [*own, *begun]


def by_detection(p, begun, of):
    """Of what has each detection, and then of each missed track."""
    hit = [merged([*((p[i][j], *of[i][j][1:]) for i in range(len(p))), one]) for j, one in enumerate(begun)]
    return [*hit, *((p[i][-1], *of[i][-1][1:]) for i in range(len(p)))]


def assert_same(existence, densities, expected):
    assert len(existence) == len(expected)
    for r, m, P, (there, mean, covariance) in zip(existence, *outputs(densities), expected, strict=True):
        np.testing.assert_allclose(r, there, rtol=1e-8, atol=1e-12)
        if there > 1e-9:
            np.testing.assert_allclose(m, mean, rtol=1e-7, atol=1e-7)
            np.testing.assert_allclose(P, covariance, rtol=1e-6, atol=1e-6)


def projected(project, tracks, z, kappa):
    """By the projection, merged: JPDA and JIPDA are TOMB/P, of tracks that are certain or not."""
    appearing = appear(intensity_of(MODEL.births, MODEL), MODEL, z, np.log(kappa))
    found = associate(tracks, MODEL, z, np.log(kappa) + appearing.log_ratio)
    new, detection = started(appearing, z, found.unassigned, 0.0)
    label = len(tracks.existence) + detection
    return reduce(project(found, new._replace(label=label), detection), None)


def of_mixture(tracks, z, kappa, certain):
    """By one update of a PMBM, or of a delta-GLMB: existence and densities of its tracks, merged."""
    n = len(tracks.existence)
    belief = mixtures.untracked(MODEL)._replace(
        hypotheses=singles(np.arange(n), 0), track=np.arange(n), existence=tracks.existence,
        leaves=tracks.densities, history=np.empty((n, 0), int), label=np.arange(n), next_label=n,
        undetected=intensity_of(MODEL.births, MODEL),
    )  # fmt: skip
    after, _ = mixtures.update(belief, MODEL, z, kappa, ALL, NO_SAMPLES, certain=certain)
    w = leaf_weights(after.hypotheses, len(after.track)) * after.existence
    return {
        int(label): merged([
            (w[a], m, P)
            for a, m, P in zip(np.flatnonzero(after.track == i), *(
                part[after.track == i] for part in outputs(after.leaves)
            ), strict=True)
        ])
        for i, label in enumerate(after.label)
    }  # fmt: skip


@pytest.mark.parametrize("certain", [True, False])
@pytest.mark.parametrize("block", range(4))
def test_jpda_jipda_and_tomb_leave_what_all_events_leave(block, certain):
    rng = np.random.default_rng([1, block, certain])
    for _ in range(CASES):
        tracks, z, kappa = drawn(rng, certain)
        got = projected(tomb, tracks, z, kappa)
        order = np.argsort(got.label)  # new tracks are sorted by their existence
        got = got.existence[order], take(got.densities, order)
        assert_same(*got, by_track(*enumerated(tracks, z, kappa)))


@pytest.mark.parametrize("block", range(4))
def test_momb_leaves_what_all_events_leave_by_detection(block):
    rng = np.random.default_rng([2, block])
    for _ in range(CASES):
        tracks, z, kappa = drawn(rng, False)
        got = projected(momb, tracks, z, kappa)
        assert_same(got.existence, got.densities, by_detection(*enumerated(tracks, z, kappa)))


@pytest.mark.parametrize("glmb", [False, True])
@pytest.mark.parametrize("block", range(4))
def test_a_pmbm_and_a_glmb_have_the_existence_and_the_states_of_all_events(block, glmb):
    rng = np.random.default_rng([3, block, glmb])
    for _ in range(CASES):
        tracks, z, kappa = drawn(rng, False)
        got, expected = of_mixture(tracks, z, kappa, glmb), by_track(*enumerated(tracks, z, kappa))
        for label, (there, mean, covariance) in enumerate(expected):
            r, m, P = got.get(label, (0.0, mean, covariance))
            np.testing.assert_allclose(r, there, rtol=1e-8, atol=1e-10)
            if there > 1e-9:
                np.testing.assert_allclose(m, mean, rtol=1e-7, atol=1e-7)
                np.testing.assert_allclose(P, covariance, rtol=1e-6, atol=1e-6)
