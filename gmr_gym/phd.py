"""The probability hypothesis density as a Gaussian mixture (Vo and Ma 2006): an intensity carried ahead,
updated with a whole scan, merged, and asked where its targets are.

Weights are expected numbers: only detections, survival, births and pruning change their sum.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from gmr_gym.kalman import Sensor, predict
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture, checked, cholesky_into, joined, log_gaussian_scale, mahalanobis_squared
from gmr_gym.multitarget import Account, Clutter, Population, nothing
from gmr_gym.reducers import reducer
from gmr_gym.reduction import Reduced, at_least_one, at_least_zero, capping, check_reduced, grouped, through
from gmr_gym.tracker import check_limits
from gmr_gym.update import posterior_into

# a pair of component and detection that would weigh less, were there clutter alone beside it, is beyond
# the gate: all such pairs together are the rounding error of 1
LOG_NEGLIGIBLE = float(np.log(1e-18))


class Labelled(NamedTuple):
    """An intensity whose components know which target they take theirs for."""

    intensity: Mixture
    label: np.ndarray  # (n,), several components may share one
    fresh: int  # the next label to give


def nobody(told: Population) -> Labelled:
    """The intensity of no target."""
    return Labelled(nothing(len(told.motion.F)), np.empty(0, np.int64), 0)


def ahead(belief: Labelled, told: Population) -> Labelled:
    """One period later: those who survive, what they spawn and births (Vo and Ma 2006, eqs. 24-29). The
    spawned scatter about where their parent moves, and they and the born get labels of their own."""
    moved = predict(belief.intensity, told.motion)
    parts = [moved._replace(w=told.survival_probability * moved.w)]
    if told.spawn_weight > 0:
        parts.append(Mixture(told.spawn_weight * moved.w, moved.m, moved.P + told.spawn_covariance))
    intensity = joined([*parts, told.births])
    new = len(intensity.w) - len(moved.w)
    label = np.append(belief.label, belief.fresh + np.arange(new))
    return Labelled(intensity, label, belief.fresh + new)


def update(
    predicted: Labelled,
    sensor: Sensor,
    z: np.ndarray,
    detection_probability: float,
    kappa: np.ndarray,
    prune_weight: float,
) -> tuple[Labelled, np.ndarray]:
    """After a scan z (k, p), and the probability (k,) that each of its detections is false: every component
    with every detection, and with none (Vo and Ma 2006, eqs. 30-35):

        missed    w (1 - P_D)       detected    w P_D N(z; H m, S) / (kappa(z) + the same over all components)

    kappa (k,) is the intensity of clutter at the detections; its own share of that sum is false. What comes
    to less than `prune_weight` is left out, without a word to the others. Labels are the parents'."""
    p = predicted.intensity
    expected, S = sensor.gates(p)
    C = sensor.look(p, expected, S, z).C
    w, m, P, parent, false = _updated(
        *p, expected, S, C, *sensor, z, np.log(kappa), detection_probability, prune_weight
    )
    return predicted._replace(intensity=Mixture(w, m, P), label=predicted.label[parent]), false


def vo_ma(p: Mixture, components: int, distance: float = 4.0) -> Reduced:
    """Merges into the heaviest component j every i with (m_i - m_j)' P_i^-1 (m_i - m_j) <= `distance`,
    then so with the heaviest of the rest until none is left; of these the `components` heaviest
    (Vo and Ma 2006, Table II). Raises ValueError for a negative distance."""
    p, components, distance = checked(p), at_least_one(components), at_least_zero("distance", distance)
    group, count = _near(*p, distance)
    capped, place = capping(grouped(p, group, count), components)
    return capped, through(group, place)


def reduction_named(name: str, components: int, merging: float) -> Callable[[Mixture], Reduced]:
    """The reduction of that name to `components`: "vo-ma", which alone heeds `merging`, or any that
    `gmr_gym.reducers.reducer` knows. Raises ValueError for an unknown name and a negative `merging`."""
    merging = at_least_zero("merging", merging)
    if name == "vo-ma":
        return partial(vo_ma, components=components, distance=merging)
    return reducer(name, components)


def reduced(belief: Labelled, reduce: Callable[[Mixture], Reduced], most: int) -> Labelled:
    """`reduce` of the `most` heaviest components; what is merged has the label of its heaviest part."""
    p, label, fresh = belief
    if len(p.w) == 0:
        return belief
    if len(p.w) > most:
        p, place = capping(p, most)
        label = label[place >= 0]
    q, origin = reduce(p)
    heaviest_last = np.argsort(-p.w, kind="stable")[::-1]
    heaviest_last = heaviest_last[origin[heaviest_last] >= 0]
    merged = np.full(len(q.w), -1)
    merged[origin[heaviest_last]] = label[heaviest_last]  # the last written stays
    return Labelled(q, merged, fresh)


def account(belief: Labelled, clutter: Clutter, number: int | None = None) -> tuple[Labelled, Account]:
    """The targets that the intensity names, the surest first, and the belief with their labels.

    A component of weight w names one target with existence min(w, 1), one more with min(w - 1, 1) and so
    on; those above 1/2 are named, round(w) in all (Vo and Ma 2006, Table III), or the `number` surest. A
    second target of one component has no label, -1; of components that share one the heaviest keeps it,
    and the others are given fresh ones."""
    p, label, fresh = belief
    copies = np.ceil(p.w - (0.5 if number is None else 0.0)).clip(0).astype(int)
    at = np.repeat(np.arange(len(p.w)), copies)
    copy = np.arange(len(at)) - np.repeat(np.cumsum(copies) - copies, copies)
    existence = np.minimum(p.w[at] - copy, 1.0)
    surest = np.lexsort((-p.w[at], -existence))[:number]
    at, copy, existence = at[surest], copy[surest], existence[surest]
    first = at[copy == 0]  # heaviest first
    _, keeps = np.unique(label[first], return_index=True)
    others = np.delete(first, keeps)
    label = label.copy()
    label[others] = fresh + np.arange(len(others))
    said = Account(p.m[at], existence, np.where(copy == 0, label[at], -1), float(p.w.sum()), p, clutter)
    return Labelled(p, label, fresh + len(others)), said


