"""What became of every hypothesis of a scan: on demand, for drawings and checks; `step` stays as fast as it
is."""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np

from gmr_gym.checks import UNLIMITED
from gmr_gym.filters.association import Expansion
from gmr_gym.filters.tracker import Report
from gmr_gym.mixture import Mixture, rescaled
from gmr_gym.reduction.protocol import Reduced, through
from gmr_gym.reduction.pruning import entering, leaving
from gmr_gym.reduction.runnalls import Greedy, merge_by_cost


class Trace(NamedTuple):
    """The hypotheses of a scan before anything was pruned or merged, and what became of each.

    Attributes
    ----------
    full : Mixture
        N hypotheses; weights sum to 1.
    parent : ndarray of int, shape (N,)
        Row of the `report.mixture` of the scan before that each came from, at the first scan of the mixture
        that the tracker starts with; -1 where it came from no single one.
    detection : ndarray of int, shape (N,)
        Row of the scan that each was updated with, -1 for a missed detection.
    into : ndarray of int, shape (N,)
        Row of `report.mixture` that each went into, -1 where it was pruned.
    mode : ndarray of int, shape (N,)
        Motion model that each was predicted by, 0 where there is one.
    """

    full: Mixture
    parent: np.ndarray
    detection: np.ndarray
    into: np.ndarray
    mode: np.ndarray


@runtime_checkable
class Tracing(Protocol):
    """A tracker that says on demand what became of every hypothesis; its `step` is that of `Tracker`."""

    def trace(self, belief: Any, z: np.ndarray) -> tuple[Any, Report, Trace]:
        """Do as `step`, and keep the hypotheses before the reduction.

        Parameters
        ----------
        belief
            Belief after the last scan.
        z : ndarray, shape (k, p)
            Detections.

        Returns
        -------
        belief
            Belief after the scan, that of `step` to the last bit.
        report : Report
            That of `step` to the last bit.
        trace : Trace
        """


def trace_of(posterior: Expansion, into: np.ndarray) -> Trace:
    """The Trace of a full posterior under one motion model whose hypotheses went `into` (N,)."""
    full, parent, detection, _ = posterior
    return Trace(full, parent, detection, into, np.zeros(len(parent), np.int64))


def rows_of_scan(detection: np.ndarray, near: np.ndarray) -> np.ndarray:
    """Rows of the scan of detections (N,) that are counted among the `near` ones (k,) alone; -1 stays."""
    return np.append(np.flatnonzero(near), -1)[detection]


def origin_of_reduction(
    posterior: Mixture,
    reduce: Callable[[Mixture], Reduced],
    prune_weight: float,
    density: float,
    max_hypotheses: int,
    most: int = UNLIMITED,
) -> np.ndarray:
    """Where every hypothesis goes in `gmr_gym.filters.mht.prune_and_reduce`.

    Parameters
    ----------
    posterior : Mixture
        Full posterior, N hypotheses.
    reduce : callable
        A reduction of a Mixture.
    prune_weight, density : float
        gamma and gamma~.
    max_hypotheses : int
        Most hypotheses that enter `reduce`.
    most : int
        Most that are left after all of it, the heaviest.

    Returns
    -------
    ndarray of int, shape (N,)
        Row of the reduced mixture that each went into, -1 where it was pruned.
    """
    entered, place = entering(posterior, prune_weight, max_hypotheses)
    entered = entered._replace(w=rescaled(entered.w))
    if isinstance(reduce, Greedy):  # without the checks of a call, as in a scan
        *merged, origin = merge_by_cost(*entered, reduce.components, reduce.loss_bound)
        reduced = Mixture(*merged)
    else:
        reduced, origin = reduce(entered)
    dense, left = leaving(reduced._replace(w=rescaled(reduced.w)), density)
    _, kept = entering(dense._replace(w=rescaled(dense.w)), 0.0, most)
    return through(through(through(place, origin), left), kept)
