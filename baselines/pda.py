"""Probabilistic data association: the full posterior of a scan merged into one Gaussian."""

from dataclasses import dataclass

import numpy as np

from gmr_gym.filters.mht import pda_update
from gmr_gym.filters.tracker import Report, check_scan
from gmr_gym.mixture import Mixture, collapsed
from gmr_gym.models.model import Model, check_one_motion


@dataclass(frozen=True)
class Pda:
    """Probabilistic data association: all gated detections, weighted by probability, update one Gaussian.

    It is an MHT merged down to one hypothesis; the formulas stand at `gmr_gym.filters.mht.pda_update`.

    Parameters
    ----------
    model : Model
        The filter model, of one motion.

    References
    ----------
    Bar-Shalom and Tse 1975.
    """

    model: Model

    def __post_init__(self):
        check_one_motion(self.model)

    def init(self) -> Mixture:
        """Belief one period before the first scan."""
        return collapsed(self.model.prior)

    def step(self, belief: Mixture, z: np.ndarray) -> tuple[Mixture, Report]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        merged, gates = pda_update(belief, self.model, check_scan(z, len(self.model.sensor.H)))
        return merged, Report(merged.m, merged.P, gates, merged)
