"""The Gaussian-mixture PHD filter as a tracker, with any reduction of its mixture."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gmr_gym.checks import check_choice, check_limits
from gmr_gym.filters import phd
from gmr_gym.filters.phd import LabelledIntensity
from gmr_gym.filters.tracker import KnownClutterTracker, MultiTargetReport
from gmr_gym.mixture import Mixture
from gmr_gym.models.clutter import Clutter
from gmr_gym.models.multi_target import MultiTargetModel, check_plain
from gmr_gym.reduction.protocol import Reduced, check_reduced

ESTIMATORS = ("expected", "components")


@dataclass(frozen=True)
class GmPhd(KnownClutterTracker):
    """GM-PHD filter: predict with births and spawning, update, prune, reduce.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    reduce : callable
        Reduction of the intensity.
    prune_weight : float
        T: components of less weight, an expected number of targets, are pruned.
    max_components : int
        Most components that enter `reduce`, the heaviest, to bound the memory of a huge scan.
    estimator : {"expected", "components"}
        How many targets are declared: "expected", the expected number, rounded, from the heaviest components;
        "components", those of weight above 1/2, round(w) of each (Vo and Ma).

    References
    ----------
    Vo and Ma 2006, Tables I-III.
    """

    model: MultiTargetModel
    reduce: Callable[[Mixture], Reduced]
    prune_weight: float = 1e-5
    max_components: int = 2000
    estimator: str = "expected"

    def __post_init__(self) -> None:
        check_plain(self.model, "the GM-PHD filter")
        check_choice("estimator", self.estimator, ESTIMATORS)
        check_limits(self.prune_weight, self.max_components)
        d = len(self.model.motion.F)
        check_reduced(self.reduce(Mixture(np.ones(1), np.zeros((1, d)), np.eye(d)[None])), 1)

    def init(self) -> LabelledIntensity:
        """Belief one period before the first scan."""
        return phd.initial(self.model)

    def update(
        self, belief: LabelledIntensity, z: np.ndarray, clutter: Clutter
    ) -> tuple[LabelledIntensity, np.ndarray]:
        """Posterior of the scan `z` (k, p), and the probability (k,) that each detection is a false alarm."""
        model = self.model
        return phd.update(
            phd.predict(belief, model), model.sensor, z,
            model.detection_probability, clutter.density(z), self.prune_weight,
        )  # fmt: skip

    def report(
        self, posterior: LabelledIntensity, clutter: Clutter, number: int | None = None
    ) -> tuple[LabelledIntensity, MultiTargetReport]:
        """The reduced posterior and its report, of `number` targets if given."""
        if number is None and self.estimator == "expected":
            number = round(float(posterior.intensity.w.sum()))
        return phd.report(phd.reduce_intensity(posterior, self.reduce, self.max_components), clutter, number)
