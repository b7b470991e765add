"""The reduction of Vo and Ma: the heaviest component absorbs all that lie near it."""

import numpy as np

from gmr_gym.checks import check_count, check_not_negative
from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, mahalanobis_squared
from gmr_gym.mixture import Mixture, checked
from gmr_gym.reduction.protocol import Reduced, grouped, through
from gmr_gym.reduction.pruning import capping


def vo_ma(p: Mixture, components: int, distance: float = 4.0) -> Reduced:
    """Merges into the heaviest component all that lie near it, then the same with the heaviest of the rest.

    Component i is merged into j if (m_i - m_j)' P_i^-1 (m_i - m_j) <= `distance`. Of the merged components
    the `components` heaviest are kept.

    Parameters
    ----------
    p : Mixture
    components : int
        Upper limit of the number of components that remain.
    distance : float
        Squared Mahalanobis distance U.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,).

    Raises
    ------
    ValueError
        For a negative distance, `components` below 1, or a mixture that fails `checked`.

    References
    ----------
    Vo and Ma 2006, Table II.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> q, origin = vo_ma(mixture([0.25, 0.75, 1.0], [[0.0], [1.0], [9.0]], [[[1.0]]] * 3), 2)
    >>> q.w.tolist(), origin.tolist()
    ([1.0, 1.0], [1, 1, 0])
    """
    p, components, distance = checked(p), check_count(components), check_not_negative("distance", distance)
    group, count = _near(*p, distance)
    capped, place = capping(grouped(p, group, count), components)
    return capped, through(group, place)


@kernel
def _near(w, m, P, distance):
    """Groups (n,) of `vo_ma`, numbered from that of the heaviest, -1 for weight zero; and their number."""
    n, d = m.shape
    factors, factored = np.zeros((n, d, d)), np.zeros(n, np.bool_)
    group, count, y = np.full(n, -1), 0, np.empty(d)
    unmerged = np.argsort(-w, kind="mergesort")
    unmerged = unmerged[w[unmerged] > 0.0]
    left = len(unmerged)
    while left > 0:
        heaviest, rest = unmerged[0], 0
        for a in range(left):
            i = unmerged[a]
            within = True
            for r in range(d):
                # the distance along one axis bounds the whole from below, up to rounding: most end here
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
                unmerged[rest] = i
                rest += 1
        left = rest
        count += 1
    return group, count
