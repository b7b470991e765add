"""The Gaussian-mixture PHD filter (Vo and Ma 2006), with any reduction of its mixture."""

from gmr_gym.filters.gm_phd import GmPhd
from gmr_gym.filters.mode_phd import ModePhd
from gmr_gym.models.multi_target import MultiTargetModel, is_plain
from gmr_gym.reduction.registry import reduction_named


def gm_phd(
    model: MultiTargetModel,
    components: int = 100,
    merging: float = 4.0,
    prune_weight: float = 1e-5,
    reduction: str = "vo-ma",
    estimator: str = "expected",
) -> GmPhd | ModePhd:
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
    estimator : {"expected", "components"}
        How many targets are declared: "expected", the expected number, rounded, from the heaviest components;
        "components", those of weight above 1/2, as Vo and Ma.

    Returns
    -------
    GmPhd or ModePhd
        The latter for a model of several motions, a radar or a P_D by state.

    References
    ----------
    Vo and Ma 2006; of several motions Pasha, Vo, Tuan and Ma 2009.

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
    kind = GmPhd if is_plain(model) else ModePhd
    return kind(model, reduction_named(reduction, components, merging), prune_weight, estimator=estimator)