def check_filter(
    told: Population, reduce: Callable[[Mixture], Reduced], prune_weight: float, most: int
) -> None:
    """Raise ValueError naming the parameter that is wrong, here rather than in a scan."""
    check_limits(prune_weight, most)
    d = len(told.motion.F)
    check_reduced(reduce(Mixture(np.ones(1), np.zeros((1, d)), np.eye(d)[None])), 1)


@kernel
def _updated(w, m, P, expected, S, C, H, R, z, log_kappa, detection_probability, least):
    table = log_ratios(w, expected, S, z, log_kappa, detection_probability)
    n, k = table.shape
    top = np.zeros(k)  # the logarithm of clutter over itself
    for i in range(n):
        for j in range(k):
            top[j] = max(top[j], table[i, j])
    false = np.exp(-top)
    total = false.copy()
    for i in range(n):
        for j in range(k):
            if table[i, j] > -np.inf:
                table[i, j] = np.exp(table[i, j] - top[j])
                total[j] += table[i, j]
            else:
                table[i, j] = 0.0
    for i in range(n):
        for j in range(k):
            table[i, j] /= total[j]
    found = posteriors((1.0 - detection_probability) * w, table, m, P, expected, S, C, H, R, z, least)
    return *found, false / total


@kernel
def log_ratios(w, expected, S, z, log_kappa, detection_probability):
    """log of w P_D N(z; H m, S) / kappa(z) (n, k), minus infinity where that is negligible."""
    n, (k, p) = len(w), z.shape
    out = np.full((n, k), -np.inf)
    L, y = np.zeros((p, p)), np.empty(p)
    for i in range(n):
        if not cholesky_into(L, S[i]):
            raise ValueError("an innovation covariance S = H P H' + R is not positive definite")
        log_w = np.log(w[i] * detection_probability) if w[i] > 0.0 else -np.inf
        log_peak = log_w + log_gaussian_scale(L)
        for j in range(k):
            size = 2.0 * (log_peak - log_kappa[j] - LOG_NEGLIGIBLE)
            within = size > 0.0
            for r in range(p):
                # a gate is never wider than this along any axis: most clutter ends here
                within &= (z[j, r] - expected[i, r]) ** 2 <= size * S[i, r, r]
            if within:
                d2 = mahalanobis_squared(L, z[j], expected[i], y)
                if d2 <= size:
                    out[i, j] = log_peak - log_kappa[j] - 0.5 * d2
    return out


@kernel
def posteriors(missed, found, m, P, expected, S, C, H, R, z, least):
    """The components that weigh anything, and at least `least`, of those of weights missed (n,), as they
    are, and found (n, k), each conditioned on its detection; then the parent of each."""
    n, d = m.shape
    k, p = z.shape
    count = 0
    for i in range(n):
        count += missed[i] >= least and missed[i] > 0.0
        for j in range(k):
            count += found[i, j] >= least and found[i, j] > 0.0
    w_out, m_out, P_out = np.empty(count), np.empty((count, d)), np.empty((count, d, d))
    parent = np.empty(count, np.int64)
    L, K, W, P_hit = np.zeros((p, p)), np.empty((d, p)), np.empty((p, d)), np.empty((d, d))
    L_noise = np.zeros((p, p))
    at = 0
    for i in range(n):
        conditioned = False
        for j in range(-1, k):  # -1 for none
            weight = found[i, j] if j >= 0 else missed[i]
            if not (weight >= least and weight > 0.0):
                continue
            if j >= 0 and not conditioned:
                cholesky_into(L, S[i])
                posterior_into(P_hit, K, W, L, L_noise, P[i], C[i], H, R)
                conditioned = True
            w_out[at], parent[at] = weight, i
            for r in range(d):
                m_out[at, r] = m[i, r]
                if j >= 0:
                    for c in range(p):
                        m_out[at, r] += K[r, c] * (z[j, c] - expected[i, c])
                for c in range(d):
                    P_out[at, r, c] = P_hit[r, c] if j >= 0 else P[i, r, c]
            at += 1
    return w_out, m_out, P_out, parent


@kernel
def _near(w, m, P, distance):
    """Groups (n,) of `vo_ma`, numbered from that of the heaviest, -1 for a weight of zero; their number."""
    n, d = m.shape
    factors, factored = np.zeros((n, d, d)), np.zeros(n, np.bool_)
    group, count, y = np.full(n, -1), 0, np.empty(d)
    alone = np.argsort(-w, kind="mergesort")
    alone = alone[w[alone] > 0.0]
    left = len(alone)
    while left > 0:
        heaviest, rest = alone[0], 0
        for a in range(left):
            i = alone[a]
            within = True
            for r in range(d):
                # no axis alone is farther than all together, but for rounding: most end here
                if (m[i, r] - m[heaviest, r]) ** 2 > distance * (1.0 + 1e-12) * P[i, r, r]:
                    within = False
                    break
            if within and not factored[i]:
                factored[i] = True
                if not cholesky_into(factors[i], P[i]):
                    raise ValueError("a covariance of the mixture is not positive definite")
            if i == heaviest or (
                within and mahalanobis_squared(factors[i], m[heaviest], m[i], y) <= distance
            ):
                group[i] = count
            else:
                alone[rest] = i
                rest += 1
        left = rest
        count += 1
    return group, count
