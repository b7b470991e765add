"""MHTs with a bank of filters, one per motion model, in every hypothesis: IMM+MHT, MMAE+MHT, MMAE.

Zhang and Liu, section 6.3; Maybeck et al., section IV, architectures 3 and 4.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial

import numpy as np

from gmr_gym.checks import UNLIMITED
from gmr_gym.filters.association import Expansion
from gmr_gym.filters.filter_bank import (
    FilterBank,
    as_bank,
    as_mixture,
    imm_mix,
    imm_output,
    initial_bank,
    merge_hypotheses,
    no_interaction,
    predict_bank,
    restart_and_floor,
)
from gmr_gym.filters.histories import (
    WithHistory,
    after_scan,
    at_start,
    joined_belief,
    parted_belief,
    reduce_with,
)
from gmr_gym.filters.joint_gating import Limits, expand_jointly, give_up_limit
from gmr_gym.filters.mixing import MIXINGS, borrowed_states
from gmr_gym.filters.trace import Trace, rows_of_scan
from gmr_gym.filters.tracker import Report, check_scan
from gmr_gym.mixture import Mixture, collapsed, match_all, mean_and_covariance, normalised
from gmr_gym.models.model import Model
from gmr_gym.reduction.n_scan import NScan
from gmr_gym.reduction.protocol import Reduced, check_reduced, through
from gmr_gym.reduction.pruning import entering
from gmr_gym.reduction.registry import hypothesis_reducer

Belief = FilterBank | WithHistory  # the latter with NScan


@dataclass(frozen=True)
class MhtOfBanks:
    """MHT whose hypotheses are banks of filters, with the detections in the gate of any filter.

    Hypotheses are pruned and reduced by the output of their banks and merged mode by mode.

    Parameters
    ----------
    model : Model
        The filter model.
    reduce : callable
        Reduction of the outputs of the banks.
    before : callable
        Interaction of the filters before the prediction, of the bank and the transition matrix.
    after : callable
        Interaction after the update, of the bank and the log densities (r, n) of its residuals.
    work_limits : Limits
        What is pruned before the reduction, and when the track is given up.

    Attributes
    ----------
    give_up_limit : float
        Expected false alarms within one sigma at which the track is given up.

    Notes
    -----
    Departs: Maybeck gates each bank on its own. Here all share one list of detections, so that their weights
    account for the same scan.
    """

    model: Model
    reduce: Callable[[Mixture], Reduced]
    before: Callable[[FilterBank, np.ndarray], FilterBank]
    after: Callable[[FilterBank, np.ndarray], FilterBank]
    work_limits: Limits = field(default_factory=Limits)
    give_up_limit: float = field(init=False, repr=False)

    def __post_init__(self):
        object.__setattr__(self, "give_up_limit", give_up_limit(self.model, self.work_limits.give_up_ratio))
        # wrong parameters fail here rather than at a scan
        if not isinstance(self.reduce, NScan):
            check_reduced(self.reduce(collapsed(self.model.prior)), 1)
        bank, _ = parted_belief(self.init())
        self.after(bank, np.zeros(bank.w.shape))

    def init(self) -> Belief:
        """Belief one period before the first scan."""
        bank = initial_bank(self.model.mode_prior, self.model.prior)
        return joined_belief(bank, at_start(self.reduce, bank.w.shape[1]))

    def step(self, belief: Belief, z: np.ndarray) -> tuple[Belief, Report]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        return self._scan(belief, z)[:2]

    def trace(self, belief: Belief, z: np.ndarray) -> tuple[Belief, Report, Trace]:
        """What `step` gives, and what became of every filter of every hypothesis.

        `full` are the filters of all banks after their interaction, by mode; those of one bank go into the
        same row of `report.mixture`, the output of the bank.
        """
        after, report, expansion, near, filters, into = self._scan(belief, z)
        r, n = parted_belief(belief)[0].w.shape
        mode, parent = np.divmod(expansion.parent, n)
        detection = rows_of_scan(expansion.detection, near)
        return after, report, Trace(as_mixture(filters), parent, detection, np.tile(into, r), mode)

    def _scan(
        self, belief: Belief, z: np.ndarray
    ) -> tuple[Belief, Report, Expansion, np.ndarray, FilterBank, np.ndarray]:
        """Belief and report; the full posterior, the mask (k,) of the detections in it, its banks after their
        interaction, and the hypothesis that each bank went into."""
        model = self.model
        z = check_scan(z, len(model.sensor.H))
        bank, history = parted_belief(belief)
        predicted = predict_bank(self.before(bank, model.switching), model.motions)
        expansion, near, gates_used, alive = expand_jointly(predicted, model, z, self.give_up_limit)
        posterior = as_bank(expansion.mixture, len(model.motions))
        posterior = self.after(posterior, expansion.log_density.reshape(posterior.w.shape))
        limits = self.work_limits
        hypotheses, kept = entering(imm_output(posterior), limits.prune_weight, limits.max_hypotheses)
        n = len(kept)
        history = after_scan(history, expansion.parent[:n], expansion.detection[:n], kept)
        (reduced, origin), history = reduce_with(self.reduce, hypotheses, history)
        into = through(kept, origin)
        bank = merge_hypotheses(posterior, into, len(reduced.w))
        bank = bank._replace(w=bank.w / bank.w.sum())
        mixture = normalised(reduced)
        mean, covariance = mean_and_covariance(mixture)
        mode_probabilities = bank.w.sum(axis=1)
        report = Report(mean[None], covariance[None], gates_used, mixture, alive, mode_probabilities)
        return joined_belief(bank, history), report, expansion, near, posterior, into


def imm_mht(
    model: Model,
    components: int = 15,
    reduction: str = "runnalls",
    prune_weight: float = 1e-5,
    max_hypotheses: int = 500,
    give_up_ratio: float = 20.0,
    mixing: str = MIXINGS[0],
) -> MhtOfBanks:
    """MHT with an IMM in each hypothesis, reduced to `components` by a reduction of the IMMs' outputs.

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
    mixing : {"augmented", "unbiased"}
        Mixing of motions of different state, see `gmr_gym.filters.mixing.borrowed_states`.

    Returns
    -------
    MhtOfBanks

    References
    ----------
    Zhang, IMM+MHT.
    """
    mix = partial(imm_mix, borrowed=borrowed_states(model.motions, mixing))
    limits = Limits(prune_weight, max_hypotheses, give_up_ratio)
    return MhtOfBanks(model, hypothesis_reducer(reduction, components), mix, no_interaction, limits)


def mmae_pda(
    model: Model, floor: float = 1e-3, restart: float = 1e-5, give_up_ratio: float = 20.0
) -> MhtOfBanks:
    """Multiple model adaptive estimation: filters that never mix, with a PDA in place of each Kalman filter.

    Parameters
    ----------
    model : Model
        The filter model.
    floor : float
        Least probability of a motion model, in [0, 1 / r).
    restart : float
        Density of its residual, per unit of the sensor's space, below which a filter is reset to the others;
        0 for never. At the paper's sensor 1e-5 per m^2 is a squared residual of 8 to 9.
    give_up_ratio : float
        The track is given up when the expected false alarms within one sigma of the prediction exceed this
        times max(1, their number at the first scan).

    Returns
    -------
    MhtOfBanks

    References
    ----------
    Maybeck, section III.
    """
    after = partial(restart_and_floor, floor=floor, restart=restart)
    return MhtOfBanks(model, _all_in_one, no_interaction, after, Limits(0.0, UNLIMITED, give_up_ratio))


def mmae_mht(
    model: Model,
    components: int = 15,
    reduction: str = "runnalls",
    prune_weight: float = 1e-5,
    floor: float = 1e-3,
    restart: float = 1e-5,
    max_hypotheses: int = 500,
    give_up_ratio: float = 20.0,
) -> MhtOfBanks:
    """MHT with an MMAE in each hypothesis, reduced to `components` by a reduction of the MMAEs' outputs.

    Parameters
    ----------
    model : Model
        The filter model.
    components : int
        Most hypotheses after the reduction.
    reduction : str
        Name of a reduction, see `gmr_gym.reduction.registry`. "ise" gives the ISE of MMAEs.
    prune_weight : float
        Hypotheses of less weight are pruned before the reduction.
    floor : float
        Least probability of a motion model, in [0, 1 / r).
    restart : float
        Density of its residual, per unit of the sensor's space, below which a filter is reset to the others;
        0 for never.
    max_hypotheses : int
        Most hypotheses that enter the reduction, whose work may grow as their square; the heaviest are kept.
    give_up_ratio : float
        The track is given up when the expected false alarms within one sigma of the prediction exceed this
        times max(1, their number at the first scan).

    Returns
    -------
    MhtOfBanks

    References
    ----------
    Maybeck, section IV.
    """
    after = partial(restart_and_floor, floor=floor, restart=restart)
    limits = Limits(prune_weight, max_hypotheses, give_up_ratio)
    return MhtOfBanks(model, hypothesis_reducer(reduction, components), no_interaction, after, limits)


def _all_in_one(p: Mixture) -> Reduced:
    return match_all(p), np.zeros(len(p.w), int)
