"""An MHT for each motion, weighed against each other by equivalent residuals: MMAE of MHTs and IMM of MHTs
(Maybeck et al., section IV, architectures 1 and 2); and the MHT of one motion alone."""

from collections.abc import Callable
from dataclasses import dataclass, field
from numbers import Integral
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_limits
from gmr_gym.filters.association import Expansion, expand
from gmr_gym.filters.filter_bank import diverging, floored, mmae_weights
from gmr_gym.filters.joint_gating import gate_jointly, give_up_limit
from gmr_gym.filters.mixing import MIXINGS, borrow_into, borrowed_states
from gmr_gym.filters.tracker import Report, check_scan
from gmr_gym.mixture import Mixture, collapsed, joined, mean_and_covariance, normalised, take
from gmr_gym.models.gating import Gates
from gmr_gym.models.kalman import predict
from gmr_gym.models.model import Model
from gmr_gym.models.sensing import PredictedDetections
from gmr_gym.reduction.protocol import Reduced, check_reduced
from gmr_gym.reduction.pruning import entering
from gmr_gym.reduction.registry import reducer
from gmr_gym.reduction.runnalls import runnalls


class Mixtures(NamedTuple):
    """What the MHT of each motion believes, and how likely each motion is."""

    w: np.ndarray  # (r,)
    each: tuple[Mixture, ...]  # r of them, each with weights that sum to 1


@dataclass(frozen=True)
class BankOfMhts:
    """An MHT for each motion, all with every detection gated by any component of any; motions are weighed
    by the density of an equivalent residual (eqs. 11, 12 and 17).

    Departs: whether a component's gate is its own or all gates together the paper leaves to the designer
    (section IV). All together, components are as many before the reduction as the paper counts."""

    model: Model
    reduce: Callable[[Mixture], Reduced]  # in each MHT
    mixing: str | None  # one of MIXINGS: ahead of the prediction, as in an IMM; None: never, as in an MMAE
    floor: float  # least probability of a motion
    restart: float  # density of its equivalent residual below which an MHT begins anew from the others
    prune_weight: float = 1e-5
    max_hypotheses: int = (
        500  # hypotheses that enter `reduce`, the heaviest, whose work may grow as their square
    )
    # times the false detections expected within a deviation at first, and one, at which it gives up
    give_up_ratio: float = 20.0
    give_up_limit: float = field(init=False, repr=False)
    _borrowed: np.ndarray = field(init=False, repr=False)

    def __post_init__(self):
        check_limits(self.prune_weight, self.max_hypotheses, self.give_up_ratio)
        object.__setattr__(self, "give_up_limit", give_up_limit(self.model, self.give_up_ratio))
        borrowed = borrowed_states(self.model.motions, MIXINGS[0] if self.mixing is None else self.mixing)
        object.__setattr__(self, "_borrowed", borrowed)
        # a wrong parameter is an error here, not in a scan
        check_reduced(self.reduce(collapsed(self.model.prior)), 1)
        floored(self.model.mode_prior, self.floor)
        diverging(np.zeros(len(self.model.motions)), self.restart)

    def init(self) -> Mixtures:
        return Mixtures(self.model.mode_prior, (self.model.prior,) * len(self.model.motions))

    def step(self, belief: Mixtures, z: np.ndarray) -> tuple[Mixtures, Report]:
        model = self.model
        z = check_scan(z, len(model.sensor.H))
        w, each = belief if self.mixing is None else self._mixed(belief)
        predicted = [predict(p, motion) for p, motion in zip(each, model.motions, strict=True)]
        own, listed, gates_used, alive = gate_jointly(weighed(w, predicted), model, z, self.give_up_limit)
        ends = np.cumsum([len(p.w) for p in predicted])[:-1]
        posteriors, log_density = [], np.zeros(len(w))
        for i, parts in enumerate(zip(predicted, np.split(own.z, ends), np.split(own.S, ends), strict=True)):
            p, gates = parts[0], Gates(*parts[1:], own.threshold)
            expansion = expand(
                p, gates, model.sensor, listed,
                model.detection_probability, model.gate_probability, model.clutter_density,
            )  # fmt: skip
            log_density[i] = equivalent_residual(
                p, expansion, model.sensor.predict_detections(p, gates.z, gates.S, listed)
            )
            posteriors.append(self._reduced(expansion.mixture))
        w = mmae_weights(w, log_density)
        posteriors = self._restarted(w, posteriors, log_density)
        belief = Mixtures(floored(w, self.floor), tuple(posteriors))
        pooled = weighed(*belief)
        pooled = take(pooled, pooled.w > 0)  # far off, the likelihood of a motion may vanish
        mean, covariance = mean_and_covariance(pooled)
        return belief, Report(mean[None], covariance[None], gates_used, pooled, alive, belief.w)

    def _mixed(self, belief: Mixtures) -> Mixtures:
        """Departs: eq. 14 mixes Gaussians; how mixtures mix is not said. All hypotheses are pooled with the
        mixing probabilities of eq. 15 and merged, as eq. 14 merges, by Runnalls to as many as the MHT had.
        So where each had one, this is the IMM; a reduction that deletes would make it another filter."""
        joint = self.model.switching * belief.w  # motion now, motion before
        w = joint.sum(axis=1)
        shares = np.where(w[:, None] > 0, joint, belief.w)  # an impossible motion, as likely as the others
        pools = [normalised(weighed(share, self._lent(belief.each, q))) for q, share in enumerate(shares)]
        merged = [runnalls(pool, len(p.w))[0] for pool, p in zip(pools, belief.each, strict=True)]
        return Mixtures(w, tuple(map(normalised, merged)))

    def _lent(self, each: tuple[Mixture, ...], q: int) -> list[Mixture]:
        """The MHTs as they are mixed into that of motion q: what states they borrow from it are those of all
        its hypotheses together."""
        if not self._borrowed[q].any():
            return list(each)
        lent = [p._replace(m=p.m.copy(), P=p.P.copy()) for p in each]
        mean, covariance = mean_and_covariance(each[q])
        for p, states in zip(lent, self._borrowed[q], strict=True):
            n = len(p.w)
            borrow_into(p.m, p.P, np.tile(mean, (n, 1)), np.tile(covariance, (n, 1, 1)), states)
        return lent

    def _reduced(self, p: Mixture) -> Mixture:
        lighter, _ = entering(p, self.prune_weight, self.max_hypotheses)
        return normalised(self.reduce(lighter)[0])

    def _restarted(self, w: np.ndarray, each: list[Mixture], log_density: np.ndarray) -> list[Mixture]:
        """MHTs that diverge begin anew from the others; where all do, none."""
        diverged = diverging(log_density, self.restart)
        if not diverged.any():
            return each
        rest = np.where(diverged, 0.0, w)
        others = weighed(rest if rest.any() else 1.0 - diverged, each)  # the impossible, as likely as others
        restarted = self._reduced(normalised(others))
        return [restarted if lost else p for lost, p in zip(diverged, each, strict=True)]


