"""Distance of a set of estimated trajectories from the set of true ones, with the cost of switched labels.

Trajectories are columns, (T, n, d), m, nan at scans at which one is absent.
"""

from collections.abc import Mapping, Sequence
from numbers import Real
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import connected_components

from gmr_gym.checks import doubles


class TrajectoryGospa(NamedTuple):
    """T-GOSPA with alpha = 2 and its parts; total^order = localisation + missed + false + switches."""

    total: float  # m
    localisation: float  # m^order, of the assigned pairs
    missed: float  # m^order, cutoff^order / 2 for each target and scan without an estimate
    false: float  # m^order, cutoff^order / 2 for each estimate and scan without a target
    switches: (
        float  # m^order, switching^order for each change of a target's estimate, half of it to or from none
    )


class _Pairs(NamedTuple):
    """Pairs of a trajectory and a target that come within the cutoff."""

    estimate: np.ndarray  # (e,), index
    target: np.ndarray  # (e,), index
    cost: np.ndarray  # (T, e), distance^order, m^order; nan where the pair is not within the cutoff


def trajectory_gospa(
    estimates: np.ndarray,
    targets: np.ndarray,
    cutoff: float = 100.0,
    order: float = 2.0,
    switching: float = 10.0,
) -> TrajectoryGospa:
    r"""Trajectory GOSPA (T-GOSPA) with alpha = 2, and its parts.

    Parameters
    ----------
    estimates : array_like (T, j, d)
        Positions, m, by scan and track; nan where a track is absent.
    targets : array_like (T, k, d)
        Positions, m, by scan and target; nan where a target is absent.
    cutoff : float
        Distance beyond which an estimate is none of the target, m.
    order : float
        At least 1, finite.
    switching : float
        Cost of a target that another track takes over, m; half of its power `order` where a track begins or
        ends to be the target's.

    Returns
    -------
    TrajectoryGospa
        Summed over scans, not averaged.

    Raises
    ------
    ValueError
        For trajectories of other shapes or of different numbers of scans or coordinates, positions of which
        only some coordinates are nan, infinite ones, cutoff or switching <= 0, and order < 1.

    Notes
    -----
    For trajectories :math:`x_i`, :math:`y_j`, cutoff c, order p and switching cost :math:`\gamma`, the p-th
    power of the distance is

    .. math::

       \min_W \sum_{t=1}^{T} \sum_{i, j} D_{ij}(t) W_{ij}(t)
       + \frac{\gamma^p}{2} \sum_{t=1}^{T-1} \sum_{i \le n_x, j \le n_y} |W_{ij}(t) - W_{ij}(t + 1)|

    over :math:`W(t) \ge 0` whose rows and columns sum to 1, with one row and column more for "none". D is
    :math:`\min(c, \|x_i - y_j\|)^p` where both are there, :math:`c^p / 2` where one is, and 0 else. It is a
    metric, and a lower bound of the same minimum over whole numbers W, which it reaches nearly always.

    Pairs that never come within the cutoff are left out, as they cost no less than both alone, and groups of
    trajectories that no pair connects are solved by themselves.

    References
    ----------
    García-Fernández, Rahmathullah and Svensson (2020), "A metric on the space of finite sets of trajectories
    for evaluation of multi-target tracking algorithms", doi 10.1109/TSP.2020.3005309: the form of linear
    programming.

    Examples
    --------
    >>> from gmr_gym.evaluation.trajectory_metrics import trajectory_gospa
    >>> nan = float("nan")
    >>> target = [[[0.0, 0.0]], [[1.0, 0.0]], [[2.0, 0.0]], [[3.0, 0.0]]]
    >>> two_halves = [[[0, 0], [nan, nan]], [[1, 0], [nan, nan]], [[nan, nan], [2, 0]], [[nan, nan], [3, 0]]]
    >>> parts = trajectory_gospa(two_halves, target, cutoff=10.0, order=1.0, switching=2.0)
    >>> round(parts.total, 6), round(parts.switches, 6)
    (2.0, 2.0)
    """
    parts = tuple(trajectory_costs(estimates, targets, cutoff, order, switching).sum(axis=1).tolist())
    return TrajectoryGospa(max(sum(parts), 0.0) ** (1 / order), *parts)


def trajectory_costs(
    estimates: np.ndarray,
    targets: np.ndarray,
    cutoff: float = 100.0,
    order: float = 2.0,
    switching: float = 10.0,
) -> np.ndarray:
    """The parts of trajectory GOSPA scan by scan.

    Parameters
    ----------
    estimates, targets, cutoff, order, switching
        As for `trajectory_gospa`.

    Returns
    -------
    ndarray (4, T)
        Localisation, missed, false and switches, m^order, whose sums over scans `trajectory_gospa` has; what
        a switch costs counts in the first scan after it.

    Raises
    ------
    ValueError
        As `trajectory_gospa`.
    """
    x, y = _checked(estimates, targets, cutoff, order, switching)
    alone, change = cutoff**order / 2, switching**order
    missed, false = (alone * np.isfinite(points[..., 0]).sum(axis=1) for points in (y, x))
    localisation, switches = np.zeros((2, len(x)))
    for group in _groups(_near(x, y, cutoff, order)):
        W = _assigned(group, 2 * alone, change)
        near = np.isfinite(group.cost)
        localisation += np.where(near, W * group.cost, 0.0).sum(axis=1)
        assigned = np.where(near, W, 0.0).sum(axis=1)
        missed, false = missed - alone * assigned, false - alone * assigned
        switches[1:] += change / 2 * np.abs(np.diff(W, axis=0)).sum(axis=1)
    return np.array([localisation, missed, false, switches])


