"""A GM-PHD filter fed the clutter that Lv's finite mixture fits to each scan."""

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
    """What the filter believes of the targets, and what the finite mixture believes of all."""

    targets: LabelledIntensity
    mixture: object


@dataclass(frozen=True)
class FittedPhd:
    """A GM-PHD filter whose intensity of clutter is that of the finite mixture fitted to the very scan that
    is judged by it. Of the targets of the mixture it hears nothing: what the mixture has lost is clutter."""

    model: MultiTargetModel
    reduce: Callable[[Mixture], Reduced]
    fit: MultiTargetTracker
    prune_weight: float = 1e-5  # an expected number of targets
    max_components: int = 2000  # components that enter `reduce`, the heaviest, lest a huge scan fill memory

    def __post_init__(self):
        phd.check_filter(self.model, self.reduce, self.prune_weight, self.max_components)

    def init(self) -> Fitted:
        return Fitted(phd.no_targets(self.model), self.fit.init())

    def step(self, belief: Fitted, z) -> tuple[Fitted, MultiTargetReport]:
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
    """GM-PHD filter of up to `components` in the clutter that the tracker `by`, "fmm-em" or "fmm-gibbs", fits
    as printed or `repaired`."""
    if by not in ("fmm-em", "fmm-gibbs"):
        raise ValueError(f"by must be fmm-em or fmm-gibbs, got {by!r}")
    reduce = reduction_named(reduction, components, merging)
    return FittedPhd(model, reduce, make_tracker(by, model, repaired=repaired), prune_weight)
