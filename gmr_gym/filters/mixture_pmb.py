"""Poisson multi-Bernoulli tracker of mixtures, by any projection: several motions, a radar, P_D by state."""

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_choice, check_whole
from gmr_gym.filters.marginals import ASSOCIATIONS
from gmr_gym.filters.mixture_tracks import (
    MixtureTracks,
    Reduction,
    associate,
    collapsed,
    most_likely,
    no_tracks,
    predict,
    reduce,
    started,
    take,
    undetected_at,
)
from gmr_gym.filters.projections import PROJECTIONS, variational
from gmr_gym.filters.target_densities import outputs
from gmr_gym.filters.tracker import KnownClutterTracker, MultiTargetReport
from gmr_gym.filters.undetected_targets import Intensity, appear, intensity_of, undetected_after
from gmr_gym.mixture import Mixture, joined
from gmr_gym.models.clutter import Clutter
from gmr_gym.models.multi_target import MultiTargetModel


class PmbOfMixtures(NamedTuple):
    """Bernoulli tracks whose densities are mixtures, and the intensity of undetected targets.

    Attributes
    ----------
    tracks : MixtureTracks
    undetected : Intensity
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
class MixturePmb(KnownClutterTracker):
    """Poisson multi-Bernoulli tracker in known clutter, of every kind of model.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    reduce : callable or None
        Reduction of the mixture of each track; None merges it by its moments, mode by mode.
    projection : {"tomb", "momb", "variational"}
    prune_existence : float
        Tracks of less existence are dropped.
    prune_weight : float
        Undetected components of less weight, an expected number of targets, are dropped.
    tracks : int
        Most tracks, and most undetected components.
    report_threshold : float
        Tracks of more existence are declared.
    association : {"exact", "belief-propagation"}
    prune_hypotheses : float
        Hypotheses of less weight in their track are pruned before the reduction.
    hypotheses : int
        Of "variational": most events of a cluster that are looked at.

    References
    ----------
    Williams 2015; for the variational projection Williams, TSP 63(1), 2015.
    """

    model: MultiTargetModel
    reduce: Reduction | None
    projection: str = "tomb"
    prune_existence: float = 1e-3
    prune_weight: float = 1e-5
    tracks: int = 200
    report_threshold: float = 0.5
    association: str = "exact"
    prune_hypotheses: float = 1e-4
    hypotheses: int = 100

    def __post_init__(self) -> None:
        check_choice("association", self.association, ASSOCIATIONS)
        check_choice("projection", self.projection, tuple(PROJECTIONS))
        check_whole("hypotheses", self.hypotheses, 1)
        if not 0 <= self.prune_hypotheses < 1:
            raise ValueError(f"prune_hypotheses must lie in [0, 1), got {self.prune_hypotheses}")

    def init(self) -> PmbOfMixtures:
        """Belief one period before the first scan."""
        return PmbOfMixtures(no_tracks(self.model), intensity_of(self.model.initial, self.model), 0, 0)

    def update(
        self, belief: PmbOfMixtures, z: np.ndarray, clutter: Clutter
    ) -> tuple[PmbOfMixtures, np.ndarray]:
        """Pruned belief after the scan `z` (k, p), and the probability (k,) that each is a false alarm."""
        model, log_kappa = self.model, np.log(clutter.density(z))
        tracks = predict(belief.tracks, model)
        undetected = undetected_at(belief.undetected, tracks, model)
        appearing = appear(undetected, model, z, log_kappa)
        found = associate(tracks, model, z, log_kappa + appearing.log_ratio, self.association)
        least = self.prune_existence if self.projection != "momb" else 0.0
        new, first = started(appearing, z, found.unassigned, least)
        new = new._replace(label=belief.next_label + new.label)
        project = PROJECTIONS[self.projection]
        if project is variational:
            project = partial(variational, hypotheses=self.hypotheses)
        both = project(found, new, first)
        next_label = belief.next_label + len(new.label)
        unnamed = np.flatnonzero(both.label < 0)
        both.label[unnamed] = next_label + np.arange(len(unnamed))
        kept = take(both, most_likely(both.existence, self.prune_existence, self.tracks))
        posterior = PmbOfMixtures(
            reduce(kept, self.reduce, self.prune_hypotheses),
            undetected_after(undetected, model, self.tracks, self.prune_weight),
            next_label + len(unnamed), found.approximated,
        )  # fmt: skip
        return posterior, found.unassigned * np.exp(-appearing.log_ratio)

    def report(self, posterior: PmbOfMixtures, clutter: Clutter) -> tuple[PmbOfMixtures, MultiTargetReport]:
        """The belief, unchanged, and its report, by decreasing existence."""
        tracks, (w, densities) = posterior.tracks, posterior.undetected
        x, P = collapsed(tracks)
        order = np.argsort(-tracks.existence, kind="stable")
        order = order[tracks.existence[order] > self.report_threshold]
        all_targets = joined([Mixture(tracks.existence, x, P), Mixture(w, *outputs(densities))])
        return posterior, MultiTargetReport(
            x[order], tracks.existence[order], tracks.label[order], float(all_targets.w.sum()), all_targets,
            clutter, posterior.approximated,
        )  # fmt: skip
