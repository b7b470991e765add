"""Marginal association probabilities, against the enumeration of all association events."""

from itertools import product

import numpy as np
import pytest

from gmr_gym.filters.belief_propagation import propagate
from gmr_gym.filters.marginals import marginals
from gmr_gym.filters.track_trees import BITS

ROUNDED = 1e-11  # sums of a few hundred products of doubles
CONVERGED = 1e-5  # belief propagation stops when its messages change by a millionth
METHODS = [(marginals, ROUNDED), (propagate, CONVERGED)]


def of_table(method, psi):
    """What a method gives for a table (n, k): a table (n, k), of missed tracks (n,), of unassigned (k,)."""
    track, detection = np.nonzero(psi > 0)
    assigned, missed, unassigned, *_ = method(track, detection, np.log(psi[track, detection]), *psi.shape)
    out = np.zeros(psi.shape)
    out[track, detection] = assigned
    return out, missed, unassigned


def enumerated(psi):
    """The same, of every assignment in which no detection is of two tracks."""
    n, k = psi.shape
    out, missed, unassigned, total = np.zeros((n, k)), np.zeros(n), np.zeros(k), 0.0
    for choice in product(range(-1, k), repeat=n):
        has = np.array(choice)
        taken = has[has >= 0]
        if len(set(taken)) < len(taken):
            continue
        weight = np.prod([psi[i, j] for i, j in enumerate(choice) if j >= 0])
        total += weight
        out[np.flatnonzero(has >= 0), taken] += weight
        missed[has < 0] += weight
        unassigned[np.setdiff1d(np.arange(k), taken)] += weight
    return out / total, missed / total, unassigned / total


def assert_close(a, b, atol, rtol=0.0):
    for one, other in zip(a, b, strict=True):
        np.testing.assert_allclose(one, other, atol=atol, rtol=rtol)


def drawn(seed):
    """Up to 4 tracks and 5 detections, some pairs impossible, weights from 1e-8 to 1e8."""
    rng = np.random.default_rng(seed)
    shape = rng.integers(1, 5), rng.integers(1, 6)
    return 10 ** rng.uniform(-8, 8, shape) * (rng.random(shape) < rng.uniform(0.3, 1.0))


@pytest.mark.parametrize("seed", range(200))
def test_marginals_are_exact(seed):
    psi = drawn(seed)
    assert_close(of_table(marginals, psi), enumerated(psi), 0.0, ROUNDED)  # also the least of them


@pytest.mark.parametrize(("method", "near"), METHODS)
@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("shape", [(1, 4), (4, 1), (1, 1)])
def test_of_one_track_or_of_one_detection_marginals_are_exact(shape, seed, method, near):
    psi = np.exp(3 * np.random.default_rng(seed).standard_normal(shape))
    assert_close(of_table(method, psi), enumerated(psi), near)


@pytest.mark.parametrize(("method", "near"), METHODS)
@pytest.mark.parametrize("seed", range(10))
def test_without_loops_marginals_are_exact(seed, method, near):
    psi = np.exp(3 * np.random.default_rng(seed).standard_normal((4, 4)))
    chain = np.array([[1, 1, 0, 0], [0, 1, 1, 0], [0, 0, 1, 1], [0, 0, 0, 1]])
    assert_close(of_table(method, psi * chain), enumerated(psi * chain), near)


@pytest.mark.parametrize("seed", range(10))
def test_with_loops_and_doubt_belief_propagation_is_near(seed):
    # all pairs are possible: a dozen loops
    psi = np.exp(np.random.default_rng(seed).standard_normal((3, 4)))
    assert_close(of_table(propagate, psi), enumerated(psi), 0.04)


@pytest.mark.parametrize(("likely", "truly", "believed"), [(1e3, 0.552, 0.921), (1e5, 0.552, 0.999)])
def test_of_two_tracks_on_two_detections_belief_propagation_is_overconfident(likely, truly, believed):
    psi = likely * np.array([[1.0, 0.9], [0.9, 1.0]])
    assert of_table(marginals, psi)[0][0, 0] == pytest.approx(truly, abs=5e-4)
    # of certain detections the exact marginal is 1 / (1 + .9^2)
    assert of_table(marginals, psi)[0][0, 0] == pytest.approx(1 / 1.81, abs=1e-3)
    assert of_table(propagate, psi)[0][0, 0] == pytest.approx(believed, abs=5e-4)


