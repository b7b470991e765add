"""Metrics: track loss and credibility of an estimate; distances of a set of estimates from the set of
targets.

No metric depends on a tracker. For sets, positions are rows, (j, d) and (k, d), in any order; either set may
be empty, (0, d), and a row of which anything is masked is absent. Units are those of the positions, metres.
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

MOST_COPIES = 300  # with more, a linear program is faster than the assignment
SAFE = 1e-140, 1e140  # m, between which the square of a distance has all its digits
IN_RANGE = 600.0  # logarithms up to which powers, and sums of many, stay within the range of floats


def lost_at(off_target: np.ndarray, patience: int) -> np.ndarray:
    """Scan at which each run loses its track.

    Parameters
    ----------
    off_target : array_like (runs, T)
        True where a scan is off target.
    patience : int
        Number of consecutive scans off target that make a track lost.

    Returns
    -------
    ndarray (runs,)
        The last of the first `patience` consecutive scans off target, -1 if there are none.

    Raises
    ------
    ValueError
        If `off_target` is not boolean, or not of two axes.

    Examples
    --------
    >>> from gmr_gym.evaluation.metrics import lost_at
    >>> lost_at([[False, True, True, True], [True, False, True, False]], patience=2).tolist()
    [2, -1]
    """
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
    r"""Normalised estimation error squared.

    Parameters
    ----------
    error : array_like (..., d)
        Estimate minus truth.
    P : array_like (..., d, d)
        Covariances of the estimates.

    Returns
    -------
    ndarray (...,)

    Raises
    ------
    ValueError
        For shapes that do not fit.

    Notes
    -----
    .. math:: \epsilon = e^\top P^{-1} e

    Its mean is d for a credible filter; divided by d and averaged over runs it is the ANEES, 1 for a credible
    filter.

    Examples
    --------
    >>> from gmr_gym.evaluation.metrics import nees
    >>> nees([[3.0, 4.0]], [[[9.0, 0.0], [0.0, 16.0]]]).round(6).tolist()
    [2.0]
    """
    error, P = doubles("error", error), doubles("P", P)
    if error.ndim == 0 or P.shape != error.shape + error.shape[-1:]:
        raise ValueError(f"error must have shape (..., d) and P (..., d, d), got {error.shape} and {P.shape}")
    return np.einsum("...i,...i->...", error, np.linalg.solve(P, error[..., None])[..., 0])


def credibility(
    error: np.ndarray, claimed: np.ndarray, weight: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    r"""Noncredibility index and inclination, per scan.

    Parameters
    ----------
    error : array_like (runs, T, d)
        Estimate minus truth.
    claimed : array_like (runs, T)
        NEES of the errors by the covariances of the filter, see `nees`.
    weight : array_like (runs,), optional
        Weights of the runs in all means; equal by default.

    Returns
    -------
    index : ndarray (T,)
        Noncredibility index, dB; 0 for a credible filter. nan where C is singular, as with fewer runs than
        states, or not finite.
    inclination : ndarray (T,)
        dB; positive for an optimistic filter, whose covariances are too small.

    Raises
    ------
    ValueError
        For shapes that do not fit, and for weights that are negative or not finite.

    Notes
    -----
    With the mean over runs :math:`\langle\cdot\rangle` and the actual error covariance C,

    .. math::

       \rho = 10 \log_{10} \frac{e^\top P^{-1} e}{e^\top C^{-1} e}, \quad C = \langle e e^\top \rangle, \quad
       \mathrm{NCI} = \langle |\rho| \rangle, \quad \mathrm{inclination} = \langle \rho \rangle

    References
    ----------
    Li and Zhao (2006); Zhang and Liu, section 6.2.
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
    known = np.isfinite(C).all(axis=(1, 2))
    known[known] = np.linalg.matrix_rank(C[known], hermitian=True) == d
    whitener = np.full_like(C, np.nan)
    whitener[known] = np.linalg.solve(np.linalg.cholesky(C[known]), np.eye(d))
    actual = ((whitener @ e) ** 2).sum(axis=1).T
    rho = 10 * np.log10(claimed / actual)
    return share @ np.abs(rho), share @ rho


