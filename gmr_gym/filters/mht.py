"""One scan of a Gaussian-mixture MHT in two halves: predict and update, then prune and reduce.

Between them the thresholds of the reduction may be set from the full posterior (D'Ortenzio, sections 2.1
and 4).
"""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gmr_gym.filters.association import (
    Expansion,
    expand,
    expand_into_hypotheses,
    log_weights,
    update_associated,
    weigh_associations,
)
from gmr_gym.kernels import ONE, kernel
from gmr_gym.linalg import pairwise_sum, root_determinants
from gmr_gym.mixture import Mixture, match, match_all, rescaled
from gmr_gym.models.gating import Gates, gate_threshold, gates
from gmr_gym.models.kalman import Sensor, predict, predict_all, predict_detections
from gmr_gym.models.model import Model
from gmr_gym.reduction.heaviest_first import Clustering, merge_by_distance
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.reduction.pruning import above_threshold, heaviest_mask, select
from gmr_gym.reduction.runnalls import Greedy, merge_by_cost

ESTIMATE_SCAN = "(f8[::1], f8[:, ::1], f8[:, :, ::1], f8, i8, i8, f8, f8)"  # signature of `estimate_scan`
MAX_HYPOTHESES = 2000  # that enter a reduction; bounds the memory of a huge scan


class ScanUpdate(NamedTuple):
    """A scan after the update and before any reduction.

    Attributes
    ----------
    posterior : Expansion
        Every hypothesis with every gated detection.
    gates : Gates
        Gates of the predicted hypotheses.
    """

    posterior: Expansion
    gates: Gates


def predict_and_update(belief: Mixture, model: Model, z: np.ndarray) -> ScanUpdate:
    """Predict the belief by one period and update it with a scan.

    Parameters
    ----------
    belief : Mixture
        Posterior of the last scan.
    model : Model
    z : ndarray, shape (k, p)
        Detections.

    Returns
    -------
    ScanUpdate
    """
    if isinstance(model.sensor, Sensor):
        # slices: a NamedTuple takes 0.5 us longer to enter compiled code than a tuple, 5 % of a PDA scan
        posterior, used = expand_scan(
            belief[:], model.motion[:], model.sensor[:], z, *gate_and_log_weights(model)
        )
        return ScanUpdate(posterior, Gates(*used))
    predicted = predict(belief, model.motion)
    gates_used = gates(predicted, model.sensor, model.gate_probability)
    posterior = expand(
        predicted, gates_used, model.sensor, z,
        model.detection_probability, model.gate_probability, model.clutter_density,
    )  # fmt: skip
    return ScanUpdate(posterior, gates_used)


def predict_and_prune(
    belief: Mixture, model: Model, z: np.ndarray, prune_weight: float, max_hypotheses: int = MAX_HYPOTHESES
) -> tuple[Mixture, Gates]:
    """`predict_and_update` without the hypotheses that `prune_and_reduce` would prune by weight at once.

    With a linear sensor their means and covariances are not even computed.

    Parameters
    ----------
    belief : Mixture
        Posterior of the last scan.
    model : Model
    z : ndarray, shape (k, p)
        Detections.
    prune_weight : float
        gamma: hypotheses of less weight are left out.
    max_hypotheses : int
        Most hypotheses; the heaviest are kept.

    Returns
    -------
    likely : Mixture
        The others, with their weights in the full posterior.
    gates : Gates
        Gates of the predicted hypotheses.
    """
    if isinstance(model.sensor, Sensor):
        likely, used, *_ = expand_and_prune(
            belief[:], model.motion[:], model.sensor[:], z, gate_and_log_weights(model),
            prune_weight, max_hypotheses,
        )  # fmt: skip
        return Mixture(*likely), Gates(*used)
    full = predict_and_update(belief, model, z)
    return full.posterior.mixture, full.gates


def pda_update(belief: Mixture, model: Model, z: np.ndarray) -> tuple[Mixture, Gates]:
    r"""Predict and update by probabilistic data association: the full posterior merged into one Gaussian.

    Parameters
    ----------
    belief : Mixture
        One Gaussian.
    model : Model
    z : ndarray, shape (k, p)
        Detections.

    Returns
    -------
    posterior : Mixture
        One Gaussian.
    gates : Gates

    Notes
    -----
    With innovations :math:`\nu_j`, gain :math:`K`, association probabilities :math:`\beta_j` (of a miss
    :math:`\beta_0`, see `association.expand`) and :math:`\nu = \sum_j \beta_j \nu_j`

    .. math::

        m \leftarrow m + K \nu, \qquad
        P \leftarrow \beta_0 P + (1 - \beta_0) (P - K S K^T)
            + K \Big( \sum_j \beta_j \nu_j \nu_j^T - \nu \nu^T \Big) K^T

    References
    ----------
    Bar-Shalom and Tse 1975.
    """
    if isinstance(model.sensor, Sensor):
        merged, used = pda_scan(belief[:], model.motion[:], model.sensor[:], z, *gate_and_log_weights(model))
        return Mixture(*merged), Gates(*used)
    full = predict_and_update(belief, model, z)
    return match_all(full.posterior.mixture), full.gates


