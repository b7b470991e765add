r"""Global hypotheses about many targets, kept apart in clusters of tracks that have shared detections.

A leaf is one history of a track: the detections that it has had. A global hypothesis of a cluster gives each
of its tracks one leaf or none. Clusters are independent, so that their product is the density of all targets.
"""

from typing import NamedTuple

import numpy as np

from gmr_gym.filters.belief_propagation import grouped
from gmr_gym.filters.intensity_update import log_sum
from gmr_gym.filters.ranked_assignments import ranked_events
from gmr_gym.filters.sampled_events import sampled_events
from gmr_gym.kernels import kernel, leaf_kernel


class Hypotheses(NamedTuple):
    """Global hypotheses, cluster by cluster.

    Attributes
    ----------
    cluster : ndarray of int, shape (h,)
        Cluster of each, ascending from 0.
    log_weight : ndarray, shape (h,)
        log of its probability; those of a cluster sum to 1.
    first : ndarray of int, shape (h + 1,)
        Where the leaves of each begin.
    leaf : ndarray of int
        Leaves of all hypotheses, one hypothesis after another.
    """

    cluster: np.ndarray
    log_weight: np.ndarray
    first: np.ndarray
    leaf: np.ndarray


class Options(NamedTuple):
    """How many hypotheses a cluster may have.

    Attributes
    ----------
    most : int
        Most hypotheses.
    least : float
        Hypotheses of less probability are dropped.
    samples : int
        Events drawn by Gibbs sampling for a cluster; 0 for the events of most weight instead.
    entries : int
        Most entries of the tables of pairs of a cluster, one table for each hypothesis. Where they would be
        more, fewer hypotheses are kept.
    """

    most: int
    least: float
    samples: int = 0
    entries: int = 20_000_000


NONE = Hypotheses(np.empty(0, np.int64), np.empty(0), np.zeros(1, np.int64), np.empty(0, np.int64))


def singles(leaves: np.ndarray, cluster: int) -> Hypotheses:
    """One hypothesis of one leaf for each of the leaves, in clusters numbered from `cluster`."""
    n = len(leaves)
    return Hypotheses(cluster + np.arange(n), np.zeros(n), np.arange(n + 1), np.asarray(leaves, np.int64))


def joined(one: Hypotheses, other: Hypotheses) -> Hypotheses:
    """The hypotheses of both, whose clusters differ and ascend."""
    return Hypotheses(
        np.append(one.cluster, other.cluster), np.append(one.log_weight, other.log_weight),
        np.append(one.first[:-1], len(one.leaf) + other.first), np.append(one.leaf, other.leaf),
    )  # fmt: skip


