"""A GM-PHD filter that estimates the clutter intensity."""

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
    """Belief of targets and state of the clutter estimator.

    Attributes
    ----------
    targets : LabelledIntensity
    estimate : ClutterEstimate
    """

    targets: LabelledIntensity
    estimate: ClutterEstimate


@dataclass(frozen=True)
class LearningPhd:
    """GM-PHD filter whose clutter intensity is estimated from past scans.

    Every detection is weighted by its probability of being a false alarm. A scan is processed with the
    clutter estimated before it.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    reduce : callable
        Reduction of the intensity.
    options : EstimatorOptions
        Options of the clutter estimator.
    prune_weight : float
        Components of less weight, an expected number of targets, are pruned.
    max_components : int
        Most components that enter `reduce`, the heaviest, to bound the memory of a huge scan.
    """

    model: MultiTargetModel
    reduce: Callable[[Mixture], Reduced]
    options: EstimatorOptions
    prune_weight: float = 1e-5
    max_components: int = 2000

    def __post_init__(self):
        phd.check_filter(self.model, self.reduce, self.prune_weight, self.max_components)

    def init(self) -> LearningPhdBelief:
        """Belief one period before the first scan."""
        return LearningPhdBelief(phd.no_targets(self.model), initial_estimate(self.model.clutter))

    def step(self, belief: LearningPhdBelief, z: np.ndarray) -> tuple[LearningPhdBelief, MultiTargetReport]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
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
    """GM-PHD filter with estimated clutter: uniform and up to `max_gaussians` Gaussians.

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
    memory : int
        Scans after which a detection counts 1 / e in the clutter estimate.
    deviation : float
        Least standard deviation of a Gaussian of clutter, m.
    max_gaussians : int
        Most Gaussians of clutter.
    iterations : int
        Steps of expectation maximisation per scan.

    Returns
    -------
    LearningPhd

    Raises
    ------
    ValueError
        Naming the parameter that is out of range.
    """
    reduce = reduction_named(reduction, components, merging)
    return LearningPhd(model, reduce, options(memory, deviation, max_gaussians, iterations), prune_weight)
