"""The filter that is told which detection is the target's: the bound for every score."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gmr_gym.checks import check_count
from gmr_gym.filters.association import expand
from gmr_gym.filters.mode_mixture import MixtureWithModes, merge_mode_probabilities, predict_every_mode
from gmr_gym.filters.tracker import Report, check_scan
from gmr_gym.mixture import collapsed, mean_and_covariance
from gmr_gym.models.gating import gates
from gmr_gym.models.model import Model
from gmr_gym.reduction.runnalls import runnalls


@dataclass(frozen=True)
class Clairvoyant:
    """Kalman filter that is told the association: whoever runs it hands it the target's own
    detection and no clutter. No tracker that has to guess can be expected to do better.

    Of several motions it is told nothing: it is then the filter of all model sequences, reduced to
    `components` by Runnalls.
    """

    model: Model
    components: int = 30
    knows_origin: ClassVar[bool] = True

    def __post_init__(self):
        check_count(self.components)

    def init(self) -> MixtureWithModes:
        return MixtureWithModes(collapsed(self.model.prior), self.model.mode_prior[None])

    def step(self, belief: MixtureWithModes, z: np.ndarray) -> tuple[MixtureWithModes, Report]:
        model = self.model
        z = check_scan(z, len(model.sensor.H))
        if len(z) > 1:
            raise ValueError(f"the clairvoyant filter takes the target's detection alone, got {len(z)}")
        predicted, mode = predict_every_mode(belief, model.motions, model.switching)
        gates_used = gates(predicted, model.sensor, model.gate_probability)
        # sure of the detection it is handed, and of nothing where there is none
        posterior = expand(
            predicted, gates_used._replace(threshold=np.inf), model.sensor, z, 1.0, 1.0, 1.0
        ).mixture
        belief = merge_mode_probabilities(
            posterior, mode, runnalls(posterior, self.components), len(model.motions)
        )
        mean, covariance = mean_and_covariance(belief.mixture)
        mode_probabilities = belief.mixture.w @ belief.modes
        return belief, Report(
            mean[None], covariance[None], gates_used, belief.mixture, modes=mode_probabilities
        )