@pytest.mark.parametrize(("method", "near"), METHODS)
@pytest.mark.parametrize("likely", [1e17, 1e80, 1e250])
def test_a_pair_beyond_doubt_does_not_swallow_the_others(likely, method, near):
    psi = np.array([[likely, 2.0], [0.0, 3.0]])
    assert_close(of_table(method, psi), ([[1, 0], [0, 0.75]], [0, 0.25], [0, 0.25]), near)


@pytest.mark.parametrize(("method", "near"), METHODS)
@pytest.mark.parametrize("likely", [10.0, 1e17, 1e80])
def test_two_who_want_the_same_detection_are_told_apart_by_their_others(likely, method, near):
    psi = np.array([[likely, 2.0, 0.0], [likely, 0.0, 3.0]])
    assert_close(of_table(method, psi), enumerated(psi), near)


@pytest.mark.parametrize(("method", "near"), METHODS)
@pytest.mark.parametrize("likely", [1e3, 1e5])
def test_pairs_beyond_floating_point_are_told_apart(likely, method, near):
    # by hand, a chain: two tracks, each e^likely times as likely to have either of two detections as none,
    # and a third that may have the last
    track, detection = np.array([0, 0, 1, 1, 2]), np.array([0, 1, 1, 2, 2])
    log_psi = np.array([likely, likely + 1, likely + 2, likely, 0.5])
    assigned, *_ = method(track, detection, log_psi, 3, 3)
    # detections of the tracks: (0, 1, none), (0, 1, 2), (0, 2, none), (1, 2, none)
    w = np.exp([2.0, 2.5, 0.0, 1.0])
    w /= w.sum()
    expected = [w[:3].sum(), w[3], w[:2].sum(), w[2:].sum(), w[1]]
    np.testing.assert_allclose(assigned, expected, atol=max(near, 1e-15 * likely))


@pytest.mark.parametrize("method", [marginals, propagate])
def test_without_pairs_all_is_missed_and_unassigned(method):
    assigned, missed, unassigned = of_table(method, np.zeros((3, 2)))
    assert not assigned.any() and (missed == 1).all() and (unassigned == 1).all()


def crossing(n, seed=0):
    """n tracks that share all of n + 3 detections."""
    return np.exp(3 * np.random.default_rng(seed).standard_normal((n, n + 3)))


@pytest.mark.parametrize("n", [5, 7])
def test_a_detection_is_of_one_track_or_of_none(n):
    assigned, missed, unassigned = of_table(marginals, crossing(n))
    np.testing.assert_allclose(assigned.sum(axis=1) + missed, 1.0, rtol=ROUNDED)
    np.testing.assert_allclose(assigned.sum(axis=0) + unassigned, 1.0, rtol=ROUNDED)


def test_the_order_of_tracks_and_of_detections_does_not_matter():
    psi, rng = crossing(7) * (crossing(7, 1) > 1), np.random.default_rng(2)
    rows, columns = rng.permutation(7), rng.permutation(10)
    assigned, missed, unassigned = of_table(marginals, psi)
    again = of_table(marginals, psi[rows][:, columns])
    assert_close(again, (assigned[rows][:, columns], missed[rows], unassigned[columns]), 0.0, ROUNDED)


def test_a_cluster_beyond_the_limit_is_propagated_and_the_others_are_exact():
    # 30 tracks that share all of 33 detections, no pair improbable, and two tracks far from them
    psi = np.zeros((32, 35))
    psi[:30, :33], psi[30:, 33:] = np.maximum(crossing(30), 1e-4), 1000.0 * np.array([[1.0, 0.9], [0.9, 1.0]])
    track, detection = np.nonzero(psi)
    log_psi = np.log(psi[track, detection])
    assigned, missed, unassigned, approximated = marginals(track, detection, log_psi, *psi.shape)
    assert approximated.tolist() == [True] * 30 + [False] * 2
    assert assigned[-4] == pytest.approx(0.552, abs=5e-4)
    many, free = track < 30, np.arange(35) < 33
    found = propagate(track[many], detection[many], log_psi[many], 30, 33)
    assert_close((assigned[many], missed[:30], unassigned[free]), found, 1e-12)


