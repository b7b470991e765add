"""Track-oriented MHT, against exhaustive searches."""

from itertools import product

import numpy as np
import pytest

from gmr_gym.filters import track_oriented_mht as mht
from gmr_gym.filters.registry import make_tracker
from gmr_gym.mixture import Mixture
from gmr_gym.models.clutter import uniform_clutter
from gmr_gym.models.kalman import motion, sensor
from gmr_gym.models.multi_target import multi_target_model

P_D, P_S, RATE, SIDE = 0.8, 0.95, 2.0, 200.0
SCANS = [
    [np.array(z).reshape(-1, 1) for z in scans]
    for scans in (
        ([-3.0, 4.0], [-2.0, 3.0], [-1.0, 1.0], [0.5, 0.0]),
        ([0.0, 1.0], [0.3], [-1.0, 0.5, 2.0], [1.5, -1.5]),
        ([1.0, 2.5], [], [1.5, 3.0], [2.0, 4.0]),
    )
]


def line():
    """Targets on a line, position and velocity, that are there from the beginning."""
    there = Mixture(np.array([1.5]), np.array([[0.0, 0.0]]), np.diag([36.0, 1.0])[None])
    none = Mixture(np.empty(0), np.empty((0, 2)), np.empty((0, 2, 2)))
    moving = motion([[1.0, 1.0], [0.0, 1.0]], np.diag([0.2, 0.1]))
    clutter = uniform_clutter([-SIDE / 2], [SIDE / 2], RATE)
    return multi_target_model(moving, sensor([[1.0, 0.0]], [[1.0]]), P_D, P_S, none, clutter, initial=there)


def score_of(told, scans, had):
    """Of a target that had the detections `had` (of each scan, -1 for none): the log probability over that of
    false alarms, the probability that it exists still, and its mean."""
    F, Q, H, R = *told.motion[:2], *told.sensor
    w, m, P = told.initial.w[0], told.initial.m[0], told.initial.P[0]
    alive, dead, detected = w, 0.0, False
    for z, j in zip(scans, had, strict=True):
        m, P = F @ m, F @ P @ F.T + Q
        dead += detected * (1 - P_S) * alive
        alive *= P_S
        if j < 0:
            alive *= 1 - P_D
            continue
        S = (H @ P @ H.T + R)[0, 0]
        nu, K = z[j, 0] - m[0], P @ H[0] / S
        alive *= P_D * np.exp(-0.5 * nu**2 / S) / np.sqrt(2 * np.pi * S) * SIDE / RATE
        m, P, dead, detected = m + K * nu, P - np.outer(K, K) * S, 0.0, True
    return np.log(alive + dead), alive / (alive + dead), m


def exhaustive(told, scans):
    """The division of detections into targets and false alarms of greatest summed score, by trying all."""
    found = [[]]
    for t, z in enumerate(scans):
        after = []
        for tracks in found:
            for choice in product(range(-1, len(z)), repeat=len(tracks)):
                taken = [j for j in choice if j >= 0]
                if len(set(taken)) < len(taken):
                    continue
                grown = [[*track, j] for track, j in zip(tracks, choice, strict=True)]
                rest = [j for j in range(len(z)) if j not in taken]
                for begins in product((False, True), repeat=len(rest)):
                    after.append(grown + [[-1] * t + [j] for j, b in zip(rest, begins, strict=True) if b])
        found = after
    score = {}
    for tracks in found:
        for had in tracks:
            if tuple(had) not in score:
                score[tuple(had)] = score_of(told, scans, had)
    return max(
        ((sum(score[tuple(had)][0] for had in tracks), tracks) for tracks in found), key=lambda pair: pair[0]
    ), score


@pytest.mark.parametrize("scans", SCANS)
def test_with_decisions_after_the_run_the_hypothesis_is_that_of_an_exhaustive_search(scans):
    told = line()
    trees = mht.untracked(told, len(scans))
    for z in scans:
        grown, _ = mht.grow(mht.predict(trees, told), told, z, told.clutter.density(z), 0.0, 10**6)
        trees = mht.decided(grown, 10**6, 0.0, 0.0)
    (total, tracks), score = exhaustive(told, scans)
    assert trees.score[trees.best].sum() == pytest.approx(total)
    start = np.cumsum([0, *map(len, scans)])
    found = []
    for i in np.flatnonzero(trees.best):
        own = trees.history[i, : len(scans)][::-1]
        found.append(tuple(int(d - start[t]) if d >= 0 else -1 for t, d in enumerate(own)))
        expected = score[found[-1]]
        np.testing.assert_allclose(trees.score[i], expected[0], rtol=1e-9)
        np.testing.assert_allclose(trees.existence[i], expected[1], rtol=1e-9)
        np.testing.assert_allclose(trees.leaves.m[i, 0], expected[2], rtol=1e-9, atol=1e-9)
    assert sorted(found) == sorted(map(tuple, tracks)) and len(found) > 1


