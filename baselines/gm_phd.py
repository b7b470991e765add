"""The Gaussian-mixture PHD filter (Vo and Ma 2006), with any reduction of its mixture."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gmr_gym.filters import phd
from gmr_gym.filters.phd import Labelled
from gmr_gym.filters.tracker import Account, check_scan
from gmr_gym.mixture import Mixture
from gmr_gym.models.multi_target import Population
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.reduction.registry import reduction_named


@dataclass(frozen=True)
class GmPhd:
    """An intensity carried ahead with births and spawning, updated with the scan, pruned, then `reduce`;
    components of weight above 1/2 are named as targets (Vo and Ma 2006, Tables I-III)."""

    population: Population
    reduce: Callable[[Mixture], Reduced]
    prune_weight: float = 1e-5  # T, an expected number of targets
    most: int = 2000  # components that enter `reduce`, the heaviest, lest a huge scan fill memory

    def __post_init__(self):
        phd.check_filter(self.population, self.reduce, self.prune_weight, self.most)

    def init(self) -> Labelled:
        return phd.nobody(self.population)

    def step(self, belief: Labelled, z: np.ndarray) -> tuple[Labelled, Account]:
        told = self.population
        z = check_scan(z, len(told.sensor.H))
        posterior, _ = phd.update(
            phd.ahead(belief, told), told.sensor, z,
            told.detection_probability, told.clutter.density(z), self.prune_weight,
        )  # fmt: skip
        return phd.account(phd.reduced(posterior, self.reduce, self.most), told.clutter)


def gm_phd(
    population: Population,
    components: int = 100,
    merging: float = 4.0,
    prune_weight: float = 1e-5,
    reduction: str = "vo-ma",
) -> GmPhd:
    """GM-PHD filter reduced to `components`: by Vo and Ma's merging of what lies within the squared distance
    `merging` (U), or by any reduction that the single-target trackers take, such as "runnalls" or
    "adaptive", which do not heed `merging`."""
    return GmPhd(population, reduction_named(reduction, components, merging), prune_weight)
