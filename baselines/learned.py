"""The adaptive MHT whose thresholds a trained network sets, scan by scan."""

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gmr_gym.hypotheses import expanded
from gmr_gym.mixture import Mixture, moments
from gmr_gym.model import Model
from gmr_gym.network import Network, load
from gmr_gym.threshold_features import FEATURES, Memory, at_start, features, remembered, told
from gmr_gym.thresholds import PAPER, Thresholds, adapted, decoded, encoded
from gmr_gym.tracker import Report, check_scan


class Belief(NamedTuple):
    """The hypotheses, and what a policy remembers of the scan that left them."""

    mixture: Mixture
    memory: Memory


@dataclass(frozen=True)
class LearnedThresholds:
    """As D'Ortenzio's Adaptive, with the thresholds that the network says for the full posterior of the scan;
    those it does not set are of `rest`."""

    model: Model
    network: Network
    rest: Thresholds = PAPER

    def __post_init__(self):
        encoded(self.rest, ("components",))  # a limit out of range is an error here, not in a scan

    def init(self) -> Belief:
        return Belief(self.model.prior, at_start(self.model))

    def step(self, belief: Belief, z: np.ndarray) -> tuple[Belief, Report]:
        model = self.model
        full = expanded(belief.mixture, model, check_scan(z, len(model.sensor.H)))
        seen = features(full, belief.memory, model, told(model))
        # in single precision, as in training
        thresholds = decoded(self.network(seen.astype(np.float32)), self.network.parameters, self.rest)
        kept = adapted(full.posterior.mixture, thresholds)
        mean, covariance = moments(kept.mixture)
        report = Report(mean[None], covariance[None], full.gates, kept.mixture)
        return Belief(kept.mixture, remembered(full, kept)), report


def learned_thresholds(
    model: Model, policy: str | Path, components: int = PAPER.components
) -> LearnedThresholds:
    """MHT of up to `components` hypotheses whose thresholds are set by the network in the file `policy`, as
    agents/export.py writes it. Raises ValueError for a file that is none, see `gmr_gym.network.load`."""
    network = load(policy, FEATURES, Thresholds._fields)
    return LearnedThresholds(model, network, PAPER._replace(components=components))
