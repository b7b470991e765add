"""Salmond's clustering: the heaviest component takes in all near it, then the heaviest of the rest."""

from dataclasses import dataclass

import numpy as np

from gmr_gym.checks import check_count, check_not_negative, refuse_unsound, sound
from gmr_gym.kernels import kernel, leaf_kernel
from gmr_gym.linalg import cholesky_into
from gmr_gym.mixture import Mixture, arrays_of, match
from gmr_gym.reduction.protocol import TOO_FAR, Reduced
from gmr_gym.reduction.runnalls import merge_down


def cluster(p: Mixture, components: int, distance: float = 4.0) -> Reduced:
    """Merges into the heaviest component all within a distance of it, then the same with the heaviest of the
    rest.

    Component i goes with the heaviest, c, if (m_i - m_c)' P_c^-1 (m_i - m_c) <= `distance`. Where more than
    `components` remain, pairs are merged by cost B.

    Parameters
    ----------
    p : Mixture
    components : int
        Upper limit of the number of components that remain.
    distance : float
        Squared Mahalanobis distance by the covariance of the heaviest.

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
    Departs: Salmond multiplies the distance by w_i w_c / (w_i + w_c), and raises the threshold until few
    enough components remain.

    References
    ----------
    Salmond 1990, section 4.2.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> q, origin = cluster(mixture([0.25, 0.75, 1.0], [[0.0], [1.0], [9.0]], [[[1.0]]] * 3), 2)
    >>> q.w.tolist(), origin.tolist()
    ([1.0, 1.0], [1, 1, 0])
    """
    return clustering(components, distance)(p)


@dataclass(frozen=True)
class Clustering:
    """`cluster` as plain numbers that a compiled scan takes."""

    components: int
    distance: float

    def __call__(self, p: Mixture) -> Reduced:
        arrays = arrays_of(p)
        if not sound(*arrays):
            refuse_unsound("p.", *arrays)
        *merged, origin, _ = merge_by_distance(*arrays, self.distance, self.components)
        if not sound(*merged):
            raise ValueError(TOO_FAR)
        return Mixture(*merged), origin


def clustering(components: int, distance: float = 4.0) -> Clustering:
    """Checked Clustering; ValueError for a negative distance and for `components` below 1."""
    return Clustering(check_count(components), check_not_negative("distance", distance))


@kernel
def merge_by_distance(w, m, P, distance, components):
    """w, m, P and origin (n,) of `cluster`, and its work: distances, and the costs of pairs beyond the
    limit."""
    group, count, distances = _near_heaviest(w, m, P, distance)
    w, m, P = match(w, m, P, group, count)
    w, m, P, place, costs = merge_down(w, m, P, components)
    for i in range(len(group)):
        if group[i] >= 0:
            group[i] = place[group[i]]
    return w, m, P, group, distances + costs


@kernel
def _near_heaviest(w, m, P, distance):
    """Groups (n,) of `cluster`, numbered from that of the heaviest, -1 for weight zero; their number; and
    that of distances."""
    n, d = m.shape
    group, count, distances = np.full(n, -1), 0, 0
    L, y = np.zeros((d, d)), np.empty(d)
    rest, left = np.empty(n, np.int64), 0
    for i in range(n):
        if w[i] > 0.0:
            rest[left] = i
            left += 1
    while left > 0:
        heaviest, stay = rest[0], 0
        for a in range(1, left):
            heaviest = rest[a] if w[rest[a]] > w[heaviest] else heaviest
        if not cholesky_into(L, P[heaviest]):
            raise ValueError("a covariance of the mixture is not positive definite")
        for a in range(left):
            i = rest[a]
            if i == heaviest or _within(distance, L, m[i], m[heaviest], y):
                group[i] = count
            else:
                rest[stay] = i
                stay += 1
        distances += left - 1
        left = stay
        count += 1
    return group, count, distances


@leaf_kernel
def _within(distance, L, x, centre, y):
    """Whether `mahalanobis_squared` is at most the distance; most are beyond it after an axis or two."""
    d2 = 0.0
    for r in range(len(x)):
        total = x[r] - centre[r]
        for k in range(r):
            total -= L[r, k] * y[k]
        y[r] = total / L[r, r]
        d2 += y[r] * y[r]
        if d2 > distance:
            return False
    return True