class Gospa(NamedTuple):
    """GOSPA with alpha = 2 and its parts: total^order = localisation + missed + false."""

    total: float  # m
    localisation: float  # m^order, of the assigned pairs
    missed: float  # m^order, cutoff^order / 2 for each target without an estimate
    false: float  # m^order, cutoff^order / 2 for each estimate without a target


def ospa(estimates, targets, cutoff: float = 100.0, order: float = 2.0) -> float:
    r"""Optimal subpattern assignment (OSPA) distance of two sets.

    Parameters
    ----------
    estimates : array_like (j, d)
        Positions, m; masked rows are absent.
    targets : array_like (k, d)
        Positions, m.
    cutoff : float
        Largest cost of a pair, and cost of each surplus point, m.
    order : float
        At least 1; may be inf.

    Returns
    -------
    float
        m. 0 for two empty sets, `cutoff` when one is empty. Of order inf it is the farthest pair of the best
        assignment, and `cutoff` for sets of unequal size.

    Raises
    ------
    ValueError
        For sets that are not finite (j, d) and (k, d), cutoff <= 0 or order < 1.

    Notes
    -----
    For n points x and m >= n points y, cutoff c and order p,

    .. math::

       \left( \frac{1}{m} \left( \min_{\pi} \sum_{i=1}^{n} \min(c, \|x_i - y_{\pi(i)}\|)^p
       + c^p (m - n) \right) \right)^{1/p}

    over the assignments :math:`\pi` of all x to different y.

    References
    ----------
    Schuhmacher, Vo and Vo (2008).

    Examples
    --------
    >>> from gmr_gym.evaluation.metrics import ospa
    >>> round(ospa([[0.0, 0.0]], [[3.0, 4.0]]), 3)
    5.0
    >>> round(ospa([[0.0, 0.0]], [[0.0, 0.0], [50.0, 0.0]]), 3)
    70.711
    """
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
    r"""Generalised OSPA (GOSPA) with alpha = 2, and its parts.

    Parameters
    ----------
    estimates, targets, cutoff, order
        As for `ospa`; the order must be finite.

    Returns
    -------
    Gospa

    Raises
    ------
    ValueError
        As `ospa`; also if the order or cutoff ** order is not finite.

    Notes
    -----
    For sets X and Y, cutoff c and order p, over assignments :math:`\theta` of some x to different y,

    .. math::

       \left( \min_{\theta} \sum_{(i, j) \in \theta} \|x_i - y_j\|^p
       + \frac{c^p}{2} (|X| + |Y| - 2 |\theta|) \right)^{1/p}

    The three parts are the localisation error of assigned pairs, the missed targets and the false estimates.

    References
    ----------
    Rahmathullah, Garcia-Fernandez and Svensson (2017).

    Examples
    --------
    >>> from gmr_gym.evaluation.metrics import gospa
    >>> parts = gospa([[3.0, 4.0], [500.0, 0.0]], [[0.0, 0.0]], cutoff=10.0)
    >>> round(parts.total, 3), round(parts.localisation, 3), parts.missed, parts.false
    (8.66, 25.0, 0.0, 50.0)
    """
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
    if unit != 1:  # the parts may underflow, the total does not
        parts = _parts(near / unit, alone, cutoff / unit if any(alone) else 0.0, order)
    return Gospa(unit * sum(parts) ** (1 / order), localisation, missed, false)


def _parts(near: np.ndarray, alone: list[int], cutoff: float, order: float) -> tuple[float, float, float]:
    """Localisation, missed and false of GOSPA, from the distances of pairs and the numbers of unassigned
    points.
    """
    missed, false = (cutoff**order / 2 * count for count in alone)
    return float((near**order).sum()), missed, false


