"""Trackers of one target as those of Stone Soup: they take its detectors, and give its tracks."""

from abc import abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.reader.base import DetectionReader
from stonesoup.tracker.base import Tracker
from stonesoup.types.track import Track

from gmr_gym.filters.registry import make_tracker
from gmr_gym.filters.tracker import Report
from gmr_gym.models.gating import Gates, gated_pairs
from gmr_gym.models.model import Model
from gmr_gym.stonesoup.detections import scan_of
from gmr_gym.stonesoup.models import model_of, reordered, state_order
from gmr_gym.stonesoup.track_states import Origin, track_state

DIRECT = object.__getattribute__  # that of a Track is slow: it looks for what it lacks in its last state
FIRST = timedelta(seconds=1)  # an interval: the belief before the first scan does not depend on it
NO_TIME = timedelta(0)
MOST_BUILT = 1000  # trackers for intervals that are kept
NO_NOISE = np.empty((0, 0, 0))  # of detections: all have the sensor's


class ScanTracker(Tracker):
    """A tracker of Stone Soup that takes whole scans.

    Parameters
    ----------
    detector : DetectionReader, optional
        Source of detections; not needed where `update_tracker` is called.
    tracker : str
        Name of a tracker, see `gmr-gym list`.
    parameters : mapping of str to object, optional
        Its parameters.
    """

    detector: DetectionReader = Property(default=None)
    tracker: str = Property()
    parameters: Mapping[str, Any] = Property(default=None)
    _time: datetime | None  # of the last scan, or the prior

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._made: Any = make_tracker(self.tracker, self._model(FIRST), **(self.parameters or {}))
        self._built: dict[timedelta, Any] = {}
        self._interval, self._current = FIRST, self._made
        self._belief = self._made.init()

    def __iter__(self) -> Iterator[tuple[datetime, set[Track]]]:
        if self.detector is None:
            raise ValueError("detector must be given to iterate; or call update_tracker with each scan")
        self._scans = iter(self.detector)
        return self

    def __next__(self) -> tuple[datetime, set[Track]]:
        return self.update_tracker(*next(self._scans))

    @abstractmethod
    def update_tracker(self, time: datetime, detections: Iterable) -> tuple[datetime, set[Track]]:
        """Update the tracks with a scan."""

    @abstractmethod
    def _model(self, interval: timedelta) -> Any:
        """The filter model of an interval."""

    def _of(self, interval: timedelta) -> Any:
        """The tracker for an interval."""
        if interval != self._interval:
            if interval not in self._built:
                if len(self._built) == MOST_BUILT:
                    self._built.clear()
                self._built[interval] = self._with_motion(self._model(interval))
            self._interval, self._current = interval, self._built[interval]
        return self._current

    def _with_motion(self, model: Any) -> Any:
        """The tracker with the motion of another interval, without looking for it by its name again."""
        made, name = self._made, "motions" if "motions" in model._fields else "motion"
        moves = getattr(model, name)
        # of another length where the tracker takes one motion of several
        if "model" in made.__dataclass_fields__ and len(moves) == len(getattr(made.model, name)):
            return replace(made, model=made.model._replace(**{name: moves}))
        return make_tracker(self.tracker, model, **(self.parameters or {}))

    def _elapsed(self, time: datetime) -> timedelta:
        """Since the last scan, or the prior; no time before a first scan without one."""
        last = time if self._time is None else self._time
        try:
            elapsed = time - last
        except TypeError:
            raise ValueError(
                f"timestamps must all have a time zone, or none, got {time} after {last}"
            ) from None
        if elapsed < NO_TIME:
            raise ValueError(f"scans must be in order of time, but {time} follows {self._time}")
        self._time = time
        return elapsed


