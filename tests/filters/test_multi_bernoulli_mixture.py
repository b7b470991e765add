"""Multi-Bernoulli mixtures, against the enumeration of all histories and against trackers of one target."""

from itertools import product

import numpy as np
import pytest

from gmr_gym.filters import multi_bernoulli_mixture as mixtures
from gmr_gym.filters.declared import of_best_number
from gmr_gym.filters.global_hypotheses import Options, leaf_weights
from gmr_gym.filters.registry import make_tracker
from gmr_gym.filters.target_densities import outputs
from gmr_gym.mixture import Mixture, gaussian
from gmr_gym.models.clutter import uniform_clutter
from gmr_gym.models.kalman import motion, sensor
from gmr_gym.models.model import model as single_target_model
from gmr_gym.models.multi_target import multi_target_model

P_D, P_S, RATE, SIDE = 0.8, 0.9, 2.0, 40.0
ALL = Options(2**62, 0.0, 0, 2**62)  # every hypothesis
NO_SAMPLES = np.random.default_rng(0)


def line(births, initial=None, p_detected=P_D, p_survives=P_S):
    """Targets on a line, position and velocity."""
    F, Q = np.array([[1.0, 1.0], [0.0, 1.0]]), np.diag([0.2, 0.1])
    clutter = uniform_clutter([-SIDE / 2], [SIDE / 2], RATE)
    return multi_target_model(
        motion(F, Q), sensor([[1.0, 0.0]], [[1.0]]), p_detected, p_survives, births, clutter, initial=initial
    )


def intensity(weights, places, spread=6.0):
    n = len(weights)
    m = np.column_stack([places, np.zeros(n)])
    return Mixture(np.array(weights, float), m, np.tile(np.diag([spread**2, 1.0]), (n, 1, 1)))


BIRTHS, INITIAL = intensity([0.3], [0.0]), intensity([0.7, 0.4], [-4.0, 5.0])
SCANS = [
    [np.array([[-3.0], [4.0]]), np.array([[-2.5], [4.5]]), np.array([[0.0], [1.0]])],
    [np.array([[0.0], [0.0]]), np.array([[0.3]]), np.array([[-1.0], [0.5], [2.0]])],
    [np.array([[1.0], [2.5]]), np.empty((0, 1)), np.array([[1.5], [3.0]])],
]


def paths(told, scans, had):
    """Of a target that had the detections `had` (of each scan, -1 for none): the sum over its births and
    deaths of all weights, that of those which exist at the end, and their mean and covariance.

    A filter of one target over a list of Gaussians."""
    F, Q, H, R = *told.motion[:2], *told.sensor
    alive = [(w, m, P) for w, m, P in zip(*told.initial, strict=True)]
    dead, detected = 0.0, False
    for z, j in zip(scans, had, strict=True):
        dead += (1 - P_S) * sum(w for w, _, _ in alive) * detected  # before it is detected it is no track
        moved = [(P_S * w, F @ m, F @ P @ F.T + Q) for w, m, P in alive]
        moved += [] if detected else list(zip(*told.births, strict=True))
        if j < 0:
            alive = [((1 - P_D) * w, m, P) for w, m, P in moved]
            continue
        dead, alive = 0.0, []
        for w, m, P in moved:
            S = (H @ P @ H.T + R)[0, 0]
            nu = z[j, 0] - (H @ m)[0]
            K = P @ H[0] / S
            alive.append(
                (
                    w * P_D * np.exp(-0.5 * nu**2 / S) / np.sqrt(2 * np.pi * S),
                    m + K * nu,
                    P - np.outer(K, K) * S,
                )
            )
        if not detected:  # a new track is one Gaussian
            alive = [moments([(1.0, *part) for part in alive])]
        detected = True
    whole, mean, P = moments([(1.0, *part) for part in alive])
    return whole + dead, whole, mean, P


def histories(scans):
    """All ways to divide the detections among targets: lists of the detections of each scan, -1 for none."""
    found = [[]]
    for t, z in enumerate(scans):
        after = []
        for tracks in found:
            # every track has a detection or none, and what is left begins tracks
            for choice in product(range(-1, len(z)), repeat=len(tracks)):
                taken = [j for j in choice if j >= 0]
                if len(set(taken)) == len(taken):
                    grown = [[*track, j] for track, j in zip(tracks, choice, strict=True)]
                    begun = [[-1] * t + [j] for j in range(len(z)) if j not in taken]
                    after.append(grown + begun)
        found = after
    return found


