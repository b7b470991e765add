r"""From the posterior of a scan back to a multi-Bernoulli: how hypotheses are shared out among tracks.

After a scan each track has hypotheses of a miss and of every detection. A projection says which of them are
merged into one track: those of one track (TOMB), those of one detection (MOMB), or those that make the
tracks most alike (variational).
"""

from collections.abc import Callable

import numpy as np

from gmr_gym.filters.marginals import clusters
from gmr_gym.filters.mixture_tracks import Associated, MixtureTracks, added
from gmr_gym.filters.ranked_assignments import ranked_assignments, ranked_events
from gmr_gym.filters.target_densities import Densities, joined, merge
from gmr_gym.filters.target_densities import take as take_densities
from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, half_log_determinant, mahalanobis_squared, solve_lower

ROUNDS = 20  # of permutations, most
TOLERANCE = 1e-3  # a round that saves less is the last
SUREST = 1.0 - 1e-8  # existence in a Kullback-Leibler divergence
SPREAD = float(np.log(1e4))  # events that are less probable than the best by more are not looked at
IMPROBABLE = 1e-4  # marginal probability of a pair that no permutation looks at


def tomb(found: Associated, new: MixtureTracks, detection: np.ndarray) -> MixtureTracks:
    """Track-oriented: hypotheses stay with their track (Williams 2015, TOMB/P).

    Parameters
    ----------
    found : Associated
    new : MixtureTracks
        What begins with detections.
    detection : ndarray of int
        Those of `new`.

    Returns
    -------
    MixtureTracks
        Not reduced.
    """
    return added(found.tracks, new)


def momb(found: Associated, new: MixtureTracks, detection: np.ndarray) -> MixtureTracks:
    r"""Measurement-oriented: a track for every detection, and one for every track that may be missed.

    Parameters
    ----------
    found : Associated
    new : MixtureTracks
        What begins with detections, with labels of its own.
    detection : ndarray of int
        Those of `new`.

    Returns
    -------
    MixtureTracks
        Not reduced. A label goes to the heaviest of the tracks that have a part of the one it was of; a track
        that gets none has that of the new track of its detection, or -1.

    Notes
    -----
    .. math:: r_j = \sum_i p_{ij} + u_j \frac{\rho_j}{\rho_j + \kappa_j}

    References
    ----------
    Williams 2015, MOMB/P.
    """
    tracks, k = found.tracks, 1 + max(found.detection.max(initial=-1), detection.max(initial=-1))
    group = np.where(found.detection >= 0, found.detection, k + tracks.track)
    group = np.append(group, detection)
    mass = np.append(tracks.existence[tracks.track] * tracks.weight, new.existence)
    used, track = np.unique(group, return_inverse=True)
    existence = np.bincount(track, mass, len(used))
    label = np.append(tracks.label[tracks.track], new.label)
    return MixtureTracks(
        np.minimum(existence, 1.0), _inherited(label, mass, track, len(used)),
        joined([tracks.densities, new.densities]),
        np.divide(mass, existence[track], out=np.ones(len(mass)), where=existence[track] > 0), track,
    )  # fmt: skip


def variational(
    found: Associated, new: MixtureTracks, detection: np.ndarray, hypotheses: int = 100
) -> MixtureTracks:
    """The multi-Bernoulli nearest to the posterior: in every event tracks are permuted.

    Parameters
    ----------
    found : Associated
    new : MixtureTracks
        What begins with detections.
    detection : ndarray of int
        Those of `new`.
    hypotheses : int
        Most events of a cluster that are looked at, the most probable ones.

    Returns
    -------
    MixtureTracks
        Not reduced. Labels mean places where tracks meet, not targets.

    Notes
    -----
    Departs: new tracks are not permuted; pairs of a marginal probability below 1e-4 count as impossible.

    References
    ----------
    Williams, TSP 63(1), 2015; Xia et al. 2022.
    """
    tracks, pairs, n = found.tracks, found.pairs, len(found.tracks.existence)
    likely = np.flatnonzero(pairs.assigned > IMPROBABLE)
    root = clusters(pairs.track[likely], pairs.detection[likely], n, len(found.unassigned))
    alone = np.flatnonzero(np.bincount(root, minlength=n)[root[tracks.track]] == 1)
    shares = [(alone, tracks.track[alone], np.ones(len(alone)))]  # rows, their slots and weights
    for lowest in np.flatnonzero(np.bincount(root, minlength=n) > 1):
        members = np.flatnonzero(root == lowest)
        shares.append(_moved(found, members, likely[root[pairs.track[likely]] == lowest], hypotheses))
    mass = tracks.existence[tracks.track] * tracks.weight
    return added(_shared_out(tracks, mass, *map(np.concatenate, zip(*shares, strict=True))), new)


def permuted(
    weight: np.ndarray, local: np.ndarray, existence: np.ndarray, densities: Densities
) -> tuple[np.ndarray, list[float]]:
    r"""Permute the tracks of a cluster in every event so that what is merged is most alike.

    Parameters
    ----------
    weight : ndarray, shape (h,)
        Probability of each event.
    local : ndarray of int, shape (h, n)
        Hypothesis of every track in each event, below u.
    existence : ndarray, shape (u,)
        Of each hypothesis.
    densities : Densities
        u densities.

    Returns
    -------
    share : ndarray, shape (u, n)
        Probability that a hypothesis is in an event where it stands in the place of each track.
    costs : list of float
        Of every round, falling.

    Notes
    -----
    In turns, for tracks :math:`q` and event h with hypotheses :math:`f_{hi}`

    .. math::

        \pi_h = \arg\min_\pi \sum_i D(f_{hi} \| q_{\pi(i)}), \qquad
        q_i = \sum_h p_h f_{h, \pi_h^{-1}(i)} \text{ by its moments}

    with the Kullback-Leibler divergence of Bernoulli densities over modes and states.
    """
    (h, n), u = local.shape, len(existence)
    slot, costs = np.tile(np.arange(n), (h, 1)), []
    while True:
        share = np.bincount((local * n + slot).ravel(), np.repeat(weight, n), u * n).reshape(u, n)
        part, into = np.nonzero(share)
        joint = share[part, into] * existence[part]
        q = merge(take_densities(densities, part), joint, into, n)
        cost = _divergences(existence, *densities, np.bincount(into, joint, n), *q)
        costs.append(float((weight @ cost[local, slot]).sum()))
        if len(costs) == ROUNDS or (len(costs) > 1 and costs[-2] - costs[-1] < TOLERANCE):
            return share, costs
        slot = _permutations(cost, local)


