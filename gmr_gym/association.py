"""Which detection came from the target: gates, and the full single-target posterior."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from scipy.special import gamma, gammaincinv

from gmr_gym.kalman import Sensing, predict
from gmr_gym.kernels import kernel
from gmr_gym.mixture import (
    Mixture,
    cholesky_into,
    joined,
    log_gaussian_scale,
    mahalanobis_squared,
    root_determinants,
    take,
)
from gmr_gym.models import Model
from gmr_gym.update import posterior_into


class Gates(NamedTuple):
    """Ellipses (z - z[i])' S[i]^-1 (z - z[i]) <= size, one around each predicted detection."""

    z: np.ndarray  # (n, p), predicted detections
    S: np.ndarray  # (n, p, p), innovation covariances
    size: float  # squared Mahalanobis distance


class Expansion(NamedTuple):
    """The full posterior of one scan, and how each hypothesis came about."""

    mixture: Mixture  # N hypotheses, weights sum to 1
    parent: np.ndarray  # (N,), index of the predicted component
    detection: np.ndarray  # (N,), index of the detection it takes for the target's, -1 for a miss
    # (N,), log N(z; H m, S) of that detection per unit of the sensor's own space, infinite for a miss
    log_density: np.ndarray


@lru_cache
def gate_size(probability: float, p: int) -> float:
    """Chi-square quantile that a p-dimensional innovation stays under with `probability`."""
    return float(2 * gammaincinv(p / 2, probability))


def gates(predicted: Mixture, sensor: Sensing, probability: float) -> Gates:
    """Gates about every predicted component that hold its detection with `probability`."""
    z, S = sensor.gates(predicted)
    return Gates(z, S, gate_size(probability, z.shape[1]))


def expand_together(
    predicted: Mixture, model: Model, z: np.ndarray, hopeless: float
) -> tuple[Expansion, Gates, bool]:
    """`expand` of components of unlike motions, which are to be weighed against each other and so have one
    list of detections to explain, that of `look_together`; the gates looked through, and whether there is
    hope."""
    own, listed, looked, alive = look_together(predicted, model, z, hopeless)
    posterior = expand(
        predicted, own, model.sensor, listed,
        model.detection_probability, model.gate_probability, model.clutter_density,
    )  # fmt: skip
    return posterior, looked, alive


def look_together(
    predicted: Mixture, model: Model, z: np.ndarray, hopeless: float
) -> tuple[Gates, np.ndarray, Gates, bool]:
    """Gates without end about every component, and the one list of detections for all of them: those of z
    (k, p) that lie in the gate of any. Then the gates looked through, and whether there is hope: beyond
    `hopeless` false detections expected within one deviation of the predictions nothing is looked at,
    which bounds the work on a track that is lost."""
    own = gates(predicted, model.sensor, model.gate_probability)
    possible = predicted.w > 0  # an impossible mode looks nowhere
    looked = own if possible.all() else Gates(own.z[possible], own.S[possible], own.size)
    density = model.sensor.density(model.clutter_density, own.z)
    alive = false_expected(own, predicted.w, density) <= hopeless
    near = np.zeros(len(z), bool)
    if alive:
        seen = distances_seen(take(predicted, possible), looked, model.sensor, z)
        near = np.isfinite(seen).any(axis=0)
    return own._replace(size=np.inf), z[near], looked, alive


def distances_seen(predicted: Mixture, gates: Gates, sensor: Sensing, z: np.ndarray) -> np.ndarray:
    """Squared Mahalanobis distances (n, k) of the detections z (k, p), as the sensor's update has them, from
    what each component expects; infinite beyond the gates' size."""
    look = sensor.look(predicted, gates.z, gates.S, z)
    return gated(look.expected, look.S, look.z, look.R, gates.size)


def hopeless_beyond(model: Model, times: float) -> float:
    """False detections expected within one deviation of its predictions at which a tracker gives up:
    `times` as many as at the first scan, and as one."""
    moved = joined([predict(model.prior, motion) for motion in model.motions])
    w = np.outer(model.switching @ model.mode_prior, model.prior.w).ravel()
    looked = gates(moved, model.sensor, 1.0)
    density = model.sensor.density(model.clutter_density, looked.z)
    return times * max(1.0, false_expected(looked, w, density))


