"""Trackers of certain targets whose tracks a logic confirms and drops: a scan in three stages.

Confirmed tracks choose among all detections, tentative ones among those that remain, and what then remains
starts new tracks: false alarms near a confirmed track do not take its detections (Blackman and Popoli 1999).
"""

from abc import abstractmethod
from typing import NamedTuple

import numpy as np

from gmr_gym.filters import track_logic
from gmr_gym.filters.mixture_tracks import (
    FREE,
    MixtureTracks,
    added,
    collapsed,
    no_tracks,
    predict,
    started,
    take,
    undetected_at,
)
from gmr_gym.filters.track_logic import TrackHistory, TrackLogic
from gmr_gym.filters.tracker import KnownClutterTracker, MultiTargetReport
from gmr_gym.filters.undetected_targets import Intensity, appear, intensity_of, undetected_after
from gmr_gym.mixture import Mixture
from gmr_gym.models.clutter import Clutter
from gmr_gym.models.multi_target import MultiTargetModel


class ConfirmedTracks(NamedTuple):
    """Tracks and their histories.

    Attributes
    ----------
    tracks : MixtureTracks
        All of existence 1.
    history : TrackHistory
    undetected : Intensity
        Of targets not yet detected.
    next_label : int
        Next unused label.
    approximated : int
        Clusters of the last scan whose association probabilities are approximate.
    """

    tracks: MixtureTracks
    history: TrackHistory
    undetected: Intensity
    next_label: int
    approximated: int


class Stage(NamedTuple):
    """Tracks after a scan.

    Attributes
    ----------
    tracks : MixtureTracks
    unassigned : ndarray, shape (k,)
        Probability that each detection is of no track.
    hit : ndarray of bool, shape (n,)
        Whether each has a detection.
    gain : ndarray, shape (n,)
        What the scan adds to the score of each.
    approximated : int
    """

    tracks: MixtureTracks
    unassigned: np.ndarray
    hit: np.ndarray
    gain: np.ndarray
    approximated: int


class ConfirmingTracker(KnownClutterTracker):
    """A tracker whose tracks are certain targets, confirmed and dropped by a logic."""

    model: MultiTargetModel
    logic: TrackLogic
    start_probability: float
    tracks: int

    @abstractmethod
    def associate(
        self, tracks: MixtureTracks, tentative: np.ndarray, z: np.ndarray, log_kappa: np.ndarray
    ) -> Stage:
        """Predicted tracks after the detections z (k, p), of clutter of log intensity log_kappa (k,).

        Those that are `tentative` (n,) have only what the others leave."""

    def init(self) -> ConfirmedTracks:
        """Belief one period before the first scan."""
        nothing = track_logic.started(self.logic, np.empty(0))
        undetected = intensity_of(self.model.initial, self.model)
        return ConfirmedTracks(no_tracks(self.model), nothing, undetected, 0, 0)

    def update(
        self, belief: ConfirmedTracks, z: np.ndarray, clutter: Clutter
    ) -> tuple[ConfirmedTracks, np.ndarray]:
        """Belief after the scan `z` (k, p), and the probability (k,) that each is a false alarm."""
        model, history = self.model, belief.history
        log_kappa, tracks = np.log(clutter.density(z)), predict(belief.tracks, model)
        stage = self.associate(_certain(tracks), ~history.confirmed, z, log_kappa)
        history, kept = track_logic.advanced(self.logic, history, stage.hit, stage.gain)
        undetected = undetected_at(belief.undetected, tracks, model)
        appearing = appear(undetected, model, z, log_kappa)
        free = (stage.unassigned > FREE).astype(float)
        new, _ = started(appearing, z, free, self.start_probability)
        score = np.log(new.existence) - np.log1p(-new.existence)
        new = new._replace(label=belief.next_label + new.label)
        both = _certain(added(take(stage.tracks, np.flatnonzero(kept)), new))
        history = track_logic.joined(track_logic.take(history, kept), track_logic.started(self.logic, score))
        most = np.sort(np.argsort(~history.confirmed, kind="stable")[: self.tracks])
        posterior = ConfirmedTracks(
            take(both, most), track_logic.take(history, most),
            undetected_after(undetected, model, self.tracks), belief.next_label + len(new.label),
            stage.approximated,
        )  # fmt: skip
        return posterior, stage.unassigned * np.exp(-appearing.log_ratio)

    def report(
        self, posterior: ConfirmedTracks, clutter: Clutter
    ) -> tuple[ConfirmedTracks, MultiTargetReport]:
        """The belief, unchanged, and its report: the confirmed tracks."""
        shown = take(posterior.tracks, np.flatnonzero(posterior.history.confirmed))
        x, P = collapsed(shown)
        n = float(len(x))
        return posterior, MultiTargetReport(
            x, shown.existence, shown.label, n, Mixture(shown.existence, x, P), clutter,
            posterior.approximated,
        )  # fmt: skip


def _certain(tracks: MixtureTracks) -> MixtureTracks:
    return tracks._replace(existence=np.ones(len(tracks.existence)))
