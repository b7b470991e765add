"""Pruning and capping: dropping light components."""

import numpy as np

from gmr_gym.checks import check_count, check_not_negative
from gmr_gym.kernels import kernel
from gmr_gym.linalg import root_determinants
from gmr_gym.mixture import Mixture, checked
from gmr_gym.reduction.protocol import Reduced


def capping(p: Mixture, components: int) -> Reduced:
    """The `components` heaviest components, the earlier first among equals.

    Returns
    -------
    Reduced
        The components that are kept, and the origin (n,). Weights are not rescaled.

    Raises
    ------
    ValueError
        For `components` below 1, or a mixture that fails `checked`.

    References
    ----------
    D'Ortenzio, section 3.3.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> q, origin = capping(mixture([0.2, 0.7, 0.1], [[0.0], [2.0], [9.0]], [[[1.0]]] * 3), 2)
    >>> q.w.tolist(), origin.tolist()
    ([0.2, 0.7], [0, 1, -1])
    """
    p, components = checked(p), check_count(components)
    return _kept(p, heaviest_mask(p.w, components) & (p.w > 0))


def prune(p: Mixture, weight: float) -> Reduced:
    """Drops the components whose weight is below `weight`, never the heaviest.

    Parameters
    ----------
    p : Mixture
    weight : float
        Threshold gamma.

    Returns
    -------
    Reduced
        The components that are kept, and the origin (n,). Weights are not rescaled.

    Raises
    ------
    ValueError
        For a negative `weight`, or a mixture that fails `checked`.

    References
    ----------
    D'Ortenzio, section 3.4.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> q, origin = prune(mixture([0.2, 0.7, 0.1], [[0.0], [2.0], [9.0]], [[[1.0]]] * 3), 0.15)
    >>> q.w.tolist(), origin.tolist()
    ([0.2, 0.7], [0, 1, -1])
    """
    p, weight = checked(p), check_not_negative("weight", weight)
    return _kept(p, above_threshold(p.w, p.w, weight))


def prune_density(p: Mixture, density: float) -> Reduced:
    """Drops the components whose w / sqrt|P| is below `density`, never the heaviest.

    Parameters
    ----------
    p : Mixture
    density : float
        Threshold gamma~, in the unit of 1 / sqrt|P|: s^2/m^4 for a planar position and velocity.

    Returns
    -------
    Reduced
        The components that are kept, and the origin (n,). Weights are not rescaled.

    Raises
    ------
    ValueError
        For a negative `density`, or a mixture that fails `checked`.

    References
    ----------
    D'Ortenzio, eq. 16.
    """
    return leaving(checked(p), check_not_negative("density", density))


def prune_and_cap(p: Mixture, weight: float, max_components: int) -> Reduced:
    """The components of at least `weight`, and of these the `max_components` heaviest.

    `prune` and `capping` in one, for the hypotheses that enter a reduction.

    Parameters
    ----------
    p : Mixture
    weight : float
        Threshold; the heaviest component is never dropped.
    max_components : int
        Upper limit of the number of components that remain.

    Returns
    -------
    Reduced
        The components that are kept, and the origin (n,). Weights are not rescaled.

    Raises
    ------
    ValueError
        For a negative `weight` or `max_components` below 1, or a mixture that fails `checked`.
    """
    p, weight = checked(p), check_not_negative("weight", weight)
    return entering(p, weight, check_count(max_components, "max_components"))


def entering(p: Mixture, weight: float, max_components: int) -> Reduced:
    """`prune_and_cap` without checks, for a mixture already checked."""
    return _kept(p, heaviest_mask(p.w, max_components) & above_threshold(p.w, p.w, weight))


def leaving(p: Mixture, density: float) -> Reduced:
    """`prune_density` without checks, for a mixture already checked."""
    return _kept(p, above_threshold(p.w, p.w / root_determinants(p.P), density))


def weighing(p: Mixture) -> Reduced:
    """The checked mixture without components of weight zero; as it is where there are none."""
    p = checked(p)
    kept = p.w > 0
    return (p, np.arange(len(kept))) if kept.all() else _kept(p, kept)


def _kept(p: Mixture, kept: np.ndarray) -> Reduced:
    *selected, origin = select(*p, kept)
    return Mixture(*selected), origin


@kernel
def above_threshold(w, measure, threshold):
    """Mask (n,) of the components of positive weight whose measure is at least the threshold; only the
    heaviest where there are none, if it has positive weight."""
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
    """Mask (n,) of the `max_components` heaviest components, the earlier first among equals."""
    n = len(w)
    kept = np.zeros(n, np.bool_)
    if n <= max_components:
        for i in range(n):
            kept[i] = True
        return kept
    # non-negative floats are ordered as their bits: bisect for the largest value that `max_components` reach
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
    """The components that are kept, and the origin (n,): the index of each, -1 where it is dropped."""
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