def enumerated(told, scans):
    """By first detection of a track: its probability of existence, and the mean and covariance then."""
    kappa = RATE / SIDE
    weights, tracks = [], []
    for division in histories(scans):
        weight, own = 1.0, {}
        for had in division:
            whole, exists, mean, P = paths(told, scans, had)
            alone = sum(j >= 0 for j in had) == 1  # of a single detection, which may be a false alarm
            weight *= whole + kappa * alone
            first = next((t, j) for t, j in enumerate(had) if j >= 0)
            own[first] = exists / (whole + kappa * alone), mean, P
        weights.append(weight)
        tracks.append(own)
    weights = np.array(weights) / np.sum(weights)
    return {
        first: moments([(w, *own[first]) for w, own in zip(weights, tracks, strict=True) if first in own])
        for first in set().union(*tracks)
    }


def moments(parts):
    w = np.array([a * r for a, r, _, _ in parts])
    m, P = np.array([a[2] for a in parts]), np.array([a[3] for a in parts])
    mean = w @ m / w.sum()
    off = m - mean
    return w.sum(), mean, np.einsum("a,aij->ij", w, P + off[:, :, None] * off[:, None]) / w.sum()


def played(told, scans, undetected=True, certain=False, options=ALL):
    belief = mixtures.untracked(told)
    for z in scans:
        predicted = mixtures.predict(belief, told, undetected)
        belief, p_clutter = mixtures.update(
            predicted, told, z, told.clutter.density(z), options, NO_SAMPLES, certain=certain
        )
    return belief, p_clutter


def by_label(belief):
    w, (m, P) = leaf_weights(belief.hypotheses, len(belief.track)), outputs(belief.leaves)
    found = {}
    for label, i in zip(belief.label, range(len(belief.label)), strict=True):
        own = belief.track == i
        found[int(label)] = moments(list(zip(w[own], belief.existence[own], m[own], P[own], strict=True)))
    return found


@pytest.mark.parametrize("scans", SCANS)
def test_the_mixture_is_the_posterior_over_all_histories(scans):
    told = line(BIRTHS, INITIAL)
    truly = enumerated(told, scans)
    found = by_label(played(told, scans)[0])
    assert len(found) == len(truly) == sum(map(len, scans))
    for label, (_, expected) in zip(sorted(found), sorted(truly.items()), strict=True):
        for a, b in zip(found[label], expected, strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-9)


@pytest.mark.parametrize("scans", SCANS)
def test_false_alarms_and_targets_share_out_the_detections(scans):
    told = line(BIRTHS, INITIAL)
    p_clutter = played(told, scans)[1]
    started = {}
    kappa = RATE / SIDE
    total = 0.0
    for division in histories(scans):
        parts = [paths(told, scans, had)[0] + kappa * (sum(j >= 0 for j in had) == 1) for had in division]
        weight = np.prod(parts)
        total += weight
        for had, part in zip(division, parts, strict=True):
            if had[:-1] == [-1] * (len(scans) - 1):  # begun by the last scan
                started[had[-1]] = started.get(had[-1], 0.0) + weight * kappa / part
    np.testing.assert_allclose(p_clutter, [started[j] / total for j in range(len(scans[-1]))], rtol=1e-8)


def test_certain_and_uncertain_existence_are_the_same_posterior():
    # the same births as Bernoulli tracks: a delta-GLMB and an MBM differ in how they write it
    told = line(intensity([0.3], [0.0]), intensity([0.5, 0.4], [-4.0, 5.0]))
    one = by_label(played(told, SCANS[0], undetected=False)[0])
    other = by_label(played(told, SCANS[0], undetected=False, certain=True)[0])
    assert one.keys() == other.keys() and len(one) == 5
    for label in one:
        for a, b in zip(one[label], other[label], strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12)


def test_one_update_of_a_glmb_is_that_of_the_enumeration():
    told, z = line(intensity([0.3], [0.0]), intensity([0.5, 0.4], [-4.0, 5.0])), SCANS[0][0]
    belief = played(told, [z], undetected=False, certain=True)[0]
    kappa = RATE / SIDE
    H, R, F, Q = *told.sensor, *told.motion[:2]
    rows = [(P_S * 0.5, -4.0, True), (P_S * 0.4, 5.0, True), (0.3, 0.0, False)]
    weights = {}
    for choice in product(("absent", "missed", 0, 1), repeat=3):
        taken = [c for c in choice if isinstance(c, int)]
        if len(set(taken)) < len(taken):
            continue
        weight = 1.0
        for (r, place, moves), c in zip(rows, choice, strict=True):
            P = np.diag([36.0, 1.0])
            P = F @ P @ F.T + Q if moves else P
            S = (H @ P @ H.T + R)[0, 0]
            like = (
                np.exp(-0.5 * (z[c, 0] - place) ** 2 / S) / np.sqrt(2 * np.pi * S)
                if isinstance(c, int)
                else 0
            )
            weight *= {"absent": 1 - r, "missed": r * (1 - P_D)}.get(c, r * P_D * like / kappa)
        weights[choice] = weight
    total = sum(weights.values())
    assert len(belief.hypotheses.cluster) == len(weights)
    np.testing.assert_allclose(
        np.sort(np.exp(belief.hypotheses.log_weight)),
        np.sort([w / total for w in weights.values()]),
        rtol=1e-9,
    )