def prune_and_reduce(
    posterior: Mixture,
    reduce: Callable[[Mixture], Reduced],
    prune_weight: float,
    density: float,
    max_hypotheses: int = MAX_HYPOTHESES,
) -> Mixture:
    """Prune by weight (SP), reduce, prune by density (NWP); weights are normalised after each step.

    Parameters
    ----------
    posterior : Mixture
        Full posterior.
    reduce : callable
        A reduction of a Mixture.
    prune_weight : float
        gamma: hypotheses of less weight are pruned.
    density : float
        gamma~: hypotheses whose weight over the square root of the determinant is less are pruned.
    max_hypotheses : int
        Most hypotheses that enter `reduce`; the heaviest are kept.

    Returns
    -------
    Mixture

    References
    ----------
    D'Ortenzio, section 4.
    """
    return reduce_and_estimate(posterior, reduce, prune_weight, density, max_hypotheses)[0]


def reduce_and_estimate(
    posterior: Mixture,
    reduce: Callable[[Mixture], Reduced],
    prune_weight: float,
    density: float,
    max_hypotheses: int,
) -> tuple[Mixture, np.ndarray, np.ndarray]:
    """`prune_and_reduce`, of the same parameters, and the moments of what it leaves.

    Returns
    -------
    left : Mixture
    mean : ndarray, shape (1, d)
    covariance : ndarray, shape (1, d, d)
    """
    if isinstance(reduce, Greedy):
        limits = prune_weight, max_hypotheses, reduce.components, reduce.loss_bound, density
        w, m, P, mean, covariance = estimate_scan(*posterior, *limits)
        return Mixture(w, m, P), mean, covariance
    if isinstance(reduce, Clustering):
        limits = prune_weight, max_hypotheses, reduce.components, reduce.distance, density
        w, m, P, mean, covariance = estimate_clustered_scan(*posterior, *limits)
        return Mixture(w, m, P), mean, covariance
    entering = Mixture(*prune_by_weight(*posterior, prune_weight, max_hypotheses))
    left = Mixture(*prune_by_density(*reduce(entering)[0], density))
    _, mean, covariance = match_all(left)
    return left, mean, covariance


def gate_and_log_weights(model: Model) -> tuple[float, float, float]:
    """Gate threshold, log(1 - P_D P_G), and log(P_D / clutter density).

    The last is the weight of a detection without its likelihood.

    Parameters
    ----------
    model : Model

    Returns
    -------
    threshold, log_miss, log_detect : float
    """
    return _gate_and_log_weights(
        len(model.sensor.H), model.detection_probability, model.gate_probability, model.clutter_density
    )


@lru_cache
def _gate_and_log_weights(p, detection_probability, gate_probability, clutter_density):
    weights = log_weights(detection_probability, gate_probability, clutter_density)
    return gate_threshold(gate_probability, p), *weights


@kernel
def expand_scan(belief, motion, sensor, z, threshold, log_miss, log_detect):
    """The Expansion of a scan, and the fields of the Gates, by a linear sensor. `belief`, `motion` and
    `sensor` are plain tuples of the fields of a Mixture, a Motion and a Sensor."""
    (w, m, P), (F, Q, offset) = belief, motion
    m, P = predict_all(m, P, F, Q, offset)
    return expand_predicted((w, m, P), sensor, z, threshold, log_miss, log_detect)


@kernel(inline="always")
def expand_predicted(predicted, sensor, z, threshold, log_miss, log_detect):
    """`expand_scan` of a mixture that is predicted already."""
    (w, m, P), (H, R) = predicted, sensor
    predicted_z = predict_detections(m, P, H, R, z)
    posterior = expand_into_hypotheses(Mixture(w, m, P), predicted_z, threshold, log_miss, log_detect)
    return posterior, (predicted_z.z_hat, predicted_z.S, threshold)


