"""The filter that knows which detection is target-originated: a bound for every score."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gmr_gym.checks import check_count
from gmr_gym.filters.association import Expansion, expand
from gmr_gym.filters.mode_mixture import MixtureWithModes, merge_mode_probabilities, predict_every_mode
from gmr_gym.filters.trace import Trace
from gmr_gym.filters.tracker import Report, check_scan
from gmr_gym.mixture import collapsed, mean_and_covariance
from gmr_gym.models.gating import gates
from gmr_gym.models.model import Model
from gmr_gym.reduction.runnalls import runnalls


@dataclass(frozen=True)
class Clairvoyant:
    """Kalman filter of known data association: it is given the target-originated measurement and no clutter.

    Its score bounds that of trackers with unknown association. With several motion models it knows nothing of
    the mode: it is then the filter of all model sequences, reduced by Runnalls' merging.

    Parameters
    ----------
    model : Model
        The filter model.
    components : int
        Most hypotheses.
    """

    model: Model
    components: int = 30
    knows_origin: ClassVar[bool] = True

    def __post_init__(self):
        check_count(self.components)

    def init(self) -> MixtureWithModes:
        """Belief one period before the first scan."""
        return MixtureWithModes(collapsed(self.model.prior), self.model.mode_prior[None])

    def step(self, belief: MixtureWithModes, z: np.ndarray) -> tuple[MixtureWithModes, Report]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        return self._scan(belief, z)[:2]

    def trace(self, belief: MixtureWithModes, z: np.ndarray) -> tuple[MixtureWithModes, Report, Trace]:
        """What `step` gives, and what became of every sequence of models with the scan, which is empty or the
        target's detection."""
        after, report, full, mode, into = self._scan(belief, z)
        parent = full.parent % len(belief.mixture.w)
        return after, report, Trace(full.mixture, parent, full.detection, into, mode)

    def _scan(
        self, belief: MixtureWithModes, z: np.ndarray
    ) -> tuple[MixtureWithModes, Report, Expansion, np.ndarray, np.ndarray]:
        """Belief and report; the full posterior, its modes (N,), and the origin of the reduction."""
        model = self.model
        z = check_scan(z, len(model.sensor.H))
        if len(z) > 1:
            raise ValueError(f"the clairvoyant filter takes the target's detection alone, got {len(z)}")
        predicted, mode = predict_every_mode(belief, model.motions, model.switching)
        gates_used = gates(predicted, model.sensor, model.gate_probability)
        # certain association of the detection, or a certain miss
        full = expand(predicted, gates_used._replace(threshold=np.inf), model.sensor, z, 1.0, 1.0, 1.0)
        reduced = runnalls(full.mixture, self.components)
        belief = merge_mode_probabilities(full.mixture, mode, reduced, len(model.motions))
        mean, covariance = mean_and_covariance(belief.mixture)
        mode_probabilities = belief.mixture.w @ belief.modes
        report = Report(mean[None], covariance[None], gates_used, belief.mixture, modes=mode_probabilities)
        return belief, report, full, mode, reduced[1]
