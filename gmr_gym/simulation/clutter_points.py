"""Points of clutter among the detections of many targets, drawn for all scans of an episode by one call."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gmr_gym.kernels import kernel, leaf_kernel
from gmr_gym.models.clutter import Clutter

UNIFORM, GAUSSIAN, ELLIPTIC = map(np.int64, range(3))


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
    parts: list[tuple] = []
    first = [0]
    for one in clutter:
        parts.append((UNIFORM, one.uniform, one.low, np.diag(one.high - one.low)))
        for kind, mixture in ((GAUSSIAN, one.gaussians), (ELLIPTIC, one.ellipses)):
            parts += [(kind, w, m, np.linalg.cholesky(P)) for w, m, P in zip(*mixture, strict=True)]
        first.append(len(parts))
    kind, *numbers = (np.array(column) for column in zip(*parts, strict=True))
    low, high = (np.array([getattr(one, side) for one in clutter], float) for side in ("low", "high"))
    return Parts(low, high, np.array(first), kind, *(one.astype(float) for one in numbers))


@kernel(nogil=True)
def scans_of(parts, measured, detected, ranks, rng):
    """The detections of T scans of m targets, among clutter that the generator draws.

    `measured` (T, m, p) are reported where `detected` (T, m) and in the box. Detections are ordered by ranks:
    those of the targets are given (T, m), and the clutter has its own, so that its order does not depend on
    the targets detected. Returns the detections (N, p), the index of the target of each (N,), -1 for clutter,
    and of each scan (T + 1,) the first of its detections.
    """
    scans, m, p = measured.shape
    first, seen, expected = np.zeros(scans + 1, np.int64), np.empty(m, np.int64), parts.w.sum()
    room = scans * m + int(expected + 5 * math.sqrt(expected))  # seldom too little
    z, origin = np.empty((room, p)), np.empty(room, np.int64)
    for t in range(scans):
        false, count, start = false_alarms(parts, t, rng), 0, first[t]
        for i in range(m):
            if detected[t, i] and within(measured[t, i], parts.low[t], parts.high[t]):
                seen[count] = i
                count += 1
        end = first[t + 1] = start + count + len(false)
        z, origin = with_room(z, end), with_room(origin, end)
        rank = np.empty(end - start)
        for row in range(len(rank)):
            rank[row] = ranks[t, seen[row]] if row < count else rng.random()
        order_into(z[start:end], origin[start:end], np.argsort(rank), seen[:count], measured[t], false)
    return z[:end], origin[:end], first


@leaf_kernel
def order_into(z, origin, order, seen, measured, false):
    """Writes the measurements of the targets seen and the false alarms (k, p), one after the other, to z
    (n, p) in the order (n,) given, and their origins (n,)."""
    for place in range(len(order)):
        row = order[place] - len(seen)
        origin[place] = seen[row] if row < 0 else -1
        for c in range(z.shape[1]):
            z[place, c] = measured[seen[row], c] if row < 0 else false[row, c]


@kernel
def false_alarms(parts, t, rng):
    """The false alarms (k, p) of scan t: the points of its parts that fall in the box."""
    here, k = range(parts.first[t], parts.first[t + 1]), 0
    z = np.empty((int(2 * parts.w[parts.first[t] : parts.first[t + 1]].sum()), parts.low.shape[1]))
    for i in here:
        count = rng.poisson(parts.w[i])
        z = with_room(z, k + count)
        k += part_into(z[k : k + count], parts, i, t, rng)
    return z[:k]


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


@kernel
def with_room(z, rows):
    """z (n, ...), or its rows at the head of a longer array, with room for so many rows."""
    if rows <= len(z):
        return z
    longer = np.empty((2 * rows, *z.shape[1:]), z.dtype)
    longer[: len(z)] = z
    return longer
