"""Gates: the regions where a target's detection is expected, and the detections in them."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import gamma, gammaincinv

from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, mahalanobis_squared, root_determinants
from gmr_gym.mixture import Mixture
from gmr_gym.models.sensing import MeasurementModel


class Gates(NamedTuple):
    r"""Ellipsoidal gates, one around each predicted detection.

    Attributes
    ----------
    z : ndarray (n, p)
        Predicted detections.
    S : ndarray (n, p, p)
        Innovation covariances.
    threshold : float
        Squared Mahalanobis distance.

    Notes
    -----
    Gate i is the set of detections z with

    .. math::

        (z - \hat z_i)^T S_i^{-1} (z - \hat z_i) \le \gamma_G

    where gamma_G is the `threshold`.
    """

    z: np.ndarray
    S: np.ndarray
    threshold: float


@lru_cache
def gate_threshold(probability: float, p: int) -> float:
    """Chi-square quantile: a p-dimensional innovation has a squared Mahalanobis distance below it with
    `probability`.

    Parameters
    ----------
    probability : float
        P_G.
    p : int
        Dimension of a detection.

    Examples
    --------
    >>> round(gate_threshold(0.99, 2), 4)
    9.2103
    """
    return float(2 * gammaincinv(p / 2, probability))


def gates(predicted: Mixture, sensor: MeasurementModel, probability: float) -> Gates:
    """Gates of every predicted component.

    Parameters
    ----------
    predicted : Mixture
        n components.
    sensor : MeasurementModel
    probability : float
        P_G: that the gate of a component contains its detection.
    """
    z, S = sensor.gates(predicted)
    return Gates(z, S, gate_threshold(probability, z.shape[1]))


def gated_distances(predicted: Mixture, gates: Gates, sensor: MeasurementModel, z: np.ndarray) -> np.ndarray:
    """Squared Mahalanobis distances of detections from the predicted ones, infinite outside the gates.

    Parameters
    ----------
    predicted : Mixture
        n components.
    gates : Gates
        Gates of these components.
    sensor : MeasurementModel
    z : ndarray (k, p)
        Detections, in the sensor's space; the distances are those of the sensor's update.

    Returns
    -------
    ndarray (n, k)
    """
    scan = sensor.predict_detections(predicted, gates.z, gates.S, z)
    return gated_distances_kernel(scan.z_hat, scan.S, scan.z, scan.R, gates.threshold)


def volumes(gates: Gates) -> np.ndarray:
    """Area (p = 2) or volume of each gate (n,), in units of the gates' space; gates may overlap."""
    p = gates.z.shape[1]
    return unit_ball(p) * gates.threshold ** (p / 2) * root_determinants(gates.S)


def gate_statistics(gates: Gates, z: np.ndarray) -> tuple[float, float]:
    """Mean over the gates of their volume, and of the number of detections in them.

    Parameters
    ----------
    gates : Gates
    z : ndarray (k, p)
        Detections in the gates' space.
    """
    return _gate_statistics(gates.z, gates.S, gates.threshold, unit_ball(gates.z.shape[1]), z)


def outside_all_gates(gates: Gates, point: np.ndarray) -> bool:
    """Whether the point (p,) of the gates' space lies in no gate; True for a nan point."""
    return outside_all_gates_kernel(gates.z, gates.S, gates.threshold, point)


@lru_cache
def unit_ball(p: int) -> float:
    """Volume of the ball of radius 1 in p dimensions."""
    return float(np.pi ** (p / 2) / gamma(p / 2 + 1))


@kernel
def _gate_statistics(centres, S, threshold, ball, z):
    return mean_volume(S, threshold, ball), count_gated(centres, S, threshold, z) / len(centres)


@kernel(inline="always")
def mean_volume(S, threshold, ball):
    """Mean volume of gates of innovation covariances S (n, p, p); `ball` is the volume of the unit ball."""
    whole = 0.0
    for root in root_determinants(S):
        whole += root
    return ball * threshold ** (S.shape[1] / 2) * (whole / len(S))


@kernel
def outside_all_gates_kernel(centres, S, threshold, point):
    """See `outside_all_gates`."""
    return count_gated(centres, S, threshold, point.reshape(1, len(point))) == 0


@kernel(inline="always")
def count_gated(centres, S, threshold, z):
    """Number of detections z (k, p) in the gates, counted in each."""
    k, p = z.shape
    first, _, _ = gated_pairs(centres, S, z.reshape(1, k, p), np.empty((0, p, p)), threshold)
    return first[len(centres)]


@kernel
def gated_distances_kernel(z_hat, S, z, R, threshold):
    """Squared Mahalanobis distances (n, k), infinite outside the gate."""
    first, detection, distance = gated_pairs(z_hat, S, z, R, threshold)
    d2 = np.full((len(z_hat), z.shape[1]), np.inf)
    for i in range(len(z_hat)):
        for h in range(first[i], first[i + 1]):
            d2[i, detection[h]] = distance[h]
    return d2


@kernel
def gated_pairs(z_hat, S, z, R, threshold):
    """The detections in each gate: those of component i are at first[i] : first[i + 1], in order, and so
    are their squared Mahalanobis distances.

    Indices are unsigned: a signed one may count from the end, and gating took half as long again."""
    n, (views, k, p) = len(z_hat), z.shape
    first = np.zeros(n + 1, np.int64)
    detection, d2 = np.empty(n * k, np.int64), np.empty(n * k)
    L, y, S_pair = np.zeros((p, p)), np.empty(p), np.empty((p, p))
    hits = np.uint64(0)
    for i in range(np.uint64(n)):
        own = i if views > 1 else np.uint64(0)
        if len(R) == 0 and not cholesky_into(L, S[i]):
            raise ValueError("an innovation covariance S = H P H' + R is not positive definite")
        near = np.uint64(k)
        for r in range(np.uint64(p)):
            # a gate is never wider than this along any axis: most clutter ends here, without a branch
            among, near = near, np.uint64(0)
            for a in range(among):
                j = np.uint64(detection[hits + a]) if r else a
                variance = S[i, r, r] + R[j, r, r] if len(R) else S[i, r, r]
                detection[hits + near] = j
                near += np.uint64((z[own, j, r] - z_hat[i, r]) ** 2 <= threshold * variance)
        start = hits
        for a in range(near):
            j = detection[start + a]
            if len(R):
                for r in range(p):
                    for c in range(p):
                        S_pair[r, c] = S[i, r, c] + R[j, r, c]
                if not cholesky_into(L, S_pair):
                    raise ValueError("an innovation covariance S = H P H' + R is not positive definite")
            distance = mahalanobis_squared(L, z[own, j], z_hat[i], y)
            detection[hits], d2[hits] = j, distance
            hits += np.uint64(distance <= threshold)
        first[i + 1] = hits
    return first, detection, d2
