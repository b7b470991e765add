"""How far a set of estimates is from the set of targets: OSPA, GOSPA and its parts, Wasserstein.

Positions are rows, (j, d) and (k, d), in any order; either may be empty, (0, d). Units are those of the
positions, metres.
"""

from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment, linprog
from scipy.spatial.distance import cdist


class Gospa(NamedTuple):
    """What GOSPA with alpha = 2 is made of; total^order = localisation + missed + false."""

    total: float  # m
    localisation: float  # m^order, of the pairs that belong together
    missed: float  # m^order, cutoff^order / 2 for each target without an estimate
    false: float  # m^order, the same for each estimate without a target


def ospa(estimates, targets, cutoff: float = 100.0, order: float = 2.0) -> float:
    """Optimal subpattern assignment distance: the best one-to-one assignment, no pair and no surplus point
    charged more than `cutoff`, averaged over the larger set (Schuhmacher, Vo and Vo 2008). 0 for two empty
    sets, `cutoff` when one of them is.

    Raises ValueError for arrays that are no finite (j, d) and (k, d), cutoff <= 0 or order < 1."""
    x, y = _checked(estimates, targets, cutoff, order)
    most = max(len(x), len(y))
    if most == 0:
        return 0.0
    cost = np.minimum(cdist(x, y), cutoff) ** order
    surplus = cutoff**order * (most - min(len(x), len(y)))
    return float(((cost[linear_sum_assignment(cost)].sum() + surplus) / most) ** (1 / order))


def gospa(estimates, targets, cutoff: float = 100.0, order: float = 2.0) -> Gospa:
    """Generalised OSPA with alpha = 2 and its parts: pairs closer than `cutoff` are localised, what is left
    over is missed or false (Rahmathullah, Garcia-Fernandez and Svensson 2017). Raises as `ospa`."""
    x, y = _checked(estimates, targets, cutoff, order)
    distance = cdist(x, y)
    # with alpha = 2 a pair at the cutoff costs as much as a miss and a false estimate
    pairs = linear_sum_assignment(np.minimum(distance, cutoff) ** order)
    near = distance[pairs][distance[pairs] < cutoff]
    localisation = float((near**order).sum())
    missed, false = (cutoff**order / 2 * (len(side) - len(near)) for side in (y, x))
    return Gospa((localisation + missed + false) ** (1 / order), localisation, missed, false)


def wasserstein(estimates, targets, order: float = 2.0) -> float:
    """Distance of Hoffman and Mahler (2004): the cheapest transport of the estimates, 1 / j each, to the
    targets, 1 / k each. 0 where either set is empty, as Lv's eq. 41 has it, which rewards losing everything.

    Departs: eq. 41 leaves the transport matrix out of the sum. Raises as `ospa`."""
    x, y = _checked(estimates, targets, 1.0, order)
    if min(len(x), len(y)) == 0:
        return 0.0
    cost = cdist(x, y) ** order
    if len(x) == len(y):  # then some permutation is as cheap as any transport
        return float(cost[linear_sum_assignment(cost)].mean() ** (1 / order))
    j, k = cost.shape
    rows, columns = np.kron(np.eye(j), np.ones(k)), np.kron(np.ones(j), np.eye(k))
    scale = max(cost.max(), np.finfo(float).tiny)  # the solver's tolerances are absolute
    found = linprog(
        cost.ravel() / scale,
        A_eq=np.vstack([rows, columns]),
        b_eq=np.concatenate([np.full(j, 1 / j), np.full(k, 1 / k)]),
        method="highs",
    )
    return float((scale * max(found.fun, 0.0)) ** (1 / order))


def _checked(estimates, targets, cutoff: float, order: float) -> tuple[np.ndarray, np.ndarray]:
    sets = []
    for name, points in (("estimates", estimates), ("targets", targets)):
        try:
            points = np.asarray(points, float)
        except (TypeError, ValueError):
            raise ValueError(f"{name} must be numbers of shape (k, d), got {points!r}") from None
        if points.ndim != 2 or not np.isfinite(points).all():
            raise ValueError(f"{name} must be finite positions (k, d), got shape {points.shape}")
        sets.append(points)
    x, y = sets
    if x.shape[1] != y.shape[1]:
        raise ValueError(f"estimates have {x.shape[1]} coordinates, but targets have {y.shape[1]}")
    if not 0 < cutoff < np.inf:
        raise ValueError(f"cutoff must be positive and finite, got {cutoff}")
    if not 1 <= order < np.inf:
        raise ValueError(f"order must be at least 1 and finite, got {order}")
    return x, y
