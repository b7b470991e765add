"""Rules that associate the detections of a look with Bernoulli tracks, beside belief propagation.

A rule takes pairs of track (e,) and detection (e,), log weights (e,) relative to a missed track and a
detection of no track, the existence (n,) of tracks, their probability (n,) to be missed or not to exist, and
the number of detections. It returns the probabilities of pairs (e,), of missed tracks (n,) and of detections
of no track (k,), as `belief_propagation.propagate` does.
"""

from collections.abc import Callable

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import min_weight_full_bipartite_matching

from gmr_gym.filters.marginals import marginals

Rule = Callable[..., tuple[np.ndarray, np.ndarray, np.ndarray]]


def every_event(
    track: np.ndarray, detection: np.ndarray, log_psi: np.ndarray, existence: np.ndarray, miss: np.ndarray,
    k: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Joint integrated probabilistic data association (Musicki and Evans 2004): marginals over all events,
    exact in clusters up to a size."""
    return marginals(track, detection, log_psi, len(miss), k)[:3]


def best_event(
    track: np.ndarray, detection: np.ndarray, log_psi: np.ndarray, existence: np.ndarray, miss: np.ndarray,
    k: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    r"""Global nearest neighbour: the best assignment alone, with the existence of a score.

    Notes
    -----
    A track with a detection exists and is detected, or does not exist and the detection is of no track. With
    q its probability to be missed or not to exist, the second has the weight :math:`(1 - r) / q` beside
    :math:`\psi`; the logarithm of their sum is what the assignment maximises, and

    .. math:: p_{ij} = \frac{\psi_{ij}}{\psi_{ij} + (1 - r_i) / q_i}

    the probability of the first, whose odds are those of the sequential probability ratio test.
    """
    n, false = len(miss), (1.0 - existence) / miss
    value = np.logaddexp(log_psi, np.log(np.maximum(false, np.finfo(float).tiny))[track])
    assigned, missed, unassigned = np.zeros(len(track)), np.ones(n), np.ones(k)
    better = np.flatnonzero(value > 0)  # than a miss
    if len(better):
        # costs must differ from zero: one that all rows have alike changes nothing
        highest = value[better].max() + 1.0
        rows = np.append(track[better], np.arange(n))
        columns = np.append(detection[better], k + np.arange(n))
        costs = np.append(highest - value[better], np.full(n, highest))
        _, column = min_weight_full_bipartite_matching(csr_array((costs, (rows, columns)), (n, k + n)))
        taken = better[column[track[better]] == detection[better]]
        i, j = track[taken], detection[taken]
        assigned[taken] = np.exp(log_psi[taken] - value[taken])
        missed[i], unassigned[j] = 0.0, 1.0 - assigned[taken]
    return assigned, missed, unassigned


def intensity(
    track: np.ndarray, detection: np.ndarray, log_psi: np.ndarray, existence: np.ndarray, miss: np.ndarray,
    k: int,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    r"""Probability hypothesis density: tracks are components of an intensity, with their existences as
    weights, and compete for detections, but detections do not for tracks.

    Notes
    -----
    With :math:`w_{ij}` the weight of a pair relative to a detection of no track, detection j has the weight
    :math:`\sum_i w_{ij} / (1 + \sum_i w_{ij})`, and the label of its heaviest parent.

    Departs: of the Gaussians of a detection only that of the heaviest parent is kept, with the weight of all,
    and a label has one detection: the heaviest first. A detection that is left is of no track.
    """
    log_w = log_psi + np.log(miss)[track]
    top = np.zeros(k)
    np.maximum.at(top, detection, log_w)
    total = np.exp(-top)
    np.add.at(total, detection, np.exp(log_w - top[detection]))
    unassigned, assigned, free = np.ones(k), np.zeros(len(track)), np.ones(len(miss), bool)
    for a in np.lexsort((track, detection, -log_w)):
        i, j = track[a], detection[a]
        if free[i] and unassigned[j] == 1.0:
            unassigned[j] = np.exp(-top[j]) / total[j]
            free[i], assigned[a] = False, 1.0 - unassigned[j]
    return assigned, miss, unassigned


RULES: dict[str, Rule] = {"pda": every_event, "gnn": best_event, "phd": intensity}
