"""Bernoulli tracks with labels and an IMM in each: one compiled call a scan, over plain arrays.

The update of `pmb` (Williams 2015, TOMB/P), in which every pair of track and detection is judged at the
detection's own time, a miss counts where the sensor has looked, and an identity restricts the association.
"""

from typing import NamedTuple

import numpy as np

from gmr_gym.filters.belief_propagation import propagate
from gmr_gym.filters.imm_tracks import (
    Banks,
    at_detection,
    carried,
    conditioned,
    mix,
    moved,
    normalised_innovation,
)
from gmr_gym.filters.pmb import LEAST_MISS
from gmr_gym.filters.track_gates import gated_pairs
from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, mahalanobis_squared
from gmr_gym.models.intervals import switching_over
from gmr_gym.models.spherical import debiased_of

NEGLIGIBLE = 1e-12  # marginal probability of a pair that no posterior is formed for
LONG = 1e9  # s, after which switching has forgotten the first mode


class Bernoullis(NamedTuple):
    """n Bernoulli tracks, as the update changes them.

    Attributes
    ----------
    banks : Banks
    existence : ndarray (n,)
    identity : ndarray of int (n,)
        -1 where it is not known.
    looked : ndarray (n,)
        Probability of detection by this look; 0 where a missed detection means nothing.
    """

    banks: Banks
    existence: np.ndarray
    identity: np.ndarray
    looked: np.ndarray


class Origins(NamedTuple):
    """Where detections of a look may come from.

    Attributes
    ----------
    detection_probability : float
        P_D.
    log_other : ndarray (k,)
        Log density of clutter and of targets without a track, at each detection, in the coordinates of the
        sensor.
    identity : ndarray of int (k,)
        -1 where it is not known.
    taken : ndarray of bool (k,)
        Whether a track has this identity; the detection then joins no track of unknown identity.
    gates : ndarray (2,)
        Largest squared distances without and with range rate.
    """

    detection_probability: float
    log_other: np.ndarray
    identity: np.ndarray
    taken: np.ndarray
    gates: np.ndarray


class Associated(NamedTuple):
    """Marginal association probabilities of a look.

    Attributes
    ----------
    unassigned : ndarray (k,)
        Probability that a detection is of no track.
    hit : ndarray (n,)
        Probability that a track exists and was detected.
    gated : ndarray of int (n,)
        Number of detections in the gate.
    best : ndarray of int (n,)
        The one of most weight, -1 for none.
    weight, nis : ndarray (n,)
        Its probability and normalised innovation squared.
    """

    unassigned: np.ndarray
    hit: np.ndarray
    gated: np.ndarray
    best: np.ndarray
    weight: np.ndarray
    nis: np.ndarray


@kernel(inline="always")  # `track_rules.follow` is the one kernel that calls it
def update(tracks, modes, look, origins):
    r"""Bring the tracks to the time of the look and update them with its detections, in place.

    Returns the fields of `Associated`.

    Notes
    -----
    As in `pmb.update`, with the likelihood of a pair summed over the modes,

    .. math:: w_{ij} = r_i P_D \sum_q \mu_{iq} \mathcal{N}(z_j; h(m_{iq}(t_j)), S_{iq}(t_j))

    each at the time :math:`t_j` of the detection. Each mode is then moment-matched over a miss and all
    detections, with their posterior mode probabilities.
    """
    predicted, pairs, gated = judged(tracks, modes, look, origins)
    track, detection, log_psi, _ = pairs
    assigned, missed, unassigned = propagate(track, detection, log_psi, len(gated), len(look.at))
    hit, best, weight, nis = concluded(tracks, modes, look, (predicted, pairs), (assigned, missed))
    return unassigned, hit, gated, best, weight, nis


@kernel(inline="always")
def judged(tracks, modes, look, origins):
    """Predict the tracks and weigh every pair of track and detection in its gate.

    Returns the predicted banks; the pairs: track (e,), detection (e,), log weight (e,) relative to a missed
    track and a detection of no track, and shares (e, r) of the modes in it; and the number of detections in
    each gate. Modes are mixed in place.
    """
    banks, existence, _, looked = tracks
    mix(banks, modes, look.time)
    predicted = carried(banks, modes, look.time, look.z.shape[1])
    track, detection, log_likelihood = gated_pairs(tracks, predicted, modes, look, origins)
    e = len(track)
    log_psi, share = np.empty(e), np.empty(log_likelihood.shape)
    miss = np.maximum(1.0 - existence * looked, LEAST_MISS)
    gated = np.zeros(len(existence), np.int64)
    for a in range(e):
        i = track[a]
        gated[i] += 1
        top = log_likelihood[a].max()
        share[a] = banks.w[i] * np.exp(log_likelihood[a] - top)
        total = share[a].sum()
        share[a] /= total
        log_psi[a] = top + np.log(total * existence[i] * origins.detection_probability / miss[i])
        log_psi[a] -= origins.log_other[detection[a]]
    return predicted, (track, detection, log_psi, share), gated


@kernel(inline="always")
def concluded(tracks, modes, look, judgement, marginal):
    """Update the tracks with their associations, in place.

    judgement is what `judged` returns first, predicted banks and pairs; marginal is (assigned, missed), the
    probabilities of pairs (e,) and of missed tracks (n,). Returns hit, best, weight and nis of `Associated`.
    """
    (predicted, (track, detection, _, share)), (assigned, missed) = judgement, marginal
    banks, existence, _, looked = tracks
    n = len(existence)
    best, weight = np.full(n, -1), np.zeros(n)
    for a in range(len(track)):
        if assigned[a] > weight[track[a]]:
            best[track[a]], weight[track[a]] = detection[a], assigned[a]
    nis = np.full(n, np.nan)
    for i in range(n):
        if best[i] >= 0:
            nis[i] = normalised_innovation(banks, predicted, modes, look, i, best[i])
    miss = np.maximum(1.0 - existence * looked, LEAST_MISS)
    missed = missed * (existence * (1.0 - looked) / miss)
    hit = _condition(tracks, predicted, modes, look, (track, detection, assigned, share, missed))
    return hit, best, weight, nis