@kernel
def expand_and_prune(belief, motion, sensor, z, weights, prune_weight, max_hypotheses):
    """`expand_scan` without the hypotheses that `prune_by_weight` drops, which are not updated: the fields of
    a Mixture, not normalised, and of the Gates, the number of detections in them, counted in each, and parent
    and detection of every hypothesis."""
    (w, m, P), (F, Q, offset), (H, R) = belief, motion, sensor
    m, P = predict_all(m, P, F, Q, offset)
    predicted_z = predict_detections(m, P, H, R, z)
    threshold, log_miss, log_detect = weights
    w, parent, detection, _ = weigh_associations(w, predicted_z, threshold, log_miss, log_detect)
    kept = heaviest_mask(w, max_hypotheses) & above_threshold(w, w, prune_weight)
    hits = n = 0
    for h in range(len(w)):
        hits += detection[h] >= 0
        if kept[h]:
            w[n], parent[n], detection[n] = w[h], parent[h], detection[h]
            n += 1
    m, P = update_associated(m, P, predicted_z, parent[:n], detection[:n])
    return (w[:n], m, P), (predicted_z.z_hat, predicted_z.S, threshold), hits, parent[:n], detection[:n]


@kernel
def pda_scan(belief, motion, sensor, z, threshold, log_miss, log_detect):
    """The fields of the merged Gaussian of a scan and of the Gates, from arguments as of `expand_scan`."""
    posterior, gates = expand_scan(belief, motion, sensor, z, threshold, log_miss, log_detect)
    w, m, P = posterior.mixture
    _, m, P = match(w, m, P, np.zeros(len(w), np.int64), ONE)
    return (np.full(1, pairwise_sum(w)), m, P), gates


@kernel
def estimate_scan(w, m, P, prune_weight, max_hypotheses, components, loss_bound, density):
    """The reduced w, m and P of `reduce_scan`, and their mean (1, d) and covariance (1, d, d)."""
    w, m, P, _, _ = reduce_scan(w, m, P, prune_weight, max_hypotheses, components, loss_bound, density)
    _, mean, covariance = match(w, m, P, np.zeros(len(w), np.int64), ONE)
    return w, m, P, mean, covariance


@kernel(inline="always")
def reduce_scan(w, m, P, prune_weight, max_hypotheses, components, loss_bound, density):
    """Prune by weight, merge and prune by density (see `prune_and_reduce`), with Runnalls' greedy merging.

    Returns the reduced w, m and P, and the numbers of hypotheses that entered and left the merging.
    """
    w, m, P = prune_by_weight(w, m, P, prune_weight, max_hypotheses)
    entered = len(w)
    w, m, P, _ = merge_by_cost(w, m, P, components, loss_bound)
    left = len(w)
    w, m, P = prune_by_density(w, m, P, density)
    return w, m, P, entered, left


@kernel
def estimate_clustered_scan(w, m, P, prune_weight, max_hypotheses, components, distance, density):
    """The reduced w, m and P of `cluster_scan`, and their mean (1, d) and covariance (1, d, d)."""
    w, m, P, _ = cluster_scan(w, m, P, prune_weight, max_hypotheses, components, distance, density)
    _, mean, covariance = match(w, m, P, np.zeros(len(w), np.int64), ONE)
    return w, m, P, mean, covariance


@kernel(inline="always")
def cluster_scan(w, m, P, prune_weight, max_hypotheses, components, distance, density):
    """Prune by weight, cluster and prune by density: the reduced w, m and P, and the work of clustering, see
    `gmr_gym.reduction.heaviest_first.merge_by_distance`."""
    w, m, P = prune_by_weight(w, m, P, prune_weight, max_hypotheses)
    w, m, P, _, work = merge_by_distance(w, m, P, distance, components)
    w, m, P = prune_by_density(w, m, P, density)
    return w, m, P, work


@kernel(inline="always")
def prune_by_weight(w, m, P, prune_weight, max_hypotheses):
    """SP: the heaviest hypotheses of weight at least prune_weight, normalised."""
    kept = heaviest_mask(w, max_hypotheses) & above_threshold(w, w, prune_weight)
    if kept.sum() < len(w):
        w, m, P, _ = select(w, m, P, kept)
    return rescaled(w), m, P


@kernel(inline="always")
def prune_by_density(w, m, P, density):
    """NWP: hypotheses whose weight over the root of the determinant is at least density, normalised."""
    w = rescaled(w)
    w, m, P, _ = select(w, m, P, above_threshold(w, w / root_determinants(P), density))
    return rescaled(w), m, P