def test_one_certain_target_is_tracked_as_by_the_mht_of_one_target():
    told = line(intensity([], []), intensity([1.0], [0.0]), p_survives=1.0)
    alone = single_target_model(
        told.motion, told.sensor, P_D, 1 - 1e-12, RATE / SIDE, gaussian(told.initial.m[0], told.initial.P[0])
    )
    mht = make_tracker("mht", alone, components=10**6, prune_weight=0.0)
    belief = mixtures.untracked(told)
    belief = mixtures._born(belief._replace(undetected=belief.undetected._replace(w=np.array([0.5]))))
    belief, hypotheses = belief._replace(existence=np.ones(1)), mht.init()
    for z in [
        np.array([[0.5], [1.5], [-1.0]]),
        np.array([[0.2]]),
        np.array([[2.0], [0.0]]),
        np.empty((0, 1)),
    ]:
        predicted = mixtures.predict(belief, told)
        belief, _ = mixtures.update(predicted, told, z, told.clutter.density(z), ALL, NO_SAMPLES)
        hypotheses, said = mht.step(hypotheses, z)
        existence, mean, P = by_label(belief)[0]
        assert existence == pytest.approx(1.0)
        np.testing.assert_allclose(mean, said.x[0], rtol=1e-7, atol=1e-8)
        np.testing.assert_allclose(P, said.P[0], rtol=1e-7)
    assert (belief.track == 0).all() and len(belief.track) == 4 * 2 * 3


def test_targets_far_apart_stay_in_clusters_of_their_own():
    told = line(BIRTHS, intensity([0.9, 0.9], [-15.0, 15.0], 1.0))
    belief, _ = played(told, [np.array([[-15.0], [15.0]])] * 3, options=Options(200, 1e-4))
    w = np.bincount(belief.track, leaf_weights(belief.hypotheses, len(belief.track)) * belief.existence)
    assert (w > 0.5).sum() == 2
    cluster = {i: set() for i in range(len(w))}
    for h, c in enumerate(belief.hypotheses.cluster):
        for leaf in belief.hypotheses.leaf[belief.hypotheses.first[h] : belief.hypotheses.first[h + 1]]:
            cluster[belief.track[leaf]].add(c)
    one, other = np.flatnonzero(w > 0.5)
    assert len(cluster[one]) == len(cluster[other]) == 1 and cluster[one] != cluster[other]


@pytest.mark.parametrize("memory", [0, 1])
def test_merged_leaves_keep_the_intensity(memory):
    told = line(BIRTHS, INITIAL)
    belief = mixtures.untracked(told, memory)
    for z in SCANS[0]:
        belief, _ = mixtures.update(
            mixtures.predict(belief, told), told, z, told.clutter.density(z), ALL, NO_SAMPLES
        )
    merged = mixtures.forgotten(belief)
    assert len(merged.track) < len(belief.track) and len(merged.label) == len(belief.label)
    of_detections = len(np.unique(np.column_stack([belief.track, belief.history]), axis=0))
    assert len(merged.track) == of_detections
    one, other = by_label(belief), by_label(merged)
    for label in one:
        for a, b in zip(one[label], other[label], strict=True):
            np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-12)
    for c in np.unique(merged.hypotheses.cluster):
        own = merged.hypotheses.cluster == c
        assert np.exp(merged.hypotheses.log_weight[own]).sum() == pytest.approx(1.0)


def test_the_most_likely_number_is_that_of_the_enumeration():
    rng = np.random.default_rng(4)
    belief, _ = played(line(BIRTHS, INITIAL), SCANS[0])
    for _ in range(20):
        belief = belief._replace(existence=rng.uniform(0.05, 1.0, len(belief.track)))
        outcomes = {}
        first, leaf = belief.hypotheses.first, belief.hypotheses.leaf
        for h, log_w in enumerate(belief.hypotheses.log_weight):
            own = leaf[first[h] : first[h + 1]]
            for there in product((0, 1), repeat=len(own)):
                r = belief.existence[own]
                p = np.exp(log_w) * np.prod(np.where(there, r, 1 - r))
                outcomes[h, there] = p
        numbers = np.zeros(10)
        for (_, there), p in outcomes.items():
            numbers[sum(there)] += p
        best = max((k for k in outcomes if sum(k[1]) == numbers.argmax()), key=outcomes.get)
        own = leaf[first[best[0]] : first[best[0] + 1]]
        assert set(of_best_number(belief, 0.0)) == set(own[np.array(best[1], bool)])
        assert belief.hypotheses.cluster[-1] == 0
