"""How good an estimate is, and when a track is lost; how far a set of estimates is from the set of targets:
OSPA, GOSPA and its parts, Wasserstein, the error of the number. Nothing here knows a tracker.

Of sets, positions are rows, (j, d) and (k, d), in any order; either may be empty, (0, d), and a row of which
anything is masked is absent. Units are those of the positions, metres.
"""

import sys
from math import lcm, log
from numbers import Real
from typing import NamedTuple

import numpy as np
from scipy.optimize import linear_sum_assignment, linprog
from scipy.sparse import csr_array
from scipy.sparse.csgraph import maximum_flow
from scipy.spatial.distance import cdist

from gmr_gym.checks import doubles
from gmr_gym.points import present

MOST_COPIES = 300  # beyond, a linear program is faster than the assignment
SAFE = 1e-140, 1e140  # m, between which the square of a distance has all its digits
IN_RANGE = 600.0  # logarithms between which powers, and sums of many, keep away from the ends of floats


def lost_at(off_target: np.ndarray, patience: int) -> np.ndarray:
    """Scan (runs,) at which `patience` scans in a row were off target (runs, T), -1 for never. Raises
    ValueError for what is neither true nor false."""
    off_target = doubles("off_target", off_target)
    if off_target.ndim != 2 or not np.isin(off_target, (0, 1)).all():
        raise ValueError(f"off_target must be true or false, of shape (runs, T), got {off_target}")
    runs, scans = off_target.shape
    at, in_a_row = np.full(runs, -1), np.zeros(runs)
    for t in range(scans):
        in_a_row = (in_a_row + 1) * off_target[:, t]
        at[(at < 0) & (in_a_row >= patience)] = t
    return at


