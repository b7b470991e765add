"""Trackers of many targets by multi-Bernoulli mixtures: what they keep and what they declare."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gmr_gym.checks import check_choice, check_count, check_limits, check_probability, check_whole
from gmr_gym.filters import multi_bernoulli_mixture as mixtures
from gmr_gym.filters.declared import ESTIMATORS
from gmr_gym.filters.global_hypotheses import Options, leaf_weights
from gmr_gym.filters.multi_bernoulli_mixture import MultiBernoulliMixture
from gmr_gym.filters.target_densities import outputs
from gmr_gym.filters.tracker import KnownClutterTracker, MultiTargetReport
from gmr_gym.mixture import Mixture, joined
from gmr_gym.models.clutter import Clutter
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.reduction.protocol import Reduced


@dataclass(frozen=True)
class MixtureTracker(KnownClutterTracker):
    """Tracker by a multi-Bernoulli mixture.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    hypotheses : int
        Most global hypotheses of a cluster.
    prune_hypotheses : float
        Global hypotheses of less probability are dropped.
    prune_existence : float
        Leaves of less existence are dropped; less than `report_threshold`.
    prune_weight : float
        Undetected components of less weight, an expected number of targets, are dropped.
    tracks : int
        Most tracks, and most undetected components.
    report_threshold : float
        Probability of existence above which a target is declared.
    estimator : {"hypothesis", "cardinality", "marginal"}
        Which targets are declared.
    memory : int, optional
        Leaves of a track that have had the same detections in so many scans are merged.
    components : int, optional
        Most leaves of a track, after `reduction`.
    reduction : callable, optional
        From a Mixture to a Mixture and the origin of its components.
    undetected : bool
        Whether born targets are a Poisson intensity; otherwise they are Bernoulli tracks.
    certain : bool
        Whether each hypothesis says of each target that it exists.
    samples : int
        Events drawn by Gibbs sampling for a cluster; 0 for those of most weight instead.
    seed : int
        Of the sampling.
    """

    model: MultiTargetModel
    hypotheses: int = 200
    prune_hypotheses: float = 1e-4
    prune_existence: float = 1e-5
    prune_weight: float = 1e-5
    tracks: int = 1000
    report_threshold: float = 0.4
    estimator: str = "hypothesis"
    memory: int | None = None
    components: int | None = None
    reduction: Callable[[Mixture], Reduced] | None = None
    undetected: bool = True
    certain: bool = False
    samples: int = 0
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("hypotheses", "tracks"):
            check_count(getattr(self, name), name)
        for name in ("samples", "seed"):
            check_whole(name, getattr(self, name), 0)
        check_limits(self.prune_weight, self.tracks)
        check_probability("report_threshold", self.report_threshold)
        check_choice("estimator", self.estimator, tuple(ESTIMATORS))
        if self.estimator == "marginal" and not self.undetected:
            # tracks born alike are exchangeable: the most likely leaves of all of them are of one target
            raise ValueError(
                "estimator must be 'hypothesis' or 'cardinality' where tracks begin with births, got "
                "'marginal'"
            )
        for name in ("memory", "components"):
            if getattr(self, name) is not None:
                check_count(getattr(self, name), name)
        for name, below in (("prune_existence", self.report_threshold), ("prune_hypotheses", 1.0)):
            if not 0 <= getattr(self, name) < below:
                raise ValueError(
                    f"{name} must be at least 0 and less than {below:g}, got {getattr(self, name)}"
                )

    def init(self) -> MultiBernoulliMixture:
        """Belief one period before the first scan."""
        return mixtures.untracked(self.model, int(self.memory or 0))

    def update(
        self, belief: MultiBernoulliMixture, z: np.ndarray, clutter: Clutter
    ) -> tuple[MultiBernoulliMixture, np.ndarray]:
        """Belief after the scan `z` (k, p), pruned, and the probability (k,) that each is a false alarm."""
        options = Options(int(self.hypotheses), float(self.prune_hypotheses), int(self.samples))
        belief, p_clutter = mixtures.update(
            mixtures.predict(belief, self.model, self.undetected), self.model, z, clutter.density(z), options,
            np.random.default_rng((int(self.seed), belief.scans)), self.prune_existence, self.certain,
        )  # fmt: skip
        belief = mixtures.prune(belief, self.prune_weight, int(self.tracks))
        if self.memory is not None:
            belief = mixtures.forgotten(belief)
        if self.reduction is not None and self.components is not None:
            belief = mixtures.reduced(belief, self.reduction, int(self.components))
        return belief, p_clutter

    def report(
        self, posterior: MultiBernoulliMixture, clutter: Clutter
    ) -> tuple[MultiBernoulliMixture, MultiTargetReport]:
        """The belief, unchanged, and its report."""
        leaf = ESTIMATORS[self.estimator](posterior, self.report_threshold)
        held = leaf_weights(posterior.hypotheses, len(posterior.track))
        existence = mixtures.track_existence(posterior)[posterior.track[leaf]]
        order = np.argsort(-existence, kind="stable")
        leaf, existence = leaf[order], existence[order]
        leaves = Mixture(held * posterior.existence, *outputs(posterior.leaves))
        undetected = Mixture(posterior.undetected.w, *outputs(posterior.undetected.densities))
        everything = joined([leaves, undetected])
        label = posterior.label[posterior.track[leaf]]
        return posterior, MultiTargetReport(
            leaves.m[leaf], existence, label, float(everything.w.sum()), everything, clutter
        )
