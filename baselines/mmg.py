"""MMG: models and associations expanded together and reduced together (Zhang and Liu, Table 1); and the
multiple model filters that differ from it in what they merge."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from gmr_gym.checks import check_limits
from gmr_gym.filters import mode_mixture
from gmr_gym.filters.joint_gating import expand_jointly, give_up_limit
from gmr_gym.filters.mode_mixture import MixtureWithModes, merge_mode_probabilities, predict_every_mode
from gmr_gym.filters.tracker import UNLIMITED, Report, check_scan
from gmr_gym.mixture import Mixture, mean_and_covariance, normalised
from gmr_gym.models.model import Model
from gmr_gym.reduction.protocol import Reduced, check_reduced
from gmr_gym.reduction.pruning import capping, entering
from gmr_gym.reduction.registry import reducer


@dataclass(frozen=True)
class Mmg:
    """Every component under every model with every detection gated by any of them, then pruned by
    weight and given to `reduce`, the mode probabilities riding along (Zhang, Table 1, eqs. 4-8).

    Departs: the paper neither prunes before the reduction nor bounds what enters it, and gives no gates.
    """

    model: Model
    reduce: Callable[[Mixture, np.ndarray], Reduced]  # of the posterior and the mode of each component
    prune_weight: float = 1e-5
    max_hypotheses: int = (
        500  # hypotheses that enter `reduce`, the heaviest, whose work may grow as their square
    )
    # times the false detections expected within a deviation at first, and one, at which it gives up
    give_up_ratio: float = 20.0
    give_up_limit: float = field(init=False, repr=False)

    def __post_init__(self):
        check_limits(self.prune_weight, self.max_hypotheses, self.give_up_ratio)
        object.__setattr__(self, "give_up_limit", give_up_limit(self.model, self.give_up_ratio))
        prior = self.model.prior
        # a wrong parameter is an error here, not in a scan
        check_reduced(self.reduce(prior, np.zeros(len(prior.w), int)), len(prior.w))

    def init(self) -> MixtureWithModes:
        """Departs: Table 1 starts all modes alike; they are model.mode_prior, alike unless told."""
        prior = self.model.prior
        return MixtureWithModes(prior, np.tile(self.model.mode_prior, (len(prior.w), 1)))

    def step(self, belief: MixtureWithModes, z: np.ndarray) -> tuple[MixtureWithModes, Report]:
        model = self.model
        z = check_scan(z, len(model.sensor.H))
        predicted, mode = predict_every_mode(belief, model.motions, model.switching)
        (posterior, parent, *_), gates_used, alive = expand_jointly(predicted, model, z, self.give_up_limit)
        posterior, kept = entering(posterior, self.prune_weight, self.max_hypotheses)
        mode = mode[parent][kept >= 0]
        reduced = self.reduce(posterior, mode)
        mixture, shares = merge_mode_probabilities(posterior, mode, reduced, len(model.motions))
        belief = MixtureWithModes(normalised(mixture), shares)
        mean, covariance = mean_and_covariance(belief.mixture)
        mode_probabilities = belief.mixture.w @ shares
        return belief, Report(
            mean[None], covariance[None], gates_used, belief.mixture, alive, mode_probabilities
        )


def mmg(
    model: Model,
    components: int = 15,
    reduction: str = "runnalls",
    prune_weight: float = 1e-5,
    max_hypotheses: int = 500,
    give_up_ratio: float = 20.0,
) -> Mmg:
    """Multiple models and multiple hypotheses reduced jointly to `components` by any `reduction` (Zhang,
    MMG; without clutter, MM by Gaussian mixture reduction)."""
    reduce = partial(_whatever_mode, reduce=reducer(reduction, components))
    return Mmg(model, reduce, prune_weight, max_hypotheses, give_up_ratio)


def gpb1(model: Model, give_up_ratio: float = 20.0) -> Mmg:
    """First-order generalised pseudo-Bayesian filter: one Gaussian; in clutter every filter is a PDA."""
    return Mmg(
        model, mode_mixture.gpb1, prune_weight=0.0, max_hypotheses=UNLIMITED, give_up_ratio=give_up_ratio
    )


def gpb2(model: Model, give_up_ratio: float = 20.0) -> Mmg:
    """Second-order generalised pseudo-Bayesian filter: one Gaussian per model, each moved by every model;
    in clutter every filter is a PDA."""
    return Mmg(
        model, mode_mixture.gpb2, prune_weight=0.0, max_hypotheses=UNLIMITED, give_up_ratio=give_up_ratio
    )


def b_best(model: Model, components: int = 15, give_up_ratio: float = 20.0) -> Mmg:
    """Keeps the `components` likeliest sequences of models, in clutter of models and associations, and
    drops the rest (Zhang, section 4, B-Best)."""
    best = partial(capping, components=components)
    return Mmg(model, partial(_whatever_mode, reduce=best), 0.0, give_up_ratio=give_up_ratio)


def _whatever_mode(posterior: Mixture, mode: np.ndarray, reduce: Callable[[Mixture], Reduced]) -> Reduced:
    return reduce(posterior)
