"""The Gaussian-mixture PHD filter (Vo and Ma 2006), with any reduction of its mixture."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gmr_gym.filters import phd
from gmr_gym.filters.phd import LabelledIntensity
from gmr_gym.filters.tracker import MultiTargetReport, check_scan
from gmr_gym.mixture import Mixture
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.reduction.registry import reduction_named


@dataclass(frozen=True)
class GmPhd:
    """An intensity carried ahead with births and spawning, updated with the scan, pruned, then `reduce`;
    components of weight above 1/2 are named as targets (Vo and Ma 2006, Tables I-III)."""

    model: MultiTargetModel
    reduce: Callable[[Mixture], Reduced]
    prune_weight: float = 1e-5  # T, an expected number of targets
    max_components: int = 2000  # components that enter `reduce`, the heaviest, lest a huge scan fill memory

    def __post_init__(self):
        phd.check_filter(self.model, self.reduce, self.prune_weight, self.max_components)

    def init(self) -> LabelledIntensity:
        return phd.no_targets(self.model)

    def step(self, belief: LabelledIntensity, z: np.ndarray) -> tuple[LabelledIntensity, MultiTargetReport]:
        model = self.model
        z = check_scan(z, len(model.sensor.H))
        posterior, _ = phd.update(
            phd.predict(belief, model), model.sensor, z,
            model.detection_probability, model.clutter.density(z), self.prune_weight,
        )  # fmt: skip
        return phd.report(phd.reduce_intensity(posterior, self.reduce, self.max_components), model.clutter)


def gm_phd(
    model: MultiTargetModel,
    components: int = 100,
    merging: float = 4.0,
    prune_weight: float = 1e-5,
    reduction: str = "vo-ma",
) -> GmPhd:
    """GM-PHD filter reduced to `components`: by Vo and Ma's merging of what lies within the squared distance
    `merging` (U), or by any reduction that the single-target trackers take, such as "runnalls" or
    "adaptive", which do not heed `merging`."""
    return GmPhd(model, reduction_named(reduction, components, merging), prune_weight)
