"""Track-oriented multiple hypothesis tracking with N-scan pruning (Kurien 1990; Blackman 2004)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gmr_gym.checks import check_count, check_limits, check_probability, check_whole
from gmr_gym.filters import track_oriented_mht as mht
from gmr_gym.filters import undetected_targets
from gmr_gym.filters.target_densities import outputs, take
from gmr_gym.filters.track_oriented_mht import Trees
from gmr_gym.filters.tracker import KnownClutterTracker, MultiTargetReport
from gmr_gym.mixture import Mixture, joined
from gmr_gym.models.clutter import Clutter
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.reduction.registry import reduction_named

WIDER = 10  # times as many leaves of a tree as are kept compete for the best hypothesis


@dataclass(frozen=True)
class Tomht(KnownClutterTracker):
    """Track-oriented MHT.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    scans, leaves : int
        Delay of decisions, and most leaves of a tree.
    prune_leaves, prune_existence, prune_weight : float
        What leaves, trees and undetected components are dropped by.
    trees : int
        Most trees, and most undetected components.
    confirm_score, report_threshold : float
        Score and probability of existence above which a target is declared.
    memory : int, optional
        Leaves of a tree that have had the same detections in so many scans are merged.
    components : int, optional
        Most leaves of a tree, after `reduction`.
    reduction : callable
        From a Mixture to a Mixture and the origin of its components.
    """

    model: MultiTargetModel
    scans: int
    leaves: int
    prune_leaves: float
    prune_existence: float
    prune_weight: float
    trees: int
    confirm_score: float
    report_threshold: float
    memory: int | None
    components: int | None
    reduction: Callable[[Mixture], Reduced]

    def init(self) -> Trees:
        """Belief one period before the first scan."""
        return mht.untracked(self.model, self.scans)

    def update(self, belief: Trees, z: np.ndarray, clutter: Clutter) -> tuple[Trees, np.ndarray]:
        """Trees after the scan `z` (k, p), and the probability (k,) that each is a false alarm."""
        model = self.model
        predicted, kappa = mht.predict(belief, model), clutter.density(z)
        trees, p_clutter = mht.grow(predicted, model, z, kappa, self.prune_leaves, WIDER * self.leaves)
        before = trees.detections - len(z)
        trees = mht.decided(trees, self.leaves, self.prune_leaves, self.prune_existence)
        newest, p_target = trees.history[trees.best, 0], 1.0 / (1.0 + np.exp(-trees.score[trees.best]))
        p_clutter[newest[newest >= before] - before] = 1.0 - p_target[newest >= before]
        if self.memory is not None:
            trees = mht.forgotten(trees, self.memory)
        if self.components is not None:
            trees = mht.reduced(trees, self.reduction, self.components)
        rest = undetected_targets.pruned(trees.undetected, self.prune_weight, self.trees)
        return mht.confirm(
            mht.fewer(trees, self.trees)._replace(undetected=rest), self.confirm_score
        ), p_clutter

    def report(self, posterior: Trees, clutter: Clutter) -> tuple[Trees, MultiTargetReport]:
        """The trees, unchanged, and the report of the best global hypothesis."""
        best = np.flatnonzero(posterior.best)
        existence = posterior.existence[best] / (1.0 + np.exp(-posterior.score[best]))
        leaves = Mixture(existence, *outputs(take(posterior.leaves, best)))
        tree, undetected = posterior.tree[best], posterior.undetected
        declared = np.flatnonzero(
            posterior.confirmed[tree] & (posterior.existence[best] > self.report_threshold)
        )
        declared = declared[np.argsort(-existence[declared], kind="stable")]
        targets = joined([leaves, Mixture(undetected.w, *outputs(undetected.densities))])
        return posterior, MultiTargetReport(
            leaves.m[declared], existence[declared], posterior.label[tree[declared]], float(targets.w.sum()),
            targets, clutter,
        )  # fmt: skip


def tomht(
    model: MultiTargetModel,
    scans: int = 5,
    leaves: int = 30,
    *,
    prune_leaves: float = 1e-4,
    prune_existence: float = 1e-3,
    prune_weight: float = 1e-5,
    trees: int = 1000,
    false_tracks: float = 0.01,
    lost_tracks: float = 0.01,
    report_threshold: float = 0.4,
    memory: int | None = None,
    components: int | None = None,
    reduction: str = "runnalls",
) -> Tomht:
    """Track-oriented MHT, with decisions on a scan `scans` scans later.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    scans : int
        N: scans that a decision is delayed; with 0 it is the best assignment of each scan.
    leaves : int
        Most leaves of a tree.
    prune_leaves : float
        Leaves less likely than the best of their tree by this factor are dropped.
    prune_existence : float
        Leaves whose target exists with less probability are dropped; less than `report_threshold`.
    prune_weight : float
        Undetected components of less weight, an expected number of targets, are dropped.
    trees : int
        Most trees, and most undetected components.
    false_tracks, lost_tracks : float
        Probabilities a and b of the sequential test, which confirms a tree of score above log((1 - b) / a).
    report_threshold : float
        Probability of existence above which the target of a confirmed tree is declared.
    memory : int, optional
        Leaves of a tree that have had the same detections in so many scans are merged; by default none are.
    components : int, optional
        Most leaves of a tree, after `reduction`; by default there is no limit but `leaves`.
    reduction : str
        A reduction of the single-target trackers, such as "runnalls" or "capping".

    Returns
    -------
    Tomht

    Raises
    ------
    ValueError
        Naming the parameter that is out of range.

    References
    ----------
    Kurien 1990; Blackman and Popoli 1999; Blackman 2004.
    """
    check_whole("scans", scans, 0)
    check_limits(prune_weight, trees)
    for name, value in (
        ("prune_leaves", prune_leaves), ("false_tracks", false_tracks), ("lost_tracks", lost_tracks),
        ("report_threshold", report_threshold),
    ):  # fmt: skip
        check_probability(name, value)
    if not 0 <= prune_existence < report_threshold:
        raise ValueError(
            f"prune_existence must be at least 0 and less than report_threshold {report_threshold}, got "
            f"{prune_existence}"
        )
    confirm_score = float(np.log1p(-lost_tracks) - np.log(false_tracks)) if lost_tracks < 1 else -np.inf
    return Tomht(
        model, int(scans), check_count(leaves, "leaves"), float(prune_leaves), float(prune_existence),
        float(prune_weight), check_count(trees, "trees"), confirm_score, float(report_threshold),
        None if memory is None else check_count(memory, "memory"),
        None if components is None else check_count(components),
        reduction_named(reduction, components or 1, 4.0),
    )  # fmt: skip
