"""The Gaussian-mixture cardinalised PHD filter, with any reduction (Vo, Vo and Cantoni 2007)."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gmr_gym.filters import cphd as cardinality
from gmr_gym.filters import phd
from gmr_gym.filters.phd import LabelledIntensity
from gmr_gym.filters.tracker import MultiTargetReport, check_scan
from gmr_gym.mixture import Mixture
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.reduction.registry import reduction_named


class CphdBelief(NamedTuple):
    """An intensity and a cardinality distribution.

    Attributes
    ----------
    targets : LabelledIntensity
    cardinality : ndarray, shape (N + 1,)
        Probability of each number of targets.
    """

    targets: LabelledIntensity
    cardinality: np.ndarray


@dataclass(frozen=True)
class GmCphd:
    """GM-CPHD filter: the GM-PHD filter with the distribution of the number of targets.

    The most probable number of targets is declared, from the heaviest components. The expected number in a
    report is the weight of the intensity: the mean of the distribution less what was pruned.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    reduce : callable
        Reduction of the intensity.
    prune_weight : float
        Components of less weight, an expected number of targets, are pruned.
    targets : int
        N, most targets; the cardinality distribution is truncated there and normalised.
    max_components : int
        Most components that enter `reduce`, the heaviest, to bound the memory of a huge scan.

    References
    ----------
    Vo, Vo and Cantoni 2007.
    """

    model: MultiTargetModel
    reduce: Callable[[Mixture], Reduced]
    prune_weight: float = 1e-5
    targets: int = 50
    max_components: int = 2000

    def __post_init__(self):
        phd.check_filter(self.model, self.reduce, self.prune_weight, self.max_components)
        if not self.targets >= 1 or self.targets != int(self.targets):
            raise ValueError(f"targets must be a whole number, at least 1, got {self.targets}")

    def init(self) -> CphdBelief:
        """Belief one period before the first scan."""
        return CphdBelief(phd.no_targets(self.model), np.eye(1, self.targets + 1)[0])

    def step(self, belief: CphdBelief, z: np.ndarray) -> tuple[CphdBelief, MultiTargetReport]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        model = self.model
        z = check_scan(z, len(model.sensor.H))
        transition = cardinality.cardinality_transition(
            model.survival_probability,
            model.spawn_weight,
            float(model.births.w.sum()),
            len(belief.cardinality) - 1,
        )
        predicted = transition @ belief.cardinality
        posterior, number = cardinality.update(
            phd.predict(belief.targets, model), predicted / predicted.sum(), model.sensor, z,
            model.detection_probability, model.clutter.density(z), self.prune_weight,
        )  # fmt: skip
        kept = phd.reduce_intensity(posterior, self.reduce, self.max_components)
        labelled, report = phd.report(kept, model.clutter, int(number.argmax()))
        return CphdBelief(labelled, number), report


def gm_cphd(
    model: MultiTargetModel,
    components: int = 100,
    merging: float = 4.0,
    prune_weight: float = 1e-5,
    reduction: str = "vo-ma",
    targets: int = 50,
) -> GmCphd:
    """GM-CPHD filter of at most `targets` targets, reduced to `components`.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    components : int
        Most components after the reduction.
    merging : float
        U, squared Mahalanobis distance of Vo and Ma's merging; other reductions ignore it.
    prune_weight : float
        Components of less weight, an expected number of targets, are pruned.
    reduction : str
        "vo-ma", or a reduction of the single-target trackers such as "runnalls" or "adaptive".
    targets : int
        N, most targets; the cardinality distribution is truncated there and normalised.

    Returns
    -------
    GmCphd

    References
    ----------
    Vo, Vo and Cantoni 2007.
    """
    reduce = reduction_named(reduction, components, merging)
    return GmCphd(model, reduce, prune_weight, targets)
