"""Interacting multiple models with probabilistic data association, for linear sensors and radars."""

from dataclasses import dataclass, field

import numpy as np

from gmr_gym.checks import check_limits
from gmr_gym.filters.association import log_weights
from gmr_gym.filters.filter_bank import FilterBank, initial_bank
from gmr_gym.filters.imm import mix_and_predict, pda_every_mode
from gmr_gym.filters.joint_gating import expand_jointly, give_up_limit
from gmr_gym.filters.mixing import MIXINGS, borrowed_states
from gmr_gym.filters.trace import Trace, rows_of_scan
from gmr_gym.filters.tracker import CompiledTracker, Report, check_scan
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture, collapsed
from gmr_gym.models.gating import Gates, count_gated, gate_threshold, unit_ball
from gmr_gym.models.kalman import Motion, Sensor, predict_detections
from gmr_gym.models.model import Model, with_radar_update


@dataclass(frozen=True)
class ImmPda:
    """IMM whose filters are PDA filters with one common list of detections.

    With one motion model it is PDA, without clutter it is the IMM. A prior of several Gaussians is merged at
    the start.

    Parameters
    ----------
    model : Model
        The filter model.
    give_up_ratio : float
        The track is given up when the expected false alarms within one sigma of the prediction exceed this
        times max(1, their number at the first scan).
    mixing : {"augmented", "unbiased"}
        Mixing of motions of different state, see `gmr_gym.filters.mixing.borrowed_states`.

    Attributes
    ----------
    give_up_limit : float
        Expected false alarms within one sigma at which the track is given up.

    Notes
    -----
    Departs: Li's eq. 14 is the covariance of a certain association, and his likelihoods weigh models by
    gates of their own. Here the covariance is that of PDA, and all models share one list of detections.

    References
    ----------
    Blom and Bar-Shalom 1988; Zhang, IMM+PDA; Li, section 3.
    """

    model: Model
    give_up_ratio: float = 20.0
    mixing: str = MIXINGS[0]
    _moves: Motion = field(init=False, repr=False)
    _logs: tuple[float, float] = field(init=False, repr=False)
    give_up_limit: float = field(init=False, repr=False)
    _borrowed: np.ndarray = field(init=False, repr=False)

    def __post_init__(self):
        model = self.model
        check_limits(0.0, 1, self.give_up_ratio)
        assumed = model.detection_probability, model.gate_probability, model.clutter_density
        # the second of log_weights is a difference of two logarithms, and differs in the last bit
        logs = log_weights(*assumed)[0], float(np.log(model.detection_probability / model.clutter_density))
        object.__setattr__(self, "_moves", Motion(*map(np.array, zip(*model.motions, strict=True))))
        object.__setattr__(self, "_logs", logs)
        object.__setattr__(self, "give_up_limit", give_up_limit(model, self.give_up_ratio))
        object.__setattr__(self, "_borrowed", borrowed_states(model.motions, self.mixing))

    @property
    def compiled(self) -> CompiledTracker | None:
        """Its form for compiled loops; None for a radar, and for another class that inherits from this."""
        model = self.model
        if type(self) is not ImmPda or not isinstance(model.sensor, Sensor):
            return None
        p = len(model.sensor.H)
        mixing = model.switching, self._borrowed, *self._moves
        gating = gate_threshold(model.gate_probability, p), float(model.clutter_density)
        told = mixing, model.sensor[:], gating, (unit_ball(p), *self._logs, self.give_up_limit)
        w, m, P = self.init()
        return CompiledTracker(_scan, told, (w[:, 0], m[:, 0], P[:, 0]))

    def init(self) -> FilterBank:
        """Belief one period before the first scan."""
        return initial_bank(self.model.mode_prior, collapsed(self.model.prior))

    def step(self, belief: FilterBank, z: np.ndarray) -> tuple[FilterBank, Report]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        model = self.model
        z = check_scan(z, len(model.sensor.H))
        predicted = self._predicted(belief)
        z_hat, S = model.sensor.gates(predicted)
        p = z_hat.shape[1]
        threshold = gate_threshold(model.gate_probability, p)
        # plain tuples: a NamedTuple takes 0.5 us longer to enter compiled code
        w, m, P, mean, covariance, alive = pda_every_mode(
            predicted[:], model.sensor.predict_detections(predicted, z_hat, S, z)[:], (z_hat, S, threshold),
            model.sensor.density(model.clutter_density, z_hat), unit_ball(p), *self._logs, self.give_up_limit,
        )  # fmt: skip
        possible = predicted.w > 0  # an impossible mode has no gate
        gates_used = (
            Gates(z_hat, S, threshold) if possible.all() else Gates(z_hat[possible], S[possible], threshold)
        )
        fused = Mixture(np.ones(1), mean, covariance)
        return FilterBank(w[:, None], m[:, None], P[:, None]), Report(
            mean, covariance, gates_used, fused, alive, w
        )

    def trace(self, belief: FilterBank, z: np.ndarray) -> tuple[FilterBank, Report, Trace]:
        """What `step` gives, and the full posterior by mode, all of which is merged into `report.mixture`,
        the output of the IMM."""
        scan = check_scan(z, len(self.model.sensor.H))
        expansion, near, *_ = expand_jointly(self._predicted(belief), self.model, scan, self.give_up_limit)
        full, mode, detection, _ = expansion
        one = np.zeros_like(mode)
        return *self.step(belief, z), Trace(full, one, rows_of_scan(detection, near), one, mode)

    def _predicted(self, belief: FilterBank) -> Mixture:
        """The filters, mixed and predicted."""
        w, m, P = belief.w[:, 0], belief.m[:, 0], belief.P[:, 0]
        return Mixture(*mix_and_predict(w, m, P, self.model.switching, self._borrowed, *self._moves))


