"""The Gaussian-mixture cardinalised PHD filter, with any reduction (Vo, Vo and Cantoni 2007)."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gmr_gym.filters import cphd
from gmr_gym.filters.gm_phd import GmPhd
from gmr_gym.filters.phd import LabelledIntensity, predict
from gmr_gym.filters.tracker import MultiTargetReport, check_scan
from gmr_gym.models.multi_target import MultiTargetModel
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
    phd : GmPhd
        Filter whose model, pruning and reduction are used.
    targets : int
        N, most targets; the cardinality distribution is truncated there and normalised.

    References
    ----------
    Vo, Vo and Cantoni 2007.
    """

    phd: GmPhd
    targets: int = 50

    def __post_init__(self):
        if not self.targets >= 1 or self.targets != int(self.targets):
            raise ValueError(f"targets must be a whole number, at least 1, got {self.targets}")

    @property
    def model(self) -> MultiTargetModel:
        """The filter model."""
        return self.phd.model

    def init(self) -> CphdBelief:
        """Belief one period before the first scan."""
        return CphdBelief(self.phd.init(), cphd.poisson(float(self.model.initial.w.sum()), self.targets))

    def step(self, belief: CphdBelief, z: np.ndarray) -> tuple[CphdBelief, MultiTargetReport]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        model = self.model
        z = check_scan(z, len(model.sensor.H))
        transition = cphd.cardinality_transition(
            model.survival_probability,
            model.spawn_weight,
            float(model.births.w.sum()),
            len(belief.cardinality) - 1,
        )
        predicted = transition @ belief.cardinality
        posterior, number = cphd.update(
            predict(belief.targets, model), predicted / predicted.sum(), model.sensor, z,
            model.detection_probability, model.clutter.density(z), self.phd.prune_weight,
        )  # fmt: skip
        labelled, report = self.phd.report(posterior, model.clutter, int(number.argmax()))
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
    return GmCphd(GmPhd(model, reduction_named(reduction, components, merging), prune_weight), targets)
