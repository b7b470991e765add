"""A multi-target tracker that estimates the clutter in which another tracks."""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.filters.clutter_estimation import (
    ClutterEstimate,
    EstimatorOptions,
    initial_estimate,
    update_estimate,
)
from gmr_gym.filters.tracker import KnownClutterTracker, MultiTargetReport, check_scan
from gmr_gym.models.multi_target import MultiTargetModel


class LearningBelief(NamedTuple):
    """Belief of targets and state of the clutter estimator.

    Attributes
    ----------
    targets
        Belief of the tracker that knows the clutter.
    estimate : ClutterEstimate
    """

    targets: Any
    estimate: ClutterEstimate


@dataclass(frozen=True)
class LearningTracker:
    """Multi-target tracker whose clutter intensity is estimated from past scans.

    Every detection is weighted by the probability that it comes from no target. A scan is processed with the
    clutter estimated before it.

    Parameters
    ----------
    known : KnownClutterTracker
        Tracker to which the estimate is passed.
    options : EstimatorOptions
        Options of the clutter estimator.
    """

    known: KnownClutterTracker
    options: EstimatorOptions

    @property
    def model(self) -> MultiTargetModel:
        """The filter model."""
        return self.known.model

    def init(self) -> LearningBelief:
        """Belief one period before the first scan."""
        return LearningBelief(self.known.init(), initial_estimate(self.model.clutter))

    def step(self, belief: LearningBelief, z: np.ndarray) -> tuple[LearningBelief, MultiTargetReport]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        model, estimate = self.model, belief.estimate
        z = check_scan(z, len(model.sensor.H))
        posterior, p_clutter = self.known.update(belief.targets, z, estimate.clutter)
        estimate = update_estimate(model.clutter, estimate, z, p_clutter, self.options)
        targets, report = self.known.report(posterior, estimate.clutter)
        return LearningBelief(targets, estimate), report
