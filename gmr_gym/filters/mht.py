"""One scan of a Gaussian-mixture MHT in two halves, so that whoever sets the thresholds of the reduction may
first look at the full posterior (D'Ortenzio, sections 2.1 and 4)."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gmr_gym.filters.association import Expansion, expand, expand_into_hypotheses, log_weights
from gmr_gym.kernels import ONE, kernel
from gmr_gym.linalg import pairwise_sum, root_determinants
from gmr_gym.mixture import Mixture, match, match_all, rescaled
from gmr_gym.models.gating import Gates, gate_threshold, gates
from gmr_gym.models.kalman import Sensor, innovation, predict, predict_all
from gmr_gym.models.model import Model
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.reduction.pruning import above_threshold, heaviest_mask, select
from gmr_gym.reduction.runnalls import Greedy, merge_by_cost

MAX_HYPOTHESES = 2000  # hypotheses that enter a reduction, the heaviest, lest a huge scan fill memory


class ScanUpdate(NamedTuple):
    """A scan after the update and before any reduction."""

    posterior: Expansion  # every hypothesis with every gated detection
    gates: Gates  # about the predicted hypotheses


def predict_and_update(belief: Mixture, model: Model, z: np.ndarray) -> ScanUpdate:
    """The first half: the belief carried forward one period and expanded by the scan z (k, p)."""
    if isinstance(model.sensor, Sensor):
        threshold, log_miss, log_detect = gate_and_log_weights(model)
        z_hat, S, w, m, P, *origin = expand_scan(
            *belief, *model.motion, *model.sensor, threshold, log_miss, log_detect, z
        )
        return ScanUpdate(Expansion(Mixture(w, m, P), *origin), Gates(z_hat, S, threshold))
    predicted = predict(belief, model.motion)
    gates_used = gates(predicted, model.sensor, model.gate_probability)
    posterior = expand(
        predicted, gates_used, model.sensor, z,
        model.detection_probability, model.gate_probability, model.clutter_density,
    )  # fmt: skip
    return ScanUpdate(posterior, gates_used)


def pda_update(belief: Mixture, model: Model, z: np.ndarray) -> tuple[Mixture, Gates]:
    """`predict_and_update` with the whole posterior merged into one Gaussian; and the gates."""
    if isinstance(model.sensor, Sensor):
        threshold, log_miss, log_detect = gate_and_log_weights(model)
        z_hat, S, w, m, P = pda_scan(
            *belief, *model.motion, *model.sensor, threshold, log_miss, log_detect, z
        )
        return Mixture(w, m, P), Gates(z_hat, S, threshold)
    full = predict_and_update(belief, model, z)
    return match_all(full.posterior.mixture), full.gates


def prune_and_reduce(
    posterior: Mixture,
    reduce: Callable[[Mixture], Reduced],
    prune_weight: float,
    density: float,
    max_hypotheses: int = MAX_HYPOTHESES,
) -> Mixture:
    """The second half: SP pruning of what weighs less than `prune_weight` (gamma), of the rest the `most`
    heaviest through `reduce`, NWP pruning below `density` (gamma~), renormalised after each."""
    if isinstance(reduce, Greedy):
        *left, _, _ = reduce_scan(
            *posterior, prune_weight, max_hypotheses, reduce.components, reduce.loss_bound, density
        )
        return Mixture(*left)
    entering = Mixture(*prune_by_weight(*posterior, prune_weight, max_hypotheses))
    return Mixture(*prune_by_density(*reduce(entering)[0], density))


def gate_and_log_weights(model: Model) -> tuple[float, float, float]:
    """The size of a gate, and the log weights of a miss and, but for the density of the innovation, of a
    detection, as `expand` puts them together."""
    threshold = gate_threshold(model.gate_probability, len(model.sensor.H))
    return threshold, *log_weights(model.detection_probability, model.gate_probability, model.clutter_density)


@kernel
def expand_scan(w, m, P, F, Q, offset, H, R, threshold, log_miss, log_detect, z):
    """Centres and innovation covariances of the gates, then what makes an Expansion, of a scan z (k, p) by a
    linear sensor."""
    m, P = predict_all(m, P, F, Q, offset)
    z_hat, S, C = innovation(m, P, H, R)
    k, p = z.shape
    w, m, P, parent, detection, log_density = expand_into_hypotheses(
        w, m, P, z_hat, S, C, z.reshape(1, k, p), np.empty((0, p, p)), np.zeros(k),
        np.ascontiguousarray(H).reshape(1, p, len(F)), np.ascontiguousarray(R).reshape(1, p, p),
        threshold, log_miss, log_detect,
    )  # fmt: skip
    return z_hat, S, w, m, P, parent, detection, log_density


@kernel
def pda_scan(w, m, P, F, Q, offset, H, R, threshold, log_miss, log_detect, z):
    """Centres and innovation covariances of the gates, and the w, m, P of the one Gaussian."""
    z_hat, S, w, m, P, _, _, _ = expand_scan(w, m, P, F, Q, offset, H, R, threshold, log_miss, log_detect, z)
    _, m, P = match(w, m, P, np.zeros(len(w), np.int64), ONE)
    return z_hat, S, np.full(1, pairwise_sum(w)), m, P


@kernel
def reduce_scan(w, m, P, prune_weight, max_hypotheses, components, loss_bound, density):
    """w, m, P of what is kept, and how many hypotheses entered the merging and came out of it."""
    w, m, P = prune_by_weight(w, m, P, prune_weight, max_hypotheses)
    entered = len(w)
    w, m, P, _ = merge_by_cost(w, m, P, components, loss_bound)
    left = len(w)
    w, m, P = prune_by_density(w, m, P, density)
    return w, m, P, entered, left


@kernel(inline="always")
def prune_by_weight(w, m, P, prune_weight, max_hypotheses):
    kept = heaviest_mask(w, max_hypotheses) & above_threshold(w, w, prune_weight)
    w, m, P, _ = select(w, m, P, kept)
    return rescaled(w), m, P


@kernel(inline="always")
def prune_by_density(w, m, P, density):
    w = rescaled(w)
    w, m, P, _ = select(w, m, P, above_threshold(w, w / root_determinants(P), density))
    return rescaled(w), m, P


@kernel
def merge_costs(entered, left):
    """Evaluations of the cost B of a pair that greedy merging needs on its way from n = `entered` to
    r = `left` hypotheses: one for each of the n (n - 1) / 2 pairs at first, then, after each merge, one for
    the new hypothesis with each of the others,

        n (n - 1) / 2 + (r - 1) + r + ... + (n - 2) = (n - 1)^2 - (r - 1) (r - 2) / 2
    """
    return (entered - 1) ** 2 - (left - 1) * (left - 2) // 2
