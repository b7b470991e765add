"""One scan of a Gaussian-mixture MHT in two halves, so that whoever sets the thresholds of the reduction may
first look at the full posterior (D'Ortenzio, sections 2.1 and 4)."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gmr_gym.association import Expansion, Gates, expand, gates
from gmr_gym.kalman import predict
from gmr_gym.mixture import Mixture, normalised
from gmr_gym.model import Model
from gmr_gym.reduction import Reduced, heaviest, prune_density

MOST = 2000  # hypotheses that enter a reduction, the heaviest, lest a huge scan fill memory


class Expanded(NamedTuple):
    """A scan after the update and before any reduction."""

    posterior: Expansion  # every hypothesis with every gated detection
    gates: Gates  # about the predicted hypotheses

    @property
    def gated(self) -> int:
        """Pairs of a hypothesis and a detection in its gate: so many Gaussians were updated."""
        return int(np.count_nonzero(self.posterior.detection >= 0))


class Kept(NamedTuple):
    """What a reduction left, and how much there was of it to merge."""

    mixture: Mixture  # weights sum to 1
    entered: int  # hypotheses that SP pruning let into the merging
    left: int  # hypotheses that came out of it, before NWP pruning

    @property
    def merge_costs(self) -> int:
        """Evaluations of the cost B of a pair that greedy merging needs on its way from n = `entered` to
        r = `left` hypotheses: one for each of the n (n - 1) / 2 pairs at first, then, after each merge, one
        for the new hypothesis with each of the others,

            n (n - 1) / 2 + (r - 1) + r + ... + (n - 2) = (n - 1)^2 - (r - 1) (r - 2) / 2
        """
        return (self.entered - 1) ** 2 - (self.left - 1) * (self.left - 2) // 2


def expanded(belief: Mixture, model: Model, z: np.ndarray) -> Expanded:
    """The first half: the belief carried forward one period and expanded by the scan z (k, p)."""
    predicted = predict(belief, model.motion)
    looked = gates(predicted, model.sensor, model.gate_probability)
    posterior = expand(
        predicted, looked, model.sensor, z,
        model.detection_probability, model.gate_probability, model.clutter_density,
    )  # fmt: skip
    return Expanded(posterior, looked)


def reduced(
    posterior: Mixture,
    reduce: Callable[[Mixture], Reduced],
    prune_weight: float,
    density: float,
    most: int = MOST,
) -> Kept:
    """The second half: SP pruning of what weighs less than `prune_weight` (gamma), of the rest the `most`
    heaviest through `reduce`, NWP pruning below `density` (gamma~), renormalised after each."""
    entered = normalised(heaviest(posterior, prune_weight, most)[0])
    left = normalised(reduce(entered)[0])
    return Kept(normalised(prune_density(left, density)[0]), len(entered.w), len(left.w))
