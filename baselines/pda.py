"""Probabilistic data association: the whole posterior of a scan merged into one Gaussian."""

from dataclasses import dataclass

import numpy as np

from gmr_gym.association import expand, gates
from gmr_gym.kalman import predict
from gmr_gym.mixture import Mixture, collapsed
from gmr_gym.model import Model
from gmr_gym.tracker import Report, check_scan


@dataclass(frozen=True)
class Pda:
    """Probabilistic data association filter: every gated detection, weighted by its probability,
    moves one Gaussian (Bar-Shalom and Tse 1975; an MHT merged down to one hypothesis)."""

    model: Model

    def init(self) -> Mixture:
        return collapsed(self.model.prior)

    def step(self, belief: Mixture, z: np.ndarray) -> tuple[Mixture, Report]:
        model = self.model
        z = check_scan(z, len(model.sensor.H))
        predicted = predict(belief, model.motion)
        looked = gates(predicted, model.sensor, model.gate_probability)
        posterior = expand(
            predicted, looked, model.sensor, z,
            model.detection_probability, model.gate_probability, model.clutter_density,
        )  # fmt: skip
        merged = collapsed(posterior.mixture)
        return merged, Report(merged.m, merged.P, looked, merged)
