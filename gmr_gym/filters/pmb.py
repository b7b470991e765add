"""Poisson multi-Bernoulli filter: Bernoulli tracks, and a Poisson intensity of undetected targets (Williams
2015).

A track is one Gaussian and a probability of existence in [0, 1]; existences do not sum to 1.
"""

from typing import NamedTuple

import numpy as np

from gmr_gym.filters.belief_propagation import propagate
from gmr_gym.filters.intensity_update import log_ratios, posteriors
from gmr_gym.filters.marginals import clusters_of, marginals
from gmr_gym.filters.tracker import MultiTargetReport
from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into
from gmr_gym.mixture import Mixture, joined, match_groups, take
from gmr_gym.models.clutter import Clutter, no_components
from gmr_gym.models.kalman import Sensor
from gmr_gym.models.kalman import predict as predict_components
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.models.update import posterior_into
from gmr_gym.reduction.pruning import capping

# probability of a miss where P_D = 1 and a track is certain to exist: an empty gate needs an explanation
LEAST_MISS = 1e-100


class MultiBernoulli(NamedTuple):
    """Bernoulli tracks, and the intensity of undetected targets.

    Attributes
    ----------
    tracks : Mixture
        n tracks; weights are probabilities of existence.
    label : ndarray, shape (n,)
        Distinct labels.
    undetected : Mixture
        Intensity of the targets not yet detected.
    next_label : int
        Next unused label.
    approximated : int
        Clusters of tracks in the last scan too large for exact association probabilities.
    """

    tracks: Mixture
    label: np.ndarray
    undetected: Mixture
    next_label: int
    approximated: int = 0


def untracked(model: MultiTargetModel) -> MultiBernoulli:
    """The belief before the first scan: no tracks; the targets that are there are undetected.

    Parameters
    ----------
    model : MultiTargetModel

    Returns
    -------
    MultiBernoulli
    """
    return MultiBernoulli(no_components(len(model.motion.F)), np.empty(0, np.int64), model.initial, 0)


def predict(belief: MultiBernoulli, model: MultiTargetModel) -> MultiBernoulli:
    """Predict the tracks and the undetected intensity by one period.

    Surviving targets move; born and spawned ones join the undetected intensity, spawned ones around their
    parent's prediction.

    Parameters
    ----------
    belief : MultiBernoulli
    model : MultiTargetModel

    Returns
    -------
    MultiBernoulli

    Notes
    -----
    Departs: spawning is not in the paper; only tracks spawn, undetected targets do not.

    References
    ----------
    Williams 2015.
    """
    tracks, undetected = (
        predict_components(belief.tracks, model.motion),
        predict_components(belief.undetected, model.motion),
    )
    parts = [undetected._replace(w=model.survival_probability * undetected.w), model.births]
    if model.spawn_weight > 0:
        parts.append(Mixture(model.spawn_weight * tracks.w, tracks.m, tracks.P + model.spawn_covariance))
    return belief._replace(
        tracks=tracks._replace(w=model.survival_probability * tracks.w), undetected=joined(parts)
    )