def false_expected(gates: Gates, w: np.ndarray, clutter_density: float | np.ndarray) -> float:
    """False detections expected within one standard deviation of a prediction, on average over
    components of weights w (n,): how unsure of its target a tracker is, whatever the size of its gates.
    The density is one for all, or (n,), that at each gate."""
    return float((w * clutter_density) @ volumes(gates._replace(size=1.0)) / w.sum())


def volumes(gates: Gates) -> np.ndarray:
    """Area (p = 2) or volume of each gate (n,), in the sensor's units; gates may overlap."""
    p = gates.z.shape[1]
    return unit_ball(p) * gates.size ** (p / 2) * root_determinants(gates.S)


def crowding(gates: Gates, z: np.ndarray) -> tuple[float, float]:
    """Volume of a gate, and how many of the points z (k, p) of the gates' space lie in it, on average."""
    return _crowding(gates.z, gates.S, gates.size, unit_ball(gates.z.shape[1]), z)


def outside(gates: Gates, point: np.ndarray) -> bool:
    """Whether the point (p,) of the gates' space lies in no gate; so too where it is nan."""
    return outside_all(gates.z, gates.S, gates.size, point)


@lru_cache
def unit_ball(p: int) -> float:
    """Volume of the ball of radius 1 in p dimensions."""
    return float(np.pi ** (p / 2) / gamma(p / 2 + 1))


def expand(
    predicted: Mixture,
    gates: Gates,
    sensor: Sensing,
    z: np.ndarray,
    detection_probability: float,
    gate_probability: float,
    clutter_density: float,
) -> Expansion:
    """Every predicted component with every detection z (k, p) in its gate, and with none
    (D'Ortenzio, eqs. 3-5). Weights are formed in logarithms:

        missed    w (1 - P_D P_G)           detected    w P_D N(z; H m, S) / clutter_density

    P_G stands in the miss because a detection outside the gate is a miss too. A scan that the
    model calls impossible (P_D P_G = 1 and every gate empty) leaves the prediction as it was.
    """
    look = sensor.look(predicted, gates.z, gates.S, z)
    w, m, P, parent, detection, log_density = expand_into_hypotheses(
        *predicted, *look, gates.size, *log_odds(detection_probability, gate_probability, clutter_density)
    )  # fmt: skip
    return Expansion(Mixture(w, m, P), parent, detection, log_density)


@lru_cache
def log_odds(
    detection_probability: float, gate_probability: float, clutter_density: float
) -> tuple[float, float]:
    """Logarithms of the weights of a miss, 1 - P_D P_G, and of a detection, P_D / clutter_density."""
    miss = 1.0 - detection_probability * gate_probability
    log_miss = float(np.log(miss)) if miss > 0 else -np.inf
    return log_miss, float(np.log(detection_probability) - np.log(clutter_density))


@kernel
def _crowding(centres, S, size, ball, z):
    p = S.shape[1]
    first, _, _ = pairs_gated(centres, S, z.reshape(1, len(z), p), np.empty((0, p, p)), size)
    return mean_volume(S, size, ball), first[len(centres)] / len(centres)


@kernel(inline="always")
def mean_volume(S, size, ball):
    """Of the gates of innovation covariances S (n, p, p), with the volume of the ball of radius 1."""
    whole = 0.0
    for root in root_determinants(S):
        whole += root
    return ball * size ** (S.shape[1] / 2) * (whole / len(S))


@kernel
def outside_all(centres, S, size, point):
    """See `outside`."""
    p = len(point)
    first, _, _ = pairs_gated(centres, S, point.reshape(1, 1, p), np.empty((0, p, p)), size)
    return first[len(centres)] == 0


