"""N-scan merging and Salmond's clustering, against what they say in plain Python."""

from itertools import pairwise

import numpy as np
import pytest
import reference

from gmr_gym.mixture import Mixture, mean_and_covariance, mixture
from gmr_gym.reduction.heaviest_first import Clustering, cluster, clustering, merge_by_distance
from gmr_gym.reduction.merge_cost import merge_costs
from gmr_gym.reduction.n_scan import MISSED, NScan, extended, inherited, merge_by_history
from gmr_gym.reduction.registry import hypothesis_reducer, reducer
from gmr_gym.reduction.runnalls import runnalls

ALL = 10**6  # components


def hypotheses(seed, n=60, scans=3, detections=3):
    """A mixture of n hypotheses, two of them of weight zero, and what each was updated with."""
    rng = np.random.default_rng(seed)
    w, m, P = reference.random_mixture(rng, n, 4)
    w[[3, n - 1]] = 0.0
    return mixture(w, m, P), rng.integers(MISSED, detections, (n, scans))


def by_label(p, labels):
    """Components of weight with the same label, merged in the order in which labels come first; and where
    each went."""
    groups = {}
    for i in np.flatnonzero(p.w > 0).tolist():
        groups.setdefault(labels[i], []).append(i)
    merged = [reference.moment_match(p.w[g], p.m[g], p.P[g]) for g in groups.values()]
    places = {label: place for place, label in enumerate(groups)}
    return merged, [places[labels[i]] if p.w[i] > 0 else -1 for i in range(len(p.w))]


def swallowed(p, distance):
    """Label of each component by clustering around the heaviest that is left."""
    labels, left = {}, [i for i in np.argsort(-p.w, kind="stable").tolist() if p.w[i] > 0]
    while left:
        c = left[0]
        away = {i: (p.m[i] - p.m[c]) @ np.linalg.solve(p.P[c], p.m[i] - p.m[c]) for i in left}
        labels |= {i: c for i in left if away[i] <= distance}
        left = [i for i in left if away[i] > distance]
    return labels


