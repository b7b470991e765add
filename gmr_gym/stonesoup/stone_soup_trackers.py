"""Trackers of Stone Soup as those here: in `evaluation.run`, in environments, wherever there is a `step`.

They are slow, a hundred to a thousand times a tracker here: objects are made of all detections, and their own
code makes more.
"""

from collections.abc import Callable
from dataclasses import dataclass
from datetime import datetime, timedelta
from typing import Any, NamedTuple

import numpy as np
from stonesoup.base import Property
from stonesoup.dataassociator.probability import PDA
from stonesoup.deleter.error import CovarianceBasedDeleter
from stonesoup.hypothesiser.probability import PDAHypothesiser
from stonesoup.initiator.base import Initiator
from stonesoup.predictor.kalman import KalmanPredictor
from stonesoup.tracker.base import Tracker
from stonesoup.tracker.simple import SingleTargetMixtureTracker
from stonesoup.types.mixture import GaussianMixture
from stonesoup.types.state import GaussianState
from stonesoup.types.track import Track
from stonesoup.updater.kalman import KalmanUpdater

from gmr_gym.filters.tracker import MultiTargetReport, Report, check_scan
from gmr_gym.mixture import Mixture, joined, mean_and_covariance
from gmr_gym.models.clutter import no_components
from gmr_gym.models.gating import gates
from gmr_gym.models.kalman import predict
from gmr_gym.models.model import Model
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.stonesoup.detections import detections_of
from gmr_gym.stonesoup.mixtures import mixture_of, vector
from gmr_gym.stonesoup.models import measurement_model_of, transition_model_of

START = datetime(2000, 1, 1)  # of the prior
NEVER = np.inf  # trace of a covariance at which a track is deleted


class Running(NamedTuple):
    """A tracker of Stone Soup under way."""

    tracker: Any
    scans: int  # so far
    last: Mixture  # posterior of the last scan
    labels: dict[str, int]  # of the ids of tracks, in order of their appearance


@dataclass(frozen=True)
class StoneSoupTracker:
    """A tracker of Stone Soup for one target.

    Of several tracks the one with the most states counts. Without any the target is given up, and predicted.

    Parameters
    ----------
    model : Model
        The filter model, of one motion and a linear sensor. The gates of a report are those of this model.
    build : callable
        From the model, a tracker of Stone Soup with the method `update_tracker`, such as `pda_of`. It begins
        with a scan of no detections at `START`, one period before the first, in which its initiator may give
        the prior: `PriorInitiator`.
    period : float
        From scan to scan, s.

    Notes
    -----
    Departs: a belief cannot be gone back to, for trackers of Stone Soup change as they run.
    """

    model: Model
    build: Callable[[Model], Any]
    period: float = 1.0

    def init(self) -> Running:
        """Belief one period before the first scan."""
        tracker = self.build(self.model)
        tracker.update_tracker(START, set())
        return Running(tracker, 0, self.model.prior, {})

    def step(self, belief: Running, z: np.ndarray) -> tuple[Running, Report]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        model = self.model
        predicted = predict(belief.last, model.motion)
        tracks = updated(belief, z, len(model.sensor.H), self.period)
        kept = mixture_of(max(tracks, key=len)) if tracks else predicted
        mean, P = mean_and_covariance(kept)
        used = gates(predicted, model.sensor, model.gate_probability)
        report = Report(mean[None], P[None], used, kept, bool(tracks))
        return belief._replace(scans=belief.scans + 1, last=kept), report


@dataclass(frozen=True)
class StoneSoupMultiTargetTracker:
    """A tracker of Stone Soup for many targets.

    Every track counts as a target, which exists with the weight of its state where that has one, and else
    certainly.

    Parameters
    ----------
    model : MultiTargetModel
        The filter model.
    build : callable
        From the model, a tracker of Stone Soup with the method `update_tracker`.
    period : float
        From scan to scan, s.

    Notes
    -----
    Departs: a belief cannot be gone back to, for trackers of Stone Soup change as they run.
    """

    model: MultiTargetModel
    build: Callable[[MultiTargetModel], Any]
    period: float = 1.0

    def init(self) -> Running:
        """Belief one period before the first scan."""
        return Running(self.build(self.model), 0, self.model.initial, {})

    def step(self, belief: Running, z: np.ndarray) -> tuple[Running, MultiTargetReport]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        model, labels = self.model, dict(belief.labels)
        found = updated(belief, z, len(model.sensor.H), self.period)
        tracks = sorted(found, key=lambda track: track.state_vector.ravel().tolist())
        for track in tracks:
            labels.setdefault(track.id, len(labels))
        targets = joined([no_components(len(model.motion.F)), *map(target_of, tracks)])
        report = MultiTargetReport(
            targets.m, targets.w, np.array([labels[track.id] for track in tracks], np.int64),
            float(targets.w.sum()), targets, model.clutter,
        )  # fmt: skip
        return Running(belief.tracker, belief.scans + 1, targets, labels), report


class PriorInitiator(Initiator):
    """Starts a track from a prior, whatever is detected.

    Parameters
    ----------
    prior : GaussianState
        State of the new track; its time becomes that of the scan.
    """

    prior: GaussianState = Property()

    def initiate(self, detections: set, timestamp: datetime, **kwargs: Any) -> set[Track]:
        """One track, of the prior."""
        return {Track([GaussianState.from_state(self.prior, timestamp=timestamp)])}


def pda_of(model: Model) -> Tracker:
    """Stone Soup's probabilistic data association for a filter model, with its own parts.

    Parameters
    ----------
    model : Model
        Of one motion and a linear sensor that measures single states; a prior of several Gaussians is merged.

    Returns
    -------
    SingleTargetMixtureTracker
    """
    predictor = KalmanPredictor(transition_model_of(model.motion))
    updater = KalmanUpdater(measurement_model_of(model.sensor))
    hypothesiser = PDAHypothesiser(
        predictor, updater, model.clutter_density, model.detection_probability, model.gate_probability
    )
    mean, P = mean_and_covariance(model.prior)
    return SingleTargetMixtureTracker(
        PriorInitiator(GaussianState(vector(mean), P)), CovarianceBasedDeleter(NEVER), None,
        PDA(hypothesiser), updater,
    )  # fmt: skip


def updated(belief: Running, z: np.ndarray, p: int, period: float) -> set[Track]:
    """Tracks after the scan z (k, p)."""
    time = START + timedelta(seconds=(belief.scans + 1) * period)
    _, tracks = belief.tracker.update_tracker(time, detections_of(check_scan(z, p), time))
    return {*tracks}


def target_of(track: Track) -> Mixture:
    """The last state of a track as one Gaussian, weighted by the probability that it exists."""
    state = track.state
    w = 1.0 if isinstance(state, GaussianMixture) else min(float(getattr(state, "weight", 1.0)), 1.0)
    return Mixture(np.array([w]), *(a[None] for a in mean_and_covariance(mixture_of(state))))
