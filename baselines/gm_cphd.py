"""The Gaussian-mixture cardinalised PHD filter (Vo, Vo and Cantoni 2007), with any reduction."""

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
    """An intensity, and the probability of each number of targets."""

    targets: LabelledIntensity
    cardinality: np.ndarray  # (N + 1,)


@dataclass(frozen=True)
class GmCphd:
    """As the GM-PHD filter, with the distribution of the number of targets beside the intensity. As many
    targets are named as is most probable, from the heaviest components (Vo, Vo and Cantoni 2007).

    The expected number of an account is the intensity's weight: the mean of the distribution, less what was
    pruned."""

    model: MultiTargetModel
    reduce: Callable[[Mixture], Reduced]
    prune_weight: float = 1e-5  # an expected number of targets
    targets: int = 50  # N, the most there may be; beyond, the distribution is cut off and rescaled
    max_components: int = 2000  # components that enter `reduce`, the heaviest, lest a huge scan fill memory

    def __post_init__(self):
        phd.check_filter(self.model, self.reduce, self.prune_weight, self.max_components)
        if not self.targets >= 1 or self.targets != int(self.targets):
            raise ValueError(f"targets must be a whole number, at least 1, got {self.targets}")

    def init(self) -> CphdBelief:
        return CphdBelief(phd.no_targets(self.model), np.eye(1, self.targets + 1)[0])

    def step(self, belief: CphdBelief, z: np.ndarray) -> tuple[CphdBelief, MultiTargetReport]:
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
    """GM-CPHD filter of at most `targets` targets, reduced to `components`: by Vo and Ma's merging of what
    lies within the squared distance `merging` (U), or by any reduction that the single-target trackers
    take, such as "runnalls" or "adaptive", which do not heed `merging`."""
    reduce = reduction_named(reduction, components, merging)
    return GmCphd(model, reduce, prune_weight, targets)