def nees(error: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Normalised error squared e' P^-1 e (...,) of errors (..., d) with covariances (..., d, d);
    its mean is d for a filter that knows how wrong it is. Raises ValueError for shapes that do not fit."""
    error, P = doubles("error", error), doubles("P", P)
    if error.ndim == 0 or P.shape != error.shape + error.shape[-1:]:
        raise ValueError(f"error must have shape (..., d) and P (..., d, d), got {error.shape} and {P.shape}")
    return np.einsum("...i,...i->...", error, np.linalg.solve(P, error[..., None])[..., 0])


def credibility(
    error: np.ndarray, claimed: np.ndarray, weight: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Noncredibility index and inclination (T,), dB, of errors (runs, T, d) whose normalised squares
    e' P^-1 e by the covariances a filter claims are `claimed` (runs, T), see `nees` (Li and Zhao 2006;
    Zhang, section 6.2):

        rho = 10 log10((e' P^-1 e) / (e' C^-1 e)),  C the mean of e e' over the runs

    index = mean |rho|, 0 for a filter as good as it says; inclination = mean rho, above 0 for one
    that is worse than it says. All means are weighted by weight (runs,) where it is given. Not a number
    at a scan whose C is singular, as with fewer runs than states. Raises ValueError for shapes that do not
    fit and for weights that are negative or not finite.
    """
    error, claimed = doubles("error", error), doubles("claimed", claimed)
    if error.ndim != 3 or claimed.shape != error.shape[:2]:
        raise ValueError(
            f"error must have shape (runs, T, d) and claimed (runs, T), got {error.shape} and {claimed.shape}"
        )
    runs, scans, d = error.shape
    weight = np.ones(runs) if weight is None else doubles("weight", weight)
    if weight.shape != (runs,) or not ((weight >= 0) & (weight < np.inf)).all():
        raise ValueError(f"weight must be {runs} finite numbers, none negative, got {weight}")
    if not weight.any():
        return np.full(scans, np.nan), np.full(scans, np.nan)
    share = weight / weight.sum()
    e = error.transpose(1, 2, 0)
    C = (share * e) @ e.transpose(0, 2, 1)
    known = np.linalg.matrix_rank(C, hermitian=True) == d
    whitener = np.full_like(C, np.nan)
    whitener[known] = np.linalg.solve(np.linalg.cholesky(C[known]), np.eye(d))
    actual = ((whitener @ e) ** 2).sum(axis=1).T
    rho = 10 * np.log10(claimed / actual)
    return share @ np.abs(rho), share @ rho


class Gospa(NamedTuple):
    """What GOSPA with alpha = 2 is made of; total^order = localisation + missed + false."""

    total: float  # m
    localisation: float  # m^order, of the pairs that belong together
    missed: float  # m^order, cutoff^order / 2 for each target without an estimate
    false: float  # m^order, the same for each estimate without a target


def ospa(estimates, targets, cutoff: float = 100.0, order: float = 2.0) -> float:
    """Optimal subpattern assignment distance: the best one-to-one assignment, no pair and no surplus point
    charged more than `cutoff`, averaged over the larger set (Schuhmacher, Vo and Vo 2008). 0 for two empty
    sets, `cutoff` when one of them is. Of order inf it is the farthest pair of the best assignment, and
    `cutoff` for sets of unequal size.

    Raises ValueError for arrays that are no finite (j, d) and (k, d), cutoff <= 0 or order < 1."""
    x, y = _checked(estimates, targets, cutoff, order)
    few, most = sorted((len(x), len(y)))
    if most == 0:
        return 0.0
    distance = np.minimum(_distances(x, y), cutoff)
    if order == np.inf:
        return float(cutoff) if few < most else _bottleneck(distance)
    cost, unit = _powers(distance, order, cutoff if few < most else None)
    surplus = (cutoff / unit) ** order * (most - few) if few < most else 0.0
    return float(unit * ((cost[linear_sum_assignment(cost)].sum() + surplus) / most) ** (1 / order))


def gospa(estimates, targets, cutoff: float = 100.0, order: float = 2.0) -> Gospa:
    """Generalised OSPA with alpha = 2 and its parts: pairs closer than `cutoff` are localised, what is left
    over is missed or false (Rahmathullah, Garcia-Fernandez and Svensson 2017). Raises as `ospa`, and for an
    order that is not finite or for which cutoff ** order is beyond floats."""
    x, y = _checked(estimates, targets, cutoff, order)
    if not order * log(cutoff) < log(sys.float_info.max / (1 + len(x) + len(y))):
        raise ValueError(
            f"order must be finite and leave cutoff ** order a float, got order {order}, cutoff {cutoff}"
        )
    distance = _distances(x, y)
    # with alpha = 2 a pair at the cutoff costs as much as a miss and a false estimate
    capped = np.minimum(distance, cutoff)
    powers, unit = _powers(capped, order, cutoff if len(x) != len(y) else None)
    pairs = linear_sum_assignment(powers)
    near = distance[pairs][distance[pairs] < cutoff]
    alone = [len(side) - len(near) for side in (y, x)]
    localisation, missed, false = parts = _parts(near, alone, cutoff, order)
    if unit != 1:  # the parts may vanish, the whole does not
        parts = _parts(near / unit, alone, cutoff / unit if any(alone) else 0.0, order)
    return Gospa(unit * sum(parts) ** (1 / order), localisation, missed, false)


def _parts(near: np.ndarray, alone: list[int], cutoff: float, order: float) -> tuple[float, float, float]:
    """Localisation, missed and false of GOSPA, from the distances of pairs and the numbers left over."""
    missed, false = (cutoff**order / 2 * count for count in alone)
    return float((near**order).sum()), missed, false


def wasserstein(estimates, targets, order: float = 2.0) -> float:
    """Distance of Hoffman and Mahler (2004): the cheapest transport of the estimates, 1 / j each, to the
    targets, 1 / k each; of order inf the farthest that any has to go. Not a number where either set is empty:
    there is nothing to carry, or nowhere to carry it to.

    Departs: Lv's eq. 41 has 0 there, which rewards losing everything, and leaves the transport matrix out of
    the sum. Raises as `ospa`."""
    x, y = _checked(estimates, targets, 1.0, order)
    if min(len(x), len(y)) == 0:
        return np.nan
    distance = _distances(x, y)
    if order == np.inf:
        return _bottleneck(distance)
    cost, unit = _powers(distance, order)
    copies = lcm(len(x), len(y))
    if copies <= MOST_COPIES:
        # of so many copies of either side, all alike in weight, a permutation is as cheap as any transport
        cost = cost.repeat(copies // len(x), axis=0).repeat(copies // len(y), axis=1)
        return float(unit * cost[linear_sum_assignment(cost)].mean() ** (1 / order))
    j, k = cost.shape
    rows, columns = np.kron(np.eye(j), np.ones(k)), np.kron(np.ones(j), np.eye(k))
    scale = max(cost.max(), np.finfo(float).tiny)  # the solver's tolerances are absolute
    found = linprog(
        cost.ravel() / scale,
        A_eq=np.vstack([rows, columns]),
        b_eq=np.concatenate([np.full(j, 1 / j), np.full(k, 1 / k)]),
        method="highs",
    )
    return float(unit * (scale * max(found.fun, 0.0)) ** (1 / order))


def _distances(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Euclidean distances (j, k), those whose squares are beyond floats too."""
    distance = cdist(x, y)
    least, most = SAFE
    if distance.size and not (distance.min() > least and distance.max() < most):
        i, j = np.nonzero((distance < least) | (distance > most))
        with np.errstate(over="ignore"):
            distance[i, j] = np.hypot.reduce(x[i] - y[j], axis=1)
        if distance.max() == np.inf:
            raise ValueError("estimates and targets are farther apart than floats reach")
    return distance


def _powers(distance: np.ndarray, order: float, surplus: float | None = None) -> tuple[np.ndarray, float]:
    """(distance / unit) ** order (j, k), and the unit: 1 where all powers are well within floats, else what
    the result is about as large as, the `surplus` where that is charged, or how far the farthest has to go at
    least. What then vanishes is below the last digit of the sum."""
    least, most = float(distance.min(initial=1.0)), float(distance.max(initial=surplus or 1.0))
    if least == 0:
        least = float(distance.min(initial=1.0, where=distance > 0))
    if order * max(log(most), -log(min(least, surplus or 1.0))) < IN_RANGE:
        return distance**order, 1.0
    unit = surplus or _bottleneck(distance) or 1.0
    # none is more than the best plan as a whole can cost, and need not be told from what is dearer still
    return np.minimum(distance / unit, distance.size ** (1 / order)) ** order, unit


def _bottleneck(distance: np.ndarray) -> float:
    """The least of lengths (j, k) within which all mass, 1 / j a row, gets to the columns, 1 / k each."""
    j, k = distance.shape
    source, sink = 0, 1 + j + k
    steps = np.unique(distance)

    def carried(longest: float) -> bool:
        rows, columns = np.nonzero(distance <= longest)
        starts = np.concatenate([np.full(j, source), 1 + rows, 1 + j + np.arange(k)])
        ends = np.concatenate([1 + np.arange(j), 1 + j + columns, np.full(k, sink)])
        room = np.concatenate([np.full(j, k), np.full(len(rows), min(j, k)), np.full(k, j)]).astype(np.int32)
        graph = csr_array((room, (starts, ends)), shape=(sink + 1, sink + 1))
        return maximum_flow(graph, source, sink).flow_value == j * k

    low, high = 0, len(steps) - 1
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if carried(steps[middle]) else (middle + 1, high)
    return float(steps[low])


def cardinality_error(named: np.ndarray, there: np.ndarray) -> np.ndarray:
    """By how many targets the numbers named are wrong, (...,) of counts (...,)."""
    return np.abs(doubles("named", named) - doubles("there", there))  # unsigned counts have no difference


def _checked(estimates, targets, cutoff: float, order: float) -> tuple[np.ndarray, np.ndarray]:
    sets = []
    for name, points in (("estimates", estimates), ("targets", targets)):
        try:
            points = np.asarray(present(points)).astype(float, casting="same_kind", copy=False)
        except (TypeError, ValueError):
            raise ValueError(f"{name} must be numbers of shape (k, d), got {points!r}") from None
        if points.ndim != 2 or not np.isfinite(points).all():
            raise ValueError(f"{name} must be finite positions (k, d), got shape {points.shape}")
        sets.append(points)
    x, y = sets
    if x.shape[1] != y.shape[1]:
        raise ValueError(f"estimates have {x.shape[1]} coordinates, but targets have {y.shape[1]}")
    if not isinstance(cutoff, Real) or not 0 < cutoff < np.inf:
        raise ValueError(f"cutoff must be positive and finite, got {cutoff!r}")
    if not isinstance(order, Real) or not order >= 1:
        raise ValueError(f"order must be at least 1, got {order!r}")
    return x, y