@kernel
def associate(hypotheses, log_miss, log_absent, pairs, k, options, rng):
    r"""The hypotheses after a scan of k detections.

    Parameters
    ----------
    hypotheses : Hypotheses
        Of L leaves.
    log_miss : ndarray, shape (L,)
        log weight of a leaf that is not detected.
    log_absent : ndarray, shape (L,)
        The same where its target turns out not to exist and the leaf ends, over that of a miss; minus
        infinity where a missed leaf has that in its probability of existence.
    pairs : tuple of ndarray, shape (e,)
        Leaf and detection of each pair, by leaf, and log weight over that of a miss and a free detection.
    k : int
    options : Options
    rng : numpy.random.Generator

    Returns
    -------
    Hypotheses
        Leaves are numbered anew: the first L were not detected, L + a had pair a, L + e + j are the leaves
        of new tracks, begun by detections j that no leaf has.

    Notes
    -----
    Clusters whose leaves have a detection of one gate become one; its hypotheses are products of theirs.
    Hypothesis h of weight :math:`w_h` then begets the :math:`\lceil K w_h \rceil` events of most weight, with
    K the most hypotheses of a cluster.

    References
    ----------
    Garcia-Fernandez et al. 2018; clusters as of Reid 1979.
    """
    row, detection, log_psi = pairs
    leaves, e = len(log_miss), len(row)
    of_leaf = np.zeros(leaves, np.int64)
    old = hypotheses.cluster[-1] + 1 if len(hypotheses.cluster) else 0
    by_cluster = np.searchsorted(hypotheses.cluster, np.arange(old + 1))
    for h in range(len(hypotheses.cluster)):
        of_leaf[hypotheses.leaf[hypotheses.first[h] : hypotheses.first[h + 1]]] = hypotheses.cluster[h]
    first_pair = np.searchsorted(row, np.arange(leaves + 1))
    nodes, start = grouped(_roots(of_leaf[row], old + detection, old + k), old + k)
    column = np.full(k, -1)
    cluster, log_weight = np.empty(16, np.int64), np.empty(16)
    first, leaf, made, at, number = np.zeros(17, np.int64), np.empty(64, np.int64), 0, 0, 0
    for g in range(old + k):
        group = nodes[start[g] : start[g + 1]]
        if len(group) == 0:
            continue
        clusters, detections = group[group < old], group[group >= old] - old
        for c in range(len(detections)):
            column[detections[c]] = c
        own = _limited(options, hypotheses, by_cluster[clusters], len(detections))
        chosen, prior = _product(clusters, by_cluster, hypotheses.log_weight, own.most)
        w, ends, codes = _children(
            (hypotheses, chosen, prior), (log_miss, log_absent), (first_pair, detection, log_psi), column,
            (detections, leaves + e), own, rng,
        )  # fmt: skip
        kept, w = _kept(w, own)
        cluster, log_weight = _with_room(cluster, made + len(kept)), _with_room(log_weight, made + len(kept))
        first = _with_room(first, made + len(kept) + 1)
        for c in range(len(kept)):
            held = codes[ends[kept[c]] : ends[kept[c] + 1]]
            leaf = _with_room(leaf, at + len(held))
            leaf[at : at + len(held)] = held
            at += len(held)
            cluster[made], log_weight[made], first[made + 1] = number, w[c], at
            made += 1
        number += 1
    return Hypotheses(
        cluster[:made].copy(), log_weight[:made].copy(), first[: made + 1].copy(), leaf[:at].copy()
    )


@kernel
def _limited(options, hypotheses, some, k):
    """The options of a cluster of k detections that takes in those of hypotheses `some`, one of each."""
    tracks = (hypotheses.first[some + 1] - hypotheses.first[some]).sum()
    most = options.entries // (tracks * (tracks + k) + 1) + 1
    return Options(min(options.most, most), options.least, min(options.samples, most), options.entries)


@leaf_kernel
def _root(root, a):
    while root[a] != a:
        root[a] = root[root[a]]
        a = root[a]
    return a


@kernel
def _roots(one, other, n):
    """The lowest of n nodes (n,) that each is connected with by edges from `one` to `other`."""
    root = np.arange(n)
    for a in range(len(one)):
        x, y = _root(root, one[a]), _root(root, other[a])
        root[max(x, y)] = min(x, y)
    for a in range(n):
        root[a] = _root(root, a)
    return root


@kernel
def _product(clusters, by_cluster, log_weight, count):
    """Combinations of a hypothesis of each cluster, the `count` of most weight: hypotheses (q, clusters), and
    log weights (q,)."""
    chosen, weight = np.empty((1, len(clusters)), np.int64), np.zeros(1)
    for c in range(len(clusters)):
        one, other = by_cluster[clusters[c]], by_cluster[clusters[c] + 1]
        order = one + np.argsort(-log_weight[one:other], kind="mergesort")
        a, b, total = _sums(weight, log_weight[order], count)
        best = np.argsort(-total, kind="mergesort")[:count]
        chosen, weight = chosen[a[best]], total[best]
        chosen[:, c] = order[b[best]]
    return chosen, weight


