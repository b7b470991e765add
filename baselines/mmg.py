"""MMG: models and associations expanded and reduced jointly; GPB1, GPB2 and B-Best, which merge otherwise.

Zhang and Liu, Table 1.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from gmr_gym.checks import UNLIMITED
from gmr_gym.filters import mode_mixture
from gmr_gym.filters.association import Expansion
from gmr_gym.filters.joint_gating import Limits, expand_jointly, give_up_limit
from gmr_gym.filters.mode_mixture import MixtureWithModes, merge_mode_probabilities, predict_every_mode
from gmr_gym.filters.trace import Trace, rows_of_scan
from gmr_gym.filters.tracker import Report, check_scan
from gmr_gym.mixture import Mixture, mean_and_covariance, normalised
from gmr_gym.models.model import Model
from gmr_gym.reduction.protocol import Reduced, check_reduced, through
from gmr_gym.reduction.pruning import capping, entering
from gmr_gym.reduction.registry import reducer


@dataclass(frozen=True)
class Mmg:
    """Every component under every motion model with every detection in any gate, pruned and reduced.

    The reduction merges the mode probabilities too, see
    `gmr_gym.filters.mode_mixture.merge_mode_probabilities`.

    Parameters
    ----------
    model : Model
        The filter model.
    reduce : callable
        Reduction, of the posterior and the mode of each component.
    work_limits : Limits
        What is pruned before the reduction, and when the track is given up.

    Attributes
    ----------
    give_up_limit : float
        Expected false alarms within one sigma at which the track is given up.

    Notes
    -----
    Departs: the paper neither prunes before the reduction nor limits what enters it, and has no gates.

    References
    ----------
    Zhang, Table 1, eqs. 4-8.
    """

    model: Model
    reduce: Callable[[Mixture, np.ndarray], Reduced]
    work_limits: Limits = field(default_factory=Limits)
    give_up_limit: float = field(init=False, repr=False)

    def __post_init__(self):
        object.__setattr__(self, "give_up_limit", give_up_limit(self.model, self.work_limits.give_up_ratio))
        prior = self.model.prior
        # wrong parameters fail here rather than at a scan
        check_reduced(self.reduce(prior, np.zeros(len(prior.w), int)), len(prior.w))

    def init(self) -> MixtureWithModes:
        """Belief one period before the first scan.

        Departs: Table 1 starts with equal mode probabilities; here they are those of the model, equal by
        default."""
        prior = self.model.prior
        return MixtureWithModes(prior, np.tile(self.model.mode_prior, (len(prior.w), 1)))

    def step(self, belief: MixtureWithModes, z: np.ndarray) -> tuple[MixtureWithModes, Report]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        return self._scan(belief, z)[:2]

    def trace(self, belief: MixtureWithModes, z: np.ndarray) -> tuple[MixtureWithModes, Report, Trace]:
        """What `step` gives, and what became of every hypothesis with the scan."""
        after, report, full, near, mode, into = self._scan(belief, z)
        parent, detection = full.parent % len(belief.mixture.w), rows_of_scan(full.detection, near)
        return after, report, Trace(full.mixture, parent, detection, through(*into), mode)

    def _scan(
        self, belief: MixtureWithModes, z: np.ndarray
    ) -> tuple[MixtureWithModes, Report, Expansion, np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]:
        """Belief and report; the full posterior, the mask (k,) of the detections in it, its modes (N,), and
        the origins of pruning and reduction."""
        model, limits = self.model, self.work_limits
        z = check_scan(z, len(model.sensor.H))
        predicted, mode = predict_every_mode(belief, model.motions, model.switching)
        full, near, gates_used, alive = expand_jointly(predicted, model, z, self.give_up_limit)
        posterior, kept = entering(full.mixture, limits.prune_weight, limits.max_hypotheses)
        mode = mode[full.parent]
        mode_kept = mode[kept >= 0]
        reduced = self.reduce(posterior, mode_kept)
        mixture, shares = merge_mode_probabilities(posterior, mode_kept, reduced, len(model.motions))
        belief = MixtureWithModes(normalised(mixture), shares)
        mean, covariance = mean_and_covariance(belief.mixture)
        mode_probabilities = belief.mixture.w @ shares
        report = Report(mean[None], covariance[None], gates_used, belief.mixture, alive, mode_probabilities)
        return belief, report, full, near, mode, (kept, reduced[1])


def mmg(
    model: Model,
    components: int = 15,
    reduction: str = "runnalls",
    prune_weight: float = 1e-5,
    max_hypotheses: int = 500,
    give_up_ratio: float = 20.0,
) -> Mmg:
    """Multiple models and multiple hypotheses reduced jointly to `components`.

    Without clutter it is the multiple-model filter by Gaussian mixture reduction.

    Parameters
    ----------
    model : Model
        The filter model.
    components : int
        Most hypotheses after the reduction.
    reduction : str
        Name of a reduction, see `gmr_gym.reduction.registry`.
    prune_weight : float
        Hypotheses of less weight are pruned before the reduction.
    max_hypotheses : int
        Most hypotheses that enter the reduction, whose work may grow as their square; the heaviest are kept.
    give_up_ratio : float
        The track is given up when the expected false alarms within one sigma of the prediction exceed this
        times max(1, their number at the first scan).

    Returns
    -------
    Mmg

    References
    ----------
    Zhang, MMG.
    """
    reduce = partial(_whatever_mode, reduce=reducer(reduction, components))
    return Mmg(model, reduce, Limits(prune_weight, max_hypotheses, give_up_ratio))


def gpb1(model: Model, give_up_ratio: float = 20.0) -> Mmg:
    """First-order generalised pseudo-Bayesian filter: one Gaussian; in clutter every filter is a PDA.

    Parameters
    ----------
    model : Model
        The filter model.
    give_up_ratio : float
        The track is given up when the expected false alarms within one sigma of the prediction exceed this
        times max(1, their number at the first scan).

    Returns
    -------
    Mmg
    """
    return Mmg(model, mode_mixture.gpb1, Limits(0.0, UNLIMITED, give_up_ratio))


def gpb2(model: Model, give_up_ratio: float = 20.0) -> Mmg:
    """Second-order generalised pseudo-Bayesian filter: one Gaussian per mode; in clutter all are PDAs.

    Each Gaussian is predicted by every motion model.

    Parameters
    ----------
    model : Model
        The filter model.
    give_up_ratio : float
        The track is given up when the expected false alarms within one sigma of the prediction exceed this
        times max(1, their number at the first scan).

    Returns
    -------
    Mmg
    """
    return Mmg(model, mode_mixture.gpb2, Limits(0.0, UNLIMITED, give_up_ratio))


def b_best(model: Model, components: int = 15, give_up_ratio: float = 20.0) -> Mmg:
    """Keeps the `components` most probable sequences of models (in clutter, of models and associations).

    Parameters
    ----------
    model : Model
        The filter model.
    components : int
        Number of sequences kept.
    give_up_ratio : float
        The track is given up when the expected false alarms within one sigma of the prediction exceed this
        times max(1, their number at the first scan).

    Returns
    -------
    Mmg

    References
    ----------
    Zhang, section 4, B-Best.
    """
    best = partial(capping, components=components)
    reduce = partial(_whatever_mode, reduce=best)
    return Mmg(model, reduce, Limits(prune_weight=0.0, give_up_ratio=give_up_ratio))


def _whatever_mode(posterior: Mixture, mode: np.ndarray, reduce: Callable[[Mixture], Reduced]) -> Reduced:
    return reduce(posterior)
