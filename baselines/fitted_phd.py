"""A GM-PHD filter with the clutter intensity that Lv's finite mixture fits to each scan."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from gmr_gym.filters import phd
from gmr_gym.filters.phd import LabelledIntensity
from gmr_gym.filters.registry import make_tracker
from gmr_gym.filters.tracker import MultiTargetReport, MultiTargetTracker, check_scan
from gmr_gym.mixture import Mixture
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.reduction.registry import reduction_named


class Fitted(NamedTuple):
    """Belief: targets of the PHD filter, and the belief of the finite mixture.

    Attributes
    ----------
    targets : LabelledIntensity
    mixture : object
        Belief of the tracker `fit`.
    """

    targets: LabelledIntensity
    mixture: object


@dataclass(frozen=True)
class FittedPhd:
    """GM-PHD filter whose clutter intensity is the finite mixture fitted to the same scan.

    The targets of the mixture are not used: detections that the mixture assigns to no target count as
    clutter.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    reduce : callable
        Reduction of the intensity.
    fit : MultiTargetTracker
        Tracker of the finite mixture.
    prune_weight : float
        Components of less weight, an expected number of targets, are pruned.
    max_components : int
        Most components that enter `reduce`, the heaviest, to bound the memory of a huge scan.
    """

    model: MultiTargetModel
    reduce: Callable[[Mixture], Reduced]
    fit: MultiTargetTracker
    prune_weight: float = 1e-5
    max_components: int = 2000

    def __post_init__(self):
        phd.check_filter(self.model, self.reduce, self.prune_weight, self.max_components)

    def init(self) -> Fitted:
        """Belief one period before the first scan."""
        return Fitted(phd.no_targets(self.model), self.fit.init())

    def step(self, belief: Fitted, z) -> tuple[Fitted, MultiTargetReport]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        model = self.model
        z = check_scan(z, len(model.sensor.H))
        mixture, fitted = self.fit.step(belief.mixture, z)
        posterior, _ = phd.update(
            phd.predict(belief.targets, model), model.sensor, z,
            model.detection_probability, fitted.clutter.density(z), self.prune_weight,
        )  # fmt: skip
        targets, report = phd.report(
            phd.reduce_intensity(posterior, self.reduce, self.max_components), fitted.clutter
        )
        return Fitted(targets, mixture), report


def fitted_phd(
    model: MultiTargetModel,
    components: int = 100,
    merging: float = 4.0,
    prune_weight: float = 1e-5,
    reduction: str = "vo-ma",
    by: str = "fmm-em",
    repaired: bool = False,
) -> FittedPhd:
    """GM-PHD filter in the clutter that a finite mixture fits to each scan.

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
    by : {"fmm-em", "fmm-gibbs"}
        Tracker that fits the clutter.
    repaired : bool
        Whether `by` is used as repaired rather than as printed.

    Returns
    -------
    FittedPhd

    Raises
    ------
    ValueError
        Naming the parameter that is out of range.
    """
    if by not in ("fmm-em", "fmm-gibbs"):
        raise ValueError(f"by must be fmm-em or fmm-gibbs, got {by!r}")
    reduce = reduction_named(reduction, components, merging)
    return FittedPhd(model, reduce, make_tracker(by, model, repaired=repaired), prune_weight)
