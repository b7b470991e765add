"""Interacting multiple models with probabilistic data association, on sensors linear or not."""

from dataclasses import dataclass, field

import numpy as np

from gmr_gym.checks import check_limits
from gmr_gym.filters.filter_bank import FilterBank, initial_bank
from gmr_gym.filters.imm import mix_and_predict, pda_every_mode
from gmr_gym.filters.joint_gating import give_up_limit
from gmr_gym.filters.mixing import MIXINGS, borrowed_states
from gmr_gym.filters.tracker import Report, check_scan
from gmr_gym.mixture import Mixture, collapsed
from gmr_gym.models.gating import Gates, gate_threshold, unit_ball
from gmr_gym.models.kalman import Motion
from gmr_gym.models.model import Model, with_radar_update


@dataclass(frozen=True)
class ImmPda:
    """A Gaussian for each motion, mixed before each scan; every detection in the gate of any of them moves
    all by its probability (Blom and Bar-Shalom 1988; Zhang, IMM+PDA; Li, section 3). With one motion it is
    PDA, without clutter IMM. A prior of several Gaussians is merged at the start. Motions of unlike state are
    mixed as `mixing` says, "augmented" or "unbiased" (see `borrowed_states`).

    Departs: Li's eq. 14 is the covariance of a certain association, his likelihoods weigh motions by gates of
    their own; this is PDA's covariance, and one list of detections for all motions.
    """

    model: Model
    # times the false detections expected within a deviation at first, and one, at which it gives up
    give_up_ratio: float = 20.0
    mixing: str = MIXINGS[0]
    _moves: Motion = field(init=False, repr=False)  # all motions, on a first axis
    _logs: tuple[float, float] = field(init=False, repr=False)  # of a miss, and of a detection for clutter
    give_up_limit: float = field(init=False, repr=False)
    _borrowed: np.ndarray = field(init=False, repr=False)

    def __post_init__(self):
        model = self.model
        check_limits(0.0, 1, self.give_up_ratio)
        miss = 1.0 - model.detection_probability * model.gate_probability
        hit = model.detection_probability / model.clutter_density
        logs = np.log(miss) if miss > 0 else -np.inf, np.log(hit)
        object.__setattr__(self, "_moves", Motion(*map(np.array, zip(*model.motions, strict=True))))
        object.__setattr__(self, "_logs", logs)
        object.__setattr__(self, "give_up_limit", give_up_limit(model, self.give_up_ratio))
        object.__setattr__(self, "_borrowed", borrowed_states(model.motions, self.mixing))

    def init(self) -> FilterBank:
        return initial_bank(self.model.mode_prior, collapsed(self.model.prior))

    def step(self, belief: FilterBank, z: np.ndarray) -> tuple[FilterBank, Report]:
        model = self.model
        z = check_scan(z, len(model.sensor.H))
        w, m, P = belief.w[:, 0], belief.m[:, 0], belief.P[:, 0]
        predicted = Mixture(*mix_and_predict(w, m, P, model.switching, self._borrowed, *self._moves))
        z_hat, S = model.sensor.gates(predicted)
        threshold = gate_threshold(model.gate_probability, z_hat.shape[1])
        w, m, P, mean, covariance, alive = pda_every_mode(
            *predicted, S, model.sensor.density(model.clutter_density, z_hat), unit_ball(z_hat.shape[1]),
            *model.sensor.predict_detections(predicted, z_hat, S, z), threshold, *self._logs,
            self.give_up_limit,
        )  # fmt: skip
        possible = predicted.w > 0  # an impossible mode looks nowhere
        gates_used = (
            Gates(z_hat, S, threshold) if possible.all() else Gates(z_hat[possible], S[possible], threshold)
        )
        fused = Mixture(np.ones(1), mean, covariance)
        return FilterBank(w[:, None], m[:, None], P[:, None]), Report(
            mean, covariance, gates_used, fused, alive, w
        )


def imm(model: Model, give_up_ratio: float = 20.0, mixing: str = MIXINGS[0]) -> ImmPda:
    """Interacting multiple models (Blom and Bar-Shalom 1988); in clutter it is IMM+PDA."""
    return ImmPda(model, give_up_ratio, mixing)


def imm_dcm_pda(model: Model, give_up_ratio: float = 20.0, mixing: str = MIXINGS[0]) -> ImmPda:
    """IMM+PDA of a radar's debiased converted measurements (Li, IMMDCMPDA)."""
    return ImmPda(with_radar_update(model, "debiased"), give_up_ratio, mixing)


def imm_ekf_pda(model: Model, give_up_ratio: float = 20.0, mixing: str = MIXINGS[0]) -> ImmPda:
    """IMM+PDA of extended Kalman filters, the radar linearised about each prediction (Li, IMMEKFPDA)."""
    return ImmPda(with_radar_update(model, "extended"), give_up_ratio, mixing)
