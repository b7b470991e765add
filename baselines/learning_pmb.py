"""Track-oriented Poisson multi-Bernoulli trackers (Williams 2015, TOMB/P), in known or estimated clutter."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_choice, check_limits, check_probability
from gmr_gym.filters import pmb as multi_bernoulli
from gmr_gym.filters.clutter_estimation import options
from gmr_gym.filters.learning_tracker import LearningTracker
from gmr_gym.filters.marginals import ASSOCIATIONS
from gmr_gym.filters.mixture_pmb import MixturePmb
from gmr_gym.filters.mixture_tracks import collapsing
from gmr_gym.filters.pmb import MultiBernoulli
from gmr_gym.filters.tracker import KnownClutterTracker, MultiTargetReport
from gmr_gym.models.clutter import Clutter
from gmr_gym.models.multi_target import MultiTargetModel, check_linear, check_plain, is_plain

FAINT = 1e-3  # existence below which a track is dropped
RARE = 0.2  # the same, of that of a track that begins with an average birth


class PmbLimits(NamedTuple):
    """Which tracks are kept and which are declared; `pmb_limits` makes a checked one.

    Attributes
    ----------
    prune_existence : float
        Tracks of less existence are dropped; less than `report_threshold`.
    prune_weight : float
        Undetected components of less weight, an expected number of targets, are dropped.
    tracks : int
        Most tracks, and most undetected components.
    report_threshold : float
        Tracks of more existence are declared.
    """

    prune_existence: float
    prune_weight: float
    tracks: int
    report_threshold: float


def pmb_limits(
    prune_existence: float, prune_weight: float, tracks: int, report_threshold: float
) -> PmbLimits:
    """Make checked limits.

    Parameters
    ----------
    prune_existence : float
        Tracks of less existence are dropped; less than `report_threshold`.
    prune_weight : float
        Undetected components of less weight, an expected number of targets, are dropped.
    tracks : int
        Most tracks, and most undetected components.
    report_threshold : float
        Tracks of more existence are declared.

    Returns
    -------
    PmbLimits

    Raises
    ------
    ValueError
        Naming the parameter that is out of range.
    """
    check_limits(prune_weight, 1)
    if not tracks >= 1 or tracks != int(tracks):
        raise ValueError(f"tracks must be a whole number, at least 1, got {tracks}")
    check_probability("report_threshold", report_threshold)
    if not 0 <= prune_existence < report_threshold:
        raise ValueError(
            f"prune_existence must be a probability less than report_threshold {report_threshold}, got "
            f"{prune_existence}"
        )
    return PmbLimits(float(prune_existence), float(prune_weight), int(tracks), float(report_threshold))


@dataclass(frozen=True)
class Pmb(KnownClutterTracker):
    """Poisson multi-Bernoulli tracker in known clutter.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    limits : PmbLimits
    association : {"exact", "belief-propagation"}
        How marginal association probabilities are found.
    """

    model: MultiTargetModel
    limits: PmbLimits
    association: str = "exact"

    def __post_init__(self) -> None:
        check_plain(self.model, "the PMB filter")
        check_choice("association", self.association, ASSOCIATIONS)

    def init(self) -> MultiBernoulli:
        """Belief one period before the first scan."""
        return multi_bernoulli.untracked(self.model)

    def update(
        self, belief: MultiBernoulli, z: np.ndarray, clutter: Clutter
    ) -> tuple[MultiBernoulli, np.ndarray]:
        """Pruned belief after the scan `z` (k, p), and the probability (k,) that each is a false alarm."""
        model, limits = self.model, self.limits
        targets, p_clutter = multi_bernoulli.update(
            multi_bernoulli.predict(belief, model), model.sensor, z,
            model.detection_probability, clutter.density(z), limits.prune_existence, self.association,
        )  # fmt: skip
        kept = multi_bernoulli.prune(targets, limits.prune_existence, limits.prune_weight, limits.tracks)
        return kept, p_clutter

    def report(self, posterior: MultiBernoulli, clutter: Clutter) -> tuple[MultiBernoulli, MultiTargetReport]:
        """The belief, unchanged, and its report."""
        return posterior, multi_bernoulli.report(posterior, clutter, self.limits.report_threshold)


def faintest(model: MultiTargetModel) -> float:
    """Existence below which tracks are dropped: `FAINT`, or less where births are rare beside clutter.

    A track begins with the probability that its detection is of a target and not a false alarm: dropped at
    once where births are few, no target that is born would ever be found.
    """
    born = float(model.births.w @ model.detected(model.births.m))
    return min(FAINT, RARE * born / (born + model.clutter.expected)) if born > 0 else FAINT


def pmb(
    model: MultiTargetModel,
    prune_existence: float | None = None,
    prune_weight: float = 1e-5,
    tracks: int = 400,
    report_threshold: float = 0.5,
    association: str = "exact",
    projection: str = "tomb",
    *,
    components: int = 1,
    reduction: str = "runnalls",
    prune_hypotheses: float = 1e-4,
    hypotheses: int = 100,
) -> Pmb | MixturePmb:
    """Poisson multi-Bernoulli tracker of up to `tracks` tracks, by any projection.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    prune_existence : float, optional
        Tracks of less existence are dropped; less than `report_threshold`. By default 1e-3, or a fifth of the
        probability that a detection is of a born target where that is less.
    prune_weight : float
        Undetected components of less weight, an expected number of targets, are dropped.
    tracks : int
        Most tracks, and most undetected components.
    report_threshold : float
        Tracks of more existence are declared.
    association : {"exact", "belief-propagation"}
        How marginal association probabilities are found: "exact" enumerates the association events of each
        cluster of tracks, up to a size.
    projection : {"tomb", "momb", "variational"}
        Which hypotheses become one track: "tomb", those of a track; "momb", those of a detection;
        "variational", those that are most alike.
    components : int
        Most components of each track.
    reduction : str
        Reduction of each track to `components`, such as "runnalls" or "capping".
    prune_hypotheses : float
        With several components: hypotheses of less weight in their track are pruned before the reduction.
    hypotheses : int
        Of "variational": most association events of a cluster of tracks that are looked at.

    Returns
    -------
    Pmb or MixturePmb
        The latter for a model of several motions, a radar or a P_D by state, and where one of the last five
        parameters asks for it.

    Raises
    ------
    ValueError
        Naming the parameter that is out of range.

    References
    ----------
    Williams 2015, TOMB/P and MOMB/P; Williams, TSP 63(1), 2015.
    """
    least = faintest(model) if prune_existence is None else prune_existence
    limits = pmb_limits(least, prune_weight, tracks, report_threshold)
    reduce = collapsing(reduction, components)
    general = MixturePmb(
        model, reduce, projection, *limits, association,
        prune_hypotheses=prune_hypotheses, hypotheses=hypotheses,
    )  # fmt: skip
    if reduce is None and projection == "tomb" and is_plain(model):
        return Pmb(model, limits, association)
    return general


def learning_pmb(
    model: MultiTargetModel,
    prune_existence: float = 1e-3,
    prune_weight: float = 1e-5,
    tracks: int = 200,
    report_threshold: float = 0.5,
    *,
    association: str = "exact",
    projection: str = "tomb",
    memory: int = 20,
    deviation: float = 15.0,
    max_gaussians: int = 12,
    iterations: int = 2,
) -> LearningTracker:
    """Poisson multi-Bernoulli tracker with estimated clutter: uniform and up to `max_gaussians` Gaussians.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    prune_existence : float
        Tracks of less existence are dropped; less than `report_threshold`.
    prune_weight : float
        Undetected components of less weight, an expected number of targets, are dropped.
    tracks : int
        Most tracks, and most undetected components.
    report_threshold : float
        Tracks of more existence are declared.
    association : {"exact", "belief-propagation"}
        As of `pmb`.
    projection : {"tomb", "momb", "variational"}
        As of `pmb`.
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
    check_linear(model, "the estimate of clutter")
    known = pmb(model, prune_existence, prune_weight, tracks, report_threshold, association, projection)
    return LearningTracker(known, options(memory, deviation, max_gaussians, iterations))
