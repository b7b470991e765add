r"""The association events of a cluster of tracks, summed over a tree of its tracks.

Of the detections that the tracks nearer to the root have only the set matters that a branch may have too.
"""

from typing import NamedTuple

import numpy as np

from gmr_gym.filters.intensity_update import log_sum
from gmr_gym.filters.track_trees import BITS, Tree, branches_of, grow, own_pairs
from gmr_gym.kernels import kernel, leaf_kernel

MOST_STEPS = 100_000  # of one cluster, from set to set of detections; it is given up where it takes more
LEAST = 1e-100  # sum of weights, the greatest 1, below which logarithms are added


class Sets(NamedTuple):
    """Sets of detections that are taken before a track, and where each leads."""

    slot: np.ndarray  # (k,) bit of each detection; -1 where it is of one track
    first: np.ndarray  # (n,) where those of each track begin and end
    end: np.ndarray
    sets: np.ndarray
    found: np.ndarray  # table of the sets of a branch
    step: np.ndarray  # (n,) where its own part of `following` begins
    following: np.ndarray  # for each set: for each branch, and for each pair, -1 where it cannot be


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
    found, end = np.empty(_power_of_two(4 * steps), np.int64), np.empty(n, np.int64)
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
    few, done = grow(begin, end, graph, tree) and _search(begin, end, graph, tree, sets), False
    for again in range(2 if few else 0):
        done = done or _sweep(begin, end, graph, tree, sets, sums, marginal, again > 0)
    return few


@leaf_kernel
def _search(begin, end, graph, tree, sets):
    """The sets that each track may find, from the root on, and where they lead; False where that takes too
    many steps."""
    root, made, used = tree.order[begin], 1, 0
    sets.sets[0], sets.first[root], sets.end[root] = 0, 0, 1
    for p in range(begin, end):
        i = tree.order[p]
        own, taken = own_pairs(i, graph), _mask(i, tree, sets)
        for a in own:
            j = graph.detection[a]
            if tree.below[a] >= 0 and sets.slot[j] < 0:
                sets.slot[j] = _unused(taken)
                if sets.slot[j] == BITS:
                    return False
                taken |= 1 << sets.slot[j]
        branches, states = branches_of(i, tree), sets.end[i] - sets.first[i]
        span = branches + len(own)
        if used + states * span > MOST_STEPS:
            return False
        sets.step[i], one = used, tree.branch[i]
        while one >= 0:
            options = 1
            for a in own:
                options += tree.below[a] == one
            size = _power_of_two(2 * states * options)
            made = _lead(i, one, made, sets.found[:size], own, span, graph, tree, sets)
            one = tree.sibling[one]
        for o in range(len(own)):
            slot = sets.slot[graph.detection[own[o]]]
            if tree.below[own[o]] < 0 and slot >= 0:
                for s in range(states):
                    free = not sets.sets[sets.first[i] + s] >> slot & 1
                    sets.following[used + s * span + branches + o] = 0 if free else -1
        used += states * span
    return True


@leaf_kernel
def _lead(i, one, made, found, own, span, graph, tree, sets):
    """Where the sets of a track lead in one of its branches; how many sets there are then."""
    mask, first, states = _mask(one, tree, sets), sets.first[i], sets.end[i] - sets.first[i]
    found[:], sets.first[one] = -1, made
    for s in range(states):
        taken, at = sets.sets[first + s], sets.step[i] + s * span
        to = _place(taken & mask, found, sets.sets, made)
        sets.following[at + tree.rank[one]] = to
        made += to == made
        for o in range(len(own)):
            if tree.below[own[o]] == one:
                bit, to = 1 << sets.slot[graph.detection[own[o]]], -1
                if not taken & bit:
                    to = _place((taken | bit) & mask, found, sets.sets, made)
                    made += to == made
                sets.following[at + span - len(own) + o] = to
    sets.end[one] = made
    return made


@leaf_kernel
def _mask(i, tree, sets):
    """The set of what the branch of a track shares with the rest."""
    mask = 0
    for b in range(tree.start[i], tree.start[i] + tree.width[i]):
        mask |= 1 << sets.slot[tree.shared[b]]
    return mask


@leaf_kernel
def _unused(taken):
    """The lowest bit that is not taken; `BITS` where all are."""
    bit = 0
    while bit < BITS and taken & (1 << bit):
        bit += 1
    return bit


@leaf_kernel
def _power_of_two(n):
    """The least power of two that is at least n."""
    power = 1
    while power < n:
        power *= 2
    return power


@leaf_kernel
def _place(used, found, sets, top):
    """Where the set stands; `top` where it is new, and written there. found is an open-addressing table."""
    size = len(found)
    h = used
    h ^= h >> 31
    h = (h * 0x5851F42D4C957F2D) & 0x7FFFFFFFFFFFFFFF
    h ^= h >> 29
    at = h & (size - 1)
    while found[at] >= 0:
        if sets[found[at]] == used:
            return found[at]
        at = (at + 1) & (size - 1)
    found[at], sets[top] = top, used
    return top


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
