"""The Poisson multi-Bernoulli mixture filter (Williams 2015; Garcia-Fernandez et al. 2018)."""

from gmr_gym.filters.mixture_tracker import MixtureTracker
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.reduction.registry import reduction_named


def pmbm(
    model: MultiTargetModel,
    hypotheses: int = 200,
    prune_hypotheses: float = 1e-4,
    *,
    prune_existence: float = 1e-5,
    prune_weight: float = 1e-5,
    tracks: int = 1000,
    report_threshold: float = 0.4,
    estimator: str = "hypothesis",
    memory: int | None = None,
    components: int | None = None,
    reduction: str = "runnalls",
    samples: int = 0,
    seed: int = 0,
) -> MixtureTracker:
    """PMBM filter of up to `hypotheses` global hypotheses in each cluster of tracks.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    hypotheses : int
        Most global hypotheses of a cluster of tracks that have shared detections.
    prune_hypotheses : float
        Global hypotheses of less probability are dropped.
    prune_existence : float
        Leaves of less existence are dropped; less than `report_threshold`.
    prune_weight : float
        Undetected components of less weight, an expected number of targets, are dropped.
    tracks : int
        Most tracks, and most undetected components.
    report_threshold : float
        Probability of existence above which a target is declared.
    estimator : {"hypothesis", "cardinality", "marginal"}
        Which targets are declared: "hypothesis", those of the most likely global hypothesis; "cardinality",
        the most likely number of them; "marginal", tracks by existence over all hypotheses.
    memory : int, optional
        Leaves of a track that have had the same detections in so many scans are merged; by default none are.
    components : int, optional
        Most leaves of a track, after `reduction`; by default there is no limit.
    reduction : str
        A reduction of the single-target trackers, such as "runnalls" or "capping".
    samples : int
        Association events drawn by Gibbs sampling in each cluster; 0 for those of most weight instead.
    seed : int
        Of the sampling.

    Returns
    -------
    MixtureTracker

    Raises
    ------
    ValueError
        Naming the parameter that is out of range.

    References
    ----------
    Williams 2015; Garcia-Fernandez et al. 2018.
    """
    return MixtureTracker(
        model, hypotheses, prune_hypotheses, prune_existence, prune_weight, tracks, report_threshold,
        estimator, memory, components, reduction_named(reduction, components or 1, 4.0), samples=samples,
        seed=seed,
    )  # fmt: skip
