r"""Multi-Bernoulli mixtures: global hypotheses about many targets, with or without a Poisson intensity of
those that are undetected (Williams 2015; Vo and Vo 2013).

A leaf of a track is a density and a probability that the target exists. Where existence is certain, a leaf
exists, and hypotheses without it say that the target does not.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gmr_gym.filters import undetected_targets
from gmr_gym.filters.global_hypotheses import (
    NONE,
    Hypotheses,
    Options,
    associate,
    joined,
    leaf_weights,
    simplify,
    singles,
)
from gmr_gym.filters.intensity_update import LOG_NEGLIGIBLE
from gmr_gym.filters.leaf_merging import by_history, by_reduction
from gmr_gym.filters.pmb import LEAST_MISS
from gmr_gym.filters.target_densities import Densities, Pairs, merge, moved, outputs, pair, posteriors, take
from gmr_gym.filters.target_densities import joined as joined_densities
from gmr_gym.filters.undetected_targets import Begun, Intensity, begun
from gmr_gym.mixture import Mixture
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.reduction.protocol import Reduced

LARGEST_BIRTH = 0.5  # probability of existence; an expected number above it is that of several targets


class MultiBernoulliMixture(NamedTuple):
    """A multi-Bernoulli mixture and the intensity of undetected targets.

    Attributes
    ----------
    hypotheses : Hypotheses
        Of L leaves.
    track : ndarray of int, shape (L,)
        Track of each leaf, ascending.
    existence : ndarray, shape (L,)
        Probability that its target exists.
    leaves : Densities
    history : ndarray of int, shape (L, s)
        Numbers of the detections that it had in the last s scans, newest first; -1 for none.
    label : ndarray of int, shape (n,)
        Distinct labels of the tracks.
    undetected : Intensity
    next_label, scans, detections : int
        Next unused label, and number of scans and of detections so far.
    """

    hypotheses: Hypotheses
    track: np.ndarray
    existence: np.ndarray
    leaves: Densities
    history: np.ndarray
    label: np.ndarray
    undetected: Intensity
    next_label: int = 0
    scans: int = 0
    detections: int = 0


def untracked(model: MultiTargetModel, memory: int = 0) -> MultiBernoulliMixture:
    """The belief before the first scan: no tracks; the targets that are there are undetected.

    Parameters
    ----------
    model : MultiTargetModel
    memory : int
        Scans whose detections are kept in the histories of leaves.

    Returns
    -------
    MultiBernoulliMixture
    """
    undetected, none = undetected_targets.intensity_of(model.initial, model), np.empty(0, int)
    nothing = take(undetected.densities, none)
    return MultiBernoulliMixture(
        NONE, none, np.empty(0), nothing, np.empty((0, memory), int), none, undetected
    )


def predict(
    belief: MultiBernoulliMixture, model: MultiTargetModel, undetected: bool = True
) -> MultiBernoulliMixture:
    """Predict tracks and undetected targets by one period.

    Parameters
    ----------
    belief : MultiBernoulliMixture
    model : MultiTargetModel
    undetected : bool
        Whether born targets join the intensity of undetected ones; otherwise each is a new track.

    Returns
    -------
    MultiBernoulliMixture

    Notes
    -----
    Departs: spawning is in none of the papers; spawned targets are born, about the prediction of a leaf.
    """
    leaves = moved(belief.leaves, model)
    existing = leaf_weights(belief.hypotheses, len(belief.track)) * belief.existence
    predicted = belief._replace(
        existence=model.survival_probability * belief.existence, leaves=leaves,
        undetected=undetected_targets.predict(belief.undetected, model, leaves, existing),
        scans=belief.scans + 1,
    )  # fmt: skip
    return predicted if undetected else _born(predicted)


def _born(belief: MultiBernoulliMixture) -> MultiBernoulliMixture:
    """The undetected targets as tracks: one for each whole or started multiple of `LARGEST_BIRTH`."""
    expected, densities = belief.undetected
    number = np.ceil(expected / LARGEST_BIRTH).astype(int)
    of, leaves, tracks = np.repeat(np.arange(len(number)), number), len(belief.track), len(belief.label)
    new = np.arange(len(of))
    cluster = belief.hypotheses.cluster[-1] + 1 if len(belief.hypotheses.cluster) else 0
    return belief._replace(
        hypotheses=joined(belief.hypotheses, singles(leaves + new, cluster)),
        track=np.append(belief.track, tracks + new),
        existence=np.append(belief.existence, (expected / np.maximum(number, 1))[of]),
        leaves=joined_densities([belief.leaves, take(densities, of)]),
        history=np.vstack([belief.history, np.full((len(of), belief.history.shape[1]), -1)]),
        label=np.append(belief.label, belief.next_label + new),
        undetected=Intensity(np.empty(0), take(densities, np.empty(0, int))),
        next_label=belief.next_label + len(of),
    )  # fmt: skip


def update(
    predicted: MultiBernoulliMixture,
    model: MultiTargetModel,
    z: np.ndarray,
    kappa: np.ndarray,
    options: Options,
    rng: np.random.Generator,
    least: float = 0.0,
    certain: bool = False,
) -> tuple[MultiBernoulliMixture, np.ndarray]:
    r"""Update tracks and undetected targets with a scan.

    Parameters
    ----------
    predicted : MultiBernoulliMixture
    model : MultiTargetModel
    z : ndarray, shape (k, p)
        Detections.
    kappa : ndarray, shape (k,)
        Intensity of clutter at the detections.
    options : Options
        Of the hypotheses.
    rng : numpy.random.Generator
        For Gibbs sampling.
    least : float
        Leaves of less existence are dropped.
    certain : bool
        Whether a hypothesis says of each of its targets that it exists, as a delta-GLMB.

    Returns
    -------
    posterior : MultiBernoulliMixture
    p_clutter : ndarray, shape (k,)
        Probability that each detection is a false alarm.

    Notes
    -----
    A leaf of existence r, missed or with detection j, gives its hypothesis the weight

    .. math:: 1 - r P_D \quad \text{or} \quad r P_D \, g_j, \qquad r' = \frac{r (1 - P_D)}{1 - r P_D}
        \quad \text{or} \quad 1

    A detection that no leaf has gives it :math:`\kappa_j + \rho_j` with

    .. math:: \rho_j = P_D \sum_u w_u g_{uj}

    over the undetected targets, and starts a track of existence :math:`\rho_j / (\rho_j + \kappa_j)`. Where
    existence is certain a missed leaf has :math:`r (1 - P_D)`, and a hypothesis without it :math:`1 - r`.

    Pairs of a smaller ratio to a miss than a hypothesis may have to the others are left out.

    References
    ----------
    Williams 2015; Garcia-Fernandez et al. 2018; Vo, Vo and Phung 2014 for certain existence.
    """
    new = begun(predicted.undetected, model, z, np.log(kappa), least)
    r, p_detected = predicted.existence, model.detected(outputs(predicted.leaves)[0])
    missed = r * (1.0 - p_detected)
    miss = np.maximum(missed if certain else 1.0 - r * p_detected, LEAST_MISS)
    with np.errstate(divide="ignore"):
        log_absent = np.log((1.0 - r if certain else np.zeros(len(r))) / miss)
        negligible = max(float(np.log(options.least)), LOG_NEGLIGIBLE)
    hit = r * p_detected / miss
    pairs = pair(predicted.leaves, model.sensor, z, new.log_free, hit, negligible)
    log_psi = pairs.log_likelihood + np.log(hit[pairs.row]) - new.log_free[pairs.detection]
    rows = pairs.row, pairs.detection, log_psi
    hypotheses = associate(predicted.hypotheses, np.log(miss), log_absent, rows, len(z), options, rng)
    exists = np.concatenate([missed > 0 if certain else missed / miss, np.ones(len(log_psi)), new.existence])
    posterior = _grown(predicted, pairs, new, hypotheses, np.where(exists >= least, exists, 0.0))
    free = leaf_weights(hypotheses, len(exists))[len(r) + len(log_psi) :]
    rest = undetected_targets.missed(predicted.undetected, model)
    posterior = posterior._replace(undetected=rest, detections=predicted.detections + len(z))
    return posterior, free * kappa * np.exp(-new.log_free)


def _grown(
    predicted: MultiBernoulliMixture, pairs: Pairs, new: Begun, hypotheses: Hypotheses, exists: np.ndarray
) -> MultiBernoulliMixture:
    """The leaves, numbered as `associate` does, that the hypotheses have and that may exist."""
    used = np.zeros(len(exists), bool)
    used[hypotheses.leaf] = True
    code, starts = (
        np.flatnonzero(used & (exists > 0)),
        np.array([0, len(predicted.track), len(exists) - len(new.existence)]),
    )
    missed, hit, begun = (
        part - start
        for part, start in zip(np.split(code, np.searchsorted(code, starts[1:])), starts, strict=True)
    )
    parent = np.append(missed, pairs.row[hit])
    track = np.append(predicted.track[parent], len(predicted.label) + np.arange(len(begun)))
    had = np.concatenate(
        [np.full(len(missed), -1), predicted.detections + np.append(pairs.detection[hit], begun)]
    )
    memory = predicted.history.shape[1]
    history = np.vstack([predicted.history[parent], np.full((len(begun), memory), -1)])
    leaves = joined_densities([
        take(predicted.leaves, missed), posteriors(predicted.leaves, pairs, hit),
        take(new.densities, np.searchsorted(new.detection, begun)),
    ])  # fmt: skip
    label = np.append(predicted.label, predicted.next_label + np.arange(len(begun)))
    order = np.argsort(track, kind="stable")
    into = np.full(len(exists), -1)
    into[code[order]] = np.arange(len(code))
    kept, track = np.unique(track[order], return_inverse=True)
    return predicted._replace(
        hypotheses=simplify(hypotheses, into), track=track, existence=exists[code[order]],
        leaves=take(leaves, order), history=np.column_stack([had, history])[order, :memory],
        label=label[kept], next_label=predicted.next_label + len(begun),
    )  # fmt: skip


def merged(belief: MultiBernoulliMixture, group: np.ndarray) -> MultiBernoulliMixture:
    """The belief with the leaves of each group (L,) merged, -1 for those that are dropped.

    Groups are numbered from 0 without gaps, and a group is of one track; numbers of tracks ascend with them.
    """
    count, kept = group.max(initial=-1) + 1, group >= 0
    held = leaf_weights(belief.hypotheses, len(group))
    weight = held * belief.existence
    total = np.bincount(group[kept], held[kept], count)
    existence = np.bincount(group[kept], weight[kept], count) / total
    first = np.full(count, len(group))
    np.minimum.at(first, group[kept], np.flatnonzero(kept))
    tracks, track = np.unique(belief.track[first], return_inverse=True)
    return belief._replace(
        hypotheses=simplify(belief.hypotheses, group), track=track, existence=np.minimum(existence, 1.0),
        leaves=merge(belief.leaves, weight, group, count), history=belief.history[first],
        label=belief.label[tracks],
    )  # fmt: skip


def forgotten(belief: MultiBernoulliMixture) -> MultiBernoulliMixture:
    """The leaves of a track that have had the same detections in the scans of the history merged."""
    group = by_history(belief.track, belief.history)
    return belief if len(group) == group.max(initial=-1) + 1 else merged(belief, group)


def reduced(
    belief: MultiBernoulliMixture, reduction: Callable[[Mixture], Reduced], components: int
) -> MultiBernoulliMixture:
    """The leaves of every track, as a mixture, reduced; merged are those of one group of `reduction`.

    Tracks of up to `components` leaves are left as they are.
    """
    if np.bincount(belief.track).max(initial=0) <= components:
        return belief
    weight = leaf_weights(belief.hypotheses, len(belief.track)) * belief.existence
    leaves = Mixture(weight, *outputs(belief.leaves))
    return merged(belief, by_reduction(belief.track, leaves, reduction, components))


def prune(belief: MultiBernoulliMixture, weight: float, tracks: int) -> MultiBernoulliMixture:
    """Drops undetected components of less `weight`, and keeps up to `tracks` of them and of the tracks."""
    belief = belief._replace(undetected=undetected_targets.pruned(belief.undetected, weight, tracks))
    if len(belief.label) <= tracks:
        return belief
    existence = track_existence(belief)
    chosen = np.zeros(len(existence), bool)
    chosen[np.argsort(-existence, kind="stable")[:tracks]] = True
    leaves = chosen[belief.track]
    return merged(belief, np.where(leaves, np.cumsum(leaves) - 1, -1))


def track_existence(belief: MultiBernoulliMixture) -> np.ndarray:
    """Probability of existence (n,) of each track."""
    weight = leaf_weights(belief.hypotheses, len(belief.track)) * belief.existence
    return np.minimum(np.bincount(belief.track, weight, len(belief.label)), 1.0)