class SingleTargetTracker(ScanTracker):
    """One target by any tracker of one target: Gaussian-mixture MHT, PDA, IMM, ...

    The track begins with the prior. A state of it is the mean and covariance; `components` of a state are
    its hypotheses. A state is an Update where detections were in the gates, and its `hypothesis` has those.
    When the tracker gives the target up, there are no tracks any more; `track` is still there.

    Parameters
    ----------
    prior : GaussianState or GaussianMixture
        With the timestamp at which it holds.
    transition_model : TransitionModel or sequence of r TransitionModel
        Linear; several are the modes of an IMM and the like.
    measurement_model : LinearGaussian or CartesianToElevationBearingRange
    clutter_spatial_density : float
        False alarms per unit volume of the detections' space.
    prob_detect, prob_gate : float
        Probabilities that the target is detected, and that its detection is in the gate.
    model_probs : array_like (r, r), optional
        Transition matrix of several models, see `switching_of`.
    mode_prior : array_like (r,), optional
        Probability of each model at the time of the prior; by default all are equal.
    measurement_update : str
        Update of a radar, see `sensor_of`.
    detector, tracker, parameters
        As of `ScanTracker`; a tracker of one target.

    Raises
    ------
    ValueError
        For a prior without a timestamp, models that there are not here, and as `gmr_gym.make_tracker`.
    """

    prior: Any = Property()
    transition_model: Any = Property()
    measurement_model: Any = Property()
    clutter_spatial_density: float = Property()
    prob_detect: float = Property(default=0.9)
    prob_gate: float = Property(default=0.999)
    model_probs: np.ndarray = Property(default=None)
    mode_prior: np.ndarray = Property(default=None)
    measurement_update: str = Property(default="debiased")
    tracker: str = Property(default="runnalls-30")

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        if self.prior.timestamp is None:
            raise ValueError("prior must have a timestamp, the time at which it holds")
        order = state_order(self.measurement_model)
        self._back = np.argsort(order)
        self._same = np.array_equal(order, np.arange(len(order)))
        self._time = self.prior.timestamp
        several = isinstance(self.transition_model, Sequence)
        self._single = None if several else self.transition_model
        self._alive = True
        self.track = Track([self.prior])

    @property
    def tracks(self) -> set[Track]:
        """The track, unless it is given up."""
        return {self.track} if self._alive else set()

    def update_tracker(self, time: datetime, detections: Iterable) -> tuple[datetime, set[Track]]:
        """Update the track with a scan.

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
            As `scan_of`, and for a time that goes back.
        """
        found, z = scan_of(detections, self.measurement_model, time)
        tracker = self._of(self._elapsed(time))
        self._belief, report = tracker.step(self._belief, z)
        self._alive = bool(report.alive)
        near = in_gates(report.gates, tracker.model.sensor.to_gate_space(z)) if found else []
        self._append(report, time, [found[j] for j in near])
        return time, self.tracks

    def _model(self, interval: timedelta) -> Model:
        return model_of(
            self.transition_model, self.measurement_model, self.prior, interval,
            prob_detect=self.prob_detect, prob_gate=self.prob_gate,
            clutter_spatial_density=self.clutter_spatial_density, model_probs=self.model_probs,
            mode_prior=self.mode_prior, update=self.measurement_update,
        )  # fmt: skip

    def _append(self, report: Report, time: datetime, near: list) -> None:
        """`Track.append`, which makes the hypotheses of every state to look for metadata."""
        x, P, p = report.x[0], report.P[0], report.mixture
        if not self._same:
            x, P, p = x[self._back], P[np.ix_(self._back, self._back)], reordered(p, self._back)
        states, metadatas = DIRECT(self.track, "states"), DIRECT(self.track, "metadatas")
        states.append(track_state(x, P, p, time, Origin(near, states[-1], self._single)))
        metadata = metadatas[-1]
        for one in near:
            if one.metadata:
                metadata = {**metadata, **one.metadata}
        metadatas.append(metadata)


class MhtTracker(SingleTargetTracker):
    """One target by the Gaussian-mixture MHT, reduced by any reduction.

    Parameters as of `SingleTargetTracker`; `parameters` are those of `gmr_gym.baselines.mht.mht`: components,
    reduction, prune_weight, prune_density.
    """

    tracker: str = Property(default="mht")


class PdaTracker(SingleTargetTracker):
    """One target by probabilistic data association; parameters as of `SingleTargetTracker`."""

    tracker: str = Property(default="pda")


def in_gates(gates: Gates, z: np.ndarray) -> list[int]:
    """Rows of the detections z (k, p) that are in any of the gates."""
    first, detection, _ = gated_pairs(gates.z, gates.S, z[None], NO_NOISE, gates.threshold)
    rows = detection[: first[-1]].tolist()
    return rows if len(first) == 2 else sorted({*rows})  # of one gate in order, and each once