def equivalent_residual(predicted: Mixture, expansion: Expansion, predicted_z: PredictedDetections) -> float:
    """Log density of the residual that an MHT as a whole makes of a scan (eqs. 12 and 17): that of
    the mean and covariance of its hypotheses' residuals. 0 where no hypothesis has a detection.

    Departs: a hypothesis without a detection has no residual, and eq. 17 does not say what then. It takes
    no part: counted as a residual of nothing, a filter that has lost its target would be the best of all.
    """
    hit = expansion.detection >= 0
    if not hit.any():
        return 0.0
    parent = expansion.parent[hit]
    with np.errstate(divide="ignore"):
        # not from the weights, which vanish beside those of the misses when the target is far off
        log_w = np.log(predicted.w)[parent] + expansion.log_density[hit]
    detection, row = expansion.detection[hit], parent if len(predicted_z.z) > 1 else 0
    residuals = predicted_z.z[row, detection] - predicted_z.z_hat[parent]
    S = predicted_z.S[parent] + (predicted_z.R[detection] if len(predicted_z.R) else 0.0)
    each = normalised(Mixture(np.exp(log_w - log_w.max()), residuals, S))
    r, A = mean_and_covariance(each)
    log_jacobian = each.w @ predicted_z.log_jacobian[detection]
    return float(log_jacobian - 0.5 * (r @ np.linalg.solve(A, r) + np.linalg.slogdet(2 * np.pi * A)[1]))


def weighed(w: np.ndarray, each) -> Mixture:
    """The mixture of mixtures, each with its weight w (r,)."""
    return joined([p._replace(w=share * p.w) for share, p in zip(w, each, strict=True)])


def mmae_of_mhts(
    model: Model,
    components: int = 15,
    reduction: str = "runnalls",
    prune_weight: float = 1e-5,
    floor: float = 1e-3,
    restart: float = 1e-5,
    max_hypotheses: int = 500,
    give_up_ratio: float = 20.0,
) -> BankOfMhts:
    """An MMAE whose filters are MHTs of `components` hypotheses each (Maybeck, architecture 1; with
    reduction="ise" the MMAE of ISEs)."""
    return BankOfMhts(
        model,
        reducer(reduction, components),
        None,
        floor,
        restart,
        prune_weight,
        max_hypotheses,
        give_up_ratio,
    )


def imm_of_mhts(
    model: Model,
    components: int = 15,
    reduction: str = "runnalls",
    prune_weight: float = 1e-5,
    max_hypotheses: int = 500,
    give_up_ratio: float = 20.0,
    mixing: str = MIXINGS[0],
) -> BankOfMhts:
    """An IMM whose filters are MHTs of `components` hypotheses each (Maybeck, architecture 2; with
    reduction="ise" the IMM of ISEs)."""
    return BankOfMhts(
        model, reducer(reduction, components), mixing, 0.0, 0.0, prune_weight, max_hypotheses, give_up_ratio
    )


def single_model_mht(
    model: Model,
    components: int = 15,
    mode: int = 0,
    reduction: str = "runnalls",
    prune_weight: float = 1e-5,
    max_hypotheses: int = 500,
    give_up_ratio: float = 20.0,
) -> BankOfMhts:
    """MHT that takes the target to follow one of the model's motions, `mode`, for good, gated as the others
    here are (Maybeck; with reduction="ise" the ISE of benign, or of aggressive, Kalman filters)."""
    known = len(model.motions)
    if isinstance(mode, bool) or not isinstance(mode, Integral) or not 0 <= mode < known:
        raise ValueError(f"mode must be one of the {known} motions, counted from 0, got {mode!r}")
    single = model._replace(motions=(model.motions[mode],), switching=np.ones((1, 1)), mode_prior=np.ones(1))
    return BankOfMhts(
        single, reducer(reduction, components), None, 0.0, 0.0, prune_weight, max_hypotheses, give_up_ratio
    )
