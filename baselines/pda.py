"""Probabilistic data association: the full posterior of a scan merged into one Gaussian."""

from dataclasses import dataclass

import numpy as np

from gmr_gym.filters.mht import gate_and_log_weights, pda_scan, pda_update, predict_and_update
from gmr_gym.filters.trace import Trace, trace_of
from gmr_gym.filters.tracker import ONE_MODE, CompiledTracker, Report, check_scan
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture, collapsed
from gmr_gym.models.gating import Gates, count_gated
from gmr_gym.models.kalman import Sensor
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

    @property
    def compiled(self) -> CompiledTracker | None:
        """Its form for compiled loops; None for a radar, and for another class that inherits from this."""
        model = self.model
        if type(self) is not Pda or not isinstance(model.sensor, Sensor):
            return None
        told = model.motion[:], model.sensor[:], gate_and_log_weights(model)
        return CompiledTracker(_scan, told, self.init()[:])

    def init(self) -> Mixture:
        """Belief one period before the first scan."""
        return collapsed(self.model.prior)

    def step(self, belief: Mixture, z: np.ndarray) -> tuple[Mixture, Report]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        merged, gates = pda_update(belief, self.model, check_scan(z, len(self.model.sensor.H)))
        return merged, Report(merged.m, merged.P, gates, merged)

    def trace(self, belief: Mixture, z: np.ndarray) -> tuple[Mixture, Report, Trace]:
        """What `step` gives, and the full posterior, all of which is merged."""
        full, _ = predict_and_update(belief, self.model, check_scan(z, len(self.model.sensor.H)))
        return *self.step(belief, z), trace_of(full, np.zeros_like(full.parent))


@kernel(inline="always")
def _scan(told, belief, z):
    """`Pda.step` for a linear sensor, see `CompiledTracker`."""
    motion, sensor, weights = told
    merged, (centres, S, threshold) = pda_scan(belief, motion, sensor, z, *weights)
    w, m, P = merged
    report = Report(m, P, Gates(centres, S, threshold), Mixture(w, m, P), True, ONE_MODE)
    return merged, report, count_gated(centres, S, threshold, z)
