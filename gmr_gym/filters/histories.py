"""Detections of the last scans, carried beside the hypotheses of a tracker that merges by them.

Where the reduction is no `gmr_gym.reduction.n_scan.NScan`, a history is None and beliefs are as they were.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.mixture import Mixture
from gmr_gym.reduction.n_scan import NScan, extended, inherited
from gmr_gym.reduction.protocol import Reduced


class WithHistory(NamedTuple):
    """A belief, and the detections of the last scans.

    Attributes
    ----------
    belief
        Belief of a tracker of n hypotheses.
    history : ndarray of int, shape (n, N)
        Detections of every hypothesis, the latest first: rows of their scans, -1 for a missed detection.
        Where a tracker has several mixtures, a tuple of one for each.
    """

    belief: Any
    history: Any


def at_start(reduce: Callable, hypotheses: int) -> np.ndarray | None:
    """Histories before the first scan of so many hypotheses."""
    return reduce.at_start(hypotheses) if isinstance(reduce, NScan) else None


def joined_belief(belief: Any, history: Any) -> Any:
    """The belief with its history, if there is one."""
    return belief if history is None else WithHistory(belief, history)


def parted_belief(belief: Any) -> tuple[Any, Any]:
    """The belief and its history."""
    return belief if isinstance(belief, WithHistory) else (belief, None)


def after_scan(history: Any, parent: np.ndarray, detection: np.ndarray, place: np.ndarray) -> Any:
    """Histories after a scan of the hypotheses that pruning left.

    Parameters
    ----------
    history : ndarray, shape (n, N), or None
        Histories before the scan.
    parent, detection : ndarray of int, shape (m,)
        Row of `history`, and of the scan, of every hypothesis before the pruning.
    place : ndarray of int, shape (m,)
        Row among what was left that each went into, -1 where it was pruned.

    Returns
    -------
    ndarray, shape (k, N), or None
    """
    return None if history is None else extended(history, parent, detection)[place >= 0]


def reduce_with(reduce: Callable[..., Reduced], p: Mixture, history: Any) -> tuple[Reduced, Any]:
    """The reduced mixture and its origin (n,), and the histories of the reduced hypotheses.

    Parameters
    ----------
    reduce : callable
        NScan, or a reduction of a Mixture.
    p : Mixture
        n hypotheses.
    history : ndarray, shape (n, N), or None
        Their histories.
    """
    if history is None:
        return reduce(p), None
    mixture, origin = reduce(p, history)
    return (mixture, origin), inherited(history, p.w, origin, len(mixture.w))