@kernel(inline="always")
def _scan(told, belief, z):
    """`ImmPda.step` for a linear sensor, see `CompiledTracker`."""
    mixing, (H, R), (threshold, clutter_density), limits = told
    w, m, P = belief
    predicted = mix_and_predict(w, m, P, *mixing)
    w, m, P = predicted
    predicted_z = predict_detections(m, P, H, R, z)
    z_hat, S = predicted_z.z_hat, predicted_z.S
    w_now, m, P, mean, covariance, alive = pda_every_mode(
        predicted, predicted_z[:], (z_hat, S, threshold), np.full(len(w), clutter_density), *limits
    )
    centres, S = z_hat[w > 0], S[w > 0]  # an impossible mode has no gate
    fused = Mixture(np.ones(1), mean, covariance)
    report = Report(mean, covariance, Gates(centres, S, threshold), fused, alive, w_now)
    return (w_now, m, P), report, count_gated(centres, S, threshold, z)


def imm(model: Model, give_up_ratio: float = 20.0, mixing: str = MIXINGS[0]) -> ImmPda:
    """Interacting multiple models; in clutter, IMM+PDA.

    Parameters
    ----------
    model : Model
        The filter model.
    give_up_ratio : float
        The track is given up when the expected false alarms within one sigma of the prediction exceed this
        times max(1, their number at the first scan).
    mixing : {"augmented", "unbiased"}
        Mixing of motions of different state, see `gmr_gym.filters.mixing.borrowed_states`.

    Returns
    -------
    ImmPda

    References
    ----------
    Blom and Bar-Shalom 1988.
    """
    return ImmPda(model, give_up_ratio, mixing)


def imm_dcm_pda(model: Model, give_up_ratio: float = 20.0, mixing: str = MIXINGS[0]) -> ImmPda:
    """IMM+PDA with the debiased converted measurements of a radar.

    Parameters
    ----------
    model : Model
        The filter model.
    give_up_ratio : float
        The track is given up when the expected false alarms within one sigma of the prediction exceed this
        times max(1, their number at the first scan).
    mixing : {"augmented", "unbiased"}
        Mixing of motions of different state, see `gmr_gym.filters.mixing.borrowed_states`.

    Returns
    -------
    ImmPda

    References
    ----------
    Li, IMMDCMPDA.
    """
    return ImmPda(with_radar_update(model, "debiased"), give_up_ratio, mixing)


def imm_ekf_pda(model: Model, give_up_ratio: float = 20.0, mixing: str = MIXINGS[0]) -> ImmPda:
    """IMM+PDA of extended Kalman filters, the radar linearised at each prediction.

    Parameters
    ----------
    model : Model
        The filter model.
    give_up_ratio : float
        The track is given up when the expected false alarms within one sigma of the prediction exceed this
        times max(1, their number at the first scan).
    mixing : {"augmented", "unbiased"}
        Mixing of motions of different state, see `gmr_gym.filters.mixing.borrowed_states`.

    Returns
    -------
    ImmPda

    References
    ----------
    Li, IMMEKFPDA.
    """
    return ImmPda(with_radar_update(model, "extended"), give_up_ratio, mixing)
