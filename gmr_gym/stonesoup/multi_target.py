"""Trackers of many targets as those of Stone Soup: they take its detectors, and give its tracks."""

from collections.abc import Iterable, Iterator
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.types.array import CovarianceMatrix
from stonesoup.types.state import TaggedWeightedGaussianState
from stonesoup.types.track import Track

from gmr_gym.filters.tracker import MultiTargetReport
from gmr_gym.models.clutter import uniform_clutter
from gmr_gym.models.multi_target import MultiTargetModel, multi_target_model
from gmr_gym.stonesoup.detections import scan_of
from gmr_gym.stonesoup.mixtures import mixture_of, vector
from gmr_gym.stonesoup.models import linear_sensor, motion_of
from gmr_gym.stonesoup.trackers import ScanTracker


class MultiTargetTracker(ScanTracker):
    """Many targets by any tracker that labels them; the Poisson multi-Bernoulli by default.

    A state of a track is weighted by the probability that the target exists, and tagged with the label. Only
    declared targets have tracks.

    Parameters
    ----------
    transition_model : TransitionModel
        Linear.
    measurement_model : LinearGaussian
    births : GaussianMixture or sequence of WeightedGaussianState
        Intensity of the targets born in a scan: their expected numbers, and where.
    meas_range : array_like (p, 2)
        Box in which false alarms fall.
    clutter_rate : float
        Expected number of false alarms in it, per scan.
    prob_detect, prob_survival : float
        Probabilities that a target is detected, and that it is still there a scan later.
    initial : GaussianMixture or sequence of WeightedGaussianState, optional
        Intensity of the targets that are there before, with the time at which it holds.
    detector, tracker, parameters
        As of `ScanTracker`; a tracker of many targets.

    Raises
    ------
    ValueError
        For models that there are not here, a prior without a time, and as `gmr_gym.make_tracker`.
    """

    transition_model: Any = Property()
    measurement_model: Any = Property()
    births: Any = Property()
    meas_range: np.ndarray = Property()
    clutter_rate: float = Property()
    prob_detect: float = Property(default=0.9)
    prob_survival: float = Property(default=0.99)
    initial: Any = Property(default=None)
    tracker: str = Property(default="pmb")

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._time = None if self.initial is None else _time_of(self.initial)
        self._of_label: dict[int, Track] = {}
        self._declared: set[Track] = set()

    @property
    def tracks(self) -> set[Track]:
        """Tracks of the targets declared in the last scan."""
        return self._declared

    def update_tracker(self, time: datetime, detections: Iterable) -> tuple[datetime, set[Track]]:
        """Update the tracks with a scan.

        Parameters
        ----------
        time : datetime
            Not before that of the last scan.
        detections : iterable of Detection
            All at that time, and of one sensor.

        Returns
        -------
        time : datetime
        tracks : set of Track

        Raises
        ------
        ValueError
            As `scan_of`, for a time that goes back, and for a tracker that has no labels.
        """
        _, z = scan_of(detections, self.measurement_model, time)
        self._belief, report = self._of(self._elapsed(time)).step(self._belief, z)
        self._declared = {self._appended(label, *state) for label, *state in self._states(report, time)}
        return time, self.tracks

    def _states(self, report: MultiTargetReport, time: datetime) -> Iterator[tuple]:
        """Label and state of each declared target."""
        for x, existence, label in zip(report.x, report.existence, report.label.tolist(), strict=True):
            if label < 0:
                raise ValueError(
                    f"tracker {self.tracker!r} has no labels, of which tracks are made; take pmb"
                )
            (row, *_) = np.flatnonzero((report.intensity.m == x).all(axis=1))
            P = report.intensity.P[row].view(CovarianceMatrix)
            yield (
                label,
                TaggedWeightedGaussianState(vector(x), P, time, weight=float(existence), tag=str(label)),
            )

    def _appended(self, label: int, state: TaggedWeightedGaussianState) -> Track:
        track = self._of_label.setdefault(label, Track(id=str(label)))
        track.append(state)
        return track

    def _model(self, interval: timedelta) -> MultiTargetModel:
        low, high = np.array(self.meas_range, float).T
        initial = None if self.initial is None else mixture_of(self.initial)
        return multi_target_model(
            motion_of(self.transition_model, interval), linear_sensor(self.measurement_model),
            float(self.prob_detect), float(self.prob_survival), mixture_of(self.births),
            uniform_clutter(low, high, self.clutter_rate), initial=initial,
        )  # fmt: skip


def _time_of(state: Any) -> datetime:
    parts = [state] if hasattr(state, "timestamp") else state
    time = next((part.timestamp for part in parts if part.timestamp is not None), None)
    if time is None:
        raise ValueError("initial must have a timestamp, the time at which it holds")
    return time