def by_label(scans: Sequence[Mapping[int, np.ndarray]], p: int) -> np.ndarray:
    """Trajectories of labelled estimates.

    Parameters
    ----------
    scans : sequence of mapping of int to ndarray (p,)
        Positions by label, of each scan.
    p : int

    Returns
    -------
    ndarray (T, n, p)
        By label in the order of first appearance; nan where one is absent.
    """
    columns = {label: i for i, label in enumerate(dict.fromkeys(name for scan in scans for name in scan))}
    x = np.full((len(scans), len(columns), p), np.nan)
    for t, scan in enumerate(scans):
        for label, position in scan.items():
            x[t, columns[label]] = position
    return x


def _near(x: np.ndarray, y: np.ndarray, cutoff: float, order: float) -> _Pairs:
    """The pairs that come within the cutoff."""
    found: list[tuple[int, int]] = []
    costs = []
    for i in range(x.shape[1]):
        distance = np.linalg.norm(x[:, i, None] - y, axis=2)  # (T, k), nan where either is absent
        for j in np.flatnonzero((distance < cutoff).any(axis=0)):
            near = np.where(distance[:, j] < cutoff, distance[:, j], np.nan)
            found.append((i, int(j)))
            costs.append(near**order)
    estimate, target = np.array(found, int).reshape(-1, 2).T
    return _Pairs(estimate, target, np.array(costs).reshape(-1, len(x)).T)


def _groups(pairs: _Pairs) -> list[_Pairs]:
    """The pairs, parted where no trajectory belongs to two parts."""
    if not len(pairs.estimate):
        return []
    n = pairs.estimate.max() + 1
    nodes = n + pairs.target.max() + 1
    links = csr_array((np.ones(len(pairs.target)), (pairs.estimate, n + pairs.target)), shape=(nodes, nodes))
    part = connected_components(links, directed=False)[1][pairs.estimate]
    return [
        _Pairs(pairs.estimate[here], pairs.target[here], pairs.cost[:, here])
        for here in (part == each for each in np.unique(part))
    ]


def _assigned(pairs: _Pairs, both_alone: float, change: float) -> np.ndarray:
    """The best shares W (T, e) of the pairs of a group.

    Scans at which no pair is within the cutoff change nothing: W stays there as it is before.
    """
    held = np.isfinite(pairs.cost).any(axis=1)
    gain = np.nan_to_num(pairs.cost[held] - both_alone, nan=0.0)  # of a pair over both alone; never positive
    T, e = gain.shape
    if e == 1:  # nothing competes for either
        W = np.ones((T, e))
    else:
        steps = np.full((T - 1) * e, change / 2)
        scale = both_alone  # the solver's tolerances are absolute
        A, b = _constraints(pairs, T)
        found = linprog(
            np.concatenate([gain.ravel(), steps]) / scale, A_ub=A, b_ub=b, bounds=(0, 1), method="highs"
        )
        W = found.x[: T * e].reshape(T, e)
    before = np.maximum.accumulate(np.where(held, np.cumsum(held) - 1, 0))
    return W[before]


def _constraints(pairs: _Pairs, T: int) -> tuple[csr_array, np.ndarray]:
    """A and b of A v <= b for v = (W, |dW|): shares of a trajectory sum to at most 1, |dW| is at least the
    change either way."""
    e = len(pairs.estimate)
    scans, columns = np.arange(T)[:, None], np.arange(e)
    W = scans * e + columns  # index of each variable
    sides, count = [], 0
    for side in (pairs.estimate, pairs.target):
        _, row = np.unique(side, return_inverse=True)
        sides.append((count + scans * (row.max() + 1) + row, W, np.ones((T, e))))
        count += T * (row.max() + 1)
    row, size = count + np.arange((T - 1) * e).reshape(T - 1, e), T * e
    step = size + np.arange((T - 1) * e).reshape(T - 1, e)
    for sign in (1.0, -1.0):
        for at, factor in ((W[1:], sign), (W[:-1], -sign), (step, -1.0)):
            sides.append((row, at, np.full(row.shape, factor)))
        row = row + (T - 1) * e
    rows, at, factors = (np.concatenate([part[i].ravel() for part in sides]) for i in range(3))
    height = count + 2 * (T - 1) * e
    A = coo_array((factors, (rows, at)), shape=(height, size + (T - 1) * e)).tocsr()
    return A, np.concatenate([np.ones(count), np.zeros(height - count)])


def _checked(
    estimates: np.ndarray, targets: np.ndarray, cutoff: float, order: float, switching: float
) -> tuple[np.ndarray, np.ndarray]:
    x, y = doubles("estimates", estimates), doubles("targets", targets)
    for name, points in (("estimates", x), ("targets", y)):
        if points.ndim != 3:
            raise ValueError(f"{name} must have shape (T, n, d), got {points.shape}")
        missing = np.isnan(points)
        if np.isinf(points).any() or (missing.any(axis=2) != missing.all(axis=2)).any():
            raise ValueError(f"{name} must be finite positions, all nan where one is absent")
    if x.shape[0] != y.shape[0] or x.shape[2] != y.shape[2]:
        raise ValueError(
            f"estimates {x.shape} and targets {y.shape} must agree in the numbers of scans and coordinates"
        )
    for name, value in (("cutoff", cutoff), ("switching", switching)):
        if not isinstance(value, Real) or not 0 < value < np.inf:
            raise ValueError(f"{name} must be positive and finite, got {value!r}")
    if not isinstance(order, Real) or not 1 <= order < np.inf:
        raise ValueError(f"order must be at least 1 and finite, got {order!r}")
    return x, y
