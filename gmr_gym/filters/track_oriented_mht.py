r"""Track-oriented multiple hypothesis tracking of many targets (Kurien 1990; Blackman 2004).

A tree begins with a detection; each of its leaves is a history of detections, with a score. The best global
hypothesis has at most one leaf of each tree and no detection twice; it decides what happened N scans before.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.optimize import Bounds, LinearConstraint, linprog, milp
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from gmr_gym.filters import undetected_targets
from gmr_gym.filters.intensity_update import LOG_NEGLIGIBLE
from gmr_gym.filters.leaf_merging import by_history, by_reduction
from gmr_gym.filters.pmb import LEAST_MISS
from gmr_gym.filters.target_densities import Densities, joined, merge, moved, outputs, pair, posteriors, take
from gmr_gym.filters.undetected_targets import Intensity, begun
from gmr_gym.mixture import Mixture
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.reduction.protocol import Reduced

MOST_LEAVES = 2000  # that compete for the best hypothesis of a cluster, the same number of each tree,
MOST_INTEGERS = 300  # and where that takes integer programming
MOST_NODES = 1000  # of its search


class Trees(NamedTuple):
    """Leaves of trees, and the intensity of undetected targets.

    Attributes
    ----------
    tree : ndarray of int, shape (L,)
        Tree of each leaf, ascending.
    score : ndarray, shape (L,)
        log of the probability that the detections of the leaf are of one target, over that of false alarms.
    existence : ndarray, shape (L,)
        Probability that this target exists still.
    leaves : Densities
    history : ndarray of int, shape (L, N + 1)
        Numbers of the detections that it had in the last scans, newest first; -1 for none.
    best : ndarray of bool, shape (L,)
        Whether the best global hypothesis has it.
    label : ndarray of int, shape (n,)
        Distinct labels of the trees.
    confirmed : ndarray of bool, shape (n,)
    undetected : Intensity
    next_label, detections : int
        Next unused label, and number of detections so far.
    """

    tree: np.ndarray
    score: np.ndarray
    existence: np.ndarray
    leaves: Densities
    history: np.ndarray
    best: np.ndarray
    label: np.ndarray
    confirmed: np.ndarray
    undetected: Intensity
    next_label: int = 0
    detections: int = 0


def untracked(model: MultiTargetModel, delay: int) -> Trees:
    """The belief before the first scan: no trees; decisions are taken `delay` scans later."""
    undetected, none = undetected_targets.intensity_of(model.initial, model), np.empty(0, int)
    return Trees(
        none, np.empty(0), np.empty(0), take(undetected.densities, none), np.empty((0, delay + 1), int),
        np.empty(0, bool), none, np.empty(0, bool), undetected,
    )  # fmt: skip


def predict(trees: Trees, model: MultiTargetModel) -> Trees:
    """Predict leaves and undetected targets by one period."""
    leaves = moved(trees.leaves, model)
    return trees._replace(
        existence=model.survival_probability * trees.existence, leaves=leaves,
        undetected=undetected_targets.predict(trees.undetected, model, leaves, trees.best * trees.existence),
    )  # fmt: skip


def grow(
    predicted: Trees, model: MultiTargetModel, z: np.ndarray, kappa: np.ndarray, ratio: float, most: int
) -> tuple[Trees, np.ndarray]:
    r"""A leaf for every leaf with a miss and with each detection of its gate, and a tree for every detection.

    Parameters
    ----------
    predicted : Trees
    model : MultiTargetModel
    z : ndarray, shape (k, p)
        Detections.
    kappa : ndarray, shape (k,)
        Intensity of clutter at the detections.
    ratio : float
        Leaves less likely than that with a miss by this factor are not grown.
    most : int
        Most leaves of a tree, by score.

    Returns
    -------
    trees : Trees
    p_clutter : ndarray, shape (k,)
        Probability that a detection is a false alarm, if it is of no tree.

    Notes
    -----
    A leaf of existence r and score L has the scores

    .. math:: L + \ln(1 - r P_D), \qquad L + \ln \frac{r P_D \, g_j}{\kappa_j}

    with a miss, after which it exists with probability :math:`r (1 - P_D) / (1 - r P_D)`, and with detection
    j. A tree begins with the score :math:`\ln(\rho_j / \kappa_j)`, where :math:`\rho_j` is the intensity of
    detections of undetected targets.

    Departs: a leaf may end unseen, by r; the papers delete trees by their score alone.

    References
    ----------
    Blackman and Popoli 1999, chapters 6 and 16.
    """
    log_kappa = np.log(kappa)
    new = begun(predicted.undetected, model, z, log_kappa, 0.0)
    r, p_detected = predicted.existence, model.detected(outputs(predicted.leaves)[0])
    miss = np.maximum(1.0 - r * p_detected, LEAST_MISS)
    with np.errstate(divide="ignore"):
        negligible = max(float(np.log(ratio)), LOG_NEGLIGIBLE)
    hit = r * p_detected / miss
    pairs = pair(predicted.leaves, model.sensor, z, log_kappa, hit, negligible)
    row, first, n = pairs.row, new.detection, len(new.detection)
    missed = predicted.score + np.log(miss)
    started = np.log(new.existence[first]) + (new.log_free - log_kappa)[first]
    gain = pairs.log_likelihood + np.log(hit[row]) - log_kappa[pairs.detection]
    tree = np.concatenate([predicted.tree, predicted.tree[row], len(predicted.label) + np.arange(n)])
    score = np.concatenate([missed, missed[row] + gain, started])
    exists = np.concatenate([r * (1.0 - p_detected) / miss, np.ones(len(row) + n)])
    older = predicted.history[:, :-1]
    history = np.vstack([older, older[row], np.full((n, older.shape[1]), -1)])
    had = np.concatenate([np.full(len(r), -1), predicted.detections + np.append(pairs.detection, first)])
    code = np.flatnonzero(_ranks(tree, score) < most)
    old, hits, new_ones = np.split(code, np.searchsorted(code, [len(r), len(r) + len(row)]))
    leaves = joined([
        take(predicted.leaves, old), posteriors(predicted.leaves, pairs, hits - len(r)),
        take(new.densities, new_ones - len(r) - len(row)),
    ])  # fmt: skip
    order = np.argsort(tree[code], kind="stable")
    code = code[order]
    return predicted._replace(
        tree=tree[code], score=score[code], existence=exists[code], leaves=take(leaves, order),
        history=np.column_stack([had, history])[code], best=np.zeros(len(code), bool),
        label=np.append(predicted.label, predicted.next_label + np.arange(n)),
        confirmed=np.append(predicted.confirmed, np.zeros(n, bool)),
        undetected=undetected_targets.missed(predicted.undetected, model),
        next_label=predicted.next_label + n, detections=predicted.detections + len(z),
    ), np.exp(log_kappa - new.log_free)  # fmt: skip


def kept(trees: Trees, chosen: np.ndarray) -> Trees:
    """The leaves that are chosen (L,), and their trees."""
    which, tree = np.unique(trees.tree[chosen], return_inverse=True)
    return trees._replace(
        tree=tree.reshape(-1), score=trees.score[chosen], existence=trees.existence[chosen],
        leaves=take(trees.leaves, chosen), history=trees.history[chosen], best=trees.best[chosen],
        label=trees.label[which], confirmed=trees.confirmed[which],
    )  # fmt: skip


def limited(trees: Trees, value: np.ndarray, leaves: int, ratio: float) -> Trees:
    """The `leaves` best leaves of each tree by `value` (L,), without those that are less likely than its best
    by the factor `ratio`; the leaves of the best global hypothesis stay."""
    order = np.lexsort((-value, ~trees.best, trees.tree))
    tree = trees.tree[order]
    first = np.searchsorted(tree, tree)
    with np.errstate(divide="ignore"):
        good = value[order] >= value[order][first] + np.log(ratio)
    return kept(trees, np.sort(order[good & (np.arange(len(tree)) - first < leaves)]))


def fewer(trees: Trees, most: int) -> Trees:
    """The `most` trees whose best leaves are likeliest to be of a target that exists."""
    if len(trees.label) <= most:
        return trees
    likely = np.full(len(trees.label), -np.inf)
    np.maximum.at(likely, trees.tree, trees.score + np.log(trees.existence))
    chosen = np.zeros(len(likely), bool)
    chosen[np.argsort(-likely, kind="stable")[:most]] = True
    return kept(trees, chosen[trees.tree])


def confirm(trees: Trees, score: float) -> Trees:
    """Trees of the best global hypothesis of a greater score are confirmed, for good."""
    confirmed = trees.confirmed.copy()
    confirmed[trees.tree[trees.best & (trees.score > score)]] = True
    return trees._replace(confirmed=confirmed)


def decided(trees: Trees, leaves: int, ratio: float, least: float) -> Trees:
    """The trees with their best global hypothesis, and without the leaves that contradict it where the
    history ends: in its trees those of another past, in other trees those with a detection of its own.

    Each tree keeps as many `leaves` as are best for all trees together, by their scores less the prices of
    their detections, those less likely than the best by the factor `ratio` and of less existence than `least`
    excepted.
    """
    trees = kept(trees, trees.existence >= least)
    best, price = best_hypothesis(trees.tree, trees.score, trees.history)
    oldest, own = trees.history[:, -1], np.full(len(trees.label), -2)
    own[trees.tree[best]] = oldest[best]
    taken = (oldest >= 0) & np.isin(oldest, oldest[best])
    own = own[trees.tree]
    agrees = np.where(own == -2, ~taken, oldest == own)
    return limited(kept(trees._replace(best=best), agrees), (trees.score - price)[agrees], leaves, ratio)


def best_hypothesis(
    tree: np.ndarray, score: np.ndarray, history: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    r"""The leaves of greatest summed score: of a tree at most one, and no detection twice.

    Parameters
    ----------
    tree : ndarray of int, shape (L,)
        Tree of each leaf, ascending.
    score : ndarray, shape (L,)
    history : ndarray of int, shape (L, s)
        Detections of each, -1 for none.

    Returns
    -------
    best : ndarray of bool, shape (L,)
    price : ndarray, shape (L,)
        What the detections of each are worth to other trees, summed.

    Notes
    -----
    Where the best leaves of all trees of a cluster share no detection they are the best hypothesis. Of the
    other clusters it is an integer linear program,

    .. math:: \max_x s^T x, \qquad x_l \in \{0, 1\}, \qquad
        \sum_{l \in \text{tree}} x_l \le 1, \qquad \sum_{l \ni j} x_l \le 1

    whose solution without the integers mostly has them; its dual variables are the prices.

    References
    ----------
    Poore 1994; Coraluppi and Carthel 2018.
    """
    best, price = np.zeros(len(tree), bool), np.zeros(len(tree))
    order = np.lexsort((-score, tree))
    order = order[score[order] > 0]  # a leaf below a false alarm is in no best hypothesis
    best[order[np.unique(tree[order], return_index=True)[1]]] = True
    leaf, scan = np.nonzero(history >= 0)
    leaf, scan = leaf[score[leaf] > 0], scan[score[leaf] > 0]
    number, detection = np.unique(history[leaf, scan], return_inverse=True)
    twice = np.bincount(detection.reshape(-1)[best[leaf]], minlength=len(number)) > 1
    if not twice.any():
        return best, price
    count = tree.max() + 1
    edges = tree[leaf], count + detection.reshape(-1)
    size = count + len(number)
    cluster = connected_components(csr_array((np.ones(len(leaf)), edges), (size, size)), directed=False)[1]
    for c in np.unique(cluster[count:][twice]):
        own = np.flatnonzero((cluster[tree] == c) & (score > 0))
        best[own], price[own] = _solved(tree[own], score[own], history[own])
    return best, price


def _solved(tree: np.ndarray, score: np.ndarray, history: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`best_hypothesis` of one cluster, by linear and where that has fractions by integer programming."""
    leaf, scan = np.nonzero(history >= 0)
    detection = np.unique(history[leaf, scan], return_inverse=True)[1].reshape(-1)
    group = np.unique(tree, return_inverse=True)[1].reshape(-1)
    trees = group.max() + 1
    rows, columns = np.append(group, trees + detection), np.append(np.arange(len(tree)), leaf)
    A = csr_array((np.ones(len(rows)), (rows, columns)))
    few = _ranks(group, score) < max(1, MOST_LEAVES // trees)
    found = linprog(-score[few], A[:, few], np.ones(A.shape[0]), bounds=(0, 1), method="highs")
    price, best = A[trees:].T @ -found.ineqlin.marginals[trees:], np.zeros(len(tree), bool)
    best[few] = found.x > 0.5  # halves are of neither
    if (np.abs(found.x - np.round(found.x)) < 1e-6).all():
        return best, price
    few &= _ranks(group, np.where(few, score - price, -np.inf)) < max(1, MOST_INTEGERS // trees)
    whole = milp(
        -score[few], integrality=np.ones(few.sum()), bounds=Bounds(0, 1),
        constraints=LinearConstraint(A[:, few], ub=1.0), options={"node_limit": MOST_NODES},
    )  # fmt: skip
    if whole.x is not None:
        best[:] = False
        best[few] = whole.x > 0.5
    return best, price


def _ranks(group: np.ndarray, score: np.ndarray) -> np.ndarray:
    """How many of its group have a greater score than each."""
    order = np.lexsort((-score, group))
    rank = np.empty(len(group), int)
    rank[order] = np.arange(len(group)) - np.searchsorted(group[order], group[order])
    return rank


def merged(trees: Trees, group: np.ndarray) -> Trees:
    """The trees with the leaves of each group (L,) merged; groups ascend with the trees, without gaps.

    A merged leaf has the history of that of the best global hypothesis, or else of the most likely one, and
    the sum of the probabilities, none of which counts more than its: those more likely contend with other
    trees.
    """
    count = group.max(initial=-1) + 1
    order = np.lexsort((-trees.score, ~trees.best, group))
    first = order[np.unique(group[order], return_index=True)[1]]
    share = np.exp(np.minimum(trees.score - trees.score[first][group], 0.0))
    total = np.bincount(group, share, count)
    weight = share * trees.existence
    return trees._replace(
        tree=trees.tree[first], score=trees.score[first] + np.log(total),
        existence=np.minimum(np.bincount(group, weight, count) / total, 1.0),
        leaves=merge(trees.leaves, weight, group, count), history=trees.history[first],
        best=np.bincount(group, trees.best, count) > 0,
    )  # fmt: skip


def forgotten(trees: Trees, memory: int) -> Trees:
    """The trees with leaves merged that had the same detections in the last `memory` scans."""
    group = by_history(trees.tree, trees.history[:, :memory])
    return trees if len(group) == group.max(initial=-1) + 1 else merged(trees, group)


def reduced(trees: Trees, reduction: Callable[[Mixture], Reduced], components: int) -> Trees:
    """The trees with their leaves, as a mixture, reduced; merged are those of one group of `reduction`."""
    number = np.bincount(trees.tree)
    if number.max(initial=0) <= components:
        return trees
    top = np.full(len(number), np.inf)
    top[trees.tree[trees.best]] = trees.score[trees.best]
    score = np.minimum(trees.score, top[trees.tree])
    top = np.maximum.reduceat(score, np.cumsum(number) - number)
    leaves = Mixture(np.exp(score - top[trees.tree]), *outputs(trees.leaves))
    group = by_reduction(trees.tree, leaves, reduction, components)
    return merged(kept(trees, group >= 0), group[group >= 0])
