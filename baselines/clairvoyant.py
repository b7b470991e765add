"""The Kalman filter that is told which detection is the target's: the bound for every score."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gmr_gym.association import gates
from gmr_gym.kalman import condition, predict
from gmr_gym.mixture import Mixture, collapsed
from gmr_gym.model import Model
from gmr_gym.tracker import Report, check_scan


@dataclass(frozen=True)
class Clairvoyant:
    """Kalman filter that is told the association: whoever runs it hands it the target's own
    detection and no clutter. No tracker that has to guess can be expected to do better."""

    model: Model
    told_origin: ClassVar[bool] = True

    def init(self) -> Mixture:
        return collapsed(self.model.prior)

    def step(self, belief: Mixture, z: np.ndarray) -> tuple[Mixture, Report]:
        z = check_scan(z, len(self.model.sensor.H))
        if len(z) > 1:
            raise ValueError(f"the clairvoyant filter takes the target's detection alone, got {len(z)}")
        belief = predict(belief, self.model.motions[0])
        looked = gates(belief, self.model.sensor, self.model.gate_probability)
        if len(z):
            belief, _ = condition(belief, self.model.sensor, z)
        return belief, Report(belief.m, belief.P, looked, belief)
