"""Tracks of many targets that are associated jointly, each a mixture of densities that is reduced by itself.

The update that JPDA, JIPDA and Poisson multi-Bernoulli trackers share: marginal association probabilities of
a scan, and the mixture that they make of every track.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_count
from gmr_gym.filters import target_densities, undetected_targets
from gmr_gym.filters.belief_propagation import propagate
from gmr_gym.filters.intensity_update import log_sum
from gmr_gym.filters.marginals import clusters_of, marginals
from gmr_gym.filters.pmb import LEAST_MISS
from gmr_gym.filters.target_densities import Densities, joined, merge, outputs, pair, posteriors
from gmr_gym.filters.target_densities import take as take_densities
from gmr_gym.filters.undetected_targets import Appearing, Intensity, detected
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.reduction.properties import MOMENTS, PROPERTIES
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.reduction.registry import reducer

Reduction = Callable[[Mixture], Reduced]
FREE = 0.5  # probability of belonging to no track, above which a detection is left to others
NEGLIGIBLE = 1e-15  # probability of a pair that no posterior is formed for


class MixtureTracks(NamedTuple):
    """n tracks, each a mixture of densities.

    Attributes
    ----------
    existence : ndarray, shape (n,)
        Probability that each exists.
    label : ndarray of int, shape (n,)
        Distinct labels.
    densities : Densities
        N hypotheses, track after track.
    weight : ndarray, shape (N,)
        Probability of each, given that its track exists.
    track : ndarray of int, shape (N,)
        Track of each, below n.
    """

    existence: np.ndarray
    label: np.ndarray
    densities: Densities
    weight: np.ndarray
    track: np.ndarray


class TrackPairs(NamedTuple):
    """The e pairs of a track and a detection.

    Attributes
    ----------
    track, detection : ndarray of int, shape (e,)
    log_psi : ndarray, shape (e,)
        log of the weight of each, relative to a miss and a detection of no track.
    assigned : ndarray, shape (e,)
        Marginal probability of each.
    """

    track: np.ndarray
    detection: np.ndarray
    log_psi: np.ndarray
    assigned: np.ndarray


class Associated(NamedTuple):
    """Tracks after a scan, not yet reduced.

    Attributes
    ----------
    tracks : MixtureTracks
    detection : ndarray of int, shape (N,)
        That each hypothesis has, -1 for none; those come first.
    unassigned : ndarray, shape (k,)
        Probability that each detection is of no track.
    missed : ndarray, shape (n,)
        Probability that each track has no detection.
    pairs : TrackPairs
    approximated : int
        Clusters whose association probabilities are approximate.
    """

    tracks: MixtureTracks
    detection: np.ndarray
    unassigned: np.ndarray
    missed: np.ndarray
    pairs: TrackPairs
    approximated: int


def no_tracks(model: MultiTargetModel) -> MixtureTracks:
    """No track, of targets of the model."""
    r, d = len(model.motions), len(model.motions[0].F)
    none, no_label = np.empty(0), np.empty(0, np.int64)
    densities = Densities(np.empty((0, r)), np.empty((0, r, d)), np.empty((0, r, d, d)))
    return MixtureTracks(none, no_label, densities, none, no_label)


def undetected_at(before: Intensity, tracks: MixtureTracks, model: MultiTargetModel) -> Intensity:
    """The undetected targets one period later: those before it that survive, and new ones of it, some of them
    about the predicted `tracks`."""
    # of the tracks that exist before the scan, whether or not they survive it
    parents = tracks.existence[tracks.track] * tracks.weight / model.survival_probability
    return undetected_targets.predict(before, model, tracks.densities, parents)


def most_likely(existence: np.ndarray, least: float | np.ndarray, most: int) -> np.ndarray:
    """Indices, increasing, of at most so many tracks, each of at least so much existence."""
    order = np.argsort(-existence, kind="stable")
    return np.sort(order[((existence >= least) & (existence > 0))[order]][:most])


def predict(tracks: MixtureTracks, model: MultiTargetModel) -> MixtureTracks:
    """Tracks one period later: they survive, and each hypothesis moves."""
    return tracks._replace(
        existence=model.survival_probability * tracks.existence,
        densities=target_densities.moved(tracks.densities, model),
    )


def collapsed(tracks: MixtureTracks) -> tuple[np.ndarray, np.ndarray]:
    """Mean (n, d) and covariance (n, d, d) of every track."""
    n = len(tracks.existence)
    if len(tracks.track) == n:
        return outputs(tracks.densities)
    return outputs(merge(tracks.densities, tracks.weight, tracks.track, n))


def take(tracks: MixtureTracks, kept: np.ndarray) -> MixtureTracks:
    """The tracks at the increasing indices `kept`."""
    if len(kept) == len(tracks.existence):
        return tracks
    place = np.full(len(tracks.existence), -1)
    place[kept] = np.arange(len(kept))
    rows = place[tracks.track] >= 0
    return MixtureTracks(
        tracks.existence[kept], tracks.label[kept], take_densities(tracks.densities, rows),
        tracks.weight[rows], place[tracks.track[rows]],
    )  # fmt: skip


def added(tracks: MixtureTracks, new: MixtureTracks) -> MixtureTracks:
    """The tracks, and new ones after them."""
    if len(new.existence) == 0:
        return tracks
    new = new._replace(track=new.track + len(tracks.existence))
    existence, label, weight, track = (
        np.concatenate([getattr(tracks, field), getattr(new, field)])
        for field in ("existence", "label", "weight", "track")
    )
    return MixtureTracks(existence, label, joined([tracks.densities, new.densities]), weight, track)


def started(
    appearing: Appearing, z: np.ndarray, unassigned: np.ndarray, least: float
) -> tuple[MixtureTracks, np.ndarray]:
    r"""A new track for every detection that may be the first of a target.

    Parameters
    ----------
    appearing : Appearing
    z : ndarray, shape (k, p)
        Detections.
    unassigned : ndarray, shape (k,)
        Probability that each is of no track.
    least : float
        Tracks of less existence are left out.

    Returns
    -------
    tracks : MixtureTracks
        By decreasing existence; labels count from 0.
    detection : ndarray of int, shape (n,)
        The first of each.

    Notes
    -----
    A detection of no track with probability :math:`u_j` starts one of existence
    :math:`u_j \rho_j / (\rho_j + \kappa_j)`, the moment match of the parts of the intensity.
    """
    _, pairs, log_part, log_ratio = appearing
    exists = unassigned * -np.expm1(-log_ratio)
    new = np.flatnonzero((exists >= least) & (exists > 0))
    new = new[np.lexsort((*z[new].T, -exists[new]))]
    place = np.full(len(z), -1)
    place[new] = np.arange(len(new))
    chosen = np.flatnonzero(place[pairs.detection] >= 0)
    of = pairs.detection[chosen]
    parts = posteriors(appearing.intensity.densities, pairs, chosen)
    densities = merge(parts, np.exp(log_part[chosen] - log_ratio[of]), place[of], len(new))
    one = np.arange(len(new))
    return MixtureTracks(exists[new], one, densities, np.ones(len(new)), one), new


def associate(
    tracks: MixtureTracks,
    model: MultiTargetModel,
    z: np.ndarray,
    log_other: np.ndarray,
    association: str = "exact",
    later: np.ndarray | None = None,
) -> Associated:
    r"""Update predicted tracks with a scan by marginal association probabilities.

    Parameters
    ----------
    tracks : MixtureTracks
        Predicted; their existence may be certain.
    model : MultiTargetModel
    z : ndarray, shape (k, p)
        Detections.
    log_other : ndarray, shape (k,)
        log of the intensity of the detections that are of no track, at each.
    association : {"exact", "belief-propagation"}
    later : ndarray of bool, shape (n,), optional
        Tracks that may have only detections that the others leave, with a probability above `FREE`.

    Returns
    -------
    Associated
        Every hypothesis after a miss and after every detection in its gate.

    Notes
    -----
    Hypothesis h of track i, of weight :math:`v_h`, has the ratios

    .. math::

        \psi_{ij} = \frac{r_i \sum_h v_h P_{D,h} g_{hj}}{(1 - r_i \sum_h v_h P_{D,h}) (\kappa_j + \rho_j)}

    and after the scan the weights :math:`p_{ij} v_h P_{D,h} g_{hj} / \sum_h v_h P_{D,h} g_{hj}` and
    :math:`p_{i0} r_i v_h (1 - P_{D,h}) / (1 - r_i \sum_h v_h P_{D,h})`.

    References
    ----------
    Fortmann, Bar-Shalom and Scheffe 1983 (certain targets); Musicki and Evans 2004; Williams 2015.
    """
    p, track, n = tracks.densities, tracks.track, len(tracks.existence)
    there, seen = tracks.existence[track] * tracks.weight, detected(p, model)
    pairs = pair(p, model.sensor, z, log_other, there * seen)
    miss, log_part, of, detection, log_whole, at = _ratios(
        there, seen, track, n, pairs.row, pairs.detection, pairs.log_likelihood, len(z)
    )
    log_psi = log_whole - np.log(miss)[of] - log_other[detection]
    weigh = partial(_marginals, association=association, n=n, k=len(z))
    if later is None:
        assigned, missed, unassigned, approximated = weigh(of, detection, log_psi)
    else:
        assigned, missed, unassigned, approximated = _in_turn(weigh, later, of, detection, log_psi)
    found = assigned[at] * np.exp(log_part - log_whole[at])
    lost = missed[track] * there * (1.0 - seen) / miss[track]
    chosen = np.flatnonzero(found > NEGLIGIBLE)
    rows = np.concatenate([track, track[pairs.row[chosen]]])
    weight = np.concatenate([lost, found[chosen]])
    existence = np.bincount(rows, weight, n)
    # what has gone stays where it was predicted
    prior = np.concatenate([tracks.weight, np.zeros(len(chosen))])
    weight = np.divide(weight, existence[rows], out=prior, where=existence[rows] > 0)
    densities = joined([p, posteriors(p, pairs, chosen)])
    # what rounding puts above 1 would grow with every scan that misses
    after = MixtureTracks(np.minimum(existence, 1.0), tracks.label, densities, weight, rows)
    has = np.concatenate([np.full(len(track), -1), pairs.detection[chosen]])
    weighed = TrackPairs(of, detection, log_psi, assigned)
    return Associated(after, has, unassigned, missed, weighed, approximated)


Marginals = tuple[np.ndarray, np.ndarray, np.ndarray, int]


def _marginals(
    track: np.ndarray, detection: np.ndarray, log_psi: np.ndarray, association: str, n: int, k: int
) -> Marginals:
    """Marginal probabilities of pairs, missed tracks and unassigned detections; approximated clusters."""
    if association != "exact":
        return *propagate(track, detection, log_psi, n, k), 0
    assigned, missed, unassigned, approximate = marginals(track, detection, log_psi, n, k)
    return assigned, missed, unassigned, clusters_of(approximate, track, detection, log_psi, k)


def _in_turn(
    weigh: Callable[..., Marginals],
    later: np.ndarray,
    track: np.ndarray,
    detection: np.ndarray,
    log_psi: np.ndarray,
) -> Marginals:
    """`_marginals` of the tracks that come first, then of the `later` ones on what these leave."""
    one = np.flatnonzero(~later[track])
    assigned, missed, unassigned, approximated = weigh(track[one], detection[one], log_psi[one])
    two = np.flatnonzero(later[track] & (unassigned > FREE)[detection])
    found, *others, more = weigh(track[two], detection[two], log_psi[two])
    every = np.zeros(len(track))
    every[one], every[two] = assigned, found
    return every, missed * others[0], unassigned * others[1], approximated + more


def collapsing(reduction: str, components: int) -> Reduction | None:
    """The reduction of that name to `components`; None where it is the merge of all by their moments."""
    named = reducer(reduction, check_count(components))
    whole = PROPERTIES.get(reduction)
    return None if components == 1 and whole is not None and whole.keeps == MOMENTS else named


def reduce(tracks: MixtureTracks, reduction: Reduction | None, prune_weight: float = 0.0) -> MixtureTracks:
    """Reduce the mixture of every track.

    Parameters
    ----------
    tracks : MixtureTracks
        In any order of hypotheses.
    reduction : callable or None
        A reduction of a Mixture; None merges each track to one density by its moments, mode by mode.
    prune_weight : float
        Hypotheses of less weight in their track are pruned before the reduction.

    Returns
    -------
    MixtureTracks
        With several motions hypotheses are merged as the reduction merges their Gaussians over the modes.
    """
    n = len(tracks.existence)
    if reduction is None:
        densities = merge(tracks.densities, tracks.weight, tracks.track, n)
        return tracks._replace(densities=densities, weight=np.ones(n), track=np.arange(n))
    top = np.zeros(n)
    np.maximum.at(top, tracks.track, tracks.weight)
    order = np.argsort(tracks.track, kind="stable")
    rows = order[(tracks.weight >= np.minimum(prune_weight, top)[tracks.track])[order]]
    first = np.searchsorted(tracks.track[rows], np.arange(n + 1))
    several = np.flatnonzero(np.diff(first) > 1)
    alone = rows[first[np.flatnonzero(np.diff(first) == 1)]]
    parts, weights, track = (
        [take_densities(tracks.densities, alone)],
        [np.ones(len(alone))],
        [tracks.track[alone]],
    )
    for i in several:
        own = rows[first[i] : first[i + 1]]
        w, density = _reduced(tracks.weight[own], take_densities(tracks.densities, own), reduction)
        parts.append(density)
        weights.append(w)
        track.append(np.full(len(w), i))
    of = np.concatenate(track)
    order = np.argsort(of, kind="stable")
    densities = take_densities(joined(parts), order)
    return tracks._replace(densities=densities, weight=np.concatenate(weights)[order], track=of[order])


def _reduced(weight: np.ndarray, densities: Densities, reduction: Reduction) -> tuple[np.ndarray, Densities]:
    """Weights, which sum to 1, and densities of one track after its reduction."""
    if not weight.sum() > 0:
        weight = np.ones(len(weight))
    x, P = outputs(densities)
    q, origin = reduction(Mixture(weight / weight.sum(), x, P))
    if densities.w.shape[1] == 1:
        return q.w / q.w.sum(), Densities(np.ones((len(q.w), 1)), q.m[:, None], q.P[:, None])
    count = len(q.w)
    w = np.bincount(origin[origin >= 0], weight[origin >= 0], count)
    return w / w.sum(), merge(densities, weight, origin, count)


@kernel
def _ratios(there, seen, track, n, row, detection, log_likelihood, k):
    """Of tracks the probability (n,) of a miss; of pairs of hypotheses (e,) the log weight; of pairs of
    tracks track, detection and log weight; and which of these each of the former is part of."""
    miss, e = np.ones(n), len(row)
    for h in range(len(track)):
        miss[track[h]] -= there[h] * seen[h]
    for i in range(n):
        miss[i] = max(miss[i], LEAST_MISS)
    log_part, at, place = np.empty(e), np.empty(e, np.int64), np.full(k, -1)
    of, of_detection, log_whole = np.empty(e, np.int64), np.empty(e, np.int64), np.empty(e)
    count, begun = 0, 0  # pairs of tracks, and those of the tracks before
    for a in range(e):
        i, j = track[row[a]], detection[a]
        log_part[a] = np.log(there[row[a]] * seen[row[a]]) + log_likelihood[a]
        if count > begun and of[count - 1] != i:
            begun = count
        if not begun <= place[j] < count:
            place[j], of[count], of_detection[count], log_whole[count] = count, i, j, -np.inf
            count += 1
        at[a] = place[j]
        log_whole[at[a]] = log_sum(log_whole[at[a]], log_part[a])
    return miss, log_part, of[:count].copy(), of_detection[:count].copy(), log_whole[:count].copy(), at
