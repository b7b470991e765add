r"""Features of a scan's full posterior, known before its thresholds are chosen.

Notes
-----
The feature "entropy" is the entropy of the n weights, scaled by that of the largest posterior:

.. math:: 2 H / \log 2000 - 1, \quad H = -\sum_{i=1}^{n} w_i \log w_i

The others are listed at `FEATURES`.
"""

from math import log
from typing import NamedTuple

import numpy as np

from gmr_gym.filters.mht import MAX_HYPOTHESES
from gmr_gym.kernels import kernel
from gmr_gym.linalg import root_determinants
from gmr_gym.models.gating import Gates, gate_threshold, volumes
from gmr_gym.models.kalman import innovation
from gmr_gym.models.model import Model

# In this order, and scaled so that most lie within [-1, 1] most of the time. n: hypotheses of the
# full posterior, w: their weights, c: cost of merging them all, S = H P H' + R: innovation covariance,
# R: measurement noise and lambda: clutter density, all of the filter model
FEATURES = (
    "size",  # 2 log n / log 2000 - 1
    "entropy",  # 2 H / log 2000 - 1, H = -sum w log w
    "effective",  # 2 log(1 / sum w^2) / log 2000 - 1
    "heaviest",  # 2 w1 - 1, w1 the largest weight
    "second",  # 2 w2 / w1 - 1, w2 the second largest, 0 where there is none
    "over_1e-2",  # 2 log n' / log 2000 - 1, n' the hypotheses that weigh more than 1e-2, at least one
    "over_1e-3",  # the same of 1e-3
    "over_1e-4",  # of 1e-4: what pruning at that weight would leave
    "over_1e-5",  # of 1e-5
    "missed",  # 2 (weight of the hypotheses without a detection) - 1
    "spread",  # log(|S| / |R|) / 2p - 1, P the covariance of the whole posterior
    "widest",  # the same of the predicted hypothesis for which it is largest
    "merge_cost",  # log10(c) / 2, c at least 1e-6
    "separation",  # 2 c / (c + H) - 1: 1 when hypotheses lie far apart, -1 when on top of each other
    "gated",  # log10(1 + detections in the gate of a predicted hypothesis, on average)
    "evidence",  # log(P_D N(z; H m, S) / lambda) / 5, by weight over hypotheses with a detection, 0 for none
    "given_up",  # 2 (relative loss of the last reduction, a share of c) - 1, -1 before the first
    "kept",  # 2 log(hypotheses kept of the last scan) / log 2000 - 1
    "work",  # log10(1 + work of the last scan) / 3 - 1
    "expected",  # log10(lambda times the area of the gate of a predicted hypothesis, on average)
    "clutter",  # log10(lambda times the area of a gate about R alone)
    "detection",  # 5 (P_D - 0.8)
    "manoeuvre",  # log10(tr(H Q H') / tr(R)) / 2 + 0.5, Q the process noise of the filter model
)
BOUND = 2.0  # no feature lies outside +- this
LOG_MOST = log(MAX_HYPOTHESES)


class Memory(NamedTuple):
    """What a policy knows of the scan before."""

    kept: int  # hypotheses
    relative_loss: float  # see `thresholds.adapt`
    work: int


def at_start(model: Model) -> Memory:
    """The memory before the first scan."""
    return Memory(len(model.prior.w), 0.0, 0)


def model_features(model: Model) -> np.ndarray:
    """The features "clutter", "detection" and "manoeuvre", which are constant through an episode.

    Parameters
    ----------
    model : Model
        The filter model; its sensor must be linear.

    Returns
    -------
    ndarray (3,)
    """
    H, R = model.sensor.H, model.sensor.R
    area = volumes(Gates(np.zeros((1, len(R))), R[None], gate_threshold(model.gate_probability, len(R))))[0]
    index = np.trace(H @ model.motion.Q @ H.T) / np.trace(R)
    return np.array([
        np.log10(model.clutter_density * area),
        5 * (model.detection_probability - 0.8),
        0.5 * np.log10(max(index, 1e-12)) + 0.5,  # without process noise it is clipped to the bound
    ])  # fmt: skip


@kernel
def observe_into(values, hypotheses, merged, S, sensor, log_detect, known, memory):
    """Writes FEATURES to the first of `values`; returns the number of hypotheses with a detection.

    Each feature is clipped to +-BOUND, and none depends on the order of the hypotheses, of which there are
    weights, detections and log densities as in an Expansion; `merged` is the `total_cost` of them. S are the
    covariances of the predicted hypotheses' gates, `sensor` has the fields of a linear one, `log_detect` is
    log(P_D / lambda), `known` is `model_features`, and `memory` a Memory.
    """
    (w, detection, log_density), (cost, mean, covariance), (H, R) = hypotheses, merged, sensor
    kept, relative_loss, work = memory
    entropy, square, first, second, hit, evidence = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    pairs, over_2, over_3, over_4, over_5 = 0, 0, 0, 0, 0
    for i in range(len(w)):
        v = w[i]
        if v > 0.0:
            entropy -= v * np.log(v)
        square += v * v
        second = max(second, min(first, v))
        first = max(first, v)
        over_2 += v > 1e-2
        over_3 += v > 1e-3
        over_4 += v > 1e-4
        over_5 += v > 1e-5
        if detection[i] >= 0:
            hit += v
            evidence += v * (log_density[i] + log_detect)
            pairs += 1
    d = len(mean)
    _, whole, _ = innovation(mean.reshape(1, d), covariance.reshape(1, d, d), H, R)
    alone = np.empty((1, *R.shape))
    alone[0] = R
    smallest = root_determinants(alone)[0]
    gates = root_determinants(S) / smallest
    for i, value in enumerate((
        2 * np.log(len(w)) / LOG_MOST - 1,
        2 * entropy / LOG_MOST - 1,
        -2 * np.log(square) / LOG_MOST - 1,
        2 * first - 1,
        2 * second / first - 1,
        2 * np.log(max(over_2, 1)) / LOG_MOST - 1,
        2 * np.log(max(over_3, 1)) / LOG_MOST - 1,
        2 * np.log(max(over_4, 1)) / LOG_MOST - 1,
        2 * np.log(max(over_5, 1)) / LOG_MOST - 1,
        1 - 2 * hit,
        np.log(root_determinants(whole)[0] / smallest) / len(R) - 1,
        np.log(gates.max()) / len(R) - 1,
        np.log10(max(cost, 1e-6)) / 2,
        2 * cost / (cost + entropy) - 1 if cost > 0.0 else -1.0,
        np.log10(1 + pairs / len(S)),
        evidence / hit / 5 if hit > 0.0 else 0.0,
        2 * relative_loss - 1,
        2 * np.log(kept) / LOG_MOST - 1,
        np.log10(1 + work) / 3 - 1,
        # the areas of two gates are in the ratio of the roots of their determinants
        np.log10(gates.mean()) + known[0],
        known[0],
        known[1],
        known[2],
    )):  # fmt: skip
        values[i] = min(max(value, -BOUND), BOUND)
    return pairs
