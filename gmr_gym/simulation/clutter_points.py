"""Points of clutter among the detections of many targets, drawn for all scans of an episode by one call."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gmr_gym.kernels import kernel, leaf_kernel
from gmr_gym.models.clutter import Clutter

KINDS = UNIFORM, GAUSSIAN, ELLIPTIC = 0, 1, 2


class Parts(NamedTuple):
    """The clutter of T scans in n parts, each a Poisson number of points centre + L y.

    By its kind y is uniform in the unit cube, Gaussian, or uniform in the unit ball.
    """

    low: np.ndarray  # (T, p), corners of the box, m
    high: np.ndarray  # (T, p)
    first: np.ndarray  # (T + 1,), scan t has the parts first[t], ..., first[t + 1] - 1
    kind: np.ndarray  # (n,), UNIFORM, GAUSSIAN or ELLIPTIC
    w: np.ndarray  # (n,), expected numbers of points
    centre: np.ndarray  # (n, p)
    L: np.ndarray  # (n, p, p)


def parts_of(clutter: Sequence[Clutter]) -> Parts:
    """The parts of the clutter of each scan."""
    low, high = (np.array([getattr(one, side) for one in clutter], float) for side in ("low", "high"))
    counts = [(1, len(one.gaussians.w), len(one.ellipses.w)) for one in clutter]
    boxes = (high - low)[:, :, None] * np.eye(low.shape[1])
    rows = [
        (
            [one.uniform, *one.gaussians.w, *one.ellipses.w],
            [one.low, *one.gaussians.m, *one.ellipses.m],
            [box, *np.linalg.cholesky(one.gaussians.P), *np.linalg.cholesky(one.ellipses.P)],
        )
        for one, box in zip(clutter, boxes, strict=True)
    ]
    w, centre, L = (
        np.array([row for each in column for row in each], float) for column in zip(*rows, strict=True)
    )
    first = np.concatenate(([0], np.cumsum(np.sum(counts, axis=1))))
    return Parts(low, high, first, np.repeat(np.tile(KINDS, len(clutter)), np.ravel(counts)), w, centre, L)


@kernel(nogil=True)
def scans_into(z, origin, parts, measured, detected, ranks, rng):
    """Writes the detections of T scans of m targets, among clutter that the generator draws, to z (N, p).

    `measured` (T, m, p) are reported where `detected` (T, m) and in the box. Detections are ordered by ranks:
    those of the targets are given (T, m), and the clutter has its own, so that its order does not depend on
    the targets detected. `origin` (N,) receives the index of the target of each, -1 for clutter. Returns the
    first detection of each scan (T + 1,). Clutter for which no room is left is dropped.
    """
    scans, m, p = measured.shape
    first, seen, false = np.zeros(scans + 1, np.int64), np.empty(m, np.int64), np.empty(z.shape)
    rank, order = np.empty(len(z)), np.empty(len(z), np.int64)
    for t in range(scans):
        start, count = first[t], 0
        for i in range(m):
            if detected[t, i] and within(measured[t, i], parts.low[t], parts.high[t]):
                seen[count] = i
                count += 1
        room = len(z) - start - m * (scans - t)  # the targets of all scans to come have theirs
        n = count + false_alarms_into(false[:room], parts, t, rng)
        for row in range(n):
            rank[row] = ranks[t, seen[row]] if row < count else rng.random()
        order_into(order[:n], rank)
        for place in range(n):
            row = order[place]
            origin[start + place] = seen[row] if row < count else -1
            for c in range(p):
                value = measured[t, seen[row], c] if row < count else false[row - count, c]
                z[start + place, c] = value
        first[t + 1] = start + n
    return first


@kernel
def false_alarms_into(z, parts, t, rng):
    """Writes the false alarms of scan t, the points of its parts that fall in the box, to the first rows of z
    (n, p); returns how many.

    Points for which no room is left are dropped.
    """
    k = 0
    for i in range(parts.first[t], parts.first[t + 1]):
        count = min(rng.poisson(parts.w[i]), len(z) - k)
        k += part_into(z[k : k + count], parts, i, t, rng)
    return k


@leaf_kernel
def order_into(order, rank):
    """Writes the rows of the first of the ranks to `order` (n,), the lowest first (Shell 1959)."""
    gap = len(order)
    for i in range(gap):
        order[i] = i
    while gap > 1:
        gap = max(1, int(gap / 2.25))
        for i in range(gap, len(order)):
            row, j = order[i], i
            while j >= gap and rank[order[j - gap]] > rank[row]:
                order[j] = order[j - gap]
                j -= gap
            order[j] = row


@leaf_kernel
def part_into(z, parts, i, t, rng):
    """Writes points of part i to the rows of z (n, p); returns how many are in the box of scan t, which come
    first.
    """
    n, p = z.shape
    for j in range(n):
        for c in range(p):
            z[j, c] = rng.random() if parts.kind[i] == UNIFORM else rng.standard_normal()
    k = 0
    for j in range(n):
        if parts.kind[i] == ELLIPTIC:
            scale_to_ball(z[j], rng.random())
        for r in range(p - 1, -1, -1):  # from the last on, as row k may be row j
            total = 0.0
            for c in range(r + 1):
                total += parts.L[i, r, c] * z[j, c]
            z[k, r] = parts.centre[i, r] + total
        k += within(z[k], parts.low[t], parts.high[t])
    return k


@leaf_kernel
def scale_to_ball(y, u):
    """Scales a Gaussian y (p,) by a uniform u in [0, 1) to a point that is uniform in the unit ball."""
    square = 0.0
    for c in range(len(y)):
        square += y[c] * y[c]
    length = math.sqrt(u) if len(y) == 2 else u ** (1 / len(y))
    y *= length / math.sqrt(square)


@leaf_kernel
def within(z, low, high):
    """Whether the point z (p,) lies in the box between low and high (p,)."""
    for c in range(len(z)):
        if not (low[c] <= z[c] and z[c] <= high[c]):
            return False
    return True
