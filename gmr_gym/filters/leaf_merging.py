"""Which leaves of a track are merged. A track is a number of hypotheses about one target, its leaves."""

from collections.abc import Callable

import numpy as np

from gmr_gym.mixture import Mixture, normalised
from gmr_gym.reduction.protocol import Reduced


def by_history(track: np.ndarray, history: np.ndarray) -> np.ndarray:
    """Groups (n,) of the leaves of one track that have had the same detections.

    Parameters
    ----------
    track : ndarray of int, shape (n,)
        Track of each leaf, ascending.
    history : ndarray of int, shape (n, s)
        Detections of each in some scans.
    """
    rows = np.column_stack([track, history])
    return np.unique(rows, axis=0, return_inverse=True)[1].reshape(-1)


def by_reduction(
    track: np.ndarray, leaves: Mixture, reduction: Callable[[Mixture], Reduced], components: int
) -> np.ndarray:
    """Groups (n,) of leaves by a reduction of the mixture of each track to `components`; -1 for those that it
    drops.

    Parameters
    ----------
    track : ndarray of int, shape (n,)
        Track of each leaf, ascending.
    leaves : Mixture
        Their weights are in proportion to their probabilities.
    reduction : callable
        From a Mixture to a Mixture and the origin of its components; not called for tracks of up to
        `components` leaves.
    components : int
    """
    group, count = np.empty(len(track), int), 0
    for own in np.split(np.arange(len(track)), np.flatnonzero(np.diff(track)) + 1) if len(track) else ():
        into = np.arange(len(own))
        if len(own) > components:
            into = reduction(normalised(Mixture(leaves.w[own], leaves.m[own], leaves.P[own])))[1]
        group[own] = np.where(into < 0, -1, count + into)
        count += into.max() + 1
    return group
