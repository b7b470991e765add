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
from gmr_gym.filters.histories import (
    WithHistory,
    after_scan,
    at_start,
    joined_belief,
    parted_belief,
    reduce_with,
)
from gmr_gym.filters.joint_gating import Limits, expand_jointly, give_up_limit
from gmr_gym.filters.mode_mixture import MixtureWithModes, merge_mode_probabilities, predict_every_mode
from gmr_gym.filters.trace import Trace, rows_of_scan
from gmr_gym.filters.tracker import Report, check_scan
from gmr_gym.mixture import Mixture, mean_and_covariance, normalised
from gmr_gym.models.model import Model
from gmr_gym.reduction.n_scan import NScan
from gmr_gym.reduction.protocol import Reduced, check_reduced, through
from gmr_gym.reduction.pruning import capping, entering
from gmr_gym.reduction.registry import hypothesis_reducer

Belief = MixtureWithModes | WithHistory  # the latter with NScan


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
        Reduction, of the posterior and the mode of each component; or NScan, whatever the modes.
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
        if not isinstance(self.reduce, NScan):
            check_reduced(self.reduce(prior, np.zeros(len(prior.w), int)), len(prior.w))

    def init(self) -> Belief:
        """Belief one period before the first scan.

        Departs: Table 1 starts with equal mode probabilities; here they are those of the model, equal by
        default."""
        prior = self.model.prior
        n = len(prior.w)
        belief = MixtureWithModes(prior, np.tile(self.model.mode_prior, (n, 1)))
        return joined_belief(belief, at_start(self.reduce, n))

    def step(self, belief: Belief, z: np.ndarray) -> tuple[Belief, Report]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        return self._scan(belief, z)[:2]

    def trace(self, belief: Belief, z: np.ndarray) -> tuple[Belief, Report, Trace]:
        """What `step` gives, and what became of every hypothesis with the scan."""
        after, report, full, near, mode, into = self._scan(belief, z)
        n = len(parted_belief(belief)[0].mixture.w)
        parent, detection = full.parent % n, rows_of_scan(full.detection, near)
        return after, report, Trace(full.mixture, parent, detection, through(*into), mode)

    def _scan(
        self, belief: Belief, z: np.ndarray
    ) -> tuple[Belief, Report, Expansion, np.ndarray, np.ndarray, tuple[np.ndarray, np.ndarray]]:
        """Belief and report; the full posterior, the mask (k,) of the detections in it, its modes (N,), and
        the origins of pruning and reduction."""
        model, limits = self.model, self.work_limits
        z = check_scan(z, len(model.sensor.H))
        before, history = parted_belief(belief)
        predicted, mode = predict_every_mode(before, model.motions, model.switching)
        full, near, gates_used, alive = expand_jointly(predicted, model, z, self.give_up_limit)
        posterior, kept = entering(full.mixture, limits.prune_weight, limits.max_hypotheses)
        mode = mode[full.parent]
        mode_kept = mode[kept >= 0]
        reduce = self.reduce if isinstance(self.reduce, NScan) else partial(_of_modes, self.reduce, mode_kept)
        history = after_scan(history, full.parent % len(before.mixture.w), full.detection, kept)
        reduced, history = reduce_with(reduce, posterior, history)
        mixture, shares = merge_mode_probabilities(posterior, mode_kept, reduced, len(model.motions))
        mixture = normalised(mixture)
        mean, covariance = mean_and_covariance(mixture)
        report = Report(mean[None], covariance[None], gates_used, mixture, alive, mixture.w @ shares)
        belief = joined_belief(MixtureWithModes(mixture, shares), history)
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
    reduce = hypothesis_reducer(reduction, components)
    if not isinstance(reduce, NScan):
        reduce = partial(_whatever_mode, reduce=reduce)
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


def _of_modes(reduce: Callable[[Mixture, np.ndarray], Reduced], mode: np.ndarray, p: Mixture) -> Reduced:
    return reduce(p, mode)
