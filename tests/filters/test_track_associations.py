"""Rules of association and the best leaves of trees: equal to all hypotheses written out."""

from itertools import product

import numpy as np
import pytest

from gmr_gym.filters.track_associations import best_event, every_event, intensity
from gmr_gym.recorded import track_leaves
from gmr_gym.recorded.track_leaves import best_leaves


def scene(seed, n=4, k=4):
    """Pairs of tracks and detections with log weights, existences, and probabilities to be missed or not to
    exist."""
    rng = np.random.default_rng(seed)
    track, detection = np.nonzero(rng.random((n, k)) < 0.7)
    existence = rng.uniform(0.01, 0.999, n)
    miss = 1 - 0.9 * existence
    return track, detection, rng.normal(0, 3, len(track)), existence, miss, k


def events(track, detection, n, k):
    """Every assignment of a pair, or -1, to each track, no detection twice."""
    pairs = [[-1, *np.flatnonzero(track == i)] for i in range(n)]
    for chosen in product(*pairs):
        used = [detection[a] for a in chosen if a >= 0]
        if len(set(used)) == len(used):
            yield [a for a in chosen if a >= 0]


@pytest.mark.parametrize("seed", range(3))
def test_marginals_are_sums_over_all_events(seed):
    track, detection, log_psi, existence, miss, k = scene(seed)
    assigned, missed, unassigned = every_event(track, detection, log_psi, existence, miss, k)
    weights, expected = 0.0, np.zeros(len(track))
    for event in events(track, detection, len(miss), k):
        w = np.exp(log_psi[event].sum())
        weights += w
        expected[event] += w
    expected /= weights
    np.testing.assert_allclose(assigned, expected, rtol=1e-9)
    np.testing.assert_allclose(missed, 1 - np.bincount(track, expected, len(miss)), atol=1e-9)
    np.testing.assert_allclose(unassigned, 1 - np.bincount(detection, expected, k), atol=1e-9)


@pytest.mark.parametrize("seed", range(8))
def test_the_best_assignment_is_the_best_of_all_with_the_odds_of_a_score(seed):
    """A track and its detection: either it exists and is detected, with P_D L against the clutter, or it does
    not exist; a sequential probability ratio test multiplies the odds of existence by P_D L / clutter."""
    track, detection, log_psi, r, miss, k = scene(seed)
    ratio = np.exp(log_psi) * miss[track] / r[track]  # P_D L / clutter
    together = r[track] * ratio + 1 - r[track]
    best = max(
        events(track, detection, len(miss), k),
        key=lambda event: np.log(together[event] / miss[track[event]]).sum(),
    )
    assigned, missed, unassigned = best_event(track, detection, log_psi, r, miss, k)
    assert np.flatnonzero(assigned).tolist() == sorted(best)
    odds = r[track] / (1 - r[track]) * ratio
    np.testing.assert_allclose(assigned[best], odds[best] / (1 + odds[best]), rtol=1e-9)
    assert np.flatnonzero(missed == 0).tolist() == sorted(track[best])
    np.testing.assert_allclose(unassigned[detection[best]], 1 - assigned[best], rtol=1e-9)


def test_without_pairs_all_are_missed():
    none = np.empty(0, int)
    for rule in (every_event, best_event, intensity):
        assigned, _, unassigned = rule(none, none, np.empty(0), np.full(2, 0.5), np.full(2, 0.55), 3)
        assert len(assigned) == 0 and (unassigned == 1).all()


def test_a_detection_of_an_intensity_has_the_weight_of_all_its_parents_and_one_label():
    """Two components of weights 0.9 and 0.6 about one detection, the first with a second one, farther off."""
    r, miss = np.array([0.9, 0.6]), np.array([0.19, 0.46])
    likelihood = np.array([4.0, 0.5, 2.0])  # P_D L / clutter of the pairs
    track, detection = np.array([0, 0, 1]), np.array([0, 1, 0])
    log_psi = np.log(r[track] * likelihood / miss[track])
    assigned, missed, unassigned = intensity(track, detection, log_psi, r, miss, 2)
    whole = 0.9 * 4.0 + 0.6 * 2.0
    np.testing.assert_allclose(assigned, [whole / (1 + whole), 0, 0])
    np.testing.assert_allclose(unassigned, [1 / (1 + whole), 1])
    np.testing.assert_array_equal(missed, miss)


@pytest.mark.parametrize("seed", range(6))
def test_the_best_leaves_are_the_best_of_all_choices_that_share_no_detection(seed, monkeypatch):
    rng = np.random.default_rng(seed)
    tree, history = np.repeat(np.arange(5), 4), rng.integers(-1, 3, (20, 2))
    history[::4] = -1  # every tree has a leaf that was always missed
    weight = rng.normal(0, 3, 20) + 2.0 * (history >= 0).sum(axis=1)

    def apart(leaves):
        used = [(scan, j) for leaf in leaves for scan, j in enumerate(history[leaf]) if j >= 0]
        return len(set(used)) == len(used)

    choices = (c for c in product(*(np.flatnonzero(tree == i) for i in range(5))) if apart(c))
    expected = max(choices, key=lambda leaves: weight[list(leaves)].sum())
    order = rng.permutation(20)
    safe = np.argsort(order)[::4]  # where these leaves are now
    found = best_leaves(tree[order], weight[order], history[order], safe)
    assert order[found].tolist() == list(expected)
    with monkeypatch.context() as patched:
        patched.setattr(track_leaves, "MOST_CHOICES", 0)
        quick = order[best_leaves(tree[order], weight[order], history[order], safe)]
    assert apart(quick) and weight[quick].sum() >= weight[::4].sum()
    assert tree[quick].tolist() == [0, 1, 2, 3, 4]
