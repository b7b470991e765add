"""Which targets a multi-Bernoulli mixture declares (Garcia-Fernandez et al. 2018, section VI)."""

from collections.abc import Callable

import numpy as np

from gmr_gym.filters.global_hypotheses import heaviest, leaf_weights
from gmr_gym.filters.multi_bernoulli_mixture import MultiBernoulliMixture, track_existence
from gmr_gym.kernels import kernel


def of_best_hypothesis(belief: MultiBernoulliMixture, threshold: float) -> np.ndarray:
    """Leaves of the most likely global hypothesis whose existence exceeds `threshold`."""
    first, leaf = belief.hypotheses.first, belief.hypotheses.leaf
    parts = [leaf[first[h] : first[h + 1]] for h in heaviest(belief.hypotheses)]
    leaves = np.concatenate([np.empty(0, np.int64), *parts])
    return leaves[belief.existence[leaves] > threshold]


def of_existing_tracks(belief: MultiBernoulliMixture, threshold: float) -> np.ndarray:
    """The most likely leaf of each track whose existence exceeds `threshold`."""
    weight = leaf_weights(belief.hypotheses, len(belief.track)) * belief.existence
    order = np.lexsort((-weight, belief.track))
    best = order[np.unique(belief.track[order], return_index=True)[1]]
    return best[track_existence(belief) > threshold]


def of_best_number(belief: MultiBernoulliMixture, threshold: float) -> np.ndarray:
    """Leaves of the most likely number of targets, of the hypothesis that is then most likely."""
    return _of_best_number(belief.hypotheses, belief.existence)


ESTIMATORS: dict[str, Callable[[MultiBernoulliMixture, float], np.ndarray]] = {
    "hypothesis": of_best_hypothesis,
    "cardinality": of_best_number,
    "marginal": of_existing_tracks,
}


@kernel
def _of_best_number(hypotheses, existence):
    """Leaves of the most likely number of targets. Clusters are independent: of numbers in clusters the
    probabilities are convolved, and the greatest log weights likewise with maxima in place of sums."""
    clusters = hypotheses.cluster[-1] + 1 if len(hypotheses.cluster) else 0
    begin = np.searchsorted(hypotheses.cluster, np.arange(clusters + 1))
    widest = np.zeros(clusters + 1, np.int64)  # most targets of the clusters before each
    for c in range(clusters):
        width = 0
        for h in range(begin[c], begin[c + 1]):
            width = max(width, hypotheses.first[h + 1] - hypotheses.first[h])
        widest[c + 1] = widest[c] + width
    most = widest[clusters]
    p, best = np.zeros(most + 1), np.full(most + 1, -np.inf)
    p[0], best[0] = 1.0, 0.0
    number, chosen = np.zeros((clusters, most + 1), np.int64), np.empty((clusters, most + 1), np.int64)
    for c in range(clusters):
        width = widest[c + 1] - widest[c]
        p_own, own, of = _numbers(hypotheses, existence, begin[c], begin[c + 1], width)
        p_sum, top = np.zeros(most + 1), np.full(most + 1, -np.inf)
        for i in range(widest[c] + 1):
            for j in range(width + 1):
                p_sum[i + j] += p[i] * p_own[j]
                if best[i] + own[j] > top[i + j]:
                    top[i + j], number[c, i + j], chosen[c, i + j] = best[i] + own[j], j, of[j]
        p, best = p_sum, top
    left = np.argmax(p)
    leaves, at = np.empty(left, np.int64), 0
    for c in range(clusters - 1, -1, -1):
        h, j = chosen[c, left], number[c, left]
        if j > 0:
            own = hypotheses.leaf[hypotheses.first[h] : hypotheses.first[h + 1]]
            leaves[at : at + j] = own[np.argsort(-existence[own], kind="mergesort")[:j]]
        at, left = at + j, left - j
    return leaves


@kernel
def _numbers(hypotheses, existence, start, stop, width):
    """Of one cluster the probability (width + 1,) of each number of targets, the greatest log weight with it,
    and the hypothesis that has it."""
    p, best = np.zeros(width + 1), np.full(width + 1, -np.inf)
    of = np.full(width + 1, start)
    for h in range(start, stop):
        own = existence[hypotheses.leaf[hypotheses.first[h] : hypotheses.first[h + 1]]]
        own = -np.sort(-own)
        p_own = np.zeros(width + 1)
        p_own[0] = np.exp(hypotheses.log_weight[h])
        for n in range(len(own) + 1):
            if n > 0:
                p_own[1 : n + 1] = (1.0 - own[n - 1]) * p_own[1 : n + 1] + own[n - 1] * p_own[:n]
                p_own[0] *= 1.0 - own[n - 1]
            # the n that are most likely exist
            log_w = hypotheses.log_weight[h] + np.log(own[:n]).sum() + np.log(1.0 - own[n:]).sum()
            if log_w > best[n]:
                best[n], of[n] = log_w, h
        p += p_own
    return p, best, of
