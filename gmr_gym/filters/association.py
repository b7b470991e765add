"""Data association of one target: gated measurements, and the full posterior of a scan."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gmr_gym.kernels import kernel, leaf_kernel
from gmr_gym.linalg import cholesky_into, log_gaussian_scale
from gmr_gym.mixture import Mixture
from gmr_gym.models.gating import Gates, gated_pairs
from gmr_gym.models.sensing import MeasurementModel
from gmr_gym.models.update import posterior_into


class Expansion(NamedTuple):
    """The full posterior of one scan, and the association that made each hypothesis.

    Attributes
    ----------
    mixture : Mixture
        N hypotheses; weights sum to 1.
    parent : ndarray, shape (N,)
        Index of the predicted component.
    detection : ndarray, shape (N,)
        Index of the detection taken as target-originated, -1 for a missed detection.
    log_density : ndarray, shape (N,)
        log N(z; H m, S) of that detection per unit of the sensor's own space; infinite for a miss.
    """

    mixture: Mixture
    parent: np.ndarray
    detection: np.ndarray
    log_density: np.ndarray


def expand(
    predicted: Mixture,
    gates: Gates,
    sensor: MeasurementModel,
    z: np.ndarray,
    detection_probability: float,
    gate_probability: float,
    clutter_density: float,
) -> Expansion:
    r"""Update every predicted component with every detection in its gate, and with a missed detection.

    Parameters
    ----------
    predicted : Mixture
        Predicted hypotheses.
    gates : Gates
        Their gates.
    sensor : MeasurementModel
    z : ndarray, shape (k, p)
        Detections of the scan.
    detection_probability, gate_probability : float
        P_D and P_G.
    clutter_density : float
        False alarms per unit of the sensor's space.

    Returns
    -------
    Expansion
        All hypotheses, their weights normalised.

    Notes
    -----
    Component :math:`i` with a missed detection and with detection :math:`z_j` in its gate has the weights

    .. math::

        w_{i0} \propto w_i (1 - P_D P_G), \qquad
        w_{ij} \propto w_i P_D \frac{\mathcal{N}(z_j; H m_i, S_i)}{\lambda}

    where :math:`\lambda` is the clutter density. They are formed in logarithms. P_G stands in the miss
    because a detection outside the gate is a miss too. A scan that is impossible under the model
    (P_D P_G = 1 and every gate empty) leaves the prediction unchanged.

    References
    ----------
    D'Ortenzio, eqs. 3-5.
    """
    predicted_z = sensor.predict_detections(predicted, gates.z, gates.S, z)
    weights = log_weights(detection_probability, gate_probability, clutter_density)
    # slices: a NamedTuple takes 0.5 us longer to enter compiled code than a tuple
    return expand_into_hypotheses(predicted[:], predicted_z[:], gates.threshold, *weights)


@lru_cache
def log_weights(
    detection_probability: float, gate_probability: float, clutter_density: float
) -> tuple[float, float]:
    """Logarithms of the association weights 1 - P_D P_G of a miss and P_D / clutter density of a detection.

    Parameters
    ----------
    detection_probability, gate_probability : float
        P_D and P_G.
    clutter_density : float
        False alarms per unit of the sensor's space.

    Returns
    -------
    log_miss, log_detect : float
        The weight of a detection is without its likelihood.
    """
    miss = 1.0 - detection_probability * gate_probability
    log_miss = float(np.log(miss)) if miss > 0 else -np.inf
    return log_miss, float(np.log(detection_probability) - np.log(clutter_density))


@kernel(inline="always")
def expand_into_hypotheses(predicted, predicted_z, threshold, log_miss, log_detect):
    """Compiled form of `expand`, from the fields of a Mixture and of its PredictedDetections."""
    w, m, P = predicted
    w, parent, detection, log_density = weigh_associations(w, predicted_z, threshold, log_miss, log_detect)
    m, P = update_associated(m, P, predicted_z, parent, detection)
    return Expansion(Mixture(w, m, P), parent, detection, log_density)


@kernel(inline="always")
def weigh_associations(w, predicted_z, threshold, log_miss, log_detect):
    """All fields of the Expansion but means and covariances, from the weights (n,) of the predicted
    components."""
    z_hat, S, _, z, R, log_jacobian, _, _ = predicted_z
    n, p = z_hat.shape
    first, near, d2 = gated_pairs(z_hat, S, z, R, threshold)
    hits = first[n]
    misses = n if log_miss > -np.inf or hits == 0 else 0
    # w_out holds logarithms until the last two loops
    w_out, top, total = np.empty(hits + misses), -np.inf, 0.0
    parent, detection = np.empty(hits + misses, np.int64), np.empty(hits + misses, np.int64)
    log_density = np.full(hits + misses, np.inf)
    L, pair = np.zeros((p, p)), np.empty((p, p))
    at = 0
    for i in range(n):
        log_w, log_peak = np.log(w[i]), 0.0
        if misses:
            w_out[at] = log_w + (log_miss if log_miss > -np.inf else 0.0)
            top = max(top, w_out[at])
            parent[at], detection[at] = i, -1
            at += 1
        for h in range(first[i], first[i + 1]):
            j = near[h]
            if len(R) or h == first[i]:  # every detection has its own noise, or all of the gate the same
                _sum_into(pair, S, i, R, j)
                cholesky_into(L, pair)
                log_peak = log_gaussian_scale(L)
            log_density[at] = log_peak - 0.5 * d2[h] + log_jacobian[j]
            w_out[at] = log_w + log_detect + log_density[at]
            top = max(top, w_out[at])
            parent[at], detection[at] = i, j
            at += 1
    for h in range(len(w_out)):
        w_out[h] = np.exp(w_out[h] - top)
        total += w_out[h]
    for h in range(len(w_out)):
        w_out[h] /= total
    return w_out, parent, detection, log_density


@kernel(inline="always")
def update_associated(m, P, predicted_z, parent, detection):
    """Means (N, d) and covariances (N, d, d) of the predicted components `parent` (N,) updated with
    `detection` (N,), -1 for a missed one; fastest where hypotheses of one parent follow each other."""
    z_hat, _, _, z, R, _, _, _ = predicted_z
    lists, p, d = len(z), z.shape[2], m.shape[1]
    m_out, P_out = np.empty((len(parent), d)), np.empty((len(parent), d, d))
    K, P_hit, room = np.empty((d, p)), np.empty((d, d)), _room(p, d)
    conditioned = -1
    for at in range(len(parent)):
        i, j = parent[at], detection[at]
        if j >= 0 and (len(R) or i != conditioned):
            _condition_into(P_hit, K, room, P, predicted_z, i, j)
            conditioned = i
        own = i if lists > 1 else 0
        for r in range(d):
            m_out[at, r] = m[i, r]
            if j >= 0:
                for c in range(p):
                    m_out[at, r] += K[r, c] * (z[own, j, c] - z_hat[i, c])
            for c in range(d):
                P_out[at, r, c] = P_hit[r, c] if j >= 0 else P[i, r, c]
    return m_out, P_out


@kernel(inline="always")
def update_by_parent(m, P, predicted_z, parent, detection):
    """`update_associated` where all detections have the same noise, with each covariance once.

    Returns means (N, d), covariances (2 n, d, d) of the n components missed, then updated with a detection,
    and the row (N,) among them of each hypothesis.
    """
    z_hat, _, _, z, _, _, _, _ = predicted_z
    n, p, d = len(m), z.shape[2], m.shape[1]
    m_out, row, every = np.empty((len(parent), d)), np.empty(len(parent), np.int64), np.empty((2 * n, d, d))
    K, room, conditioned = np.empty((d, p)), _room(p, d), -1
    for i in range(n):
        for r in range(d):
            for c in range(d):
                every[i, r, c] = every[n + i, r, c] = P[i, r, c]
    for at in range(len(parent)):
        i, j = parent[at], detection[at]
        if j >= 0 and i != conditioned:
            _condition_into(every[n + i], K, room, P, predicted_z, i, j)
            conditioned = i
        row[at] = i if j < 0 else n + i
        for r in range(d):
            m_out[at, r] = m[i, r]
            if j >= 0:
                for c in range(p):
                    m_out[at, r] += K[r, c] * (z[0, j, c] - z_hat[i, c])
    return m_out, every, row


@kernel(inline="always")
def _room(p, d):
    """Workspace of `_condition_into`."""
    return np.zeros((p, p)), np.empty((p, p)), (np.empty((p, d)), np.empty((p, p)))


@kernel(inline="always")
def _condition_into(P_out, K, room, P, predicted_z, i, j):
    """Writes covariance and gain of component i updated with detection j to P_out (d, d) and K (d, p)."""
    (L, pair, rest), (_, S, C, _, R, _, H, noise) = room, predicted_z
    _sum_into(pair, S, i, R, j)
    cholesky_into(L, pair)
    _sum_into(pair, noise, 0 if len(noise) == 1 else i, R, j)
    posterior_into(P_out, K, rest, L, P[i], C[i], H[0 if len(H) == 1 else i], pair)


@leaf_kernel
def _sum_into(pair, S, i, R, j):
    """Writes the covariance S[i] plus the noise R[j], where detections have their own, to `pair`."""
    for r in range(len(pair)):
        for c in range(len(pair)):
            pair[r, c] = S[i, r, c] + (R[j, r, c] if len(R) else 0.0)