def assert_merged(q, merged):
    for mine, theirs in zip(q, zip(*merged, strict=True), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("scans", [0, 1, 2, 3])
def test_hypotheses_of_the_same_history_are_merged_and_no_others(scans):
    p, history = hypotheses(scans, scans=scans)
    q, origin = NScan(ALL, scans)(p, history)
    merged, wanted = by_label(p, [tuple(row) for row in history.tolist()])
    assert origin.tolist() == wanted and 1 <= len(q.w) == len(merged) < 60
    assert_merged(q, merged)


def test_histories_are_compared_and_not_their_hashes_alone():
    rng = np.random.default_rng(0)
    n = 2000
    p = mixture(np.full(n, 1 / n), rng.standard_normal((n, 1)), np.ones((n, 1, 1)))
    histories = (
        rng.permutation(n)[:, None] << 40,  # the same low bits
        np.stack(np.divmod(np.arange(n), 64), axis=1),
        rng.integers(MISSED, 30, (n, 2)),
    )
    for history in histories:
        _, origin = NScan(ALL, history.shape[1])(p, history)
        _, wanted = np.unique(history, axis=0, return_inverse=True)
        pairs = set(zip(origin.tolist(), wanted.ravel().tolist(), strict=True))
        assert len(pairs) == len(set(origin)) == len(set(wanted.ravel()))


@pytest.mark.parametrize("components", [ALL, 4, 1])
@pytest.mark.parametrize("rule", ["history", "distance"])
def test_moments_are_kept_and_work_counts_every_comparison(rule, components):
    p, history = hypotheses(5)
    if rule == "history":
        *q, origin, work = merge_by_history(*p, history, history.shape[1], components)
        merged, _ = by_label(p, [tuple(row) for row in history.tolist()])
        compared = len(p.w)
    else:
        *q, origin, work = merge_by_distance(*p, 20.0, components)
        labels = swallowed(p, 20.0)
        merged, _ = by_label(p, labels)
        centres = sorted(set(labels.values()), key=lambda c: -p.w[c])
        left = len(labels)
        compared = 0
        for c in centres:
            compared += left - 1
            left -= list(labels.values()).count(c)
    beyond = merge_costs(len(merged), components) if len(merged) > components else 0
    assert work == compared + beyond and len(merged) > 4
    assert len(q[0]) == min(len(merged), components) and set(origin[p.w > 0]) == set(range(len(q[0])))
    assert q[0].sum() == pytest.approx(p.w.sum(), rel=1e-12)
    for mine, theirs in zip(mean_and_covariance(Mixture(*q)), mean_and_covariance(p), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-10, atol=1e-10)


def test_beyond_the_limit_the_merged_are_reduced_as_runnalls_does():
    p, history = hypotheses(6)
    for reduce in (lambda n: NScan(n, 3)(p, history), lambda n: cluster(p, n, 20.0)):
        (all_of_them, first), (few, origin) = reduce(ALL), reduce(5)
        wanted, second = runnalls(all_of_them, 5)
        np.testing.assert_array_equal(few.m, wanted.m)
        np.testing.assert_array_equal(origin, np.append(second, -1)[first])


@pytest.mark.parametrize("distance", [0.0, 5.0, 20.0, 1e9])
def test_the_heaviest_takes_in_what_is_near_it_by_its_own_covariance(distance):
    p, _ = hypotheses(7)
    q, origin = cluster(p, ALL, distance)
    labels = swallowed(p, distance)
    centres = sorted(set(labels.values()), key=lambda c: -p.w[c])
    assert origin.tolist() == [centres.index(labels[i]) if i in labels else -1 for i in range(len(p.w))]
    merged, _ = by_label(p, labels)
    assert_merged(Mixture(*(part[np.argsort(-q.w)] for part in q)), sorted(merged, key=lambda one: -one[0]))
    assert (len(q.w) == 58) == (distance == 0.0) and (len(q.w) == 1) == (distance == 1e9)


def test_a_narrow_component_does_not_take_in_what_a_wide_one_would():
    m, P = [[0.0], [3.0]], [[[1.0]], [[9.0]]]
    assert len(cluster(mixture([0.6, 0.4], m, P), 2)[0].w) == 2
    assert len(cluster(mixture([0.4, 0.6], m, P), 2)[0].w) == 1


def test_a_history_moves_on_by_a_scan_and_is_inherited_from_the_heaviest():
    history = np.array([[4, 5, 6], [7, 8, 9]])
    after = extended(history, np.array([1, 0, 1]), np.array([2, MISSED, 0]))
    assert after.tolist() == [[2, 7, 8], [MISSED, 4, 5], [0, 7, 8]]
    assert inherited(after, np.array([0.2, 0.5, 0.3]), np.array([0, -1, 0]), 1).tolist() == [[0, 7, 8]]
    start = NScan(ALL, 2).at_start(3)
    assert start.shape == (3, 2) and all((a != b).all() for a, b in pairwise(start)) and start.max() < 0


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("n-scan:scans=-1", "scans must be at least 0, got -1"),
        ("n-scan:scans=1.5", "scans must be a whole number, got 1.5"),
        ("n-scan:scans=two", "scans must be a whole number, got 'two'"),
        ("n-scan:reach=1", "reduction 'n-scan' takes no parameter 'reach'; it takes scans"),
    ],
)
def test_what_is_wrong_with_an_n_scan_reduction_is_said(name, message):
    with pytest.raises(ValueError, match=message):
        hypothesis_reducer(name, 5)


def test_by_name_only_hypotheses_with_detections_are_merged_by_them():
    assert hypothesis_reducer("n-scan:scans=3", 5) == NScan(5, 3)
    assert hypothesis_reducer("cluster:distance=2", 5).keywords == {"components": 5, "distance": 2}
    with pytest.raises(ValueError, match="components must be at least 1, got 0"):
        hypothesis_reducer("n-scan", 0)
    with pytest.raises(ValueError, match="reduction 'n-scan' compares the detections of hypotheses"):
        reducer("n-scan", 5)
    assert clustering(3, 2) == Clustering(3, 2.0)
    with pytest.raises(ValueError, match="distance must be a number, at least 0, got -1"):
        clustering(3, -1)
