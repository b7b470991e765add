"""Track-oriented multiple hypotheses: a track is a tree of the histories of detections it may have.

Every leaf has a bank and an existence of its own (Kurien 1990; Williams 2015). The best leaves of all tracks
that share no detection decide what the tracks were some scans ago.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import LinearConstraint, milp
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from gmr_gym.filters.bernoulli_tracks import Bernoullis, Origins, concluded, judged
from gmr_gym.filters.imm_tracks import Banks
from gmr_gym.filters.pmb import LEAST_MISS
from gmr_gym.models.intervals import Modes
from gmr_gym.models.positions import Look
from gmr_gym.recorded.array_records import chosen, joined

SCANS = 4  # in whose detections the leaves of a track may differ
MOST = 16  # leaves of a track
MOST_CHOICES = 600  # leaves of a cluster of tracks, from which the likeliest hypothesis is chosen exactly
LEAST = -10.0  # log weight of a leaf relative to the heaviest of its track


class Leaves(NamedTuple):
    """L leaves of tracks.

    Attributes
    ----------
    banks : Banks
    existence : ndarray (L,)
        Probability that the target exists where its history is that of the leaf.
    log_weight : ndarray (L,)
        Up to a constant of the track.
    label : ndarray of int (L,)
        Of the track.
    history : ndarray of int (L, SCANS)
        Its detections in the last scans, the latest first; -1 for none.
    best : ndarray of bool (L,)
        Whether it is that of the likeliest hypothesis.
    """

    banks: Banks
    existence: np.ndarray
    log_weight: np.ndarray
    label: np.ndarray
    history: np.ndarray
    best: np.ndarray


def no_leaves(r: int, d: int) -> Leaves:
    """No leaf, of r motion models and d states."""
    none, count = np.empty(0), np.empty(0, np.int64)
    banks = Banks(np.empty((0, r)), np.empty((0, r, d)), np.empty((0, r, d, d)), none)
    return Leaves(banks, none, none, count, np.empty((0, SCANS), np.int64), np.empty(0, bool))


def grown(
    leaves: Leaves, targets: Any, modes: Modes, survival: float, look: Look, origins: Origins,
    looked: np.ndarray,
) -> tuple[Leaves, tuple]:  # fmt: skip
    """Leaves after a look, and the fields of `Associated`; the targets become their likeliest leaves, in
    place.

    Leaves of no target are dropped, and a target that has none is its own. looked (n,) is the probability
    that each is detected by this look.
    """
    leaves, tree = _of_targets(leaves, targets)
    leaves.existence[:] *= survival ** (look.time - leaves.banks.time)
    before = Bernoullis(leaves.banks, leaves.existence, targets.identity[tree], looked[tree])
    predicted, pairs, _ = judged(before, modes, look, origins)
    gated = _gated(tree[pairs[0]], pairs[1], len(looked))
    parent, history, log_weight, from_pair, safe = _children(leaves, tree, pairs, looked[tree])
    best = best_leaves(tree[parent], log_weight, history, safe)
    log_weight -= log_weight[best][tree[parent]]
    kept, p = _worth(tree[parent], log_weight, history, best)
    chosen_now = np.isin(kept, best)
    tree, parent, history, from_pair = tree[parent[kept]], parent[kept], history[kept], from_pair[kept]
    hit = np.flatnonzero(history[:, 0] >= 0)
    own = hit, history[hit, 0], np.zeros(len(hit)), pairs[3][from_pair[hit]]
    banks, existence = chosen(leaves.banks, parent), leaves.existence[parent]
    after = Bernoullis(banks, existence, targets.identity[tree], looked[tree])
    judgement = chosen(Banks(*predicted), parent), own
    missed = (history[:, 0] < 0).astype(float)
    _, _, _, nis = concluded(after, modes, look, judgement, (np.ones(len(hit)), missed))
    leaves = Leaves(banks, existence, log_weight[kept], leaves.label[parent], history, chosen_now)
    return leaves, _shown(leaves, targets, (tree, p, nis), gated, len(look.at))


def best_leaves(
    tree: np.ndarray, log_weight: np.ndarray, history: np.ndarray, safe: np.ndarray
) -> np.ndarray:
    """The leaf (n,) of each tree of the likeliest hypothesis: one of every tree, no detection in two.

    Clusters of trees with more than `MOST_CHOICES` leaves get a hypothesis that is good, not always the
    likeliest.

    Parameters
    ----------
    tree : ndarray of int (L,)
        From 0.
    log_weight : ndarray (L,)
    history : ndarray of int (L, h)
        Detections of h scans, -1 for none.
    safe : ndarray of int (n,)
        A leaf of each tree; no two of them share a detection.

    Returns
    -------
    ndarray of int (n,)
    """
    order = np.lexsort((-log_weight, tree))
    best = order[np.unique(tree[order], return_index=True)[1]]
    detection = _distinct(history)
    if not _twice(detection[best]):
        return best
    leaf, slot = np.nonzero(detection >= 0)
    used, n = detection[leaf, slot], len(best)
    size = n + detection.max() + 1
    links = csr_array((np.ones(len(leaf)), (tree[leaf], n + used)), (size, size))
    cluster = connected_components(links, directed=False)[1][:n]
    for c in np.unique(cluster):
        if _twice(detection[best[cluster == c]]):
            mine = np.flatnonzero(cluster[tree] == c)
            choose = _likeliest if len(mine) <= MOST_CHOICES else _likely
            _, of = np.unique(tree[mine], return_inverse=True)
            best[cluster == c] = mine[
                choose(of, log_weight[mine], detection[mine], np.flatnonzero(np.isin(mine, safe)))
            ]
    return best


def _likeliest(
    tree: np.ndarray, log_weight: np.ndarray, detection: np.ndarray, safe: np.ndarray
) -> np.ndarray:
    """As `best_leaves`, of a small cluster: an integer program. detection (L, h) has a number for each."""
    count = len(tree)
    one = csr_array((np.ones(count), (tree, np.arange(count))))
    leaf, slot = np.nonzero(detection >= 0)
    shared = csr_array((np.ones(len(leaf)), (detection[leaf, slot], leaf)), (detection.max() + 1, count))
    limits = [LinearConstraint(one, 1.0, 1.0), LinearConstraint(shared, ub=1.0)]
    found = milp(-log_weight, integrality=np.ones(count), bounds=(0, 1), constraints=limits)
    if found.x is None:
        return _likely(tree, log_weight, detection, safe)
    chosen_now = np.flatnonzero(found.x > 0.5)
    return chosen_now[np.argsort(tree[chosen_now])]


def _likely(tree: np.ndarray, log_weight: np.ndarray, detection: np.ndarray, safe: np.ndarray) -> np.ndarray:
    """As `best_leaves`, of a large cluster: leaves in place of the safe ones, those first that gain most,
    where they share no detection with what other trees have."""
    best = safe[np.argsort(tree[safe])]
    owner = np.full(detection.max() + 2, -1)  # the last is of no detection
    for leaf in best:
        owner[detection[leaf]] = tree[leaf]
    gain = log_weight - log_weight[best][tree]
    for leaf in np.argsort(-gain, kind="stable")[: (gain > 0).sum()]:
        i, own = tree[leaf], detection[leaf]
        owner[-1] = -1
        if log_weight[leaf] > log_weight[best[i]] and ((owner[own] < 0) | (owner[own] == i)).all():
            owner[detection[best[i]]] = -1
            owner[own], best[i] = i, leaf
    return best


def _of_targets(leaves: Leaves, targets: Any) -> tuple[Leaves, np.ndarray]:
    """The leaves of the targets, new ones for targets without, and the index of the target of each; those of
    targets that were changed since, or that exist in none, are dropped."""
    label, time = targets.lives.label, targets.banks.time
    n = len(label)
    own = Leaves(
        targets.banks, targets.existence, np.zeros(n), label, np.full((n, SCANS), -1), np.ones(n, bool)
    )
    at = np.searchsorted(label, leaves.label).clip(max=max(len(label) - 1, 0))
    same = (label[at] == leaves.label) & (time[at] == leaves.banks.time) if len(label) else at < 0
    same[same] = np.bincount(at[same], leaves.existence[same], n)[at[same]] > 0
    old = np.flatnonzero(same)
    new = np.flatnonzero(np.bincount(at[old], minlength=len(label)) == 0)
    return joined(chosen(leaves, old), chosen(own, new)), np.append(at[old], new)


def _gated(tree: np.ndarray, detection: np.ndarray, n: int) -> np.ndarray:
    """Number (n,) of the detections in the gates of each tree."""
    return np.bincount(np.unique(np.stack([tree, detection]), axis=1)[0], minlength=n)


def _children(leaves: Leaves, tree: np.ndarray, pairs: tuple, looked: np.ndarray) -> tuple:
    """Parents, histories and log weights of the leaves after the look, the pair of each, -1 for a miss, and
    for each tree its best leaf, missed. Of a tree these are the heaviest, `MOST` of them, and the last."""
    track, detection, log_psi, _ = pairs
    count, miss = len(looked), np.log(np.maximum(1.0 - leaves.existence * looked, LEAST_MISS))
    parent = np.append(np.arange(count), track)
    pair = np.append(np.full(count, -1), np.arange(len(track)))
    log_weight = (leaves.log_weight + miss)[parent] + np.append(np.zeros(count), log_psi)
    of = tree[parent]
    order = np.lexsort((-log_weight, of))
    rank = np.arange(len(order)) - np.searchsorted(of[order], of[order])
    likely = np.zeros(len(order), bool)
    likely[order[rank < MOST]] = True
    likely[:count] |= leaves.best
    likely &= log_weight > -np.inf  # a leaf in which the target does not exist has no detection
    kept = np.flatnonzero(likely)
    safe = np.flatnonzero((pair[kept] < 0) & leaves.best[parent[kept]])
    safe = safe[np.argsort(of[kept[safe]])]
    parent, pair = parent[kept], pair[kept]
    latest = np.append(detection, -1)[pair]
    return parent, np.column_stack([latest, leaves.history[parent, :-1]]), log_weight[kept], pair, safe


def _worth(
    tree: np.ndarray, log_weight: np.ndarray, history: np.ndarray, best: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The leaves that are kept, and their probabilities in their trees: nil for those that share a detection
    with the best of another tree."""
    detection = _distinct(history)
    owner = np.full(detection.max(initial=-1) + 2, -1)
    for leaf in best:
        owner[detection[leaf]] = tree[leaf]
    owner[-1] = -1  # of no detection
    other = owner[detection]
    apart = ((other < 0) | (other == tree[:, None])).all(axis=1)
    heaviest = np.full(len(best), -np.inf)
    np.maximum.at(heaviest, tree, log_weight)
    likely = (history[:, -1] == history[best, -1][tree]) & (log_weight >= heaviest[tree] + LEAST)
    order = np.lexsort((-log_weight, ~likely, tree))
    rank = np.arange(len(order)) - np.searchsorted(tree[order], tree[order])
    likely[order[rank >= MOST]] = False
    likely[best] = True
    kept = np.flatnonzero(likely)
    w = np.where(apart[kept], np.exp(log_weight[kept] - heaviest[tree[kept]]), 0.0)
    return kept, w / np.bincount(tree[kept], w)[tree[kept]]


