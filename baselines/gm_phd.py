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
    """GM-PHD filter: predict with births and spawning, update, prune, reduce.

    Components of weight above 1/2 are declared targets.

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

    References
    ----------
    Vo and Ma 2006, Tables I-III.
    """

    model: MultiTargetModel
    reduce: Callable[[Mixture], Reduced]
    prune_weight: float = 1e-5
    max_components: int = 2000

    def __post_init__(self):
        phd.check_filter(self.model, self.reduce, self.prune_weight, self.max_components)

    def init(self) -> LabelledIntensity:
        """Belief one period before the first scan."""
        return phd.no_targets(self.model)

    def step(self, belief: LabelledIntensity, z: np.ndarray) -> tuple[LabelledIntensity, MultiTargetReport]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
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
    """GM-PHD filter reduced to `components`.

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

    Returns
    -------
    GmPhd

    References
    ----------
    Vo and Ma 2006.

    Examples
    --------
    >>> import numpy as np
    >>> from gmr_gym.mixture import gaussian
    >>> from gmr_gym.models import constant_velocity, multi_target_model, position_sensor, uniform_clutter
    >>> births = gaussian(np.zeros(4), np.diag([1e4, 1e4, 25.0, 25.0]))._replace(w=np.array([0.1]))
    >>> clutter = uniform_clutter([-500.0, -500.0], [500.0, 500.0], 5.0)
    >>> assumed = multi_target_model(
    ...     constant_velocity(1.0, 0.5), position_sensor(10.0), 0.9, 0.99, births, clutter
    ... )
    >>> tracker = gm_phd(assumed, components=20)
    >>> belief, report = tracker.step(tracker.init(), np.array([[30.0, 40.0]]))
    >>> round(report.expected_targets, 2)
    0.21
    """
    return GmPhd(model, reduction_named(reduction, components, merging), prune_weight)
