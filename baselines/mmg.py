"""MMG: models and associations expanded together and reduced together (Zhang and Liu, Table 1); and the
multiple model filters that differ from it in what they merge."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from gmr_gym import modes
from gmr_gym.association import expand, false_expected, gates, in_any_gate, possible
from gmr_gym.mixture import Mixture, moments, normalised
from gmr_gym.model import Model
from gmr_gym.modes import Modal, carried, spread
from gmr_gym.reducers import reducer
from gmr_gym.reduction import Reduced, capping, heaviest
from gmr_gym.tracker import Report, check_limits, check_scan

ALL = 10**9  # hypotheses: those that are only matched cost no more than they are many


@dataclass(frozen=True)
class Mmg:
    """Every component under every model with every detection gated by any of them, then pruned by
    weight and given to `reduce`, the mode probabilities riding along (Zhang, Table 1, eqs. 4-8)."""

    model: Model
    reduce: Callable[[Mixture, np.ndarray], Reduced]  # of the posterior and the mode of each component
    prune_weight: float = 1e-5
    most: int = 500  # hypotheses that enter `reduce`, the heaviest, whose work may grow as their square
    # false detections within one deviation of its predictions beyond which a track is given up: it then
    # coasts, which bounds the work and is said in the report
    hopeless: float = 20.0

    def __post_init__(self):
        check_limits(self.prune_weight, self.most, self.hopeless)
        prior = self.model.prior
        self.reduce(prior, np.zeros(len(prior.w), int))  # a wrong parameter is an error here

    def init(self) -> Modal:
        """Departs: Table 1 starts all modes alike; they are model.mode_prior, alike unless told."""
        prior = self.model.prior
        return Modal(prior, np.tile(self.model.mode_prior, (len(prior.w), 1)))

    def step(self, belief: Modal, z: np.ndarray) -> tuple[Modal, Report]:
        model = self.model
        z = check_scan(z, len(model.sensor.H))
        predicted, mode = spread(belief, model.motions, model.switching)
        every = gates(predicted, model.sensor, model.gate_probability)
        looked = possible(every, predicted.w)
        alive = false_expected(every, predicted.w, model.clutter_density) <= self.hopeless
        posterior, parent, _ = expand(
            predicted, every._replace(size=np.inf), model.sensor, z[in_any_gate(looked, z) & alive],
            model.detection_probability, model.gate_probability, model.clutter_density,
        )  # fmt: skip
        posterior, kept = heaviest(posterior, self.prune_weight, self.most)
        mode = mode[parent][kept >= 0]
        reduced = self.reduce(posterior, mode)
        mixture, shares = carried(posterior, mode, reduced, len(model.motions))
        belief = Modal(normalised(mixture), shares)
        mean, covariance = moments(belief.mixture)
        return belief, Report(mean[None], covariance[None], looked, belief.mixture, alive)


def mmg(model: Model, components: int = 15, reduction: str = "runnalls", prune_weight: float = 1e-5) -> Mmg:
    """Multiple models and multiple hypotheses reduced jointly to `components` by any `reduction` (Zhang,
    MMG; without clutter, MM by Gaussian mixture reduction)."""
    return Mmg(model, partial(_whatever_mode, reduce=reducer(reduction, components)), prune_weight)


def gpb1(model: Model) -> Mmg:
    """First-order generalised pseudo-Bayesian filter: one Gaussian; in clutter every filter is a PDA."""
    return Mmg(model, modes.gpb1, prune_weight=0.0, most=ALL)


def gpb2(model: Model) -> Mmg:
    """Second-order generalised pseudo-Bayesian filter: one Gaussian per model, each moved by every model;
    in clutter every filter is a PDA."""
    return Mmg(model, modes.gpb2, prune_weight=0.0, most=ALL)


def b_best(model: Model, components: int = 15) -> Mmg:
    """Keeps the `components` likeliest sequences of models, in clutter of models and associations, and
    drops the rest (Zhang, section 4, B-Best)."""
    return Mmg(model, partial(_whatever_mode, reduce=partial(capping, components=components)), 0.0)


def _whatever_mode(posterior: Mixture, mode: np.ndarray, reduce: Callable[[Mixture], Reduced]) -> Reduced:
    return reduce(posterior)