@kernel
def gated(expected, S, z, R, size):
    """Squared Mahalanobis distances (n, k), infinite outside the gate."""
    first, detection, distance = pairs_gated(expected, S, z, R, size)
    d2 = np.full((len(expected), z.shape[1]), np.inf)
    for i in range(len(expected)):
        for h in range(first[i], first[i + 1]):
            d2[i, detection[h]] = distance[h]
    return d2


@kernel
def pairs_gated(expected, S, z, R, size):
    """The detections in each gate: those of component i stand at first[i] : first[i + 1], in order, and so do
    their squared Mahalanobis distances."""
    n, (seen, k, p) = len(expected), z.shape
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
                near += (z[own, j, r] - expected[i, r]) ** 2 <= size * variance
        start = hits
        for a in range(near):
            j = detection[start + a]
            if len(R):
                for r in range(p):
                    for c in range(p):
                        S_pair[r, c] = S[i, r, c] + R[j, r, c]
                if not cholesky_into(L, S_pair):
                    raise ValueError("an innovation covariance S = H P H' + R is not positive definite")
            distance = mahalanobis_squared(L, z[own, j], expected[i], y)
            if distance <= size:
                detection[hits], d2[hits] = j, distance
                hits += 1
        first[i + 1] = hits
    return first, detection, d2


@kernel(inline="always")
def expand_into_hypotheses(w, m, P, expected, S, C, z, R, log_stretch, H, noise, size, log_miss, log_detect):
    n, d = m.shape
    seen, p = len(z), z.shape[2]
    first, near, d2 = pairs_gated(expected, S, z, R, size)
    hits = first[n]
    misses = n if log_miss > -np.inf or hits == 0 else 0
    # logarithms of the weights at first
    w_out, top, whole = np.empty(hits + misses), -np.inf, 0.0
    m_out, P_out = np.empty((hits + misses, d)), np.empty((hits + misses, d, d))
    parent, detection = np.empty(hits + misses, np.int64), np.empty(hits + misses, np.int64)
    log_density = np.full(hits + misses, np.inf)
    L, K, W, P_hit = np.zeros((p, p)), np.empty((d, p)), np.empty((p, d)), np.empty((d, d))
    pair, L_noise = np.empty((p, p)), np.empty((p, p))
    at = 0
    for i in range(n):
        if misses:
            w_out[at] = np.log(w[i]) + (log_miss if log_miss > -np.inf else 0.0)
            top = max(top, w_out[at])
            parent[at], detection[at] = i, -1
            for r in range(d):
                m_out[at, r] = m[i, r]
                for c in range(d):
                    P_out[at, r, c] = P[i, r, c]
            at += 1
        own = i if seen > 1 else 0
        conditioned = False
        log_peak = 0.0
        for h in range(first[i], first[i + 1]):
            j = near[h]
            if not conditioned:
                for r in range(p):
                    for c in range(p):
                        pair[r, c] = S[i, r, c] + (R[j, r, c] if len(R) else 0.0)
                cholesky_into(L, pair)
                alike = 0 if len(noise) == 1 else i
                for r in range(p):
                    for c in range(p):
                        pair[r, c] = noise[alike, r, c] + (R[j, r, c] if len(R) else 0.0)
                posterior_into(P_hit, K, W, L, L_noise, P[i], C[i], H[0 if len(H) == 1 else i], pair)
                log_peak = log_gaussian_scale(L)
                conditioned = len(R) == 0  # else the next detection has a noise of its own
            log_density[at] = log_peak - 0.5 * d2[h] + log_stretch[j]
            w_out[at] = np.log(w[i]) + log_detect + log_density[at]
            top = max(top, w_out[at])
            for r in range(d):
                m_out[at, r] = m[i, r]
                for c in range(p):
                    m_out[at, r] += K[r, c] * (z[own, j, c] - expected[i, c])
                for c in range(d):
                    P_out[at, r, c] = P_hit[r, c]
            parent[at], detection[at] = i, j
            at += 1
    for h in range(len(w_out)):
        w_out[h] = np.exp(w_out[h] - top)
        whole += w_out[h]
    for h in range(len(w_out)):
        w_out[h] /= whole
    return w_out, m_out, P_out, parent, detection, log_density
