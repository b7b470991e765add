"""Protocols of trackers, and what they report of a scan."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from gmr_gym.mixture import Mixture
from gmr_gym.models.clutter import Clutter
from gmr_gym.models.gating import Gates
from gmr_gym.models.model import Model
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.points import check_points

ONE_MODE = np.ones(1)  # mode probabilities where the model has one motion
ONE_MODE.setflags(write=False)


class Report(NamedTuple):
    """Report of a single-target tracker on one scan.

    Attributes
    ----------
    x : ndarray, shape (1, d)
        Estimate of the state.
    P : ndarray, shape (1, d, d)
        Its covariance according to the tracker.
    gates : Gates
        Gates used for the scan; for a radar, in Cartesian coordinates.
    mixture : Mixture
        Hypotheses after the reduction.
    alive : bool
        False when the tracker has given the target up and only predicts.
    modes : ndarray, shape (r,)
        Probability of each motion model.
    """

    x: np.ndarray
    P: np.ndarray
    gates: Gates
    mixture: Mixture
    alive: bool = True
    modes: np.ndarray = ONE_MODE


class CompiledTracker(NamedTuple):
    """A tracker for compiled loops, equal to its `step` to the last bit.

    A tracker that has one hands it over by a property `compiled`, for linear sensors; None where it has not.

    Attributes
    ----------
    scan : kernel
        `scan(told, belief, z)` processes the detections z (k, p): the belief after them, the Report, with all
        its fields, and the number of detections in the gates, counted in each.
    told : tuple
        Constant parameters.
    belief : tuple
        Belief one period before the first scan, of arrays and numbers of the types that `scan` returns.
    """

    scan: Callable
    told: tuple
    belief: tuple


class Tracker(Protocol):
    """A single-target tracker: frozen parameters.

    The belief, private to the tracker, is passed in and returned; the tracker stores nothing between scans.
    """

    @property
    def model(self) -> Model:
        """The filter model."""

    def init(self) -> Any:
        """Belief one period before the first scan."""

    def step(self, belief: Any, z: np.ndarray) -> tuple[Any, Report]:
        """Predict by one period and update with a scan.

        Parameters
        ----------
        belief
            Belief after the last scan.
        z : ndarray, shape (k, p)
            Detections.

        Returns
        -------
        belief
            Belief after the scan.
        report : Report
        """


def check_scan(z, p: int) -> np.ndarray:
    """Check the detections of a scan.

    Parameters
    ----------
    z : array_like, shape (k, p)
        Detections; masked ones are dropped. An empty list is an empty scan.
    p : int
        Dimension of a detection.

    Returns
    -------
    ndarray of float, shape (k, p)

    Raises
    ------
    ValueError
        As `gmr_gym.points.check_points`, among others for a coordinate beyond +-1e10.
    """
    return check_points(z, p)


class MultiTargetReport(NamedTuple):
    """Report of a multi-target tracker on one scan.

    Attributes
    ----------
    x : ndarray, shape (j, d)
        States of the declared targets.
    existence : ndarray, shape (j,)
        Probability that each exists.
    label : ndarray, shape (j,)
        Label of each, constant over scans for one target; -1 for none.
    expected_targets : float
        Expected number of targets.
    intensity : Mixture
        Intensity of targets; weights sum to `expected_targets` up to rounding.
    clutter : Clutter
        Clutter assumed or estimated after the scan.
    approximated : int
        Clusters of tracks in the scan too large for exact association probabilities.
    """

    x: np.ndarray
    existence: np.ndarray
    label: np.ndarray
    expected_targets: float
    intensity: Mixture
    clutter: Clutter
    approximated: int = 0


class MultiTargetTracker(Protocol):
    """A multi-target tracker: frozen parameters, as `Tracker`.

    The belief is passed in and returned.
    """

    @property
    def model(self) -> MultiTargetModel:
        """The filter model."""

    def init(self) -> object:
        """Belief one period before the first scan."""

    def step(self, belief, z: np.ndarray) -> tuple[object, MultiTargetReport]:
        """Predict by one period and update with a scan.

        Parameters
        ----------
        belief
            Belief after the last scan.
        z : ndarray, shape (k, p)
            Detections.

        Returns
        -------
        belief
            Belief after the scan.
        report : MultiTargetReport
        """


class KnownClutterTracker(ABC):
    """A multi-target tracker that knows the clutter of a scan: its filter model's, or one that is passed."""

    model: MultiTargetModel

    @abstractmethod
    def init(self) -> Any:
        """Belief one period before the first scan."""

    @abstractmethod
    def update(self, belief: Any, z: np.ndarray, clutter: Clutter) -> tuple[Any, np.ndarray]:
        """Predict by one period and update with a scan.

        Parameters
        ----------
        belief
            Belief after the last scan.
        z : ndarray, shape (k, p)
            Detections.
        clutter : Clutter

        Returns
        -------
        posterior
        p_clutter : ndarray, shape (k,)
            Probability that each detection is a false alarm.
        """

    @abstractmethod
    def report(self, posterior: Any, clutter: Clutter) -> tuple[Any, MultiTargetReport]:
        """Belief and report after an update; `clutter` is to be reported."""

    def step(self, belief: Any, z: np.ndarray) -> tuple[Any, MultiTargetReport]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        z = check_scan(z, len(self.model.sensor.H))
        posterior, _ = self.update(belief, z, self.model.clutter)
        return self.report(posterior, self.model.clutter)
