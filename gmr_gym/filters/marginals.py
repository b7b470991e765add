r"""Marginal association probabilities of a scan: exact cluster by cluster, belief propagation beyond a size.

An association event assigns to each track one detection of its gate or none, and no detection to two tracks.
Its probability is proportional to the product of :math:`\psi_{ij}` over its pairs, the weight of the pair
relative to a missed track and an unassigned detection. Tracks that share detections, also through other
tracks, form a cluster; clusters are independent.
"""

import numpy as np

from gmr_gym.filters.belief_propagation import grouped, propagate
from gmr_gym.filters.intensity_update import log_sum
from gmr_gym.kernels import kernel, leaf_kernel

ASSOCIATIONS = ("exact", "belief-propagation")
MOST_STEPS = 100_000  # of one cluster, from set to set of detections; a cluster that takes more is propagated
BITS = 62  # detections that a set can hold
LEAST = 1e-200  # sum of the weights of all events, each track's greatest 1, below which logarithms are added


@kernel
def marginals(track, detection, log_psi, n, k):
    r"""Marginal association probabilities of n tracks and k detections.

    Returns those of each pair (e,), of a missed track (n,) and of an unassigned detection (k,), and for each
    track (n,) whether belief propagation approximated its cluster.

    log_psi (e,) is the log weight of the pair of track (e,) and detection (e,). No pair may occur twice.

    Notes
    -----
    Efficient hypothesis management (Maskell, Briers and Wright 2004) as dynamic programming: of the tracks
    that come before one in an order, only the set U of the detections matters that they use and that a later
    track may use. With :math:`\psi_{i0} = 1`

    .. math::

        \alpha_i(U') = \sum_{(U, j) \to U'} \alpha_{i-1}(U) \psi_{ij}, \qquad
        \beta_{i-1}(U) = \sum_{j \notin U} \psi_{ij} \beta_i(U'), \qquad
        \bar p_{ij} \propto \sum_{U \not\ni j} \alpha_{i-1}(U) \psi_{ij} \beta_i(U')

    All terms are positive. A detection of one track alone stands in no set.
    """
    e = len(track)
    by_track, first_track = grouped(track, n)
    by_detection, first_detection = grouped(detection, k)
    assigned, missed, unassigned = np.zeros(e), np.ones(n), np.ones(k)
    approximated = np.zeros(n, np.bool_)
    cluster = _clusters(track, by_detection, first_detection, n)
    members, first = grouped(cluster, n)
    pairs = by_track, first_track, detection, log_psi
    room, made = (np.empty(0, np.int64), np.empty(0), np.empty(0), np.empty(0, np.int64)), False
    left = np.zeros(e, np.bool_)
    for c in range(n):
        tracks = members[first[c] : first[c + 1]]
        if len(tracks) == 0 or first_track[tracks[0] + 1] == first_track[tracks[0]]:
            continue
        if len(tracks) > 1 and not made:
            room, made = (
                np.empty(MOST_STEPS + 1, np.int64), np.empty(MOST_STEPS + 1), np.empty(MOST_STEPS + 1),
                np.empty(MOST_STEPS + 1, np.int64),
            ), True  # fmt: skip
        if len(tracks) == 1:
            _alone(tracks[0], pairs, assigned, missed, unassigned)
            continue
        order, last = _ordered(tracks, pairs, first_detection)
        if not _enumerate(order, last, pairs, first_detection, room, (assigned, missed, unassigned)):
            for i in tracks:
                approximated[i] = True
                for b in range(first_track[i], first_track[i + 1]):
                    left[by_track[b]] = True
    if left.any():
        rest = np.flatnonzero(left)
        found, without, free = propagate(track[rest], detection[rest], log_psi[rest], n, k)
        for b in range(len(rest)):
            a = rest[b]
            assigned[a] = found[b]
            missed[track[a]], unassigned[detection[a]] = without[track[a]], free[detection[a]]
    return assigned, missed, unassigned, approximated


def clusters(track: np.ndarray, detection: np.ndarray, n: int, k: int) -> np.ndarray:
    """The lowest track (n,) of the cluster that each of n tracks is of, by its pairs with k detections."""
    return _clusters(track, *grouped(detection, k), n)


