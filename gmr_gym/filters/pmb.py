"""Targets as Bernoulli tracks over a Poisson intensity of those not yet detected (Williams 2015): which
detection is whose is a matter of marginal probabilities, by belief propagation (Williams and Lau 2014).

A track is there or is not; if it is, it is one Gaussian. Existences are no shares: each lies in [0, 1].
"""

from typing import NamedTuple

import numpy as np

from gmr_gym.filters.intensity_update import log_ratios, posteriors
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

TOLERANCE = 1e-6  # relative, of the messages of one round to those of the next
ROUNDS = 1000  # of messages, at most
# a track that is certain to be detected is missed with this probability: something must explain an empty gate
LEAST_MISS = 1e-100


class MultiBernoulli(NamedTuple):
    """Tracks, each of one target or of none, and the intensity of the targets that no scan has shown."""

    tracks: Mixture  # weights (n,) are probabilities of existence
    label: np.ndarray  # (n,), no two alike
    undetected: Mixture  # an intensity
    next_label: int  # the next label to give


def no_targets(model: MultiTargetModel) -> MultiBernoulli:
    """No track, and nobody to detect."""
    d = len(model.motion.F)
    return MultiBernoulli(no_components(d), np.empty(0, np.int64), no_components(d), 0)


def predict(belief: MultiBernoulli, model: MultiTargetModel) -> MultiBernoulli:
    """One period later: whoever survives moves, and those born and those whom tracks spawn, about where their
    parent moves, are undetected (Williams 2015; the spawning is ours: undetected targets have
    none)."""
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
) -> tuple[MultiBernoulli, np.ndarray]:
    """After a scan z (k, p), and the probability (k,) that each of its detections is false.

    kappa (k,) is the intensity of clutter at the detections. Track i, of existence r, against its absence:

        missed    1 - r P_D, then it exists with r (1 - P_D) / (1 - r P_D)    detected    r P_D N(z; H m, S)

    A detection that is of none is of the first target seen there, of intensity rho = P_D times the sum of
    w N(z; H m, S) over the undetected, or false: it starts a track of existence rho / (rho + kappa)
    (Williams 2015). Each track is one Gaussian over its marginal probabilities (his TOMB/P).
    New tracks that exist with less than `least` are left out; the surest has the first label."""
    tracks, undetected = predicted.tracks, predicted.undetected
    d = tracks.m.shape[1]
    log_kappa = np.log(kappa)
    z_hat, S = sensor.gates(tracks)
    at, spread = sensor.gates(undetected)
    seen = log_ratios(tracks.w, z_hat, S, z, log_kappa, detection_probability)
    appeared = log_ratios(undetected.w, at, spread, z, log_kappa, detection_probability)
    log_unowned = np.logaddexp.reduce(appeared, axis=0, initial=0.0)  # log of (rho + kappa) / kappa
    miss = np.maximum(1.0 - tracks.w * detection_probability, LEAST_MISS)
    track, detection = np.nonzero(seen > -np.inf)
    log_psi = seen[track, detection] - np.log(miss[track]) - log_unowned[detection]
    assigned, missed, unassigned = marginals(track, detection, log_psi, len(tracks.w), len(z))
    found = np.zeros(seen.shape)
    found[track, detection] = assigned
    absent = missed * tracks.w * (1.0 - detection_probability) / miss
    C = sensor.predict_detections(tracks, z_hat, S, z).C
    old = Mixture(*moment_matched(absent, found, tracks.m, tracks.P, z_hat, S, C, *sensor, z))

    exists = unassigned * -np.expm1(-log_unowned)
    new = np.flatnonzero((exists >= least) & (exists > 0))
    new = new[np.lexsort((*z[new].T, -exists[new]))]
    born = unassigned[new] * np.exp(appeared[:, new] - log_unowned[new])
    C = sensor.predict_detections(undetected, at, spread, z).C
    parts = posteriors(
        np.zeros(len(at)), born, undetected.m, undetected.P, at, spread, C, *sensor, z[new], 0.0
    )  # without a miss, these are the positive entries of `born`, row by row
    next_label = (
        match_groups(Mixture(*parts[:3]), np.nonzero(born > 0)[1], len(new)) if len(new) else no_components(d)
    )
    posterior = MultiBernoulli(
        joined([old, next_label]),
        np.append(predicted.label, predicted.next_label + np.arange(len(new))),
        undetected._replace(w=(1.0 - detection_probability) * undetected.w),
        predicted.next_label + len(new),
    )
    return posterior, unassigned * np.exp(-log_unowned)


def prune(belief: MultiBernoulli, existence: float, weight: float, max_components: int) -> MultiBernoulli:
    """Without tracks of less than `existence` and undetected components of less than `weight`, and no more
    than the `most` surest of the one and the `most` heaviest of the other."""
    tracks, label, undetected, next_label = belief
    surest = np.argsort(-tracks.w, kind="stable")[:max_components]
    kept = np.sort(surest[(tracks.w[surest] >= existence) & (tracks.w[surest] > 0)])
    undetected = take(undetected, (undetected.w >= weight) & (undetected.w > 0))
    if len(undetected.w) > max_components:
        undetected = capping(undetected, max_components)[0]
    return MultiBernoulli(take(tracks, kept), label[kept], undetected, next_label)


