"""Speeds that no target has: the sign of a unit that was mistaken."""

from typing import Any

import numpy as np

from gmr_gym.recorded.detections import Detections, numbered
from gmr_gym.recorded.positions import local_positions

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
    points = local_positions(found)
    step = _distances(points, first, second)
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
    code = numbered(found.identity)
    if (code >= 0).any():
        order = np.argsort(code, kind="stable")
        same = (np.diff(code[order]) == 0) & (code[order][1:] >= 0)
        return order[:-1][same], order[1:][same]
    n, points = len(found.time), local_positions(found)
    first, second = [], []
    for row in np.unique(np.linspace(0, n - 2, LOOKED_AT).astype(int)).tolist():
        following = np.arange(row + 1, min(row + 1 + AHEAD, n))
        gap = found.time[following] - found.time[row]
        if gap[-1] > 0:
            away = _distances(points, row, following)
            first.append(row)
            second.append(following[np.argmin(away / np.maximum(gap, 1e-9))])
    return np.array(first, int), np.array(second, int)


def _distances(points: np.ndarray, first: Any, second: np.ndarray) -> np.ndarray:
    """Distances (k,) on the ground of points (n, p), m."""
    return np.hypot(points[second, 0] - points[first, 0], points[second, 1] - points[first, 1])
