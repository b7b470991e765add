"""What a tracker is, what it says of a scan, and how trackers are found by name."""

from typing import Any, NamedTuple, Protocol

import numpy as np

from gmr_gym.mixture import Mixture
from gmr_gym.models.clutter import Clutter
from gmr_gym.models.gating import Gates
from gmr_gym.models.model import Model
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.points import check_points

UNLIMITED = 10**9  # hypotheses, for what costs no more than they are many
ONE_MODE = np.ones(1)  # of the one motion there is
ONE_MODE.setflags(write=False)


class Report(NamedTuple):
    """What a tracker says of one scan."""

    x: np.ndarray  # (j, d), estimates: one for a single-target tracker
    P: np.ndarray  # (j, d, d), the covariances it claims for them
    gates: Gates  # where it looked for the target's detection; of a radar, a yardstick in space
    mixture: Mixture  # the hypotheses it kept
    alive: bool = True  # False when it has given the target up, and only coasts
    modes: np.ndarray = ONE_MODE  # (r,), probability of each of the model's motions


class Tracker(Protocol):
    """A frozen dataclass of parameters. The belief is its private affair: it goes in and comes
    out, and nothing is remembered in between."""

    @property
    def model(self) -> Model:
        """What it was told."""

    def init(self) -> Any:
        """The belief one period before the first scan."""

    def step(self, belief: Any, z: np.ndarray) -> tuple[Any, Report]:
        """The belief after the scan z (k, p) one period later, and the report on that scan."""


def check_scan(z, p: int) -> np.ndarray:
    """The detections as floats (k, p), (0, p) for an empty scan, without those masked; ValueError as in
    `points.check_points`: so no scan that a tracker takes holds a coordinate beyond +-1e10."""
    return check_points(z, p)


class MultiTargetReport(NamedTuple):
    """What a tracker of many targets says of a scan."""

    x: np.ndarray  # (j, d), the targets it is ready to name
    existence: np.ndarray  # (j,), how sure it is of each, in [0, 1]
    label: np.ndarray  # (j,), the same from scan to scan for what it takes to be the same target; -1 for none
    expected_targets: float
    intensity: Mixture  # of targets, what it believes; weights sum to `expected_targets`, but for rounding
    clutter: Clutter  # what it believes of false detections, after the scan


class MultiTargetTracker(Protocol):
    """As `tracker.Tracker`, for many targets: frozen parameters, a belief in and out."""

    @property
    def model(self) -> MultiTargetModel:
        """What it was told."""

    def init(self) -> object:
        """The belief one period before the first scan."""

    def step(self, belief, z: np.ndarray) -> tuple[object, MultiTargetReport]:
        """The belief after the scan z (k, p) one period later, and the account of that scan."""
