"""Gates: where a target's detection is looked for, and which detections lie there."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import gamma, gammaincinv

from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, mahalanobis_squared, root_determinants
from gmr_gym.mixture import Mixture
from gmr_gym.models.sensing import MeasurementModel


class Gates(NamedTuple):
    """Ellipses (z - z[i])' S[i]^-1 (z - z[i]) <= size, one around each predicted detection."""

    z: np.ndarray  # (n, p), predicted detections
    S: np.ndarray  # (n, p, p), innovation covariances
    threshold: float  # squared Mahalanobis distance


@lru_cache
def gate_threshold(probability: float, p: int) -> float:
    """Chi-square quantile that a p-dimensional innovation stays under with `probability`."""
    return float(2 * gammaincinv(p / 2, probability))


def gates(predicted: Mixture, sensor: MeasurementModel, probability: float) -> Gates:
    """Gates about every predicted component that hold its detection with `probability`."""
    z, S = sensor.gates(predicted)
    return Gates(z, S, gate_threshold(probability, z.shape[1]))


def gated_distances(predicted: Mixture, gates: Gates, sensor: MeasurementModel, z: np.ndarray) -> np.ndarray:
    """Squared Mahalanobis distances (n, k) of the detections z (k, p), as the sensor's update has them, from
    what each component expects; infinite beyond the gates' size."""
    look = sensor.predict_detections(predicted, gates.z, gates.S, z)
    return gated_distances_kernel(look.z_hat, look.S, look.z, look.R, gates.threshold)


def volumes(gates: Gates) -> np.ndarray:
    """Area (p = 2) or volume of each gate (n,), in the sensor's units; gates may overlap."""
    p = gates.z.shape[1]
    return unit_ball(p) * gates.threshold ** (p / 2) * root_determinants(gates.S)


def gate_statistics(gates: Gates, z: np.ndarray) -> tuple[float, float]:
    """Volume of a gate, and how many of the points z (k, p) of the gates' space lie in it, on average."""
    return _gate_statistics(gates.z, gates.S, gates.threshold, unit_ball(gates.z.shape[1]), z)


def outside_all_gates(gates: Gates, point: np.ndarray) -> bool:
    """Whether the point (p,) of the gates' space lies in no gate; so too where it is nan."""
    return outside_all_gates_kernel(gates.z, gates.S, gates.threshold, point)


@lru_cache
def unit_ball(p: int) -> float:
    """Volume of the ball of radius 1 in p dimensions."""
    return float(np.pi ** (p / 2) / gamma(p / 2 + 1))


@kernel
def _gate_statistics(centres, S, threshold, ball, z):
    p = S.shape[1]
    first, _, _ = gated_pairs(centres, S, z.reshape(1, len(z), p), np.empty((0, p, p)), threshold)
    return mean_volume(S, threshold, ball), first[len(centres)] / len(centres)


@kernel(inline="always")
def mean_volume(S, threshold, ball):
    """Of the gates of innovation covariances S (n, p, p), with the volume of the ball of radius 1."""
    whole = 0.0
    for root in root_determinants(S):
        whole += root
    return ball * threshold ** (S.shape[1] / 2) * (whole / len(S))


@kernel
def outside_all_gates_kernel(centres, S, threshold, point):
    """See `outside`."""
    p = len(point)
    first, _, _ = gated_pairs(centres, S, point.reshape(1, 1, p), np.empty((0, p, p)), threshold)
    return first[len(centres)] == 0


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
    """The detections in each gate: those of component i stand at first[i] : first[i + 1], in order, and so do
    their squared Mahalanobis distances."""
    n, (seen, k, p) = len(z_hat), z.shape
    first = np.zeros(n + 1, np.int64)
    detection, d2 = np.empty(n * k, np.int64), np.empty(n * k)
    L, y, S_pair = np.zeros((p, p)), np.empty(p), np.empty((p, p))
    hits = 0
    for i in range(n):
        own = i if seen > 1 else 0
        if len(R) == 0 and not cholesky_into(L, S[i]):
            raise ValueError("an innovation covariance S = H P H' + R is not positive definite")
        near = k
        for r in range(p):
            # a gate is never wider than this along any axis: most clutter ends here, without a branch
            among, near = near, 0
            for a in range(among):
                j = detection[hits + a] if r else a
                variance = S[i, r, r] + R[j, r, r] if len(R) else S[i, r, r]
                detection[hits + near] = j
                near += (z[own, j, r] - z_hat[i, r]) ** 2 <= threshold * variance
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
            if distance <= threshold:
                detection[hits], d2[hits] = j, distance
                hits += 1
        first[i + 1] = hits
    return first, detection, d2