def _moved(
    found: Associated, members: np.ndarray, likely: np.ndarray, hypotheses: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The hypotheses of a cluster of tracks, the tracks that they go to, and the share of each that does."""
    tracks, pairs, n = found.tracks, found.pairs, len(members)
    place = np.full(len(tracks.existence), -1)
    place[members] = np.arange(n)
    there, column = np.unique(pairs.detection[likely], return_inverse=True)
    table = np.full((n, len(there)), -np.inf)
    table[place[pairs.track[likely]], column] = pairs.log_psi[likely]
    event, log_weight = ranked_events(table, hypotheses, SPREAD)
    weight = np.exp(log_weight - log_weight[0])
    # hypotheses of a track by detection, a miss first; those of one detection are judged as one
    rows = np.flatnonzero(place[tracks.track] >= 0)
    of = np.searchsorted(there, found.detection[rows]).clip(0, len(there) - 1)
    missed = found.detection[rows] < 0
    known = missed | (table[place[tracks.track[rows]], of] > -np.inf)
    key = place[tracks.track[rows]] * (len(there) + 1) + np.where(missed, 0, of + 1)
    keys, local = np.unique(key[known], return_inverse=True)
    held = rows[known]
    mass = tracks.existence[tracks.track[held]] * tracks.weight[held]
    exists = np.ones(len(keys))
    miss = keys % (len(there) + 1) == 0
    exists[miss] = np.bincount(local, mass)[miss] / found.missed[members[keys[miss] // (len(there) + 1)]]
    densities = merge(take_densities(tracks.densities, held), mass, local, len(keys))
    chosen = np.searchsorted(keys, np.arange(n) * (len(there) + 1) + event + 1)
    share, _ = permuted(weight / weight.sum(), chosen, exists.clip(0.0, 1.0), densities)
    whole = share.sum(axis=1, keepdims=True)
    own = np.eye(n)[keys // (len(there) + 1)]  # of what is in none of the events
    share = np.where(whole > 0, share / np.where(whole > 0, whole, 1.0), own)
    a, slot = np.nonzero(share[local])
    rest = rows[~known]
    return (
        np.append(held[a], rest),
        np.append(members[slot], tracks.track[rest]),
        np.append(share[local[a], slot], np.ones(len(rest))),
    )


def _shared_out(tracks, mass, row, slot, share):
    """Tracks of which each has the given shares of hypotheses."""
    n = len(tracks.existence)
    part = mass[row] * share
    existence = np.bincount(slot, part, n)
    weight = np.divide(part, existence[slot], out=np.ones(len(part)), where=existence[slot] > 0)
    return MixtureTracks(
        np.minimum(existence, 1.0), tracks.label, take_densities(tracks.densities, row), weight, slot
    )


@kernel
def _divergences(existence, w, m, P, other_existence, other_w, other_m, other_P):
    """Kullback-Leibler divergence (u, n) of u Bernoulli densities over modes from n others."""
    (u, r, d), n = m.shape, len(other_m)
    L, y, own = np.zeros((n, r, d, d)), np.empty(d), np.zeros((d, d))
    out = np.zeros((u, n))
    for i in range(n):
        for q in range(r):
            cholesky_into(L[i, q], other_P[i, q])
    for a in range(u):
        there = min(existence[a], SUREST)
        for q in range(r):
            cholesky_into(own, P[a, q])
            volume = half_log_determinant(own)
            for i in range(n):
                apart = mahalanobis_squared(L[i, q], m[a, q], other_m[i, q], y) - d
                white = own.copy()
                solve_lower(L[i, q], white)
                apart += (white * white).sum() + 2.0 * (half_log_determinant(L[i, q]) - volume)
                if there * w[a, q] > 0.0:
                    unlike = np.log(w[a, q] / other_w[i, q]) + 0.5 * apart
                    out[a, i] += there * w[a, q] * unlike
        for i in range(n):
            other = min(max(other_existence[i], 1.0 - SUREST), SUREST)
            out[a, i] += (1.0 - there) * np.log((1.0 - there) / (1.0 - other))
            out[a, i] += there * np.log(there / other) if there > 0.0 else 0.0
    return out


@kernel
def _permutations(cost, local):
    """For every event (h, n) the places of its tracks, of least sum of cost (u, n)."""
    h, n = local.shape
    out = np.empty((h, n), np.int64)
    for a in range(h):
        out[a] = ranked_assignments(cost[local[a]], 1)[0][0]
    return out


PROJECTIONS: dict[str, Callable] = {"tomb": tomb, "momb": momb, "variational": variational}


def _inherited(label, mass, track, count):
    """Label of each of `count` tracks: that of its heaviest part, -1 where a heavier track has it."""
    out, taken = np.full(count, -1), set()
    for a in np.argsort(-mass, kind="stable"):
        if out[track[a]] < 0 and label[a] not in taken:
            out[track[a]] = label[a]
            taken.add(label[a])
    return out