def wasserstein(estimates, targets, order: float = 2.0) -> float:
    """Wasserstein distance of two sets: the cheapest transport of estimates, 1 / j each, to targets, 1 / k
    each.

    Parameters
    ----------
    estimates, targets, order
        As for `ospa`. Of order inf the distance is the longest way in the best transport.

    Returns
    -------
    float
        m; nan where either set is empty, as no transport exists.

    Raises
    ------
    ValueError
        As `ospa`.

    References
    ----------
    Hoffman and Mahler (2004). Departs: Lv's eq. 41 has 0 for an empty set, which rewards losing every target,
    and leaves the transport matrix out of the sum.

    Examples
    --------
    >>> from gmr_gym.evaluation.metrics import wasserstein
    >>> round(wasserstein([[0.0, 0.0]], [[3.0, 4.0]]), 3)
    5.0
    >>> wasserstein([[0.0, 0.0]], [[0.0, 0.0], [6.0, 8.0]], order=1.0)
    5.0
    """
    x, y = _checked(estimates, targets, 1.0, order)
    if min(len(x), len(y)) == 0:
        return np.nan
    distance = _distances(x, y)
    if order == np.inf:
        return _bottleneck(distance)
    cost, unit = _powers(distance, order)
    copies = lcm(len(x), len(y))
    if copies <= MOST_COPIES:
        # with copies of equal weight on both sides, the best permutation is as cheap as the best transport
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
    """Euclidean distances (j, k), also where their squares overflow or underflow."""
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
    """(distance / unit) ** order (j, k), and the unit.

    The unit is 1 where all powers are well within floats. Else it has the magnitude of the result: the
    `surplus` where that is charged, or the shortest possible longest way. Powers that then vanish are below
    the last digit of the sum.
    """
    least, most = float(distance.min(initial=1.0)), float(distance.max(initial=surplus or 1.0))
    if least == 0:
        least = float(distance.min(initial=1.0, where=distance > 0))
    if order * max(log(most), -log(min(least, surplus or 1.0))) < IN_RANGE:
        return distance**order, 1.0
    unit = surplus or _bottleneck(distance) or 1.0
    # capped at the most that the best plan can cost in all: pairs beyond are never used
    return np.minimum(distance / unit, distance.size ** (1 / order)) ** order, unit


def _bottleneck(distance: np.ndarray) -> float:
    """The least of the lengths (j, k) within which all mass, 1 / j a row, reaches the columns, 1 / k each."""
    j, k = distance.shape
    source, sink = 0, 1 + j + k
    steps = np.unique(distance)

    def reaches(longest: float) -> bool:
        rows, columns = np.nonzero(distance <= longest)
        starts = np.concatenate([np.full(j, source), 1 + rows, 1 + j + np.arange(k)])
        ends = np.concatenate([1 + np.arange(j), 1 + j + columns, np.full(k, sink)])
        room = np.concatenate([np.full(j, k), np.full(len(rows), min(j, k)), np.full(k, j)]).astype(np.int32)
        graph = csr_array((room, (starts, ends)), shape=(sink + 1, sink + 1))
        return maximum_flow(graph, source, sink).flow_value == j * k

    low, high = 0, len(steps) - 1
    while low < high:
        middle = (low + high) // 2
        low, high = (low, middle) if reaches(steps[middle]) else (middle + 1, high)
    return float(steps[low])


def cardinality_error(declared: np.ndarray, targets: np.ndarray) -> np.ndarray:
    """Absolute difference of the numbers of declared and true targets.

    Parameters
    ----------
    declared : array_like (...,)
        Number of declared targets.
    targets : array_like (...,)
        Number of true targets.

    Returns
    -------
    ndarray (...,)
    """
    # as floats: unsigned counts have no negative difference
    return np.abs(doubles("declared", declared) - doubles("targets", targets))


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
