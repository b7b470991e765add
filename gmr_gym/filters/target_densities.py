"""Densities of single targets, of which the hypotheses of trackers of many targets are made.

A density is a probability and a Gaussian for each motion model, an IMM; with one motion it is a Gaussian.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gmr_gym.filters.association import update_associated
from gmr_gym.filters.intensity_update import LOG_NEGLIGIBLE
from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, log_gaussian_scale, mahalanobis_squared
from gmr_gym.mixture import Mixture, match
from gmr_gym.models.kalman import Motion, predict_all
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.models.sensing import MeasurementModel, PredictedDetections


class Densities(NamedTuple):
    """n densities of single targets over r motion models.

    Attributes
    ----------
    w : ndarray, shape (n, r)
        Mode probabilities; rows sum to 1.
    m : ndarray, shape (n, r, d)
        Mean of the state given the mode.
    P : ndarray, shape (n, r, d, d)
        Its covariance.
    """

    w: np.ndarray
    m: np.ndarray
    P: np.ndarray


class Pairs(NamedTuple):
    """The e pairs of a density and a detection in its gate, by density, then by detection.

    Attributes
    ----------
    row : ndarray of int, shape (e,)
        Density.
    detection : ndarray of int, shape (e,)
    log_likelihood : ndarray, shape (e,)
        log of the density of the detection, in the sensor's own space.
    of_mode : ndarray, shape (e, r)
        Its parts: log of mode probability times density given the mode.
    predicted_z : PredictedDetections
        Of all modes of all densities, mode after mode of each.
    """

    row: np.ndarray
    detection: np.ndarray
    log_likelihood: np.ndarray
    of_mode: np.ndarray
    predicted_z: PredictedDetections


def of_mixture(p: Mixture, mode_prior: np.ndarray) -> Densities:
    """A density for each component of a mixture, the same for every mode.

    Parameters
    ----------
    p : Mixture
        n components; their weights play no part.
    mode_prior : ndarray, shape (r,)
        Mode probabilities.

    Returns
    -------
    Densities
    """
    n, r = len(p.w), len(mode_prior)
    m, P = np.repeat(p.m[:, None], r, axis=1), np.repeat(p.P[:, None], r, axis=1)
    return Densities(np.tile(mode_prior, (n, 1)), m, P)


def as_mixture(densities: Densities) -> Mixture:
    """The n r Gaussians (mode after mode of each density) as one mixture."""
    n, r, d = densities.m.shape
    return Mixture(densities.w.reshape(-1), densities.m.reshape(n * r, d), densities.P.reshape(n * r, d, d))


def take(densities: Densities, index: np.ndarray) -> Densities:
    """The densities at `index`, integers or a boolean mask (n,)."""
    return Densities(densities.w[index], densities.m[index], densities.P[index])


def joined(parts: Sequence[Densities]) -> Densities:
    """The densities of all parts, one part after another."""
    return Densities(*map(np.concatenate, zip(*parts, strict=True)))


def predict(densities: Densities, motions: tuple[Motion, ...], switching: np.ndarray) -> Densities:
    r"""Predict by one period: mix the modes, and move each by its motion.

    Parameters
    ----------
    densities : Densities
    motions : tuple of Motion
        r motion models.
    switching : ndarray, shape (r, r)
        Transition matrix; columns sum to 1.

    Returns
    -------
    Densities

    Notes
    -----
    The mixing of `filter_bank.imm_mix`; with one motion, a Kalman prediction.

    References
    ----------
    Blom and Bar-Shalom 1988.
    """
    F, Q, offset = (np.array(part) for part in zip(*motions, strict=True))
    return Densities(*_predicted(*densities, switching, F, Q, offset))


def pair(
    densities: Densities,
    sensor: MeasurementModel,
    z: np.ndarray,
    log_kappa: np.ndarray,
    weight: np.ndarray,
    log_negligible: float = LOG_NEGLIGIBLE,
) -> Pairs:
    r"""Gate the detections of a scan, and weigh each pair.

    Parameters
    ----------
    densities : Densities
        Predicted.
    sensor : MeasurementModel
    z : ndarray, shape (k, p)
        Detections.
    log_kappa : ndarray, shape (k,)
        log of the clutter intensity at the detections, in the sensor's space.
    weight : ndarray, shape (n,)
        Expected number of detections of each: probabilities of existence and of detection, multiplied.
    log_negligible : float
        A pair is left out where its ratio to the clutter is smaller in every mode.

    Returns
    -------
    Pairs

    Notes
    -----
    With mode probabilities :math:`\mu_q` the likelihood of a pair is

    .. math:: g_{ij} = \sum_q \mu_{iq} \mathcal{N}(z_j; h(m_{iq}), S_{iq})
    """
    p = as_mixture(densities)
    predicted_z = sensor.predict_detections(p, *sensor.gates(p), z)
    with np.errstate(divide="ignore"):
        log_weight = np.log(weight) - log_negligible
    # plain tuples: a kernel takes a record in 30 us
    row, detection, log_likelihood, of_mode = _paired(densities.w, predicted_z[:], log_weight, log_kappa)
    return Pairs(row, detection, log_likelihood, of_mode, predicted_z)


def posteriors(densities: Densities, pairs: Pairs, chosen: np.ndarray) -> Densities:
    """The densities of the chosen pairs, conditioned on their detections.

    Parameters
    ----------
    densities : Densities
        Predicted, as they were paired.
    pairs : Pairs
    chosen : ndarray of int, shape (c,)
        Pairs; fastest in their order.

    Returns
    -------
    Densities
        c densities: a Kalman update of each mode, and mode probabilities by their likelihoods.
    """
    _, m, P = as_mixture(densities)
    *weighed, predicted_z = pairs
    return Densities(*_conditioned(m, P, tuple(weighed), predicted_z[:], chosen))


def merge(densities: Densities, weight: np.ndarray, group: np.ndarray, count: int) -> Densities:
    r"""Merge densities by their moments, mode by mode.

    Parameters
    ----------
    densities : Densities
    weight : ndarray, shape (n,)
    group : ndarray of int, shape (n,)
        Group of each, below `count`; -1 for a density that is left out.
    count : int
        Number of groups, none of them empty.

    Returns
    -------
    Densities
        One for each group. Where all weights of a group are 0 they count as equal.

    Notes
    -----
    With the share :math:`\beta_i` of density i in the weight of its group

    .. math:: \mu_q = \sum_i \beta_i \mu_{iq}

    and the Gaussian of mode q matches the moments of its members' with weights :math:`\beta_i \mu_{iq}`.
    Merged over modes, the mode probabilities would mean nothing in the next prediction.
    """
    return Densities(*_merged(*densities, weight, group, count))


def outputs(densities: Densities) -> tuple[np.ndarray, np.ndarray]:
    """Mean (n, d) and covariance (n, d, d) of each density over its modes."""
    n, r, d = densities.m.shape
    if r == 1:
        return densities.m.reshape(n, d), densities.P.reshape(n, d, d)
    _, x, P = match(*as_mixture(densities), np.repeat(np.arange(n), r), n)
    return x, P


def moved(densities: Densities, model: MultiTargetModel) -> Densities:
    """`predict` by the motions of a filter model."""
    return predict(densities, model.motions, model.switching)


@kernel
def _predicted(w, m, P, switching, F, Q, offset):
    n, r, d = m.shape
    m_out, P_out = np.empty((n, r, d)), np.empty((n, r, d, d))
    if r > 1:
        joint, into = np.empty(n * r * r), np.empty(n * r * r, np.int64)
        m_in, P_in = np.empty((n * r * r, d)), np.empty((n * r * r, d, d))
        for i in range(n):
            for q in range(r):
                for p in range(r):
                    at = (i * r + q) * r + p
                    joint[at], into[at] = switching[q, p] * w[i, p], i * r + q
                    m_in[at], P_in[at] = m[i, p], P[i, p]
        w_mixed, m_mixed, P_mixed = match(joint, m_in, P_in, into, n * r)
        w, m, P = w_mixed.reshape(n, r), m_mixed.reshape(n, r, d), P_mixed.reshape(n, r, d, d)
    for q in range(r):
        m_out[:, q], P_out[:, q] = predict_all(m[:, q].copy(), P[:, q].copy(), F[q], Q[q], offset[q])
    return w, m_out, P_out


@kernel
def _paired(w, predicted_z, log_weight, log_kappa):
    """Fields of `Pairs` but for the last; log_weight (n,) is over the negligible ratio."""
    z_hat, S, _, z, R, log_jacobian, _, _ = predicted_z
    (n, r), p, k = w.shape, z_hat.shape[1], len(log_kappa)
    row, detection = np.empty(n * k, np.int64), np.empty(n * k, np.int64)
    log_likelihood, of_mode = np.empty(n * k), np.empty((n * k, r))
    L, y, S_pair, log_w, log_peak = np.zeros((r, p, p)), np.empty(p), np.empty((p, p)), np.log(w), np.empty(r)
    at = 0
    for i in range(n):
        for q in range(r):
            if not cholesky_into(L[q], S[i * r + q]):
                raise ValueError("an innovation covariance S = H P H' + R is not positive definite")
            log_peak[q] = log_gaussian_scale(L[q])  # without the detection's own noise no smaller than with
        for j in range(k):
            bound, near, top = log_weight[i] - log_kappa[j] + log_jacobian[j], False, -np.inf
            for q in range(r):
                # bounding box of the gate of a mode: rejects most clutter cheaply
                a, own = i * r + q, i * r + q if len(z) > 1 else 0
                threshold = 2.0 * (bound + log_w[i, q] + log_peak[q])
                within = threshold > 0.0
                for c in range(p):
                    variance = S[a, c, c] + R[j, c, c] if len(R) else S[a, c, c]
                    within &= (z[own, j, c] - z_hat[a, c]) ** 2 <= threshold * variance
                near |= within
            if not near:
                continue
            for q in range(r):
                a, own, peak = i * r + q, i * r + q if len(z) > 1 else 0, log_peak[q]
                if len(R):
                    for c in range(p):
                        for b in range(p):
                            S_pair[c, b] = S[a, c, b] + R[j, c, b]
                    cholesky_into(L[q], S_pair)
                    peak = log_gaussian_scale(L[q])
                d2 = mahalanobis_squared(L[q], z[own, j], z_hat[a], y)
                of_mode[at, q] = log_w[i, q] + peak - 0.5 * d2 + log_jacobian[j]
                top = max(top, of_mode[at, q])
            if top + log_weight[i] >= log_kappa[j]:
                total = 0.0
                for q in range(r):
                    total += np.exp(of_mode[at, q] - top)
                row[at], detection[at], log_likelihood[at] = i, j, top + np.log(total)
                at += 1
    return row[:at].copy(), detection[:at].copy(), log_likelihood[:at].copy(), of_mode[:at].copy()


@kernel
def _conditioned(m, P, weighed, predicted_z, chosen):
    row, paired_detection, log_likelihood, of_mode = weighed
    count, r, d = len(chosen), of_mode.shape[1], m.shape[1]
    parent, detection = np.empty(count * r, np.int64), np.empty(count * r, np.int64)
    w = np.empty((count, r))
    for c in range(count):
        a = chosen[c]
        for q in range(r):
            parent[c * r + q], detection[c * r + q] = row[a] * r + q, paired_detection[a]
            w[c, q] = np.exp(of_mode[a, q] - log_likelihood[a])
    m_out, P_out = update_associated(m, P, predicted_z, parent, detection)
    return w, m_out.reshape(count, r, d), P_out.reshape(count, r, d, d)


@kernel
def _merged(w, m, P, weight, group, count):
    n, r, d = m.shape
    whole, members = np.zeros(count), np.zeros(count)
    for i in range(n):
        if group[i] >= 0:
            whole[group[i]] += weight[i]
            members[group[i]] += 1.0
    joint, into = np.zeros(n * r), np.full(n * r, -1)
    for i in range(n):
        g = group[i]
        if g >= 0:
            share = weight[i] / whole[g] if whole[g] > 0.0 else 1.0 / members[g]
            for q in range(r):
                joint[i * r + q], into[i * r + q] = share * w[i, q], g * r + q
    w_out, m_out, P_out = match(joint, m.reshape(n * r, d), P.reshape(n * r, d, d), into, count * r)
    return w_out.reshape(count, r), m_out.reshape(count, r, d), P_out.reshape(count, r, d, d)
