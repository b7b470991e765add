"""A GM-PHD filter that estimates the clutter intensity."""

from gmr_gym.filters.clutter_estimation import options
from gmr_gym.filters.gm_phd import GmPhd
from gmr_gym.filters.learning_tracker import LearningTracker
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.reduction.registry import reduction_named


def learning_phd(
    model: MultiTargetModel,
    components: int = 100,
    merging: float = 4.0,
    prune_weight: float = 1e-5,
    reduction: str = "vo-ma",
    *,
    estimator: str = "expected",
    memory: int = 20,
    deviation: float = 15.0,
    max_gaussians: int = 12,
    iterations: int = 2,
) -> LearningTracker:
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
    estimator : {"expected", "components"}
        As of `gm_phd`.
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
    LearningTracker

    Raises
    ------
    ValueError
        Naming the parameter that is out of range.
    """
    known = GmPhd(model, reduction_named(reduction, components, merging), prune_weight, estimator=estimator)
    return LearningTracker(known, options(memory, deviation, max_gaussians, iterations))
