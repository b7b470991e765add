"""The sets of detections that are taken when a tree of tracks is gone through from its root.

Of the detections that the tracks nearer to the root have only those count that a branch may have too.
"""

from typing import NamedTuple

import numpy as np

from gmr_gym.filters.track_trees import BITS, branches_of, own_pairs
from gmr_gym.kernels import leaf_kernel

MOST_STEPS = 100_000  # of one cluster, from set to set of detections; it is given up where it takes more


class Sets(NamedTuple):
    """Sets of detections that are taken before a track, and where each leads."""

    slot: np.ndarray  # (k,) bit of each detection; -1 where it is of one track
    first: np.ndarray  # (n,) where those of each track begin and end
    end: np.ndarray
    sets: np.ndarray
    found: np.ndarray  # table of the sets of a branch
    step: np.ndarray  # (n,) where its own part of `following` begins
    following: np.ndarray  # for each set: for each branch, and for each pair, -1 where it cannot be


@leaf_kernel
def search(begin, end, graph, tree, sets):
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
            made = _lead(i, one, made, own, span, graph, tree, sets)
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
def _lead(i, one, made, own, span, graph, tree, sets):
    """Where the sets of a track lead in one of its branches; how many sets there are then."""
    mask, first, states = _mask(one, tree, sets), sets.first[i], sets.end[i] - sets.first[i]
    options, sets.first[one] = 1, made
    for a in own:
        options += tree.below[a] == one
    found = sets.found[: power_of_two(2 * states * options)]
    found[:] = -1
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
def power_of_two(n):
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