@kernel
def _sums(x, y, count):
    """Those sums of an element of x and one of y, both descending, that may be among the `count` greatest."""
    size = 0
    for i in range(min(len(x), count)):
        size += min(len(y), count // (i + 1))
    a, b, total, at = np.empty(size, np.int64), np.empty(size, np.int64), np.empty(size), 0
    for i in range(min(len(x), count)):
        for j in range(min(len(y), count // (i + 1))):
            a[at], b[at], total[at] = i, j, x[i] + y[j]
            at += 1
    return a, b, total


@kernel
def _children(parents, log_alone, pairs, column, numbers, options, rng):
    """Hypotheses after the scan of one cluster: log weights (c,), where each begins, and leaves."""
    (hypotheses, chosen, prior), (log_miss, log_absent) = parents, log_alone
    (first_pair, detection, log_psi), (detections, begun) = pairs, numbers
    count = 0
    share = np.exp(prior - prior.max())
    share /= share.sum()
    w, ends, codes, at = np.empty(16), np.zeros(17, np.int64), np.empty(64, np.int64), 0
    k, spread = len(detections), -np.log(options.least)
    free = np.empty(k, np.bool_)
    for q in range(len(prior)):
        own = np.empty(0, np.int64)
        for h in chosen[q]:
            own = np.append(own, hypotheses.leaf[hypotheses.first[h] : hypotheses.first[h + 1]])
        base, place, rows, absent = prior[q], np.full(len(own), -1), 0, False
        for a in range(len(own)):
            base += log_miss[own[a]]
            if first_pair[own[a]] < first_pair[own[a] + 1] or log_absent[own[a]] > -np.inf:
                place[a] = rows
                rows += 1
                absent |= log_absent[own[a]] > -np.inf
        # columns: the detections, and for each row that its target does not exist
        table, pair = np.full((rows, k + rows * absent), -np.inf), np.empty((rows, k), np.int64)
        for a in range(len(own)):
            if place[a] >= 0:
                if absent:
                    table[place[a], k + place[a]] = log_absent[own[a]]
                for b in range(first_pair[own[a]], first_pair[own[a] + 1]):
                    table[place[a], column[detection[b]]] = log_psi[b]
                    pair[place[a], column[detection[b]]] = b
        if options.samples:
            draws = int(np.ceil(options.samples * share[q]))
            events, gain = sampled_events(table, draws, rng)
        else:
            events, gain = ranked_events(table, int(np.ceil(options.most * share[q])), spread)
        w, ends = _with_room(w, count + len(events)), _with_room(ends, count + len(events) + 1)
        codes = _with_room(codes, at + len(events) * (len(own) + k))
        for c in range(len(events)):
            free[:] = True
            for a in range(len(own)):
                taken = events[c, place[a]] if place[a] >= 0 else -1
                if taken < 0:
                    codes[at] = own[a]
                    at += 1
                elif taken < k:
                    codes[at], free[taken] = len(log_miss) + pair[place[a], taken], False
                    at += 1
            for j in range(k):
                if free[j]:
                    codes[at] = begun + detections[j]
                    at += 1
            w[count], ends[count + 1] = base + gain[c], at
            count += 1
    return w[:count], ends[: count + 1], codes[:at]


@kernel
def _kept(log_weight, options):
    """The most likely hypotheses of a cluster, and their log weights, which then sum to 1."""
    order = np.argsort(-log_weight, kind="mergesort")[: options.most]
    w = log_weight[order]
    w -= w[0] + np.log(np.exp(w - w[0]).sum())
    kept = max(1, (w >= np.log(options.least)).sum())
    w = w[:kept]
    return order[:kept], w - np.log(np.exp(w).sum())


@kernel
def _with_room(a, size):
    """The array, or a larger copy that has room for `size`."""
    if len(a) >= size:
        return a
    larger = np.zeros(2 * size, a.dtype)
    larger[: len(a)] = a
    return larger


@kernel
def simplify(hypotheses, into):
    """The hypotheses with other leaves: into (L,) is the new number of each, -1 where it is dropped.

    Hypotheses of a cluster that are then equal are added up; a leaf that all hypotheses of a cluster have is
    independent of the others, and becomes a cluster of its own.
    """
    n, size = len(hypotheses.cluster), into.max() + 1 if len(into) else 0
    renamed, first, at = np.empty(len(hypotheses.leaf), np.int64), np.zeros(n + 1, np.int64), 0
    weight, same = hypotheses.log_weight.copy(), np.zeros(n, np.uint64)
    for h in range(n):
        for a in range(hypotheses.first[h], hypotheses.first[h + 1]):
            if into[hypotheses.leaf[a]] >= 0:
                renamed[at] = into[hypotheses.leaf[a]]
                at += 1
        renamed[first[h] : at].sort()
        first[h + 1] = at
        for a in range(first[h], at):
            same[h] = (same[h] ^ np.uint64(renamed[a] + 1)) * np.uint64(0x9E3779B97F4A7C15)
    cluster, out, ends = np.empty(n + at, np.int64), np.empty(n + at), np.zeros(n + at + 1, np.int64)
    leaf, made, number, holders = np.empty(at, np.int64), 0, 0, np.zeros(size, np.int64)
    top, start = 0, 0
    while start < n:
        stop = start
        while stop < n and hypotheses.cluster[stop] == hypotheses.cluster[start]:
            stop += 1
        different = _added_up(start, stop, renamed, first, weight, same)
        for h in different:
            holders[renamed[first[h] : first[h + 1]]] += 1
        for a in renamed[first[start] : first[start + 1]]:
            if holders[a] == len(different):
                leaf[top], cluster[made], out[made] = a, number, 0.0
                top, made, number = top + 1, made + 1, number + 1
                ends[made] = top
        if len(different) > 1:
            for h in different:
                for a in renamed[first[h] : first[h + 1]]:
                    if holders[a] < len(different):
                        leaf[top] = a
                        top += 1
                cluster[made], out[made] = number, weight[h]
                made += 1
                ends[made] = top
            number += 1
        for h in different:
            holders[renamed[first[h] : first[h + 1]]] = 0
        start = stop
    return Hypotheses(cluster[:made].copy(), out[:made].copy(), ends[: made + 1].copy(), leaf[:top].copy())


@kernel
def _added_up(start, stop, leaf, first, weight, same):
    """Hypotheses of start .. stop - 1 that differ; the weights of equal ones are added to the first's."""
    different = np.empty(stop - start, np.int64)
    count = 0
    for h in range(start, stop):
        equal = -1
        for c in range(count):
            o = different[c]
            if same[o] == same[h] and first[o + 1] - first[o] == first[h + 1] - first[h]:
                if (leaf[first[o] : first[o + 1]] == leaf[first[h] : first[h + 1]]).all():
                    equal = o
        if equal < 0:
            different[count] = h
            count += 1
        else:
            weight[equal] = log_sum(weight[equal], weight[h])
    return different[:count]


@kernel
def leaf_weights(hypotheses, leaves):
    """Probability (leaves,) of the hypotheses that have each leaf."""
    w = np.zeros(leaves)
    for h in range(len(hypotheses.cluster)):
        for a in range(hypotheses.first[h], hypotheses.first[h + 1]):
            w[hypotheses.leaf[a]] += np.exp(hypotheses.log_weight[h])
    return w


@kernel
def heaviest(hypotheses):
    """The most likely hypothesis of each cluster."""
    best = np.empty(len(hypotheses.cluster), np.int64)
    count = 0
    for h in range(len(hypotheses.cluster)):
        if h == 0 or hypotheses.cluster[h] > hypotheses.cluster[h - 1]:
            best[count] = h
            count += 1
        elif hypotheses.log_weight[h] > hypotheses.log_weight[best[count - 1]]:
            best[count - 1] = h
    return best[:count]
