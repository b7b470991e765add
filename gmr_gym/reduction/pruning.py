"""Drop what hardly counts: pruning and capping."""

import numpy as np

from gmr_gym.checks import check_count, check_not_negative
from gmr_gym.kernels import kernel
from gmr_gym.linalg import root_determinants
from gmr_gym.mixture import Mixture, checked
from gmr_gym.reduction.protocol import Reduced


def capping(p: Mixture, components: int) -> Reduced:
    """The `components` heaviest, the earlier first among equals (D'Ortenzio, section 3.3)."""
    p, components = checked(p), check_count(components)
    return _kept(p, heaviest_mask(p.w, components) & (p.w > 0))


def prune(p: Mixture, weight: float) -> Reduced:
    """Drops what weighs less than `weight` (gamma; D'Ortenzio, section 3.4), never the heaviest."""
    p, weight = checked(p), check_not_negative("weight", weight)
    return _kept(p, above_threshold(p.w, p.w, weight))


def prune_density(p: Mixture, density: float) -> Reduced:
    """Drops what has w / sqrt|P| below `density` (gamma~, in units of 1 / sqrt|P|: s^2/m^4 for a
    planar position and velocity), never the heaviest (D'Ortenzio, eq. 16)."""
    p, density = checked(p), check_not_negative("density", density)
    return _kept(p, above_threshold(p.w, p.w / root_determinants(p.P), density))


def prune_and_cap(p: Mixture, weight: float, max_components: int) -> Reduced:
    """What weighs at least `weight`, and of that no more than the `most` heaviest: `prune` and
    `capping` in one, for the hypotheses that are to enter a reduction."""
    return entering(checked(p), check_not_negative("weight", weight), check_count(max_components, "most"))


def entering(p: Mixture, weight: float, max_components: int) -> Reduced:
    """`prune_and_cap` for a mixture made here."""
    return _kept(p, heaviest_mask(p.w, max_components) & above_threshold(p.w, p.w, weight))


def weighing(p: Mixture) -> Reduced:
    """The checked mixture without what weighs nothing: itself, where all of it weighs something."""
    p = checked(p)
    kept = p.w > 0
    return (p, np.arange(len(kept))) if kept.all() else _kept(p, kept)


def _kept(p: Mixture, kept: np.ndarray) -> Reduced:
    *selected, origin = select(*p, kept)
    return Mixture(*selected), origin


@kernel
def above_threshold(w, measure, threshold):
    """Which components (n,) have a weight and a measure of at least the threshold: the heaviest if none,
    should it weigh anything."""
    n, found, first = len(w), False, 0
    kept = np.zeros(n, np.bool_)
    for i in range(n):
        kept[i] = measure[i] >= threshold and w[i] > 0.0
        found |= kept[i]
        first = i if w[i] > w[first] else first
    if not found and n > 0:
        kept[first] = w[first] > 0.0
    return kept


@kernel
def heaviest_mask(w, max_components):
    """Which components (n,) are the `most` heaviest, the earlier first among equals."""
    n = len(w)
    kept = np.zeros(n, np.bool_)
    if n <= max_components:
        for i in range(n):
            kept[i] = True
        return kept
    # numbers that are not negative are in the order of their bits: the largest that `most` of them reach
    bits, low, high = np.empty(n, np.int64), np.int64(0), np.int64(0)
    for i in range(n):
        bits[i] = np.float64(w[i]).view(np.int64)
        high = max(high, bits[i])
    while low < high:
        middle = high - (high - low) // 2
        reached = 0
        for i in range(n):
            reached += bits[i] >= middle
        if reached >= max_components:
            low = middle
        else:
            high = middle - 1
    left = max_components
    for i in range(n):
        kept[i] = bits[i] > low
        left -= kept[i]
    for i in range(n):
        if left > 0 and bits[i] == low:
            kept[i] = True
            left -= 1
    return kept


@kernel
def select(w, m, P, kept):
    """Components that are kept, and the place (n,) of each, -1 where it is not."""
    n, d = m.shape
    count = 0
    for i in range(n):
        count += kept[i]
    w_out, m_out, P_out = np.empty(count), np.empty((count, d)), np.empty((count, d, d))
    origin = np.full(n, -1)
    at = 0
    for i in range(n):
        if kept[i]:
            w_out[at], origin[i] = w[i], at
            for r in range(d):
                m_out[at, r] = m[i, r]
                for c in range(d):
                    P_out[at, r, c] = P[i, r, c]
            at += 1
    return w_out, m_out, P_out, origin
