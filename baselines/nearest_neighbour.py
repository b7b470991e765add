"""Nearest neighbour: the gated detection closest to the prediction is taken for the target's."""

from dataclasses import dataclass

import numpy as np

from gmr_gym.association import gated_distances, gates
from gmr_gym.kalman import condition, predict
from gmr_gym.mixture import Mixture, collapsed
from gmr_gym.model import Model
from gmr_gym.tracker import Report, check_scan


@dataclass(frozen=True)
class NearestNeighbour:
    """Kalman filter fed the gated detection of least Mahalanobis distance; an empty gate coasts."""

    model: Model

    def init(self) -> Mixture:
        return collapsed(self.model.prior)

    def step(self, belief: Mixture, z: np.ndarray) -> tuple[Mixture, Report]:
        z = check_scan(z, len(self.model.sensor.H))
        belief = predict(belief, self.model.motion)
        looked = gates(belief, self.model.sensor, self.model.gate_probability)
        distance = gated_distances(looked, z)[0]
        if len(z) and np.isfinite(distance.min()):
            belief, _ = condition(belief, self.model.sensor, z[[distance.argmin()]])
        return belief, Report(belief.m, belief.P, looked, belief)
