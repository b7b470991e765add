"""Banks of MHTs, one per motion model: MMAE of MHTs, IMM of MHTs, and the MHT of one motion model.

Motion models are weighted by the density of an equivalent residual (Maybeck et al., section IV, architectures
1 and 2).
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from numbers import Integral
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.filters.association import Expansion, expand
from gmr_gym.filters.filter_bank import diverging, floored, mmae_weights
from gmr_gym.filters.histories import (
    WithHistory,
    after_scan,
    at_start,
    joined_belief,
    parted_belief,
    reduce_with,
)
from gmr_gym.filters.joint_gating import Limits, gate_jointly, give_up_limit
from gmr_gym.filters.mixing import MIXINGS, borrow_into, borrowed_states
from gmr_gym.filters.trace import Trace, rows_of_scan
from gmr_gym.filters.tracker import Report, check_scan
from gmr_gym.mixture import Mixture, collapsed, joined, mean_and_covariance, normalised, take
from gmr_gym.models.gating import Gates
from gmr_gym.models.kalman import predict
from gmr_gym.models.model import Model
from gmr_gym.models.sensing import PredictedDetections
from gmr_gym.reduction.n_scan import NScan, inherited
from gmr_gym.reduction.protocol import Reduced, check_reduced, through
from gmr_gym.reduction.pruning import entering
from gmr_gym.reduction.registry import hypothesis_reducer
from gmr_gym.reduction.runnalls import runnalls

Origins = tuple[np.ndarray, np.ndarray]  # of the pruning, and of the reduction after it


class Mixtures(NamedTuple):
    """Belief of a bank of MHTs.

    Attributes
    ----------
    w : ndarray, shape (r,)
        Mode probabilities.
    each : tuple of Mixture
        Hypotheses of the r MHTs; the weights of each sum to 1.
    """

    w: np.ndarray
    each: tuple[Mixture, ...]


Belief = Mixtures | WithHistory  # the latter with NScan


@dataclass(frozen=True)
class BankOfMhts:
    """One MHT per motion model, all with the detections in any component's gate.

    Parameters
    ----------
    model : Model
        The filter model.
    reduce : callable
        Reduction of each MHT.
    mixing : {"augmented", "unbiased"} or None
        How MHTs are mixed before the prediction, as in an IMM; None for no mixing, as in an MMAE.
    floor : float
        Least probability of a motion model, in [0, 1 / r).
    restart : float
        Density of the equivalent residual below which an MHT is reset to the mixture of the others, 0 for
        never.
    work_limits : Limits
        What is pruned before the reduction, and when the track is given up.

    Attributes
    ----------
    give_up_limit : float
        Expected false alarms within one sigma at which the track is given up.

    Notes
    -----
    Departs: the paper leaves to the designer whether a component uses its own gate or all gates together
    (section IV). With all together, the number of components before the reduction is as the paper counts it.

    References
    ----------
    Maybeck, section IV, eqs. 11, 12 and 17.
    """

    model: Model
    reduce: Callable[[Mixture], Reduced]
    mixing: str | None
    floor: float
    restart: float
    work_limits: Limits = field(default_factory=Limits)
    give_up_limit: float = field(init=False, repr=False)
    _borrowed: np.ndarray = field(init=False, repr=False)

    def __post_init__(self):
        object.__setattr__(self, "give_up_limit", give_up_limit(self.model, self.work_limits.give_up_ratio))
        borrowed = borrowed_states(self.model.motions, MIXINGS[0] if self.mixing is None else self.mixing)
        object.__setattr__(self, "_borrowed", borrowed)
        # wrong parameters fail here rather than at a scan
        if not isinstance(self.reduce, NScan):
            check_reduced(self.reduce(collapsed(self.model.prior)), 1)
        floored(self.model.mode_prior, self.floor)
        diverging(np.zeros(len(self.model.motions)), self.restart)

    def init(self) -> Belief:
        """Belief one period before the first scan."""
        prior, r = self.model.prior, len(self.model.motions)
        history = at_start(self.reduce, len(prior.w))
        return joined_belief(
            Mixtures(self.model.mode_prior, (prior,) * r), None if history is None else (history,) * r
        )

    def step(self, belief: Belief, z: np.ndarray) -> tuple[Belief, Report]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        return self._scan(belief, z)[:2]

    def trace(self, belief: Belief, z: np.ndarray) -> tuple[Belief, Report, Trace]:
        """What `step` gives, and what became of every hypothesis of every MHT.

        The mixture of a belief are the hypotheses of all MHTs, by mode. With mixing, `parent` is -1: a
        hypothesis is predicted from several. An MHT that is reset to the others leaves its hypotheses pruned,
        and nothing goes into its new ones.
        """
        after, report, expansions, near, origins = self._scan(belief, z)
        before, now = parted_belief(belief)[0], parted_belief(after)[0]
        full = weighed(now.w, [expansion.mixture for expansion in expansions])
        mode = np.repeat(np.arange(len(expansions)), [len(e.parent) for e in expansions])
        parent = _pooled_rows(before, [e.parent for e in expansions])
        if self.mixing is not None:
            parent = np.full_like(parent, -1)
        detection = rows_of_scan(np.concatenate([e.detection for e in expansions]), near)
        into = _pooled_rows(now, [through(*pair) for pair in origins])
        return after, report, Trace(full, parent, detection, into, mode)

    def _scan(
        self, belief: Belief, z: np.ndarray
    ) -> tuple[Belief, Report, list[Expansion], np.ndarray, list[Origins]]:
        """Belief and report; the full posterior of each MHT, the mask (k,) of the detections in them, and the
        origins of their hypotheses."""
        model = self.model
        z = check_scan(z, len(model.sensor.H))
        (w, each), histories = parted_belief(belief if self.mixing is None else self._mixed(belief))
        predicted = [predict(p, motion) for p, motion in zip(each, model.motions, strict=True)]
        own, near, gates_used, alive = gate_jointly(weighed(w, predicted), model, z, self.give_up_limit)
        ends = np.cumsum([len(p.w) for p in predicted])[:-1]
        listed, expansions, log_density = z[near], [], np.zeros(len(w))
        for i, parts in enumerate(zip(predicted, np.split(own.z, ends), np.split(own.S, ends), strict=True)):
            p, gates = parts[0], Gates(*parts[1:], own.threshold)
            expansion = expand(
                p, gates, model.sensor, listed,
                model.detection_probability, model.gate_probability, model.clutter_density,
            )  # fmt: skip
            log_density[i] = equivalent_residual(
                p, expansion, model.sensor.predict_detections(p, gates.z, gates.S, listed)
            )
            expansions.append(expansion)
        w = mmae_weights(w, log_density)
        if histories is None:
            histories = (None,) * len(w)
        each_own = [self._reduced(e, history) for e, history in zip(expansions, histories, strict=True)]
        reduced, origins, histories = zip(*self._restarted(w, each_own, log_density), strict=True)
        mixtures = Mixtures(floored(w, self.floor), reduced)
        pooled = weighed(*mixtures)
        pooled = take(pooled, pooled.w > 0)  # the likelihood of a motion may underflow
        mean, covariance = mean_and_covariance(pooled)
        report = Report(mean[None], covariance[None], gates_used, pooled, alive, mixtures.w)
        belief = mixtures if histories[0] is None else WithHistory(mixtures, histories)
        return belief, report, expansions, near, list(origins)

    def _mixed(self, belief: Belief) -> Belief:
        """Mix the MHTs before the prediction.

        Departs: eq. 14 mixes Gaussians; how mixtures mix is not stated. All hypotheses are pooled with the
        mixing probabilities of eq. 15 and merged by Runnalls to as many as the MHT had. With one hypothesis
        each this is the IMM; a reduction that deletes hypotheses would not reduce to it.
        """
        (before, each), histories = parted_belief(belief)
        joint = self.model.switching * before  # mode now, mode before
        w = joint.sum(axis=1)
        shares = np.where(w[:, None] > 0, joint, before)  # arbitrary for an impossible mode
        pools = [normalised(weighed(share, self._lent(each, q))) for q, share in enumerate(shares)]
        merged = [runnalls(pool, len(p.w)) for pool, p in zip(pools, each, strict=True)]
        mixed = Mixtures(w, tuple(normalised(p) for p, _ in merged))
        if histories is None:
            return mixed
        pooled = np.concatenate(histories)
        return WithHistory(mixed, tuple(
            inherited(pooled, pool.w, origin, len(p.w))
            for pool, (p, origin) in zip(pools, merged, strict=True)
        ))  # fmt: skip

    def _lent(self, each: tuple[Mixture, ...], q: int) -> list[Mixture]:
        """The MHTs as mixed into that of mode q; borrowed states have its overall mean and covariance."""
        if not self._borrowed[q].any():
            return list(each)
        lent = [p._replace(m=p.m.copy(), P=p.P.copy()) for p in each]
        mean, covariance = mean_and_covariance(each[q])
        for p, states in zip(lent, self._borrowed[q], strict=True):
            n = len(p.w)
            borrow_into(p.m, p.P, np.tile(mean, (n, 1)), np.tile(covariance, (n, 1, 1)), states)
        return lent

    def _reduced(self, expansion: Expansion, history: Any) -> tuple[Mixture, Origins, Any]:
        """An MHT after the pruning and the reduction, their origins, and its histories."""
        limits = self.work_limits
        lighter, kept = entering(expansion.mixture, limits.prune_weight, limits.max_hypotheses)
        history = after_scan(history, expansion.parent, expansion.detection, kept)
        (reduced, origin), history = reduce_with(self.reduce, lighter, history)
        return normalised(reduced), (kept, origin), history

    def _restarted(
        self, w: np.ndarray, each: list[tuple[Mixture, Origins, Any]], log_density: np.ndarray
    ) -> list[tuple[Mixture, Origins, Any]]:
        """The MHTs, those that diverge reset to the mixture of the others; where all diverge, none."""
        diverged = diverging(log_density, self.restart)
        if not diverged.any():
            return each
        rest = np.where(diverged, 0.0, w)
        share = rest if rest.any() else 1.0 - diverged  # where the others have probability 0
        pool = normalised(weighed(share, [p for p, _, _ in each]))
        limits, history = self.work_limits, each[0][2]
        lighter, kept = entering(pool, limits.prune_weight, limits.max_hypotheses)
        if history is not None:
            history = np.concatenate([own for _, _, own in each])[kept >= 0]
        (reduced, _), history = reduce_with(self.reduce, lighter, history)
        restarted = normalised(reduced)
        return [
            (restarted, (kept, np.full_like(origin, -1)), history) if lost else (p, (kept, origin), own)
            for lost, (p, (kept, origin), own) in zip(diverged, each, strict=True)
        ]


def equivalent_residual(predicted: Mixture, expansion: Expansion, predicted_z: PredictedDetections) -> float:
    r"""Log density of the equivalent residual of a whole MHT; 0 where no hypothesis has a detection.

    Parameters
    ----------
    predicted : Mixture
        Predicted hypotheses.
    expansion : Expansion
        Their full posterior.
    predicted_z : PredictedDetections
        Predicted detections of every hypothesis.

    Returns
    -------
    float

    Notes
    -----
    With :math:`\bar r` and :math:`\bar A` the mean and covariance of the mixture of the hypotheses' residuals

    .. math:: \log f = -\tfrac12 \left( \bar r^T \bar A^{-1} \bar r + \log \det (2 \pi \bar A) \right)

    Departs: a hypothesis with a missed detection has no residual, and eq. 17 does not cover it. It is left
    out: counted as a residual of zero, a filter that has lost its target would be the likeliest.

    References
    ----------
    Maybeck, eqs. 12 and 17.
    """
    hit = expansion.detection >= 0
    if not hit.any():
        return 0.0
    parent = expansion.parent[hit]
    with np.errstate(divide="ignore"):
        # not from the weights, which underflow beside those of the misses when the target is far away
        log_w = np.log(predicted.w)[parent] + expansion.log_density[hit]
    detection, row = expansion.detection[hit], parent if len(predicted_z.z) > 1 else 0
    residuals = predicted_z.z[row, detection] - predicted_z.z_hat[parent]
    S = predicted_z.S[parent] + (predicted_z.R[detection] if len(predicted_z.R) else 0.0)
    each = normalised(Mixture(np.exp(log_w - log_w.max()), residuals, S))
    r, A = mean_and_covariance(each)
    log_jacobian = each.w @ predicted_z.log_jacobian[detection]
    return float(log_jacobian - 0.5 * (r @ np.linalg.solve(A, r) + np.linalg.slogdet(2 * np.pi * A)[1]))


def weighed(w: np.ndarray, each) -> Mixture:
    """Mixture of mixtures.

    Parameters
    ----------
    w : ndarray, shape (r,)
        Weight of each mixture.
    each : sequence of Mixture
        r mixtures.

    Returns
    -------
    Mixture
    """
    return joined([p._replace(w=share * p.w) for share, p in zip(w, each, strict=True)])


def _pooled_rows(belief: Mixtures, each: list[np.ndarray]) -> np.ndarray:
    """Rows among all hypotheses of the belief of positive weight of rows `each` of its MHTs, one MHT after
    another; -1 stays."""
    possible = weighed(*belief).w > 0
    ends = np.cumsum([len(p.w) for p in belief.each])[:-1]
    pooled = np.split(np.where(possible, np.cumsum(possible) - 1, -1), ends)
    return np.concatenate([through(rows, own) for rows, own in zip(each, pooled, strict=True)])


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
    """MMAE whose filters are MHTs of `components` hypotheses each.

    Parameters
    ----------
    model : Model
        The filter model.
    components : int
        Most hypotheses after the reduction.
    reduction : str
        Name of a reduction, see `gmr_gym.reduction.registry`. "ise" gives the MMAE of ISEs.
    prune_weight : float
        Hypotheses of less weight are pruned before the reduction.
    floor : float
        Least probability of a motion model, in [0, 1 / r).
    restart : float
        Density of the equivalent residual below which an MHT is reset to the others, 0 for never.
    max_hypotheses : int
        Most hypotheses that enter the reduction, whose work may grow as their square; the heaviest are kept.
    give_up_ratio : float
        The track is given up when the expected false alarms within one sigma of the prediction exceed this
        times max(1, their number at the first scan).

    Returns
    -------
    BankOfMhts

    References
    ----------
    Maybeck, section IV, architecture 1.
    """
    limits = Limits(prune_weight, max_hypotheses, give_up_ratio)
    return BankOfMhts(model, hypothesis_reducer(reduction, components), None, floor, restart, limits)


def imm_of_mhts(
    model: Model,
    components: int = 15,
    reduction: str = "runnalls",
    prune_weight: float = 1e-5,
    max_hypotheses: int = 500,
    give_up_ratio: float = 20.0,
    mixing: str = MIXINGS[0],
) -> BankOfMhts:
    """IMM whose filters are MHTs of `components` hypotheses each.

    Parameters
    ----------
    model : Model
        The filter model.
    components : int
        Most hypotheses after the reduction.
    reduction : str
        Name of a reduction, see `gmr_gym.reduction.registry`. "ise" gives the IMM of ISEs.
    prune_weight : float
        Hypotheses of less weight are pruned before the reduction.
    max_hypotheses : int
        Most hypotheses that enter the reduction, whose work may grow as their square; the heaviest are kept.
    give_up_ratio : float
        The track is given up when the expected false alarms within one sigma of the prediction exceed this
        times max(1, their number at the first scan).
    mixing : {"augmented", "unbiased"}
        Mixing of motions of different state, see `gmr_gym.filters.mixing.borrowed_states`.

    Returns
    -------
    BankOfMhts

    References
    ----------
    Maybeck, section IV, architecture 2.
    """
    limits = Limits(prune_weight, max_hypotheses, give_up_ratio)
    return BankOfMhts(model, hypothesis_reducer(reduction, components), mixing, 0.0, 0.0, limits)


def single_model_mht(
    model: Model,
    components: int = 15,
    mode: int = 0,
    reduction: str = "runnalls",
    prune_weight: float = 1e-5,
    max_hypotheses: int = 500,
    give_up_ratio: float = 20.0,
) -> BankOfMhts:
    """MHT that assumes one of the model's motions throughout.

    Gated as the other trackers of this module.

    Parameters
    ----------
    model : Model
        The filter model.
    components : int
        Most hypotheses after the reduction.
    mode : int
        Index of the motion model, from 0.
    reduction : str
        Name of a reduction, see `gmr_gym.reduction.registry`. "ise" gives the ISE of
        benign, or of aggressive, Kalman filters.
    prune_weight : float
        Hypotheses of less weight are pruned before the reduction.
    max_hypotheses : int
        Most hypotheses that enter the reduction, whose work may grow as their square; the heaviest are kept.
    give_up_ratio : float
        The track is given up when the expected false alarms within one sigma of the prediction exceed this
        times max(1, their number at the first scan).

    Returns
    -------
    BankOfMhts

    Raises
    ------
    ValueError
        If the model has no motion `mode`.

    References
    ----------
    Maybeck, section IV.
    """
    known = len(model.motions)
    if isinstance(mode, bool) or not isinstance(mode, Integral) or not 0 <= mode < known:
        raise ValueError(f"mode must be one of the {known} motions, counted from 0, got {mode!r}")
    single = model._replace(motions=(model.motions[mode],), switching=np.ones((1, 1)), mode_prior=np.ones(1))
    limits = Limits(prune_weight, max_hypotheses, give_up_ratio)
    return BankOfMhts(single, hypothesis_reducer(reduction, components), None, 0.0, 0.0, limits)
