"""The labelled multi-Bernoulli filter (Reuter, Vo, Vo and Dietmayer 2014), its marginals exact."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_choice, check_limits, check_probability, check_whole
from gmr_gym.filters.marginals import ASSOCIATIONS
from gmr_gym.filters.mixture_tracks import (
    MixtureTracks,
    Reduction,
    added,
    associate,
    collapsed,
    collapsing,
    most_likely,
    no_tracks,
    predict,
    reduce,
    started,
    take,
    undetected_at,
)
from gmr_gym.filters.multi_bernoulli_mixture import LARGEST_BIRTH
from gmr_gym.filters.target_densities import take as take_densities
from gmr_gym.filters.tracker import KnownClutterTracker, MultiTargetReport
from gmr_gym.filters.undetected_targets import Intensity, appear, intensity_of, undetected_after
from gmr_gym.mixture import Mixture
from gmr_gym.models.clutter import Clutter
from gmr_gym.models.multi_target import MultiTargetModel

BIRTHS = ("detections", "model")


class LabelledBernoullis(NamedTuple):
    """Bernoulli tracks with labels.

    Attributes
    ----------
    tracks : MixtureTracks
    undetected : Intensity
        Of targets not yet detected; none where births are tracks.
    next_label : int
        Next unused label.
    approximated : int
        Clusters of the last scan whose association probabilities are approximate.
    """

    tracks: MixtureTracks
    undetected: Intensity
    next_label: int
    approximated: int


@dataclass(frozen=True)
class Lmb(KnownClutterTracker):
    r"""LMB filter: each track a probability of existence and a mixture over the detections it may have had.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    reduce : callable or None
        Reduction of the mixture of each track; None merges it by its moments, mode by mode.
    prune_existence : float
        Tracks of less existence are dropped; less than `report_threshold`.
    prune_weight : float
        Hypotheses of less weight in their track are pruned before the reduction.
    tracks : int
        Most tracks.
    report_threshold : float
        Tracks of more existence are declared.
    births : {"detections", "model"}
        Where tracks begin: at detections of no track, or at the births of the model.
    association : {"exact", "belief-propagation"}

    Notes
    -----
    The update of an LMB is a delta-GLMB, and the LMB of the same intensity of labels has existences

    .. math:: r_l = \sum_{(I, \xi): l \in I} w^{(I, \xi)}

    which are marginals of association events, found as those of JIPDA without listing the events.

    Departs: births are a Poisson intensity in the model. Those of detections have the existence that it gives
    a detection of no track, in the same scan, not in the next. Of those of the model the weight of each
    component is shared out equally among as few Bernoulli births as have an existence of at most
    `LARGEST_BIRTH`; births in one place then stay alike, and are no estimates.

    References
    ----------
    Reuter, Vo, Vo and Dietmayer 2014.
    """

    model: MultiTargetModel
    reduce: Reduction | None
    prune_existence: float = 1e-4
    prune_weight: float = 1e-4
    tracks: int = 1000
    report_threshold: float = 0.5
    births: str = "detections"
    association: str = "exact"

    def __post_init__(self) -> None:
        check_choice("births", self.births, BIRTHS)
        check_choice("association", self.association, ASSOCIATIONS)
        check_limits(self.prune_weight, 1)
        check_whole("tracks", self.tracks, 1)
        check_probability("report_threshold", self.report_threshold)
        if not 0 <= self.prune_existence < self.report_threshold:
            raise ValueError(
                f"prune_existence must be a probability less than report_threshold {self.report_threshold}, "
                f"got {self.prune_existence}"
            )

    def init(self) -> LabelledBernoullis:
        """Belief one period before the first scan."""
        return LabelledBernoullis(no_tracks(self.model), intensity_of(self.model.initial, self.model), 0, 0)

    def update(
        self, belief: LabelledBernoullis, z: np.ndarray, clutter: Clutter
    ) -> tuple[LabelledBernoullis, np.ndarray]:
        """Belief after the scan `z` (k, p), pruned, and the probability (k,) that each is a false alarm."""
        model, log_kappa = self.model, np.log(clutter.density(z))
        tracks = predict(belief.tracks, model)
        undetected = undetected_at(belief.undetected, tracks, model)
        if self.births == "model":
            tracks = added(tracks, _bernoullis(undetected, belief.next_label))
            undetected = Intensity(np.empty(0), no_tracks(model).densities)
        appearing = appear(undetected, model, z, log_kappa)
        found = associate(tracks, model, z, log_kappa + appearing.log_ratio, self.association)
        next_label = max(belief.next_label, found.tracks.label.max(initial=-1) + 1)
        new, _ = started(appearing, z, found.unassigned, self.prune_existence)
        both = added(found.tracks, new._replace(label=next_label + new.label))
        kept = most_likely(both.existence, self.prune_existence, self.tracks)
        posterior = LabelledBernoullis(
            reduce(take(both, kept), self.reduce, self.prune_weight),
            undetected_after(undetected, model, self.tracks), next_label + len(new.label),
            found.approximated,
        )  # fmt: skip
        return posterior, found.unassigned * np.exp(-appearing.log_ratio)

    def report(
        self, posterior: LabelledBernoullis, clutter: Clutter
    ) -> tuple[LabelledBernoullis, MultiTargetReport]:
        """The belief, unchanged, and its report, by decreasing existence."""
        tracks = posterior.tracks
        x, P = collapsed(tracks)
        order = np.argsort(-tracks.existence, kind="stable")
        order = order[tracks.existence[order] > self.report_threshold]
        return posterior, MultiTargetReport(
            x[order], tracks.existence[order], tracks.label[order], float(tracks.existence.sum()),
            Mixture(tracks.existence, x, P), clutter, posterior.approximated,
        )  # fmt: skip


def _bernoullis(intensity: Intensity, next_label: int) -> MixtureTracks:
    """Bernoulli tracks of an intensity, of labels from `next_label` on."""
    parts = np.ceil(intensity.w / LARGEST_BIRTH).astype(np.int64)
    row = np.repeat(np.arange(len(parts)), parts)
    born = np.arange(len(row))
    densities = take_densities(intensity.densities, row)
    return MixtureTracks(intensity.w[row] / parts[row], next_label + born, densities, np.ones(len(row)), born)


def lmb(
    model: MultiTargetModel,
    components: int = 5,
    reduction: str = "runnalls",
    prune_existence: float = 1e-4,
    report_threshold: float = 0.5,
    births: str = "detections",
    *,
    prune_weight: float = 1e-4,
    tracks: int = 1000,
    association: str = "exact",
) -> Lmb:
    """LMB filter (labelled multi-Bernoulli) with exact association probabilities, of one motion or several.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model: one motion or several, a linear sensor or a radar.
    components : int
        Most components of each track.
    reduction : str
        Reduction of each track to `components`, such as "runnalls" or "capping".
    prune_existence : float
        Tracks of less existence are dropped; less than `report_threshold`.
    report_threshold : float
        Tracks of more existence are declared.
    births : {"detections", "model"}
        Where tracks begin: at detections of no track, or at the births of the model.
    prune_weight : float
        Hypotheses of less weight in their track are pruned before the reduction.
    tracks : int
        Most tracks.
    association : {"exact", "belief-propagation"}
        "exact" enumerates the association events of each cluster of tracks, up to a size.

    Returns
    -------
    Lmb

    Raises
    ------
    ValueError
        Naming the parameter that is out of range.

    References
    ----------
    Reuter, Vo, Vo and Dietmayer 2014; by marginals Kropfreiter, Meyer and Hlawatsch 2019.
    """
    return Lmb(
        model, collapsing(reduction, components), prune_existence, prune_weight, tracks, report_threshold,
        births, association,
    )  # fmt: skip
