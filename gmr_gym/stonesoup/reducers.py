"""Every reduction of a Gaussian mixture as a reducer of Stone Soup."""

import uuid
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.mixturereducer.base import MixtureReducer
from stonesoup.types.state import TaggedWeightedGaussianState, WeightedGaussianState

from gmr_gym.mixture import Mixture
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.reduction.pruning import prune
from gmr_gym.reduction.registry import reduction_named
from gmr_gym.stonesoup.mixtures import components_of, mixture_of


class Reducer(MixtureReducer):
    """Reduces mixtures by any reduction; usable where Stone Soup takes a GaussianMixtureReducer.

    Merged components keep the tag of their heaviest, where components have tags. Unlike Stone Soup's own, it
    changes no component that it is given, and limits no weight to 1.

    Parameters
    ----------
    reduction : str
        Name of a reduction, with parameters or not, as "adaptive:loss_bound=0.1"; see `gmr-gym list`.
    max_number_components : int
        Most components that remain.
    prune_threshold : float
        Components of less weight are dropped before, but never the heaviest.
    merge_threshold : float
        Squared Mahalanobis distance within which "vo-ma" merges.

    Raises
    ------
    ValueError
        As `gmr_gym.reduction.reducer`, for an unknown reduction or parameter, with those that there are.
    """

    reduction: str = Property(default="runnalls")
    max_number_components: int = Property(default=100)
    prune_threshold: float = Property(default=0.0)
    merge_threshold: float = Property(default=4.0)

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._reduce  # noqa: B018 - a name that is wrong fails here

    @cached_property
    def _reduce(self) -> Callable[[Mixture], Reduced]:
        return reduction_named(self.reduction, self.max_number_components, self.merge_threshold)

    def reduce(self, components_list: Sequence[WeightedGaussianState]) -> list[WeightedGaussianState]:
        """Reduce a mixture.

        Parameters
        ----------
        components_list : sequence of WeightedGaussianState or GaussianMixture
            Weights of any sum.

        Returns
        -------
        list of WeightedGaussianState
            TaggedWeightedGaussianState where all that is given is. The time is that of the first component.
        """
        given = list(components_list)
        if not given:
            return given
        p, origin = self._reduced(given)
        tags = _tags(given, origin, len(p.w)) if isinstance(given[0], TaggedWeightedGaussianState) else None
        return components_of(p, given[0].timestamp, tags)

    def _reduced(self, given: list[WeightedGaussianState]) -> Reduced:
        p, kept = prune(mixture_of(given), self.prune_threshold)
        q, into = self._reduce(p)
        return q, np.append(into, -1)[kept]


def _tags(given: Sequence[TaggedWeightedGaussianState], origin: np.ndarray, count: int) -> list[str]:
    """Tags of `count` components: of their heaviest, and new ones where another has it that weighs more."""
    tags = [str(uuid.uuid4()) for _ in range(count)]
    taken: set[str] = set()
    named: set[int] = set()
    for i in sorted(range(len(given)), key=lambda i: -float(given[i].weight)):
        into = int(origin[i])
        if into >= 0 and into not in named:
            named.add(into)
            if given[i].tag not in taken:
                taken.add(given[i].tag)
                tags[into] = given[i].tag
    return tags
