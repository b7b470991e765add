"""Trees of the tracks of a cluster, in which two that may have one detection are on one way from the root.

Given the detections that the tracks nearer to the root have, the branches below a track are independent: they
share no other detection.
"""

from typing import NamedTuple

import numpy as np

from gmr_gym.kernels import kernel, leaf_kernel

MOST_SETS = 2**20  # of detections that a branch shares with the rest; a cluster with more is given up,
BITS = 62  # and one with more detections in a set


class Graph(NamedTuple):
    """Tracks, detections and their pairs; a track is called by its place (n,) among the members (n,) of the
    clusters, one cluster after another."""

    members: np.ndarray
    place: np.ndarray
    by_track: np.ndarray  # (e,) pairs, and where those of each track begin
    first_track: np.ndarray
    holder: np.ndarray  # (e,) tracks by detection, and where those of each begin
    first_detection: np.ndarray
    detection: np.ndarray
    log_psi: np.ndarray


class Tree(NamedTuple):
    """Trees of tracks, and what it takes to grow them."""

    order: np.ndarray  # (n,) tracks of each cluster from the root on
    branch: np.ndarray  # (n,) last branch of each, -1 for none
    sibling: np.ndarray  # (n,) branch before it
    rank: np.ndarray  # (n,) number of branches before it
    start: np.ndarray  # (n,) where what its branch shares with the rest begins in `shared`, and how many
    width: np.ndarray
    shared: np.ndarray
    below: np.ndarray  # (e,) branch that may have the detection too; -1 for none
    cost: np.ndarray  # (n,) of taking each next; -1 where it is taken
    stale: np.ndarray  # (n,) whether that is to be found anew
    left: np.ndarray  # (k,) tracks that wait
    top: np.ndarray  # (k,) branch that may have each
    seen: np.ndarray  # (k,)
    union: np.ndarray  # (k,)


@leaf_kernel
def grow(begin, end, graph, tree):
    """Grows the tree from its leaves: next is the track whose branch shares fewest detections with those that
    wait. Branches that share one with it become its own. False where a branch shares too many."""
    at = 0
    for i in range(begin, end):
        tree.cost[i], tree.stale[i], tree.order[i] = 0, 1, i
        for a in own_pairs(i, graph):
            j = graph.detection[a]
            tree.left[j] = graph.first_detection[j + 1] - graph.first_detection[j]
    for last in range(end - 1, begin - 1, -1):  # those that wait come first in the order
        best = begin
        while True:
            for p in range(begin, last + 1):
                best = p if tree.cost[tree.order[p]] < tree.cost[tree.order[best]] else best
            i = tree.order[best]
            if not tree.stale[i]:
                break
            tree.cost[i], tree.stale[i] = _cost(i, graph, tree), 0
        tree.order[best], tree.order[last], tree.cost[i] = tree.order[last], i, -1
        own, size = _union(i, graph, tree)
        for a in own_pairs(i, graph):
            one = tree.top[graph.detection[a]]
            tree.below[a] = one
            if one >= 0 and tree.rank[one] < 0:
                tree.rank[one] = branches_of(i, tree)
                tree.sibling[one], tree.branch[i] = tree.branch[i], one
        tree.start[i] = at
        for b in range(size):
            j = tree.union[b]
            tree.left[j] -= b < own
            tree.top[j] = -1
            if tree.left[j] > 0:
                tree.top[j], tree.shared[at] = i, j
                at += 1
        tree.width[i] = at - tree.start[i]
        if tree.width[i] > BITS or _subsets(tree.width[i], last - begin) > MOST_SETS:
            return False
        for b in range(tree.start[i], at):
            j = tree.shared[b]
            for c in range(graph.first_detection[j], graph.first_detection[j + 1]):
                other = graph.place[graph.holder[c]]
                if tree.cost[other] >= 0:  # it may cost less where it alone is left, else more
                    tree.stale[other] = 1
                    tree.cost[other] = 0 if tree.left[j] == 1 else tree.cost[other]
    return True


@kernel(inline="always")
def own_pairs(i, graph):
    """The pairs of a track."""
    return graph.by_track[graph.first_track[graph.members[i]] : graph.first_track[graph.members[i] + 1]]


@leaf_kernel
def _union(i, graph, tree):
    """Writes the detections of a track that others may have, and then those of the branches that would be its
    own, to `union`: how many of the first, and of all."""
    size, track = 0, graph.members[i]
    for b in range(graph.first_track[track], graph.first_track[track + 1]):
        j = graph.detection[graph.by_track[b]]
        if graph.first_detection[j + 1] - graph.first_detection[j] > 1:
            tree.union[size], tree.seen[j] = j, i
            size += 1
    own = size
    for a in range(own):
        one = tree.top[tree.union[a]]
        for b in range(tree.start[one], tree.start[one] + (tree.width[one] if one >= 0 else 0)):
            if tree.seen[tree.shared[b]] != i:
                tree.union[size], tree.seen[tree.shared[b]] = tree.shared[b], i
                size += 1
    for a in range(size):
        tree.seen[tree.union[a]] = -1
    return own, size


@leaf_kernel
def _cost(i, graph, tree):
    """How many detections the branch of a track would share with those that wait; of equal ones that with
    fewer in all costs less."""
    own, size = _union(i, graph, tree)
    shared = size - own
    for a in range(own):
        shared += tree.left[tree.union[a]] > 1
    return shared * (len(tree.left) + 1) + size


@leaf_kernel
def _subsets(n, most):
    """Number of the sets of up to `most` of n elements."""
    total, choices = 1.0, 1.0
    for q in range(min(n, most)):
        choices *= (n - q) / (q + 1.0)
        total += choices
    return total


@leaf_kernel
def branches_of(i, tree):
    """How many branches a track has."""
    return tree.rank[tree.branch[i]] + 1 if tree.branch[i] >= 0 else 0
