"""Interacting multiple models with probabilistic data association, on sensors linear or not."""

from dataclasses import dataclass, field

import numpy as np

from gmr_gym.checks import check_limits
from gmr_gym.filters.filter_bank import Bank, started
from gmr_gym.filters.imm import associated, mixed_ahead
from gmr_gym.filters.joint_gating import hopeless_beyond
from gmr_gym.filters.mixing import MIXINGS, borrowed_states
from gmr_gym.filters.tracker import Report, check_scan
from gmr_gym.mixture import Mixture, collapsed
from gmr_gym.models.gating import Gates, gate_size, unit_ball
from gmr_gym.models.kalman import Motion
from gmr_gym.models.model import Model, told_by


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
    hopeless: float = 20.0
    mixing: str = MIXINGS[0]
    _moves: Motion = field(init=False, repr=False)  # all motions, on a first axis
    _logs: tuple[float, float] = field(init=False, repr=False)  # of a miss, and of a detection for clutter
    _given_up: float = field(init=False, repr=False)
    _borrowed: np.ndarray = field(init=False, repr=False)

    def __post_init__(self):
        model = self.model
        check_limits(0.0, 1, self.hopeless)
        miss = 1.0 - model.detection_probability * model.gate_probability
        hit = model.detection_probability / model.clutter_density
        logs = np.log(miss) if miss > 0 else -np.inf, np.log(hit)
        object.__setattr__(self, "_moves", Motion(*map(np.array, zip(*model.motions, strict=True))))
        object.__setattr__(self, "_logs", logs)
        object.__setattr__(self, "_given_up", hopeless_beyond(model, self.hopeless))
        object.__setattr__(self, "_borrowed", borrowed_states(model.motions, self.mixing))

    def init(self) -> Bank:
        return started(self.model.mode_prior, collapsed(self.model.prior))

    def step(self, belief: Bank, z: np.ndarray) -> tuple[Bank, Report]:
        model = self.model
        z = check_scan(z, len(model.sensor.H))
        w, m, P = belief.w[:, 0], belief.m[:, 0], belief.P[:, 0]
        predicted = Mixture(*mixed_ahead(w, m, P, model.switching, self._borrowed, *self._moves))
        at, S = model.sensor.gates(predicted)
        size = gate_size(model.gate_probability, at.shape[1])
        w, m, P, mean, covariance, alive = associated(
            *predicted, S, model.sensor.density(model.clutter_density, at), unit_ball(at.shape[1]),
            *model.sensor.look(predicted, at, S, z), size, *self._logs, self._given_up,
        )  # fmt: skip
        possible = predicted.w > 0  # an impossible mode looks nowhere
        looked = Gates(at, S, size) if possible.all() else Gates(at[possible], S[possible], size)
        fused = Mixture(np.ones(1), mean, covariance)
        return Bank(w[:, None], m[:, None], P[:, None]), Report(mean, covariance, looked, fused, alive, w)


def imm(model: Model, hopeless: float = 20.0, mixing: str = MIXINGS[0]) -> ImmPda:
    """Interacting multiple models (Blom and Bar-Shalom 1988); in clutter it is IMM+PDA."""
    return ImmPda(model, hopeless, mixing)


def imm_dcm_pda(model: Model, hopeless: float = 20.0, mixing: str = MIXINGS[0]) -> ImmPda:
    """IMM+PDA of a radar's debiased converted measurements (Li, IMMDCMPDA)."""
    return ImmPda(told_by(model, "debiased"), hopeless, mixing)


def imm_ekf_pda(model: Model, hopeless: float = 20.0, mixing: str = MIXINGS[0]) -> ImmPda:
    """IMM+PDA of extended Kalman filters, the radar linearised about each prediction (Li, IMMEKFPDA)."""
    return ImmPda(told_by(model, "extended"), hopeless, mixing)