def test_a_long_chain_of_clusters_is_exact():
    # track i may have detections i and i + 1: the sets stay small, however many tracks there are
    n = 200
    psi = np.zeros((n, n + 1))
    psi[np.arange(n), np.arange(n)] = psi[np.arange(n), np.arange(n) + 1] = 5.0
    track, detection = np.nonzero(psi)
    found = marginals(track, detection, np.log(psi[track, detection]), n, n + 1)
    assert not found[3].any()
    assert_close(found[:3], propagate(track, detection, np.log(psi[track, detection]), n, n + 1), CONVERGED)


def test_a_set_holds_62_detections():
    # two tracks share 70 detections: more than a set holds at once
    psi = np.ones((2, BITS + 8))
    track, detection = np.nonzero(psi)
    assert marginals(track, detection, np.zeros(len(track)), *psi.shape)[3].all()


@pytest.mark.parametrize("seed", range(3))
def test_branches_of_one_track_are_exact(seed):
    # a track may have a detection of each of four others, or one that two of them share as well
    rng = np.random.default_rng(seed)
    psi = np.zeros((5, 5))
    psi[0] = 1.0
    psi[np.arange(1, 5), np.arange(4)] = 1.0
    psi[[1, 4], 4] = 1.0
    psi *= 10 ** rng.uniform(-3, 3, psi.shape)
    assert_close(of_table(marginals, psi), enumerated(psi), 0.0, ROUNDED)


@pytest.mark.parametrize("scale", [1.0, 1e60])
def test_many_branches_with_loops_are_exact(scale):
    # track 0 may have one detection of each of twelve groups of three tracks, who share all of three: given
    # which it has, the groups are independent
    groups, rng = 12, np.random.default_rng(0)
    psi = np.zeros((1 + 3 * groups, 3 * groups))
    parts = [scale * np.exp(2 * rng.standard_normal((3, 3))) for _ in range(groups)]
    for g, part in enumerate(parts):
        psi[1 + 3 * g : 4 + 3 * g, 3 * g : 3 * g + 3] = part
    psi[0, ::3] = scale * np.exp(2 * rng.standard_normal(groups))

    def weight(part):
        """Sum over the events of a group, and of those that leave its first detection free."""
        _, _, free = enumerated(part)
        total = sum(
            np.prod([part[i, j] for i, j in enumerate(has) if j >= 0])
            for has in product(range(-1, 3), repeat=3)
            if len({j for j in has if j >= 0}) == sum(j >= 0 for j in has)
        )
        return total, total * free[0]

    whole, free = np.transpose([weight(part) for part in parts])
    odds = psi[0, ::3] * free / whole
    assigned, missed, _ = of_table(marginals, psi)
    np.testing.assert_allclose(assigned[0, ::3], odds / (1 + odds.sum()), rtol=ROUNDED)
    assert missed[0] == pytest.approx(1 / (1 + odds.sum()), rel=ROUNDED)


def test_a_binary_tree_of_tracks_is_exact():
    # track i shares a detection with each of tracks 2 i + 1 and 2 i + 2
    n = 127
    track, detection = np.append(np.arange(n), (np.arange(1, n) - 1) // 2), np.arange(n)
    detection = np.append(detection, np.arange(1, n))
    log_psi = np.random.default_rng(0).normal(1.0, 2.0, len(track))
    found = marginals(track, detection, log_psi, n, n)
    assert not found[3].any()
    assert_close(found[:3], propagate(track, detection, log_psi, n, n), CONVERGED)


def test_improbable_pairs_do_not_make_a_cluster_too_large():
    # 30 tracks that share all of 30 detections, each pair but their own of weight 1e-7
    psi = np.full((30, 30), 1e-7)
    np.fill_diagonal(psi, 2.0)
    track, detection = np.nonzero(psi)
    assigned, missed, _, approximated = marginals(track, detection, np.log(psi[track, detection]), 30, 30)
    assert not approximated.any()
    np.testing.assert_allclose(assigned[track == detection], 2 / 3)
    np.testing.assert_allclose(missed, 1 / 3)
