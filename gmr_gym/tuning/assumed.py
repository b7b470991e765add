"""A scan predicted and updated under factors on what the filter model assumes, and its features."""

import numpy as np

from gmr_gym.filters.association import Expansion, update_by_parent, weigh_associations
from gmr_gym.filters.mht import gate_and_log_weights
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture
from gmr_gym.models.kalman import predict_all, predict_detections
from gmr_gym.models.model import Model
from gmr_gym.reduction.merge_cost import shared_total_cost
from gmr_gym.reduction.n_scan import MISSED
from gmr_gym.tuning.features import FEATURES, model_features, observe_into
from gmr_gym.tuning.recent import ALL_FEATURES, observe_recent_into
from gmr_gym.tuning.thresholds import COASTING, FADING, MEASUREMENT, ODDS, PROCESS


def assumed(model: Model) -> tuple:
    """A filter model of one motion and a linear sensor as `processed` takes it: the fields of motion and
    sensor, `gate_and_log_weights`, P_D, P_G and clutter density, and `model_features`."""
    probabilities = model.detection_probability, model.gate_probability, model.clutter_density
    return (
        model.motion[:], (model.sensor.H, model.sensor.R), np.array(gate_and_log_weights(model)),
        np.array(probabilities), model_features(model),
    )  # fmt: skip


@kernel(inline="always")
def processed(belief, z, told, thresholds, memory, recent, price, every):
    """The hypotheses of a scan under the factors among `thresholds`, the fields of the gates, its features,
    the cost of merging all of them, and the detections in the gates, counted in each.

    `belief` is that of `expand_scan` and the history of its hypotheses, `told` is what `assumed` returns,
    and `memory` and `recent` are those of `observe_into` and `observe_recent_into`, whose features are left
    out unless `every`. Of the hypotheses there are weights, means, what they share of covariances and its
    rows, parents and detections: see `selected`.
    """
    ((w, m, P), history), ((F, Q, offset), (H, R), weights, probabilities, known) = belief, told
    Q, noise = Q * thresholds[PROCESS] ** 2, R * thresholds[MEASUREMENT] ** 2
    if thresholds[FADING] != 1.0:
        P = thresholds[FADING] * P
    m, P = predict_all(m, P, F, Q, offset)
    more = thresholds[COASTING] ** 2 - 1
    for i in range(len(w)):
        if more != 0.0 and history[i, 0] == MISSED:
            for r in range(len(Q)):
                for c in range(len(Q)):
                    P[i, r, c] += more * Q[r, c]
    threshold, log_miss, log_detect = weights_by_odds(weights, probabilities, thresholds[ODDS])
    near = predict_detections(m, P, H, noise, z)
    w, parent, detection, log_density = weigh_associations(w, near, threshold, log_miss, log_detect)
    m, P, row = update_by_parent(m, P, near, parent, detection)
    merged, gates = shared_total_cost(w, m, P, row), (near.z_hat, near.S, threshold)
    features = np.empty(len(ALL_FEATURES) if every else len(FEATURES))
    gated = observe_into(
        features, (w, detection, log_density), merged, near.S, (H, R), log_detect, known, memory
    )
    if every:
        missed = 1 - probabilities[0] * probabilities[1]
        observe_recent_into(
            features[len(FEATURES) :], (w, parent, detection), gates, z, (H, R),
            (missed, thresholds[PROCESS], price), recent,
        )  # fmt: skip
    return (w, m, P, row, parent, detection), gates, features, merged[0], gated


@kernel
def selected(hypotheses, kept):
    """w, m, P, parent and detection of the hypotheses of `processed` in the mask `kept`."""
    w, m, P, row, parent, detection = hypotheses
    n, d = kept.sum(), m.shape[1]
    w_out, m_out, P_out = np.empty(n), np.empty((n, d)), np.empty((n, d, d))
    parent_out, detection_out, at = np.empty(n, np.int64), np.empty(n, np.int64), 0
    for i in range(len(w)):
        if kept[i]:
            w_out[at], parent_out[at], detection_out[at] = w[i], parent[i], detection[i]
            for r in range(d):
                m_out[at, r] = m[i, r]
                for c in range(d):
                    P_out[at, r, c] = P[row[i], r, c]
            at += 1
    return w_out, m_out, P_out, parent_out, detection_out


def every(hypotheses: tuple) -> Expansion:
    """The Expansion of the hypotheses of `processed`, without densities."""
    w, m, P, parent, detection = selected(hypotheses, np.ones(len(hypotheses[0]), bool))
    return Expansion(Mixture(w, m, P), parent, detection, np.full(len(w), np.nan))


@kernel
def weights_by_odds(weights, probabilities, factor):
    """`gate_and_log_weights` (3,) where the odds of a detection are `factor` times those of the filter model,
    of P_D, P_G and clutter density `probabilities` (3,)."""
    if factor == 1.0:
        return weights[0], weights[1], weights[2]
    detection = factor * probabilities[0] / (1 - probabilities[0] + factor * probabilities[0])
    return weights[0], np.log(1 - detection * probabilities[1]), np.log(detection / probabilities[2])
