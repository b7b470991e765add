"""The association events of a cluster of tracks, summed over a tree of its tracks."""

from typing import NamedTuple

import numpy as np

from gmr_gym.filters.detection_sets import Sets, power_of_two, search
from gmr_gym.filters.intensity_update import log_sum
from gmr_gym.filters.track_trees import BITS, Tree, branches_of, grow, own_pairs
from gmr_gym.kernels import kernel, leaf_kernel

LEAST = 1e-100  # sum of weights, the greatest 1, below which logarithms are added


class Sums(NamedTuple):
    """Sums over events, for each set, and weights."""

    forward: np.ndarray
    backward: np.ndarray
    alone: np.ndarray  # (n,) log weight of no shared detection
    free: np.ndarray  # (n,) the same relative to the greatest of the track
    high: np.ndarray  # (n,) greatest backward sum, to which the others are relative
    w: np.ndarray  # (e,)
    kept: np.ndarray  # (branches,) sum of the branch, and of all that take a detection of it
    lost: np.ndarray
    product: np.ndarray  # (branches + 1,) of the branches before, and the same with a detection lost
    mixed: np.ndarray


@kernel
def workspace(n, k, e, steps):
    """A Tree, Sets and Sums for n tracks, k detections, e pairs and so many steps of a cluster."""
    node, column, each = np.full((10, n), -1), np.full((5, k), -1), np.empty((7, n + 1))
    shared = np.empty((BITS + 1) * n + k if steps else 0, np.int64)
    tree = Tree(
        node[0], node[1], node[2], node[3], node[4], node[5], shared, np.full(e, -1), node[6], node[7],
        column[0], column[1], column[2], column[3],
    )  # fmt: skip
    reached, following = np.empty(steps + 1, np.int64), np.empty(steps + 1, np.int64)
    found, end = np.empty(power_of_two(4 * steps), np.int64), np.empty(n, np.int64)
    sets = Sets(column[4], node[8], end, reached, found, node[9], following)
    sums = Sums(
        np.empty(steps + 1), np.empty(steps + 1), each[0], each[1], each[2], np.empty(e), each[3], each[4],
        each[5], each[6],
    )  # fmt: skip
    return tree, sets, sums


@kernel(inline="always")
def sum_events(begin, end, graph, tree, sets, sums, marginal):
    """The marginals of a cluster, the members from `begin` to `end`, written to `marginal`; False where that
    takes too many steps, and nothing is written."""
    few = grow(begin, end, graph, tree) and search(begin, end, graph, tree, sets)
    done = not few
    for logs in range(2):
        done = done or _sweep(begin, end, graph, tree, sets, sums, marginal, logs == 1)
    return few


@leaf_kernel
def _sweep(begin, end, graph, tree, sets, sums, marginal, logs):
    """Sums from the leaves to the root and back, and the marginals from both; False where a part that may
    count is no float. Weights are relative to the greatest of each track."""
    zero = -np.inf if logs else 0.0
    for p in range(end - 1, begin - 1, -1):
        i, high = tree.order[p], zero
        own = own_pairs(i, graph)
        _weigh(i, own, graph, sets, sums, logs)
        for s in range(sets.first[i], sets.end[i]):
            here, count = _branches(i, s, own, graph, tree, sets, sums, logs), branches_of(i, tree)
            sums.backward[s] = _plus(_times(here, sums.product[count], logs), sums.mixed[count], logs)
            high = max(high, sums.backward[s])
        if not logs and not high > LEAST:
            return False
        sums.high[i] = high
        for s in range(sets.first[i], sets.end[i]):
            sums.backward[s] = sums.backward[s] - high if logs else sums.backward[s] / high
    sums.forward[0] = 0.0 if logs else 1.0
    for p in range(begin, end):
        i, whole, high = tree.order[p], zero, zero
        for s in range(sets.first[i], sets.end[i]):
            whole = _plus(whole, _times(sums.forward[s], sums.backward[s], logs), logs)
            high = max(high, sums.forward[s])
        if not logs and not whole > LEAST * high:
            return False
        whole = _times(whole, sums.high[i], logs)
        for s in range(sets.first[i], sets.end[i]):
            sums.forward[s] = sums.forward[s] - whole if logs else sums.forward[s] / whole
        _hand_down(i, own_pairs(i, graph), graph, tree, sets, sums, marginal, logs)
    return True


@leaf_kernel
def _weigh(i, own, graph, sets, sums, logs):
    """The weights of what a track may have, relative to the greatest."""
    alone = 0.0
    for a in own:
        alone = log_sum(alone, graph.log_psi[a]) if sets.slot[graph.detection[a]] < 0 else alone
    top = alone
    for a in own:
        top = max(top, graph.log_psi[a])
    sums.alone[i] = alone
    sums.free[i] = alone - top if logs else np.exp(alone - top)
    for a in own:
        sums.w[a] = graph.log_psi[a] - top if logs else np.exp(graph.log_psi[a] - top)