def _shown(leaves: Leaves, targets: Any, of: tuple, gated: np.ndarray, k: int) -> tuple:
    """Each target becomes its likeliest leaf that exists, in place; the fields of `Associated`."""
    (tree, p, nis), latest, n = of, leaves.history[:, 0], len(gated)
    exists, hit = p * leaves.existence, latest >= 0
    order = np.lexsort((-exists, tree))
    shown = order[np.unique(tree[order], return_index=True)[1]]
    for whole, part in zip(targets.banks, leaves.banks, strict=True):
        whole[:] = part[shown]
    targets.existence[:] = np.minimum(np.bincount(tree, exists, n), 1.0)
    used = np.bincount(latest[hit], p[hit], k)
    same = hit & (latest == latest[shown][tree])
    found = np.bincount(tree[hit], p[hit], n)
    return (
        np.maximum(1.0 - used, 0.0),
        found,
        gated,
        latest[shown],
        np.bincount(tree[same], p[same], n),
        nis[shown],
    )


def _distinct(history: np.ndarray) -> np.ndarray:
    """A number for each detection of each scan, -1 for none."""
    scans = history.shape[1]
    return np.where(history < 0, -1, history * scans + np.arange(scans))


def _twice(detection: np.ndarray) -> bool:
    """Whether a number other than -1 is there twice."""
    found = detection[detection >= 0]
    return len(np.unique(found)) < len(found)
