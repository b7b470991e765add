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
    """

    banks: Banks
    existence: np.ndarray
    log_weight: np.ndarray
    label: np.ndarray
    history: np.ndarray


def no_leaves(r: int, d: int) -> Leaves:
    """No leaf, of r motion models and d states."""
    none, count = np.empty(0), np.empty(0, np.int64)
    banks = Banks(np.empty((0, r)), np.empty((0, r, d)), np.empty((0, r, d, d)), none)
    return Leaves(banks, none, none, count, np.empty((0, SCANS), np.int64))


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
    parent, history, log_weight = _children(leaves, pairs, looked[tree])
    best = best_leaves(tree[parent], log_weight, history)
    log_weight -= log_weight[best][tree[parent]]
    kept, p = _worth(tree[parent], log_weight, history, best)
    from_pair = kept - len(tree)
    tree, parent, history = tree[parent[kept]], parent[kept], history[kept]
    hit = np.flatnonzero(history[:, 0] >= 0)
    own = hit, history[hit, 0], np.zeros(len(hit)), pairs[3][from_pair[hit]]
    banks, existence = chosen(leaves.banks, parent), leaves.existence[parent]
    after = Bernoullis(banks, existence, targets.identity[tree], looked[tree])
    judgement = chosen(Banks(*predicted), parent), own
    missed = (history[:, 0] < 0).astype(float)
    _, _, _, nis = concluded(after, modes, look, judgement, (np.ones(len(hit)), missed))
    leaves = Leaves(banks, existence, log_weight[kept], leaves.label[parent], history)
    return leaves, _shown(leaves, targets, (tree, p, nis), gated, len(look.at))


def best_leaves(tree: np.ndarray, log_weight: np.ndarray, history: np.ndarray) -> np.ndarray:
    """The leaf (n,) of each tree of the likeliest hypothesis: one of every tree, no detection in two.

    Parameters
    ----------
    tree : ndarray of int (L,)
        From 0, each with a leaf that shares no detection with the trees that it can conflict with.
    log_weight : ndarray (L,)
    history : ndarray of int (L, h)
        Detections of h scans, -1 for none.

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
            one = csr_array((np.ones(len(mine)), (tree[mine], np.arange(len(mine)))), (n, len(mine)))
            rows, columns = np.nonzero(detection[mine] >= 0)
            shared = (np.ones(len(rows)), (detection[mine[rows], columns], rows))
            limits = [
                LinearConstraint(one, cluster == c, cluster == c),
                LinearConstraint(csr_array(shared, (size - n, len(mine))), ub=1.0),
            ]
            found = milp(-log_weight[mine], integrality=np.ones(len(mine)), bounds=(0, 1), constraints=limits)
            chosen = mine[found.x > 0.5]
            best[tree[chosen]] = chosen
    return best


def _of_targets(leaves: Leaves, targets: Any) -> tuple[Leaves, np.ndarray]:
    """The leaves of the targets, new ones for targets without, and the index of the target of each; those of
    targets that were changed since are dropped."""
    label, time = targets.lives.label, targets.banks.time
    own = Leaves(
        targets.banks, targets.existence, np.zeros(len(label)), label, np.full((len(label), SCANS), -1)
    )
    at = np.searchsorted(label, leaves.label).clip(max=max(len(label) - 1, 0))
    same = (label[at] == leaves.label) & (time[at] == leaves.banks.time) if len(label) else at < 0
    old = np.flatnonzero(same)
    new = np.flatnonzero(np.bincount(at[old], minlength=len(label)) == 0)
    return joined(chosen(leaves, old), chosen(own, new)), np.append(at[old], new)


def _gated(tree: np.ndarray, detection: np.ndarray, n: int) -> np.ndarray:
    """Number (n,) of the detections in the gates of each tree."""
    return np.bincount(np.unique(np.stack([tree, detection]), axis=1)[0], minlength=n)


def _children(leaves: Leaves, pairs: tuple, looked: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parents, histories and log weights of all leaves after the look: missed ones, then one of each pair."""
    track, detection, log_psi, _ = pairs
    count, miss = len(looked), np.log(np.maximum(1.0 - leaves.existence * looked, LEAST_MISS))
    parent = np.append(np.arange(count), track)
    latest = np.append(np.full(count, -1), detection)
    history = np.column_stack([latest, leaves.history[parent, :-1]])
    return parent, history, (leaves.log_weight + miss)[parent] + np.append(np.zeros(count), log_psi)


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
