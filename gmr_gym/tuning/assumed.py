"""A scan predicted and updated under factors on what the filter model assumes, and its features."""

import numpy as np

from gmr_gym.filters.mht import expand_predicted, gate_and_log_weights
from gmr_gym.kernels import kernel
from gmr_gym.models.kalman import Sensor, predict_all
from gmr_gym.models.model import Model
from gmr_gym.reduction.n_scan import MISSED
from gmr_gym.tuning.features import model_features, observe
from gmr_gym.tuning.recent import observe_recent
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
    """The Expansion of a scan under the factors among `thresholds`, the fields of the gates, its features,
    the cost of merging it all, and the detections in the gates, counted in each.

    `belief` is that of `expand_scan` and the history of its hypotheses, `told` is what `assumed` returns,
    and `memory` and `recent` are those of `observe` and `observe_recent`, whose features are left out
    unless `every`.
    """
    ((w, m, P), history), ((F, Q, offset), (H, R), weights, probabilities, known) = belief, told
    Q, noise = Q * thresholds[PROCESS] ** 2, R * thresholds[MEASUREMENT] ** 2
    if thresholds[FADING] != 1.0:
        P = thresholds[FADING] * P
    m, P = predict_all(m, P, F, Q, offset)
    more = thresholds[COASTING] ** 2 - 1
    for i in range(len(w)):
        if more != 0.0 and history[i, 0] == MISSED:
            P[i] += more * Q
    threshold, log_miss, log_detect = weights_by_odds(weights, probabilities, thresholds[ODDS])
    full, gates = expand_predicted((w, m, P), (H, noise), z, threshold, log_miss, log_detect)
    features, cost, gated = observe(full, gates[1], Sensor(H, R), log_detect, known, memory)
    if every:
        missed = 1 - probabilities[0] * probabilities[1]
        later = observe_recent(full, gates, z, (H, R), missed, thresholds[PROCESS], price, recent)
        features = np.concatenate((features, later))
    return full, gates, features, cost, gated


@kernel
def weights_by_odds(weights, probabilities, factor):
    """`gate_and_log_weights` (3,) where the odds of a detection are `factor` times those of the filter model,
    of P_D, P_G and clutter density `probabilities` (3,)."""
    if factor == 1.0:
        return weights[0], weights[1], weights[2]
    detection = factor * probabilities[0] / (1 - probabilities[0] + factor * probabilities[0])
    return weights[0], np.log(1 - detection * probabilities[1]), np.log(detection / probabilities[2])