def clusters_of(chosen: np.ndarray, track: np.ndarray, detection: np.ndarray, k: int) -> int:
    """Number of clusters of the tracks that are `chosen` (n,)."""
    return len(np.unique(clusters(track, detection, len(chosen), k)[chosen])) if chosen.any() else 0


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
def _alone(i, pairs, assigned, missed, unassigned):
    """The marginals of a track whose detections no other track may have."""
    by_track, first_track, detection, log_psi = pairs
    own = by_track[first_track[i] : first_track[i + 1]]
    whole = 0.0
    for a in own:
        whole = log_sum(whole, log_psi[a])
    missed[i] = np.exp(-whole)
    for a in own:
        assigned[a] = np.exp(log_psi[a] - whole)
    for a in own:
        unassigned[detection[a]] = _without(a, own, assigned, missed[i])


@leaf_kernel
def _without(a, own, assigned, rest):
    """1 - assigned[a], of marginals that sum to 1 with `rest`, without cancellation."""
    if assigned[a] < 0.5:
        return 1.0 - assigned[a]
    for b in own:  # of one pair at most
        rest += assigned[b] if b != a else 0.0
    return rest


@kernel
def _ordered(tracks, pairs, first_detection):
    """The tracks of a cluster in an order that keeps few detections in sets, and the place (k,) in it of the
    last track of each detection. The next track is the one after which the fewest detections are open."""
    by_track, first_track, detection, _ = pairs
    k, count = len(first_detection) - 1, len(tracks)
    left, last = np.zeros(k, np.int64), np.full(k, -1)
    for i in tracks:
        for b in range(first_track[i], first_track[i + 1]):
            left[detection[by_track[b]]] += 1
    opened = left.copy()  # equal to `left` before the first track of a detection
    order, waiting = np.empty(count, np.int64), np.ones(count, np.bool_)
    for place in range(count):
        best, least = -1, 0
        for t in range(count):
            if not waiting[t]:
                continue
            change = 0
            for b in range(first_track[tracks[t]], first_track[tracks[t] + 1]):
                j = detection[by_track[b]]
                change += (opened[j] == left[j]) - (left[j] == 1)
            if best < 0 or change < least:
                best, least = t, change
        order[place], waiting[best] = tracks[best], False
        for b in range(first_track[tracks[best]], first_track[tracks[best] + 1]):
            j = detection[by_track[b]]
            left[j] -= 1
            last[j] = place
    return order, last


@kernel
def _enumerate(order, last, pairs, first_detection, room, marginal):
    """The marginals of the tracks of a cluster, written to `marginal`; False where that takes more than
    `MOST_STEPS`. Weights are relative to the greatest of each track; where all events are then too unlikely
    for a float, they are added once more as logarithms."""
    by_track, first_track, detection, _ = pairs
    count, sets, following = len(order), room[0], room[3]
    slot, taken = np.full(len(last), -1), 0
    layer, step = np.zeros(count + 2, np.int64), np.zeros(count + 1, np.int64)
    keep, found = np.empty(count, np.int64), np.full(64, -1)
    for t in range(count):
        for b in range(first_track[order[t]], first_track[order[t] + 1]):
            j = detection[by_track[b]]
            if first_detection[j + 1] - first_detection[j] > 1:
                if slot[j] < 0:
                    slot[j] = _unused(taken)
                    if slot[j] == BITS:
                        return False
                    taken |= 1 << slot[j]
        keep[t] = -1
        for b in range(first_track[order[t]], first_track[order[t] + 1]):
            j = detection[by_track[b]]
            if last[j] == t and slot[j] >= 0:
                keep[t] ^= 1 << slot[j]
        taken &= keep[t]
    sets[0], layer[1] = 0, 1
    for t in range(count):
        own = by_track[first_track[order[t]] : first_track[order[t] + 1]]
        steps = (layer[t + 1] - layer[t]) * (len(own) + 1)
        if step[t] + steps > MOST_STEPS:
            return False
        if 2 * steps > len(found):
            found = np.empty(4 * _power_of_two(steps), np.int64)
        found[:] = -1
        at, top = step[t], layer[t + 1]
        for s in range(layer[t], layer[t + 1]):
            following[at] = _place(sets[s] & keep[t], found, sets, top)
            top += following[at] == top
            for o in range(len(own)):
                following[at + o + 1] = -1
                bit = slot[detection[own[o]]]
                if bit >= 0 and not sets[s] & (1 << bit):
                    target = _place((sets[s] | (1 << bit)) & keep[t], found, sets, top)
                    following[at + o + 1] = target
                    top += target == top
            at += len(own) + 1
        layer[t + 2], step[t + 1] = top, at
    searched = slot, layer, step
    if not _sweep(order, last, pairs, searched, room, marginal, False):
        _sweep(order, last, pairs, searched, room, marginal, True)
    return True


