"""A GM-PHD filter that learns the clutter it is in."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gmr_gym.filters import phd
from gmr_gym.filters.clutter_estimation import (
    ClutterEstimate,
    EstimatorOptions,
    initial_estimate,
    options,
    update_estimate,
)
from gmr_gym.filters.phd import LabelledIntensity
from gmr_gym.filters.tracker import MultiTargetReport, check_scan
from gmr_gym.mixture import Mixture
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.reduction.registry import reduction_named


class LearningPhdBelief(NamedTuple):
    """What is believed of the targets, and of the clutter."""

    targets: LabelledIntensity
    estimate: ClutterEstimate


@dataclass(frozen=True)
class LearningPhd:
    """A GM-PHD filter whose intensity of clutter is fitted to the scans so far, every detection counted by
    the probability that no target accounts for it. The scan is judged by what was learned before it."""

    model: MultiTargetModel
    reduce: Callable[[Mixture], Reduced]
    options: EstimatorOptions
    prune_weight: float = 1e-5  # an expected number of targets
    max_components: int = 2000  # components that enter `reduce`, the heaviest, lest a huge scan fill memory

    def __post_init__(self):
        phd.check_filter(self.model, self.reduce, self.prune_weight, self.max_components)

    def init(self) -> LearningPhdBelief:
        return LearningPhdBelief(phd.no_targets(self.model), initial_estimate(self.model.clutter))

    def step(self, belief: LearningPhdBelief, z: np.ndarray) -> tuple[LearningPhdBelief, MultiTargetReport]:
        model, estimate = self.model, belief.estimate
        z = check_scan(z, len(model.sensor.H))
        posterior, p_clutter = phd.update(
            phd.predict(belief.targets, model), model.sensor, z,
            model.detection_probability, estimate.clutter.density(z), self.prune_weight,
        )  # fmt: skip
        estimate = update_estimate(model.clutter, estimate, z, p_clutter, self.options)
        reduced = phd.reduce_intensity(posterior, self.reduce, self.max_components)
        targets, report = phd.report(reduced, estimate.clutter)
        return LearningPhdBelief(targets, estimate), report


def learning_phd(
    model: MultiTargetModel,
    components: int = 100,
    merging: float = 4.0,
    prune_weight: float = 1e-5,
    reduction: str = "vo-ma",
    memory: int = 20,
    deviation: float = 15.0,
    max_gaussians: int = 12,
    iterations: int = 2,
) -> LearningPhd:
    """GM-PHD filter of up to `components`, with clutter learned as a uniform and up to `most` Gaussians no
    narrower than `deviation` (m), which forgets within `memory` scans."""
    reduce = reduction_named(reduction, components, merging)
    return LearningPhd(model, reduce, options(memory, deviation, max_gaussians, iterations), prune_weight)