@kernel(inline="always")
def _condition(tracks, predicted, modes, look, associations):
    """Moment match of every mode over a miss and its detections, in place; returns the probability (n,) that
    a track exists and was detected."""
    track, detection, assigned, share, missed = associations
    banks, existence = tracks.banks, tracks.existence
    n, r, d = banks.m.shape
    mass, shift, spread = np.empty((n, r)), np.zeros((n, r, d)), np.empty((n, r, d, d))
    hit = np.zeros(n)
    for i in range(n):
        for q in range(r):
            mass[i, q] = missed[i] * banks.w[i, q]
            spread[i, q] = mass[i, q] * predicted.P[i, q]
    for a in range(len(track)):
        i, j = track[a], detection[a]
        hit[i] += assigned[a]
        for q in range(r):
            weight = assigned[a] * share[a, q]
            if weight <= NEGLIGIBLE:
                continue
            m, P = at_detection(banks, predicted, modes, look, (i, q, j))
            m, P = conditioned(m, P, modes, look, (i, q, j))
            off = m - predicted.m[i, q]
            mass[i, q] += weight
            shift[i, q] += weight * off
            for x in range(d):
                for y in range(d):
                    spread[i, q, x, y] += weight * (P[x, y] + off[x] * off[y])
    for i in range(n):
        total = mass[i].sum()
        existence[i] = min(total, 1.0)
        for q in range(r):
            banks.m[i, q], banks.P[i, q] = predicted.m[i, q], predicted.P[i, q]
            if mass[i, q] > 0.0:
                off = shift[i, q] / mass[i, q]
                banks.m[i, q] += off
                banks.P[i, q] = spread[i, q] / mass[i, q] - off.reshape(d, 1) * off
                banks.w[i, q] = mass[i, q] / total
            elif total > 0.0:
                banks.w[i, q] = 0.0
        banks.time[i] = look.time
    return hit


@kernel
def started(modes, look, rows, max_speed, d):
    """Banks of the tracks that detections `rows` start, at the time of the look.

    A velocity is uniform up to max_speed, matched by a Gaussian, and updated with the range rate; the
    position is the detection, polar ones debiased.
    """
    n, p, r = len(rows), look.z.shape[1], len(modes.motion)
    w, m, P = np.empty((n, r)), np.zeros((n, r, d)), np.zeros((n, r, d, d))
    likely = switching_over(modes, LONG).sum(axis=1) / r
    speed = max_speed**2 / (p + 2)
    noise, spherical = np.zeros(3), np.zeros((1, 3))
    for a in range(n):
        j = rows[a]
        mean, covariance = np.zeros(d), np.zeros((d, d))
        for c in range(p):
            mean[c], covariance[c, c] = look.z[j, c], look.deviation[c] ** 2
            covariance[p + c, p + c] = speed
        for c in range(2 * p, d):
            covariance[c, c] = modes.parameters[:, 0].max() ** 2
        if look.polar:
            noise[:p], spherical[0, :p] = look.deviation[:p], look.z[j]
            place, R = debiased_of(spherical, noise)
            mean[:p] = place[0, :p] + look.origin[j, :p]
            covariance[:p, :p] = R[0, :p, :p]
        if np.isfinite(look.range_rate[j]):
            along = mean[:p] - look.origin[j, :p]
            along /= np.sqrt((along**2).sum())
            gain = speed / (speed + look.deviation[p] ** 2)
            mean[p : 2 * p] = gain * look.range_rate[j] * along
            covariance[p : 2 * p, p : 2 * p] -= gain * speed * along.reshape(p, 1) * along
        for q in range(r):
            w[a, q] = likely[q]
            m[a, q], P[a, q] = moved(mean, covariance, modes, q, look.time - look.at[j], p)
    return Banks(w, m, P, np.full(n, look.time))


@kernel
def outputs(banks, p):
    """Mean (n, 2 p) and covariance (n, 2 p, 2 p) of position and velocity over the modes."""
    (n, r), s = banks.w.shape, 2 * p
    x, P = np.zeros((n, s)), np.zeros((n, s, s))
    for i in range(n):
        for q in range(r):
            x[i] += banks.w[i, q] * banks.m[i, q, :s]
        for q in range(r):
            off = banks.m[i, q, :s] - x[i]
            P[i] += banks.w[i, q] * (banks.P[i, q, :s, :s] + off.reshape(s, 1) * off)
    return x, P


@kernel
def first_of_each(x, P, identity, order, distance):
    """For each track (n,) itself, or the track before it in `order` that is on the same target.

    Two are on the same target where their states are within `distance` of the deviations of their
    difference, and their identities do not differ.
    """
    n, d = x.shape
    of, L, y = np.arange(n), np.zeros((d, d)), np.empty(d)
    for b in range(len(order)):
        i = order[b]
        for a in range(b):
            j = order[a]
            apart = identity[i] >= 0 and identity[j] >= 0 and identity[i] != identity[j]
            if apart or of[j] != j:
                continue
            close = True
            for c in range(d):
                close &= (x[i, c] - x[j, c]) ** 2 <= distance**2 * (P[i, c, c] + P[j, c, c])
            if close and cholesky_into(L, P[i] + P[j]):
                if mahalanobis_squared(L, x[i], x[j], y) <= distance**2:
                    of[i] = j
                    break
    return of