def report(belief: MultiBernoulli, clutter: Clutter, report_threshold: float = 0.5) -> MultiTargetReport:
    """The tracks that exist with more than `naming`, the surest first, under their labels."""
    tracks, label, undetected, _ = belief
    surest = np.argsort(-tracks.w, kind="stable")
    surest = surest[tracks.w[surest] > report_threshold]
    all_targets = joined([tracks, undetected])
    existence = np.minimum(tracks.w[surest], 1.0)  # a sum of marginals is 1 but for rounding
    return MultiTargetReport(
        tracks.m[surest], existence, label[surest], float(all_targets.w.sum()), all_targets, clutter
    )


@kernel
def moment_matched(absent, found, m, P, z_hat, S, C, H, R, z):
    """Each track i one Gaussian again, by its moments, after it was absent with probability absent (n,) and
    had each detection with found (n, k). With the innovations nu_j, K of S and C = H P, beta their shares:

        m + K nu      (1 - beta_0) (P - K S K') + beta_0 P + K (sum beta_j nu_j nu_j' - nu nu') K',
        nu = sum beta_j nu_j

    so that no posterior of a pair is ever formed: thousands of detections in a gate need no room."""
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
        w_out[i] = absent[i] + hit
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
        posterior_into(P_hit, K, W, L, L_noise, P[i], C[i], H, R)
        missed = absent[i] / w_out[i]
        for r in range(p):
            for s in range(r + 1):
                # where it was absent the mean stays, at an innovation of 0
                spread[r, s] += missed * nu[r] * nu[s]
                spread[s, r] = spread[r, s]
        shift = K @ spread @ K.T
        for r in range(d):
            for c in range(p):
                m_out[i, r] += K[r, c] * nu[c]
            for c in range(r + 1):
                P_out[i, r, c] = missed * P[i, r, c] + (1.0 - missed) * P_hit[r, c] + shift[r, c]
                P_out[i, c, r] = P_out[i, r, c]
    return w_out, m_out, P_out


@kernel
def marginals(track, detection, log_psi, n, k):
    """Marginal probabilities that a track has a detection (e,), a track none (n,) and a detection no track
    (k,), by loopy belief propagation (Williams and Lau 2014): exact where the e pairs
    close no loop.

    log_psi (e,) is the logarithm of how much likelier than a track missed and a detection of no track is the
    pair of track (e,) and detection (e,); messages are logarithms too, for where there is hardly any clutter
    psi is beyond floating point. No pair may occur twice."""
    e = len(log_psi)
    by_track, first_track = _grouped(track, n)
    by_detection, first_detection = _grouped(detection, k)
    to_track, to_detection, value = np.zeros(e), np.empty(e), np.empty(e)
    missed, unassigned = np.zeros(n), np.zeros(k)
    for _ in range(ROUNDS):
        for a in range(e):
            value[a] = log_psi[a] + to_track[a]
        _others(to_detection, missed, value, by_track, first_track)
        for a in range(e):
            to_detection[a] = log_psi[a] - to_detection[a]
        change = 0.0
        _others(value, unassigned, to_detection, by_detection, first_detection)
        for a in range(e):
            change = max(change, abs(to_track[a] + value[a]))
            to_track[a] = -value[a]
        if change <= TOLERANCE:
            break
    for a in range(e):
        value[a] = log_psi[a] + to_track[a]
    _others(to_detection, missed, value, by_track, first_track)
    for a in range(e):
        value[a] = np.exp(value[a] - missed[track[a]])
    return value, np.exp(-missed), np.exp(-unassigned)


@kernel
def _grouped(group, count):
    """Members (e,) in order of their group, and where each group begins (count + 1,)."""
    first = np.zeros(count + 1, np.int64)
    for a in range(len(group)):
        first[group[a] + 1] += 1
    for g in range(count):
        first[g + 1] += first[g]
    member, at = np.empty(len(group), np.int64), first[:count].copy()
    for a in range(len(group)):
        member[at[group[a]]] = a
        at[group[a]] += 1
    return member, first


@kernel
def _others(out, whole, value, member, first):
    """log(1 + sum of exp) of the values of all others of the same group, into out (e,), and of all of each
    group, into whole (groups,)."""
    share = np.empty(len(value))
    for g in range(len(first) - 1):
        top, surest, second = 0.0, -1, 0.0
        for b in range(first[g], first[g + 1]):
            a = member[b]
            if value[a] > top:
                top, surest, second = value[a], a, top
            else:
                second = max(second, value[a])
        whole[g], rest = np.exp(-top), np.exp(-second)
        for b in range(first[g], first[g + 1]):
            a = member[b]
            share[a] = np.exp(value[a] - top)
            whole[g] += share[a]
            rest += np.exp(value[a] - second) if a != surest else 0.0
        for b in range(first[g], first[g + 1]):
            a = member[b]
            # of the largest: the sum less itself would lose the others
            out[a] = top + np.log(whole[g] - share[a]) if a != surest else second + np.log(rest)
        whole[g] = top + np.log(whole[g])