@pytest.mark.parametrize("seed", range(20))
def test_the_best_hypothesis_is_that_of_all_sets_of_leaves(seed):
    rng = np.random.default_rng(seed)
    tree, score = np.sort(rng.integers(0, 4, 11)), rng.normal(1.0, 3.0, 11)
    history = np.column_stack([rng.integers(-1, 3, 11), 3 + rng.integers(-1, 3, 11)])
    history[history[:, 1] == 2, 1] = -1
    greatest = 0.0
    for chosen in product((False, True), repeat=11):
        own = np.flatnonzero(chosen)
        used = history[own][history[own] >= 0]
        if len(set(tree[own])) == len(own) and len(set(used.tolist())) == len(used):
            greatest = max(greatest, score[own].sum())
    best, price = mht.best_hypothesis(tree, score, history)
    used = history[best][history[best] >= 0]
    assert len(set(tree[best])) == best.sum() and len(set(used.tolist())) == len(used)
    assert score[best].sum() == pytest.approx(greatest) and (price >= -1e-9).all()


def test_a_program_whose_solution_has_fractions_is_solved_in_integers():
    # three trees, each of which shares one detection with each other: halves of all are worth 1.5
    tree, history = np.arange(3), np.array([[0, 1], [1, 2], [0, 2]])
    best, _ = mht.best_hypothesis(tree, np.array([1.0, 1.1, 1.0]), history)
    assert best.tolist() == [False, True, False]


def test_many_trees_of_one_place_are_solved_in_integers():
    # every one of 40 trees may have any of 30 detections, and all are worth the same: 30 trees have one
    tree = np.repeat(np.arange(40), 60)
    history = np.tile(np.arange(60) % 30, 40)[:, None]
    score = np.tile(np.where(np.arange(60) < 30, 1.0, 0.5), 40)
    best, _ = mht.best_hypothesis(tree, score, history)
    assert best.sum() == 30 == len(set(history[best, 0])) == len(set(tree[best]))


def crossing(seed=0, scans=14):
    """Two targets that cross, in light clutter."""
    rng, out = np.random.default_rng(seed), []
    for t in range(scans):
        targets = np.array([[-7.0 + t], [7.0 - t]]) + rng.standard_normal((2, 1)) * 0.5
        out.append(np.vstack([targets[rng.random(2) < 0.95], rng.uniform(-SIDE / 2, SIDE / 2, (1, 1))]))
    return out


@pytest.mark.parametrize(
    "options", [{}, {"components": 3}, {"memory": 2}, {"components": 3, "reduction": "capping"}]
)
def test_two_targets_that_cross_are_two_tracks(options):
    tracker = make_tracker("tomht", line(), scans=3, **options)
    belief, declared = tracker.init(), []
    for z in crossing():
        belief, said = tracker.step(belief, z)
        declared.append(len(said.x))
        assert (
            len(set(belief.history[belief.best][belief.history[belief.best] >= 0]))
            == (belief.history[belief.best] >= 0).sum()
        )
    assert declared[-1] == 2 and max(declared) <= 3
    assert (np.bincount(belief.tree) <= options.get("components", 30)).all()


def test_a_decision_is_kept_once_it_is_taken():
    told, scans = line(), crossing(1)
    tracker = make_tracker("tomht", told, scans=2)
    belief = tracker.init()
    decided: dict = {}
    for z in scans:
        belief, _ = tracker.step(belief, z)
        for i in np.flatnonzero(belief.best):
            label = int(belief.label[belief.tree[i]])
            same = belief.history[belief.tree == belief.tree[i], -1]
            assert (same == belief.history[i, -1]).all()  # all leaves of a tree have one past
            decided.setdefault(label, []).append(int(belief.history[i, -1]))
    taken = [d for own in decided.values() for d in own if d >= 0]
    assert len(set(taken)) == len(taken) > 10
