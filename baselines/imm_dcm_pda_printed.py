"""IMM with debiased converted measurements and PDA, with the formulas as printed: for comparison only."""

from dataclasses import dataclass, field

import numpy as np

from gmr_gym.filters.filter_bank import FilterBank, initial_bank
from gmr_gym.filters.imm import mix_and_predict
from gmr_gym.filters.mixing import MIXINGS, borrowed_states
from gmr_gym.filters.tracker import Report, check_scan
from gmr_gym.mixture import Mixture, collapsed, match_all
from gmr_gym.models.gating import Gates, gated_distances, gates, volumes
from gmr_gym.models.model import Model, with_radar_update
from gmr_gym.models.sensing import PredictedDetections
from gmr_gym.models.update import joseph_into


@dataclass(frozen=True)
class Printed:
    """Li's filter with the covariance and likelihood as printed, or those of PDA.

    With both of PDA's it is imm-pda with update="debiased-at-prediction".

    Parameters
    ----------
    model : Model
        The filter model.
    covariance_as_printed : bool
        The covariance of eq. 14 if True, that of PDA otherwise.
    likelihood_as_printed : bool
        The likelihood printed after eq. 16 if True, that of PDA otherwise.
    mixing : {"augmented", "unbiased"}
        Mixing of motions of different state, see `gmr_gym.filters.mixing.borrowed_states`.

    Notes
    -----
    The paper leaves open: the bias and covariance of a conversion have the index of a model and not of a
    detection, so they are those at the model's prediction. With no detection in a model's gate the printed
    likelihood divides by zero; it is then 1 - P_D P_G.

    References
    ----------
    Li, eqs. 8-19.
    """

    model: Model
    covariance_as_printed: bool
    likelihood_as_printed: bool
    mixing: str = MIXINGS[0]
    _borrowed: np.ndarray = field(init=False, repr=False)

    def __post_init__(self):
        object.__setattr__(self, "_borrowed", borrowed_states(self.model.motions, self.mixing))

    def init(self) -> FilterBank:
        """Belief one period before the first scan."""
        return initial_bank(self.model.mode_prior, collapsed(self.model.prior))

    def step(self, belief: FilterBank, z: np.ndarray) -> tuple[FilterBank, Report]:
        """Belief after the scan `z` (k, p) one period later, and its report."""
        model = self.model
        z = check_scan(z, len(model.sensor.H))
        w, m, P = belief.w[:, 0], belief.m[:, 0], belief.P[:, 0]
        moves = map(np.array, zip(*model.motions, strict=True))
        predicted = Mixture(*mix_and_predict(w, m, P, model.switching, self._borrowed, *moves))
        gates_used = gates(predicted, model.sensor, model.gate_probability)
        d2 = gated_distances(predicted, gates_used, model.sensor, z)
        near = np.isfinite(d2)
        if not self.likelihood_as_printed:  # likelihoods of models compare only over one list
            near[:] = near.any(axis=0)
            d2 = gated_distances(predicted, gates_used._replace(threshold=np.inf), model.sensor, z)
        predicted_z = model.sensor.predict_detections(predicted, gates_used.z, gates_used.S, z)
        volume = volumes(Gates(predicted_z.z_hat, predicted_z.S, gates_used.threshold))
        clutter = model.sensor.density(model.clutter_density, gates_used.z)
        updated = [
            self._updated(j, predicted, predicted_z, near[j], d2[j], volume[j], clutter[j])
            for j in range(len(w))
        ]
        log_likelihood, m, P = (np.array(part) for part in zip(*updated, strict=True))
        top = log_likelihood[predicted.w > 0].max()
        w = predicted.w  # unchanged where the scan is impossible under every model
        if top > -np.inf:
            w = w * np.exp(np.minimum(log_likelihood - top, 0.0))
            w /= w.sum()
        fused = match_all(Mixture(w, m, P))
        return FilterBank(w[:, None], m[:, None], P[:, None]), Report(
            fused.m, fused.P, gates_used, fused, modes=w
        )

    def _updated(
        self,
        j,
        predicted: Mixture,
        predicted_z: PredictedDetections,
        near,
        d2,
        volume: float,
        clutter_density: float,
    ):
        """Log-likelihood, mean and covariance of model j.

        clutter_density is the density of clutter in space at the prediction.
        """
        model, S = self.model, predicted_z.S[j]
        own = predicted_z.z[j] if len(predicted_z.z) > 1 else predicted_z.z[0]
        innovations = (own - predicted_z.z_hat[j])[near]
        missed = 1 - model.detection_probability * model.gate_probability
        scale = np.sqrt(np.linalg.det(2 * np.pi * S))
        e = np.exp(-0.5 * d2[near])
        # b(k) and e(k) per unit of the radar's own space, where the clutter density is constant
        own_e = e * np.exp(predicted_z.log_jacobian[near])
        b = model.clutter_density * scale * missed / model.detection_probability
        total = b + own_e.sum()
        beta = own_e / total if total > 0 else own_e
        K = np.linalg.solve(S, predicted_z.C[j]).T.copy()
        innovation = beta @ innovations
        mean = predicted.m[j] + K @ innovation
        P_hit = np.empty_like(predicted.P[j])
        # P - K S K', in Joseph's form, which does not cancel for a wide prediction
        joseph_into(
            P_hit,
            K,
            predicted.P[j],
            predicted_z.H[j % len(predicted_z.H)],
            predicted_z.noise[j % len(predicted_z.noise)],
        )
        if self.covariance_as_printed:
            covariance = P_hit
        else:
            missing, off = 1 - beta.sum(), innovations - innovation
            scatter = (beta * off.T) @ off + missing * np.outer(innovation, innovation)
            covariance = missing * predicted.P[j] + beta.sum() * P_hit + K @ scatter @ K.T
        count = len(e)
        with np.errstate(divide="ignore"):  # of zero likelihoods
            if not self.likelihood_as_printed:
                log_likelihood = np.log(model.detection_probability * total / scale)
            elif count:
                # V^(1 - m) in logarithms: it overflows for many detections m
                log_share = (1 - count) * np.log(volume) if count > 1 else 0.0
                log_share += np.log(model.detection_probability / count)
                log_likelihood = log_share + np.log(clutter_density / model.clutter_density * b + e.sum())
            else:
                log_likelihood = np.log(missed)
        return log_likelihood, mean, (covariance + covariance.T) / 2


def imm_dcm_pda_printed(
    model: Model,
    covariance_as_printed: bool = True,
    likelihood_as_printed: bool = True,
    mixing: str = MIXINGS[0],
) -> Printed:
    """`imm-dcm-pda` with the formulas of the paper as printed, for comparison.

    Parameters
    ----------
    model : Model
        The filter model.
    covariance_as_printed : bool
        The covariance of eq. 14 if True, that of PDA otherwise.
    likelihood_as_printed : bool
        The likelihood printed after eq. 16 if True, that of PDA otherwise.
    mixing : {"augmented", "unbiased"}
        Mixing of motions of different state, see `gmr_gym.filters.mixing.borrowed_states`.

    Returns
    -------
    Printed

    References
    ----------
    Li, eqs. 8-19.
    """
    debiased = with_radar_update(model, "debiased-at-prediction")
    return Printed(debiased, covariance_as_printed, likelihood_as_printed, mixing)
