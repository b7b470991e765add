"""Nearest neighbour: the gated detection closest to the prediction is taken as target-originated."""

from dataclasses import dataclass

import numpy as np

from gmr_gym.filters.association import expand
from gmr_gym.filters.trace import Trace
from gmr_gym.filters.tracker import Report, check_scan
from gmr_gym.mixture import Mixture, collapsed
from gmr_gym.models.gating import gated_distances, gates
from gmr_gym.models.kalman import predict
from gmr_gym.models.model import Model, check_one_motion


@dataclass(frozen=True)
class NearestNeighbour:
    """Kalman filter updated with the gated detection of least Mahalanobis distance; an empty gate coasts.

    Parameters
    ----------
    model : Model
        The filter model, of one motion.
    """

    model: Model

    def __post_init__(self):
        check_one_motion(self.model)

    def init(self) -> Mixture:
        """Belief one period before the first scan."""
        return collapsed(self.model.prior)

    def step(self, belief: Mixture, z: np.ndarray) -> tuple[Mixture, Report]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        return self._scan(belief, z)[:2]

    def trace(self, belief: Mixture, z: np.ndarray) -> tuple[Mixture, Report, Trace]:
        """What `step` gives, and which detection was taken: a single hypothesis."""
        belief, report, detection = self._scan(belief, z)
        one = np.zeros(1, np.int64)
        return belief, report, Trace(belief, one, np.array([detection]), one, one)

    def _scan(self, belief: Mixture, z: np.ndarray) -> tuple[Mixture, Report, int]:
        """Belief, report, and the row of the detection that was taken, -1 for none."""
        z = check_scan(z, len(self.model.sensor.H))
        belief = predict(belief, self.model.motion)
        gates_used = gates(belief, self.model.sensor, self.model.gate_probability)
        distance = gated_distances(belief, gates_used, self.model.sensor, z)[0]
        detection = int(distance.argmin()) if len(z) and np.isfinite(distance.min()) else -1
        if detection >= 0:
            # certain association
            belief = expand(belief, gates_used, self.model.sensor, z[[detection]], 1.0, 1.0, 1.0).mixture
        return belief, Report(belief.m, belief.P, gates_used, belief), detection
