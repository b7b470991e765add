"""Salmond's joining, and West's merging of the lightest component with its nearest."""

import numpy as np

from gmr_gym.checks import check_count, check_not_negative
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture, moments
from gmr_gym.reduction.protocol import TOO_FAR, Reduced, at_unit, grouped, through
from gmr_gym.reduction.pruning import weighing


def salmond(p: Mixture, components: int, distance: float = 0.0) -> Reduced:
    r"""Joining: merges the pair with the least distance, relative to the covariance of the whole mixture.

    Merging goes on while more than `components` remain or the least squared distance is below `distance`.

    Parameters
    ----------
    p : Mixture
    components : int
        Upper limit of the number of components that remain.
    distance : float
        Squared distance below which pairs are merged even when few enough remain.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,).

    Raises
    ------
    ValueError
        For a negative distance, `components` below 1, or a mixture that fails `checked`.

    Notes
    -----
    With P the covariance of the whole mixture:

    .. math::

        d_{ij}^2 = \frac{w_i w_j}{w_i + w_j} (m_i - m_j)^T P^{-1} (m_i - m_j)

    References
    ----------
    Salmond 1990, section 4.1.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> p = mixture([0.25, 0.25, 0.5], [[0.0], [2.0], [9.0]], [[[1.0]]] * 3)
    >>> q, origin = salmond(p, 2)
    >>> q.m.tolist(), origin.tolist()
    ([[1.0], [9.0]], [0, 0, 1])
    """
    components, distance = check_count(components), check_not_negative("distance", distance)
    q, place = weighing(p)
    if len(q.w) <= (components if distance == 0 else 1):
        return q, place
    return _merged(q, place, _joining(q.w / q.w.sum(), whitened(q), components, distance))


def west(p: Mixture, components: int) -> Reduced:
    """Merges the lightest component with its nearest neighbour until `components` remain.

    Distances are relative to the covariance of the whole mixture.

    Parameters
    ----------
    p : Mixture
    components : int
        Upper limit of the number of components that remain.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,).

    Raises
    ------
    ValueError
        For `components` below 1, or a mixture that fails `checked`.

    References
    ----------
    West 1993, section 3.
    """
    components = check_count(components)
    q, place = weighing(p)
    if len(q.w) <= components:
        return q, place
    return _merged(q, place, _lightest_first(at_unit(q.w), whitened(q), components))


def whitened(p: Mixture) -> np.ndarray:
    """Means (n, d) in coordinates where the whole mixture has unit covariance."""
    mean, P = moments(p)
    try:
        L = np.linalg.cholesky(P)
    except np.linalg.LinAlgError:
        raise ValueError(TOO_FAR) from None
    return np.linalg.solve(L, (p.m - mean).T).T.copy()


def _merged(p: Mixture, place: np.ndarray, group: np.ndarray) -> Reduced:
    """Moment match of each group of components: group (n,) holds the index of a member. The origin refers
    to the mixture before components of weight zero were dropped, whose origin is `place`."""
    used, origin = np.unique(group, return_inverse=True)
    return grouped(p, origin, len(used)), through(place, origin)


@kernel
def _joining(w, y, components, distance):
    """Groups (n,) of Salmond's joining, from the weights and whitened means y (n, d)."""
    n, d = y.shape
    w, y, group, alive = w.copy(), y.copy(), np.arange(n), np.arange(n)
    while len(alive) > 1:
        best, first, second = np.inf, alive[0], alive[1]
        for a in range(1, len(alive)):
            for b in range(a):
                i, j = alive[a], alive[b]
                d2 = 0.0
                for r in range(d):
                    d2 += (y[i, r] - y[j, r]) ** 2
                d2 *= w[i] / (w[i] + w[j]) * w[j]
                if d2 < best:
                    best, first, second = d2, j, i
        if len(alive) <= components and best >= distance:
            break
        _join(first, second, w, y, group)
        alive = alive[alive != second]
    return group


@kernel
def _lightest_first(w, y, components):
    """Groups (n,) of West's merging, from the weights and whitened means y (n, d)."""
    w, y, group, alive = w.copy(), y.copy(), np.arange(len(w)), np.arange(len(w))
    while len(alive) > components:
        lightest = alive[w[alive].argmin()]
        best, nearest = np.inf, alive[0] if alive[0] != lightest else alive[1]
        for i in alive:
            d2 = ((y[i] - y[lightest]) ** 2).sum()
            if i != lightest and d2 < best:
                best, nearest = d2, i
        _join(nearest, lightest, w, y, group)
        alive = alive[alive != lightest]
    return group


@kernel
def _join(i, j, w, y, group):
    y[i] = (w[i] * y[i] + w[j] * y[j]) / (w[i] + w[j])
    w[i] += w[j]
    group[group == j] = i