def update(
    predicted: MultiBernoulli,
    sensor: Sensor,
    z: np.ndarray,
    detection_probability: float,
    kappa: np.ndarray,
    least: float = 0.0,
    association: str = "exact",
) -> tuple[MultiBernoulli, np.ndarray]:
    r"""Update the tracks and the undetected intensity with a scan (TOMB/P).

    Parameters
    ----------
    predicted : MultiBernoulli
    sensor : Sensor
    z : ndarray, shape (k, p)
        Detections.
    detection_probability : float
        P_D.
    kappa : ndarray, shape (k,)
        Intensity of clutter at the detections.
    least : float
        New tracks of less existence are dropped.
    association : {"exact", "belief-propagation"}
        How marginal probabilities are found: "exact" enumerates the association events of each cluster of
        tracks, up to a size.

    Returns
    -------
    posterior : MultiBernoulli
        Each track moment-matched over its marginal association probabilities. New tracks are ordered by
        decreasing existence.
    p_clutter : ndarray, shape (k,)
        Probability that each detection is a false alarm.

    Notes
    -----
    Track i of existence :math:`r_i` has the association weights

    .. math::

        w_{i0} = 1 - r_i P_D, \qquad w_{ij} = r_i P_D \mathcal{N}(z_j; H m_i, S_i)

    and after a missed detection it exists with probability :math:`r_i (1 - P_D) / (1 - r_i P_D)`. A detection
    assigned to no track is the first of a new target or a false alarm. With

    .. math:: \rho_j = P_D \sum_l w^u_l \mathcal{N}(z_j; H m^u_l, S^u_l)

    over the undetected intensity, marginal probabilities follow from the ratios

    .. math:: \psi_{ij} = \frac{w_{ij}}{w_{i0} (\kappa_j + \rho_j)}

    A detection unassigned with probability :math:`u_j` starts a track of existence
    :math:`u_j \rho_j / (\rho_j + \kappa_j)`. The undetected intensity is multiplied by :math:`1 - P_D`.

    References
    ----------
    Williams 2015, with belief propagation; exact marginals by Maskell, Briers and Wright 2004.
    """
    tracks, undetected = predicted.tracks, predicted.undetected
    d = tracks.m.shape[1]
    log_kappa = np.log(kappa)
    tracks_z, undetected_z = (sensor.predict_detections(p, *sensor.gates(p), z) for p in (tracks, undetected))
    seen = log_ratios(tracks.w, tracks_z.z_hat, tracks_z.S, z, log_kappa, detection_probability)
    appeared = log_ratios(
        undetected.w, undetected_z.z_hat, undetected_z.S, z, log_kappa, detection_probability
    )
    log_new_ratio = np.logaddexp.reduce(appeared, axis=0, initial=0.0)  # log((rho + kappa) / kappa)
    miss = np.maximum(1.0 - tracks.w * detection_probability, LEAST_MISS)
    track, detection = np.nonzero(seen > -np.inf)
    log_psi = seen[track, detection] - np.log(miss[track]) - log_new_ratio[detection]
    pairs, approximated = (track, detection, log_psi, len(tracks.w), len(z)), 0
    if association == "exact":
        assigned, missed, unassigned, too_large = marginals(*pairs)
        approximated = clusters_of(too_large, track, detection, log_psi, len(z))
    else:
        assigned, missed, unassigned = propagate(*pairs)
    found = np.zeros(seen.shape)
    found[track, detection] = assigned
    absent = tracks._replace(w=missed * tracks.w * (1.0 - detection_probability) / miss)
    old = moment_matched(absent, found, tracks_z)
    # what rounding puts above 1 would grow with every scan that misses
    old = old._replace(w=np.minimum(old.w, 1.0))

    exists = unassigned * -np.expm1(-log_new_ratio)
    new = np.flatnonzero((exists >= least) & (exists > 0))
    new = new[np.lexsort((*z[new].T, -exists[new]))]
    born = unassigned[new] * np.exp(appeared[:, new] - log_new_ratio[new])
    # without misses: the positive entries of `born`, row by row
    unseen = undetected._replace(w=np.zeros(len(undetected.w)))
    parts, _ = posteriors(unseen, born, undetected_z._replace(z=z[new][None]), 0.0)
    started = match_groups(parts, np.nonzero(born > 0)[1], len(new)) if len(new) else no_components(d)
    posterior = MultiBernoulli(
        joined([old, started]),
        np.append(predicted.label, predicted.next_label + np.arange(len(new))),
        undetected._replace(w=(1.0 - detection_probability) * undetected.w),
        predicted.next_label + len(new),
        approximated,
    )
    return posterior, unassigned * np.exp(-log_new_ratio)


def prune(belief: MultiBernoulli, existence: float, weight: float, max_components: int) -> MultiBernoulli:
    """Prune tracks by existence and undetected components by weight.

    Parameters
    ----------
    belief : MultiBernoulli
    existence : float
        Tracks of less existence are dropped.
    weight : float
        Undetected components of less weight are dropped.
    max_components : int
        Most tracks, and most undetected components.

    Returns
    -------
    MultiBernoulli

    Notes
    -----
    Departs: tracks of little existence are dropped; the paper may recycle them into the undetected intensity.
    """
    tracks, label, undetected, next_label, approximated = belief
    order = np.argsort(-tracks.w, kind="stable")[:max_components]
    kept = np.sort(order[(tracks.w[order] >= existence) & (tracks.w[order] > 0)])
    undetected = take(undetected, (undetected.w >= weight) & (undetected.w > 0))
    if len(undetected.w) > max_components:
        undetected = capping(undetected, max_components)[0]
    return MultiBernoulli(take(tracks, kept), label[kept], undetected, next_label, approximated)