@leaf_kernel
def _branches(i, s, own, graph, tree, sets, sums, logs):
    """The sums of the branches of a track that finds a set: as they are, and of the choices that take a
    detection from each; products of these over the branches, with none or one of the latter. Returns the sum
    of the choices that take none from any."""
    zero, count = -np.inf if logs else 0.0, branches_of(i, tree)
    at, here = sets.step[i] + (s - sets.first[i]) * (count + len(own)), sums.free[i]
    for q in range(count):
        sums.kept[q], sums.lost[q] = sums.backward[sets.following[at + q]], zero
    for o in range(len(own)):
        a, to = own[o], sets.following[at + count + o]
        if sets.slot[graph.detection[a]] >= 0 and to >= 0:
            if tree.below[a] < 0:
                here = _plus(here, sums.w[a], logs)
            else:
                q = tree.rank[tree.below[a]]
                sums.lost[q] = _plus(sums.lost[q], _times(sums.w[a], sums.backward[to], logs), logs)
    sums.product[0], sums.mixed[0] = 0.0 if logs else 1.0, zero
    for q in range(count):
        sums.product[q + 1] = _times(sums.product[q], sums.kept[q], logs)
        one = _times(sums.product[q], sums.lost[q], logs)
        sums.mixed[q + 1] = _plus(_times(sums.mixed[q], sums.kept[q], logs), one, logs)
    return here


@leaf_kernel
def _hand_down(i, own, graph, tree, sets, sums, marginal, logs):
    """The forward sums of the branches of a track, and its marginals."""
    zero, count, none = -np.inf if logs else 0.0, branches_of(i, tree), 0.0
    (assigned, missed, unassigned), one = marginal, tree.branch[i]
    while one >= 0:
        sums.forward[sets.first[one] : sets.end[one]] = zero
        one = tree.sibling[one]
    for a in own:
        assigned[a] = 0.0
        if tree.below[a] < 0:
            unassigned[graph.detection[a]] = 0.0
    for s in range(sets.first[i], sets.end[i]):
        here, f = _branches(i, s, own, graph, tree, sets, sums, logs), sums.forward[s]
        at = sets.step[i] + (s - sets.first[i]) * (count + len(own))
        every = _times(f, sums.product[count], logs)
        none += _value(_times(every, sums.free[i], logs), logs)
        for o in range(len(own)):
            if not _closes(o, own, at + count, graph, tree, sets):
                continue
            assigned[own[o]] += _value(_times(every, sums.w[own[o]], logs), logs)
            others = sums.free[i]
            for c in range(len(own)):
                if c != o and _closes(c, own, at + count, graph, tree, sets):
                    others = _plus(others, sums.w[own[c]], logs)
            others = _plus(_times(others, sums.product[count], logs), sums.mixed[count], logs)
            unassigned[graph.detection[own[o]]] += _value(_times(f, others, logs), logs)
        one, after, after_lost = tree.branch[i], 0.0 if logs else 1.0, zero
        while one >= 0:
            q, to = tree.rank[one], sets.following[at + tree.rank[one]]
            rest = _times(sums.product[q], after, logs)
            lost = _times(sums.mixed[q], after, logs)
            lost = _plus(lost, _times(sums.product[q], after_lost, logs), logs)
            part = _times(f, _plus(_times(here, rest, logs), lost, logs), logs)
            sums.forward[to] = _plus(sums.forward[to], part, logs)
            for o in range(len(own)):
                to = sets.following[at + count + o]
                if tree.below[own[o]] == one and to >= 0:
                    part = _times(_times(f, rest, logs), sums.w[own[o]], logs)
                    sums.forward[to] = _plus(sums.forward[to], part, logs)
                    assigned[own[o]] += _value(_times(part, sums.backward[to], logs), logs)
            lost = _times(after, sums.lost[q], logs)
            after_lost = _plus(_times(after_lost, sums.kept[q], logs), lost, logs)
            after, one = _times(after, sums.kept[q], logs), tree.sibling[one]
    i, alone = graph.members[i], sums.alone[i]
    missed[i] = none * np.exp(-alone)
    for a in own:
        if sets.slot[graph.detection[a]] < 0:
            assigned[a] = none * np.exp(graph.log_psi[a] - alone)
    for a in own:
        if sets.slot[graph.detection[a]] < 0:
            unassigned[graph.detection[a]] = without(a, own, assigned, missed[i])


@leaf_kernel
def _closes(o, own, at, graph, tree, sets):
    """Whether a track may have a detection that no branch of it may have, but a track nearer to the root."""
    a = own[o]
    return tree.below[a] < 0 and sets.slot[graph.detection[a]] >= 0 and sets.following[at + o] >= 0


@leaf_kernel
def without(a, own, assigned, rest):
    """1 - assigned[a], of marginals that sum to 1 with `rest`, without cancellation."""
    if assigned[a] < 0.5:
        return 1.0 - assigned[a]
    for b in own:  # of one pair at most
        rest += assigned[b] if b != a else 0.0
    return rest


@leaf_kernel
def _plus(a, b, logs):
    return log_sum(a, b) if logs else a + b


@leaf_kernel
def _times(a, b, logs):
    return a + b if logs else a * b


@leaf_kernel
def _value(a, logs):
    return np.exp(a) if logs else a
