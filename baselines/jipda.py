"""Joint integrated probabilistic data association (Musicki and Evans 2004)."""

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
from gmr_gym.filters.tracker import KnownClutterTracker, MultiTargetReport
from gmr_gym.filters.undetected_targets import Intensity, appear, intensity_of, undetected_after
from gmr_gym.mixture import Mixture
from gmr_gym.models.clutter import Clutter
from gmr_gym.models.multi_target import MultiTargetModel


class JipdaBelief(NamedTuple):
    """Tracks, and which of them are confirmed.

    Attributes
    ----------
    tracks : MixtureTracks
    confirmed : ndarray of bool, shape (n,)
    undetected : Intensity
        Of targets not yet detected.
    next_label : int
        Next unused label.
    approximated : int
        Clusters of the last scan whose association probabilities are approximate.
    """

    tracks: MixtureTracks
    confirmed: np.ndarray
    undetected: Intensity
    next_label: int
    approximated: int


@dataclass(frozen=True)
class Jipda(KnownClutterTracker):
    r"""JIPDA: as JPDA, of tracks with a probability of existence.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    reduce : callable or None
        Reduction of the mixture of each track; None merges it by its moments, mode by mode.
    confirm : float
        Existence from which a track is declared until it is dropped.
    drop, drop_confirmed : float
        Existence below which a track is dropped before and after it is confirmed.
    prune_weight : float
        Hypotheses of less weight in their track are pruned before the reduction.
    tracks : int
        Most tracks.
    association : {"exact", "belief-propagation"}

    Notes
    -----
    A detection of no track is the first of a new target with probability
    :math:`\rho_j / (\rho_j + \kappa_j)`. Departs: the paper has one density of new targets for all scans;
    :math:`\rho_j` is that of the targets not yet detected, as of Poisson multi-Bernoulli trackers.

    References
    ----------
    Musicki and Evans 2004.
    """

    model: MultiTargetModel
    reduce: Reduction | None
    confirm: float = 0.9
    drop: float = 1e-4
    drop_confirmed: float = 0.05
    prune_weight: float = 1e-4
    tracks: int = 1000
    association: str = "exact"

    def __post_init__(self) -> None:
        check_choice("association", self.association, ASSOCIATIONS)
        check_limits(self.prune_weight, 1)
        check_whole("tracks", self.tracks, 1)
        check_probability("confirm", self.confirm)
        for name in ("drop", "drop_confirmed"):
            if not 0 <= getattr(self, name) < self.confirm:
                got = getattr(self, name)
                raise ValueError(f"{name} must be a probability less than confirm {self.confirm}, got {got}")

    def init(self) -> JipdaBelief:
        """Belief one period before the first scan."""
        initial = intensity_of(self.model.initial, self.model)
        return JipdaBelief(no_tracks(self.model), np.empty(0, bool), initial, 0, 0)

    def update(self, belief: JipdaBelief, z: np.ndarray, clutter: Clutter) -> tuple[JipdaBelief, np.ndarray]:
        """Belief after the scan `z` (k, p), and the probability (k,) that each is a false alarm."""
        model = self.model
        log_kappa, tracks = np.log(clutter.density(z)), predict(belief.tracks, model)
        undetected = undetected_at(belief.undetected, tracks, model)
        appearing = appear(undetected, model, z, log_kappa)
        found = associate(tracks, model, z, log_kappa + appearing.log_ratio, self.association)
        least = np.where(belief.confirmed, self.drop_confirmed, self.drop)
        kept = most_likely(found.tracks.existence, least, self.tracks)
        old = reduce(take(found.tracks, kept), self.reduce, self.prune_weight)
        new, _ = started(appearing, z, found.unassigned, self.drop)
        new = new._replace(label=belief.next_label + new.label)
        confirmed = np.append(belief.confirmed[kept], np.zeros(len(new.label), bool))
        both = added(old, new)
        confirmed |= both.existence >= self.confirm
        unseen = undetected_after(undetected, model, self.tracks)
        next_label = belief.next_label + len(new.label)
        posterior = JipdaBelief(both, confirmed, unseen, next_label, found.approximated)
        return posterior, found.unassigned * np.exp(-appearing.log_ratio)

    def report(self, posterior: JipdaBelief, clutter: Clutter) -> tuple[JipdaBelief, MultiTargetReport]:
        """The belief, unchanged, and its report: the confirmed tracks, by decreasing existence."""
        tracks = posterior.tracks
        x, P = collapsed(tracks)
        order = np.argsort(-tracks.existence, kind="stable")
        order = order[posterior.confirmed[order]]
        return posterior, MultiTargetReport(
            x[order], tracks.existence[order], tracks.label[order], float(tracks.existence.sum()),
            Mixture(tracks.existence, x, P), clutter, posterior.approximated,
        )  # fmt: skip


def jipda(
    model: MultiTargetModel,
    components: int = 1,
    reduction: str = "runnalls",
    confirm: float = 0.9,
    drop: float = 1e-4,
    drop_confirmed: float = 0.05,
    *,
    prune_weight: float = 1e-4,
    tracks: int = 1000,
    association: str = "exact",
) -> Jipda:
    """JIPDA with exact association probabilities; of several motions, or a mixture in every track.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model: one motion or several, a linear sensor or a radar.
    components : int
        Most components of each track; 1 is JIPDA.
    reduction : str
        Reduction of each track to `components`, such as "runnalls" or "capping".
    confirm : float
        Existence from which a track is declared until it is dropped.
    drop, drop_confirmed : float
        Existence below which a track is dropped before and after it is confirmed.
    prune_weight : float
        Hypotheses of less weight in their track are pruned before the reduction.
    tracks : int
        Most tracks.
    association : {"exact", "belief-propagation"}
        "exact" enumerates the association events of each cluster of tracks, up to a size.

    Returns
    -------
    Jipda

    Raises
    ------
    ValueError
        Naming the parameter that is out of range.

    References
    ----------
    Musicki and Evans 2004; exact probabilities by Maskell, Briers and Wright 2004.
    """
    return Jipda(
        model,
        collapsing(reduction, components),
        confirm,
        drop,
        drop_confirmed,
        prune_weight,
        tracks,
        association,
    )