def report(belief: MultiBernoulli, clutter: Clutter, report_threshold: float = 0.5) -> MultiTargetReport:
    """Declare the tracks whose existence exceeds `report_threshold`, by decreasing existence.

    Parameters
    ----------
    belief : MultiBernoulli
    clutter : Clutter
        Clutter to report.
    report_threshold : float
        Probability of existence.

    Returns
    -------
    MultiTargetReport
    """
    tracks, label, undetected, _, approximated = belief
    order = np.argsort(-tracks.w, kind="stable")
    order = order[tracks.w[order] > report_threshold]
    all_targets = joined([tracks, undetected])
    existence = np.minimum(tracks.w[order], 1.0)  # a sum of marginals may exceed 1 by rounding
    return MultiTargetReport(
        tracks.m[order], existence, label[order], float(all_targets.w.sum()), all_targets, clutter,
        approximated,
    )  # fmt: skip


@kernel
def moment_matched(absent, found, tracks_z):
    r"""Moment match of every track over its association probabilities; weights are existences.

    absent is the Mixture of the tracks, its weights the probabilities that a track exists and is missed;
    found (n, k) are those of each detection; tracks_z are the PredictedDetections of a Sensor.

    Notes
    -----
    With innovations :math:`\nu_j`, shares :math:`\beta` of `absent` and `found`, and
    :math:`\nu = \sum_j \beta_j \nu_j`

    .. math::

        m \leftarrow m + K \nu, \qquad
        P \leftarrow \beta_0 P + (1 - \beta_0) (P - K S K^T)
            + K \Big( \sum_j \beta_j \nu_j \nu_j^T - \nu \nu^T \Big) K^T

    No posterior of a single pair is formed, so memory does not grow with the detections in a gate.
    """
    w, m, P = absent
    z_hat, S, C = tracks_z.z_hat, tracks_z.S, tracks_z.C
    z, H, R = tracks_z.z[0], tracks_z.H[0], tracks_z.noise[0]
    (n, d), (k, p) = m.shape, z.shape
    w_out, m_out, P_out = np.empty(n), m.copy(), P.copy()
    L, K, W, P_hit = np.zeros((p, p)), np.empty((d, p)), np.empty((p, d)), np.empty((d, d))
    nu, spread, L_noise = np.empty(p), np.empty((p, p)), np.zeros((p, p))
    for i in range(n):
        hit = 0.0
        nu[:], spread[:] = 0.0, 0.0
        for j in range(k):
            hit += found[i, j]
            for r in range(p):
                nu[r] += found[i, j] * (z[j, r] - z_hat[i, r])
        w_out[i] = w[i] + hit
        if not hit > 0.0:
            continue
        nu /= w_out[i]
        for j in range(k):
            if found[i, j] > 0.0:
                for r in range(p):
                    for s in range(r + 1):
                        off = (z[j, r] - z_hat[i, r] - nu[r]) * (z[j, s] - z_hat[i, s] - nu[s])
                        spread[r, s] += found[i, j] / w_out[i] * off
        cholesky_into(L, S[i])
        posterior_into(P_hit, K, (W, L_noise), L, P[i], C[i], H, R)
        missed = w[i] / w_out[i]
        for r in range(p):
            for s in range(r + 1):
                # a miss keeps the mean: an innovation of 0
                spread[r, s] += missed * nu[r] * nu[s]
                spread[s, r] = spread[r, s]
        shift = K @ spread @ K.T
        for r in range(d):
            for c in range(p):
                m_out[i, r] += K[r, c] * nu[c]
            for c in range(r + 1):
                P_out[i, r, c] = missed * P[i, r, c] + (1.0 - missed) * P_hit[r, c] + shift[r, c]
                P_out[i, c, r] = P_out[i, r, c]
    return Mixture(w_out, m_out, P_out)
