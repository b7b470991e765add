"""Speeds that no target has: the sign of a unit that was mistaken."""

import numpy as np
from numpy.typing import ArrayLike

from gmr_gym.recorded.detections import CARTESIAN, Detections, named

FASTEST = 12_000.0  # m/s: nothing that stays with the Earth is faster
NEAR = 1000.0  # m; steps below it may be noise over next to no time
LOOKED_AT, AHEAD = 400, 200  # rows, and rows after each, that are looked at where there are no identities


def check_speeds(source: str, found: Detections) -> str | None:
    """Refuse detections of which most move at a speed that no target has: from a row of an identity to its
    next one, or without identities to any of the rows that follow.

    Returns
    -------
    str or None
        A remark, where a few do.

    Raises
    ------
    ValueError
        Naming the lines and the speed.
    """
    first, second = _steps(found)
    if not len(first):
        return None
    step = np.linalg.norm(_places(found, second) - _places(found, first), axis=1)
    gap = found.time[second] - found.time[first]
    speed = step / np.maximum(gap, 1e-9)
    fast = (speed > FASTEST) & (step > NEAR)
    if not fast.any():
        return None
    i = int(np.argmax(fast))
    shown = (
        f"lines {found.row[first[i]]} and {found.row[second[i]]} are {step[i]:.3g} m and {gap[i]:.3g} s "
        f"apart, {speed[i]:.3g} m/s"
    )
    if fast.mean() > 0.5:
        raise ValueError(
            f"{source}: {shown}, faster than any target: a unit is mistaken, of the time or of a position"
        )
    return f"{fast.sum()} steps of {len(first)} are faster than any target: {shown}"


def _steps(found: Detections) -> tuple[np.ndarray, np.ndarray]:
    """Indices of rows, and of those after them that may be of the same target."""
    if len(found.time) < 2:
        return np.empty(0, int), np.empty(0, int)
    known = named(found.identity)
    if known.any():
        rows = np.flatnonzero(known)
        _, code = np.unique(found.identity[rows].astype(str), return_inverse=True)
        order = rows[np.argsort(code, kind="stable")]
        code = np.sort(code)
        same = code[1:] == code[:-1]
        return order[:-1][same], order[1:][same]
    n = len(found.time)
    first, second = [], []
    for row in np.unique(np.linspace(0, n - 2, LOOKED_AT).astype(int)).tolist():
        following = np.arange(row + 1, min(row + 1 + AHEAD, n))
        gap = found.time[following] - found.time[row]
        if gap[-1] > 0:
            away = np.linalg.norm(_places(found, following) - _places(found, row), axis=1)
            first.append(row)
            second.append(following[np.argmin(away / np.maximum(gap, 1e-9))])
    return np.array(first, int), np.array(second, int)


def _places(found: Detections, rows: ArrayLike) -> np.ndarray:
    """Positions (k, 2) on the ground, m."""
    rows = np.atleast_1d(rows)
    z, origin = found.z[rows], found.origin[rows, :2]
    kinds = np.array([spec.kind == CARTESIAN for spec in found.sensors])[found.sensor[rows]]
    direction = np.column_stack([np.cos(z[:, 1]), np.sin(z[:, 1])])
    return np.where(kinds[:, None], z[:, :2], origin + z[:, :1] * direction)
