"""A GM-PHD filter with the clutter intensity that Lv's finite mixture fits to each scan."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gmr_gym.filters.gm_phd import GmPhd
from gmr_gym.filters.phd import LabelledIntensity
from gmr_gym.filters.registry import make_tracker
from gmr_gym.filters.tracker import MultiTargetReport, MultiTargetTracker, check_scan
from gmr_gym.models.multi_target import MultiTargetModel
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
    phd : GmPhd
    fit : MultiTargetTracker
        Tracker of the finite mixture.
    """

    phd: GmPhd
    fit: MultiTargetTracker

    @property
    def model(self) -> MultiTargetModel:
        """The filter model."""
        return self.phd.model

    def init(self) -> Fitted:
        """Belief one period before the first scan."""
        return Fitted(self.phd.init(), self.fit.init())

    def step(self, belief: Fitted, z: np.ndarray) -> tuple[Fitted, MultiTargetReport]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        z = check_scan(z, len(self.model.sensor.H))
        mixture, fitted = self.fit.step(belief.mixture, z)
        posterior, _ = self.phd.update(belief.targets, z, fitted.clutter)
        targets, report = self.phd.report(posterior, fitted.clutter)
        return Fitted(targets, mixture), report


def fitted_phd(
    model: MultiTargetModel,
    components: int = 100,
    merging: float = 4.0,
    prune_weight: float = 1e-5,
    reduction: str = "vo-ma",
    by: str = "fmm-em",
    repaired: bool = False,
    estimator: str = "expected",
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
    estimator : {"expected", "components"}
        As of `gm_phd`.

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
    phd = GmPhd(model, reduction_named(reduction, components, merging), prune_weight, estimator=estimator)
    return FittedPhd(phd, make_tracker(by, model, repaired=repaired))