@kernel
def _sweep(order, last, pairs, searched, room, marginal, logarithms):
    """Both sweeps over the sets that `_enumerate` found; False where the sum of all events is no float."""
    by_track, first_track, detection, log_psi = pairs
    (slot, layer, step), (_, forward, _, following) = searched, room
    count = len(order)
    free, top, w = np.zeros(count), np.zeros(count), np.empty(len(log_psi))
    for t in range(count):  # of no shared detection, the greatest, and each pair over it
        own = by_track[first_track[order[t]] : first_track[order[t] + 1]]
        for a in own:
            free[t] = log_sum(free[t], log_psi[a]) if slot[detection[a]] < 0 else free[t]
        top[t] = free[t]
        for a in own:
            top[t] = max(top[t], log_psi[a])
        free[t] = free[t] - top[t] if logarithms else np.exp(free[t] - top[t])
        for a in own:
            w[a] = log_psi[a] - top[t] if logarithms else np.exp(log_psi[a] - top[t])
    forward[: layer[count + 1]] = -np.inf if logarithms else 0.0
    forward[0] = 0.0 if logarithms else 1.0
    for t in range(count):
        own = by_track[first_track[order[t]] : first_track[order[t] + 1]]
        at = step[t]
        for s in range(layer[t], layer[t + 1]):
            for o in range(len(own) + 1):
                target = following[at + o]
                if target >= 0:
                    weight = w[own[o - 1]] if o else free[t]
                    if logarithms:
                        forward[target] = log_sum(forward[target], forward[s] + weight)
                    else:
                        forward[target] += forward[s] * weight
            at += len(own) + 1
    if not logarithms and not forward[layer[count]] > LEAST:
        return False
    _sweep_back(order, last, pairs, searched, room, marginal, (free, top, w), logarithms)
    return True


@kernel(inline="always")
def _sweep_back(order, last, pairs, searched, room, marginal, weights, logarithms):
    """The backward sweep, and the marginals from both."""
    by_track, first_track, detection, log_psi = pairs
    (slot, layer, step), (_, forward, backward, following) = searched, room
    (assigned, missed, unassigned), (free, top, w) = marginal, weights
    count = len(order)
    whole, backward[layer[count]] = forward[layer[count]], 0.0 if logarithms else 1.0
    for t in range(count - 1, -1, -1):
        own = by_track[first_track[order[t]] : first_track[order[t] + 1]]
        for a in own:
            assigned[a] = 0.0
            unassigned[detection[a]] = 0.0 if last[detection[a]] == t else unassigned[detection[a]]
        through, none, at = np.empty(len(own) + 1), 0.0, step[t]
        for s in range(layer[t], layer[t + 1]):
            backward[s] = -np.inf if logarithms else 0.0
            for o in range(len(own) + 1):
                target, through[o] = following[at + o], 0.0
                if target < 0:
                    continue
                weight = w[own[o - 1]] if o else free[t]
                if logarithms:
                    backward[s] = log_sum(backward[s], backward[target] + weight)
                    through[o] = np.exp(forward[s] + backward[target] + weight - whole)
                else:
                    backward[s] += backward[target] * weight
                    through[o] = forward[s] * backward[target] * weight / whole
            none += through[0]
            for c in range(1, len(own) + 1):
                assigned[own[c - 1]] += through[c]
                if last[detection[own[c - 1]]] == t and following[at + c] >= 0:  # of no later track
                    for o in range(len(own) + 1):
                        unassigned[detection[own[c - 1]]] += through[o] if o != c else 0.0
            at += len(own) + 1
        alone = top[t] + (free[t] if logarithms else np.log(free[t]))
        missed[order[t]] = none * np.exp(-alone)
        for a in own:
            if slot[detection[a]] < 0:
                assigned[a] = none * np.exp(log_psi[a] - alone)
        for a in own:
            if slot[detection[a]] < 0:
                unassigned[detection[a]] = _without(a, own, assigned, missed[order[t]])


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
