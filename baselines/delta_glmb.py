"""The delta-generalised labelled multi-Bernoulli filter, jointly predicted and updated (Vo, Vo, Hoang)."""

from gmr_gym.checks import check_choice
from gmr_gym.filters.mixture_tracker import MixtureTracker
from gmr_gym.models.multi_target import MultiTargetModel

BIRTHS = ("detections", "model")
SAMPLERS = ("gibbs", "murty")


def delta_glmb(
    model: MultiTargetModel,
    hypotheses: int = 1000,
    samples: int = 1000,
    prune_hypotheses: float = 1e-3,
    *,
    prune_weight: float = 1e-5,
    tracks: int = 1000,
    births: str = "detections",
    association: str = "gibbs",
    estimator: str = "cardinality",
    report_threshold: float = 0.4,
    seed: int = 0,
) -> MixtureTracker:
    """Delta-GLMB filter: hypotheses of which targets exist, and of the detections that they have had.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    hypotheses : int
        Most hypotheses of a cluster of tracks that have shared detections.
    samples : int
        Association events drawn in each cluster by Gibbs sampling.
    prune_hypotheses : float
        Hypotheses of less probability are dropped.
    prune_weight : float
        Undetected components of less weight, an expected number of targets, are dropped.
    tracks : int
        Most tracks.
    births : {"detections", "model"}
        Where targets are born: "detections", at detections that no target has had, with the probability that
        the model gives a new target against a false alarm; "model", each birth component of the filter
        model as in `mbm`, which needs many hypotheses where it is wide.
    association : {"gibbs", "murty"}
        How association events are found: "gibbs" draws them, "murty" has those of most weight.
    estimator : {"cardinality", "hypothesis", "marginal"}
        Which targets are declared: "cardinality", the most likely number of them, from the most likely
        hypothesis; the others as of `pmbm`, "marginal" with births at detections alone.
    report_threshold : float
        Probability of existence above which a target is declared, where the estimator is not "cardinality".
    seed : int
        Of the sampling.

    Returns
    -------
    MixtureTracker

    Raises
    ------
    ValueError
        Naming the parameter that is out of range.

    Notes
    -----
    Where P_D and P_S are 1, a certain target that a scan does not detect has gone: no hypothesis explains the
    scan then, and those without the target are nearest to one.

    Departs: the papers have no clusters, births of the filter model, and no undetected targets. With births
    at detections the undetected are a Poisson intensity, and whether a target is one is decided one scan
    after its first detection.

    References
    ----------
    Vo and Vo 2013; Vo, Vo and Phung 2014; Vo, Vo and Hoang 2017.
    """
    check_choice("births", births, BIRTHS)
    check_choice("association", association, SAMPLERS)
    return MixtureTracker(
        model, hypotheses, prune_hypotheses, min(1e-5, report_threshold / 2), prune_weight, tracks,
        report_threshold, estimator, undetected=births == "detections", certain=True,
        samples=samples if association == "gibbs" else 0, seed=seed,
    )  # fmt: skip
