r"""Marginal association probabilities of a scan: exact cluster by cluster, belief propagation beyond a size.

An association event assigns to each track one detection of its gate or none, and no detection to two tracks.
Its probability is proportional to the product of :math:`\psi_{ij}` over its pairs, the weight of the pair
relative to a missed track and an unassigned detection. Tracks that share detections, also through other
tracks, form a cluster; clusters are independent.
"""

import numpy as np

from gmr_gym.filters.belief_propagation import grouped, propagate
from gmr_gym.filters.detection_sets import MOST_STEPS
from gmr_gym.filters.event_sums import sum_events, without, workspace
from gmr_gym.filters.intensity_update import log_sum
from gmr_gym.filters.track_trees import Graph
from gmr_gym.kernels import kernel

ASSOCIATIONS = ("exact", "belief-propagation")
IMPROBABLE = float(np.log(1e-5))  # a pair of less weight has a marginal probability of less


@kernel
def marginals(track, detection, log_psi, n, k):
    r"""Marginal association probabilities of n tracks and k detections.

    Returns those of each pair (e,), of a missed track (n,) and of an unassigned detection (k,), and for each
    track (n,) whether belief propagation approximated its cluster.

    log_psi (e,) is the log weight of the pair of track (e,) and detection (e,). No pair may occur twice.

    Notes
    -----
    Efficient hypothesis management (Maskell, Briers and Wright 2004) as dynamic programming, over a tree of
    the tracks of a cluster (Horridge and Maskell 2006): two tracks that share a detection are on one way from
    the root. Of the tracks nearer to the root than track i only the set U of the detections matters that they
    use and that its branch, it and all tracks beyond it, may use. With :math:`\psi_{i0} = 1`, branches c of
    track i, and :math:`U_{jc}` what of U and j the branch c may use,

    .. math::

        \beta_i(U) = \sum_{j \notin U} \psi_{ij} \prod_c \beta_c(U_{jc}), \qquad
        \alpha_c(U') = \sum_{(U, j) \to U'} \alpha_i(U) \psi_{ij} \prod_{b \ne c} \beta_b(U_{jb}), \qquad
        \bar p_{ij} \propto \sum_{U \not\ni j} \alpha_i(U) \psi_{ij} \prod_c \beta_c(U_{jc})

    All terms are positive. A detection of one track alone stands in no set.

    A cluster that is too large is taken without its pairs of a weight below 1e-5, and is approximated where
    it still is.
    """
    assigned, missed, unassigned, large = np.zeros(len(track)), np.ones(n), np.ones(k), np.ones(n, np.bool_)
    rest = np.arange(len(track))
    for _ in range(2):
        if large.any():
            found = np.zeros(len(rest))
            large = _exact(track[rest], detection[rest], log_psi[rest], (found, missed, unassigned))
            assigned[rest] = found
            rest = np.flatnonzero(large[track] & (log_psi > IMPROBABLE))
    if large.any():
        found, lost, free = propagate(track[rest], detection[rest], log_psi[rest], n, k)
        assigned[rest] = found
        for a in rest:
            missed[track[a]], unassigned[detection[a]] = lost[track[a]], free[detection[a]]
    return assigned, missed, unassigned, large


@kernel(inline="always")
def _exact(track, detection, log_psi, marginal):
    """The marginals of the clusters that are not too large, written to `marginal`; which tracks (n,) are of
    those that are."""
    n, k, e = len(marginal[1]), len(marginal[2]), len(track)
    by_track, first_track = grouped(track, n)
    by_detection, first_detection = grouped(detection, k)
    members, first = grouped(_clusters(track, by_detection, first_detection, n), n)
    place, large, most = np.empty(n, np.int64), np.zeros(n, np.bool_), 0
    for p in range(n):
        place[members[p]] = p
        most = max(most, first[p + 1] - first[p])
    graph = Graph(
        members, place, by_track, first_track, track[by_detection], first_detection, detection, log_psi
    )
    tree, sets, sums = workspace(n, k, e, MOST_STEPS if most > 1 else 0)
    for c in range(n):
        begin, end = first[c], first[c + 1]
        if end - begin == 1 and first_track[members[begin] + 1] > first_track[members[begin]]:
            _alone(members[begin], graph, marginal)
        elif end - begin > 1 and not sum_events(begin, end, graph, tree, sets, sums, marginal):
            large[members[begin:end]] = True
    return large


def clusters(track: np.ndarray, detection: np.ndarray, n: int, k: int) -> np.ndarray:
    """The lowest track (n,) of the cluster that each of n tracks is of, by its pairs with k detections."""
    return _clusters(track, *grouped(detection, k), n)


def clusters_of(
    chosen: np.ndarray, track: np.ndarray, detection: np.ndarray, log_psi: np.ndarray, k: int
) -> int:
    """Number of clusters of the tracks that are `chosen` (n,), without improbable pairs."""
    if not chosen.any():
        return 0
    kept = chosen[track] & (log_psi > IMPROBABLE)
    return len(np.unique(clusters(track[kept], detection[kept], len(chosen), k)[chosen]))


@kernel
def _clusters(track, by_detection, first_detection, n):
    """The lowest track (n,) of the cluster that each is of."""
    root = np.arange(n)
    for j in range(len(first_detection) - 1):
        for b in range(first_detection[j] + 1, first_detection[j + 1]):
            one, other = track[by_detection[b - 1]], track[by_detection[b]]
            while root[one] != one:
                one = root[one]
            while root[other] != other:
                other = root[other]
            root[max(one, other)] = min(one, other)
    for i in range(n):
        root[i] = root[root[i]]
    return root


@kernel
def _alone(i, graph, marginal):
    """The marginals of a track whose detections no other track may have."""
    (assigned, missed, unassigned), whole = marginal, 0.0
    own = graph.by_track[graph.first_track[i] : graph.first_track[i + 1]]
    for a in own:
        whole = log_sum(whole, graph.log_psi[a])
    missed[i] = np.exp(-whole)
    for a in own:
        assigned[a] = np.exp(graph.log_psi[a] - whole)
    for a in own:
        unassigned[graph.detection[a]] = without(a, own, assigned, missed[i])
