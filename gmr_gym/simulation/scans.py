"""A scan made in place: clutter that is a function of a key and of the scan's number, and the target's own
detection among it."""

from typing import NamedTuple

import numpy as np

from gmr_gym.kernels import ZERO, kernel, leaf_kernel
from gmr_gym.linalg import cholesky_into
from gmr_gym.simulation.philox import buffer_for, normals_into, pair, points_into, poisson

CELL = 500.0  # m, side of the squares in which clutter on the ground is drawn
# streams of an episode's key
NOISE, DETECTION, COUNT, GROUND_COUNT = map(np.int64, range(4))
PLACES, GROUND_PLACES = np.int64(4), np.int64(8)  # and those after them, one for every two coordinates


class View(NamedTuple):
    """What `scan_into` has to know of a scenario; `simulate.view_of` reads it off."""

    clutter_rate: float  # expected false detections in the window, a scan
    low: np.ndarray  # (p,), m, of the window, relative to its centre
    high: np.ndarray  # (p,), m
    limits_view: bool
    region_low: np.ndarray  # (2,), m, of the region; (0,) where there is none
    region_high: np.ndarray  # (2,), m


@kernel
def measure_all(measurement, key, R):
    """Adds to what a sensor would say of T scans (T, p) the noise of covariance R (p, p) that goes with the
    key (2,). Returns for every scan two numbers (T,) in [0, 1): the target is detected if the first is below
    its probability, and the second decides where among the clutter its detection stands."""
    L, normal, detection_draw, slot = (
        factor(R),
        np.empty(len(R)),
        np.empty(len(measurement)),
        np.empty(len(measurement)),
    )
    for t in range(len(measurement)):
        detection_draw[t], slot[t] = add_noise(measurement[t], key, t, L, normal)
    return detection_draw, slot


@leaf_kernel
def add_noise(measurement, key, t, L, normal):
    """`measure_all` of scan t alone, z (p,), for noise of covariance L L'; normal (p,) is written over."""
    at = (t, ZERO, ZERO)
    normals_into(normal, key, NOISE, at)
    for r in range(len(L)):
        noise = 0.0
        for c in range(r + 1):
            noise += L[r, c] * normal[c]
        measurement[r] += noise
    return pair(key, DETECTION, ZERO, at)


@kernel
def factor(R):
    """Lower factor L (p, p) of the covariance R = L L'."""
    L = np.zeros_like(R)
    cholesky_into(L, R)
    return L


@kernel
def scan_into(z, view, key, t, centre, target, detected, slot):
    """Scan t of the episode that has the key (2,), by a linear sensor whose View is placed at centre (p,),
    zeros where it stands fast: its k detections, one a row of z (capacity, p), among them that of the target
    (p,) where it is `detected` and in sight, in a place that `slot` in [0, 1) decides. Returns k and the
    target's row, -1 for none; the rows from k on are left as they are."""
    return scan_by(z, view, key, t, centre, target, detected, slot, buffer_for(len(z)))


@leaf_kernel
def scan_by(z, view, key, t, centre, target, detected, slot, buffer):
    """`scan_into` by way of `buffer_for` as many points as z has rows."""
    seen = detected
    if view.limits_view:
        for c in range(len(target)):
            away = target[c] - centre[c]
            seen = seen and view.low[c] <= away and away <= view.high[c]
            if len(view.region_low) > 0:
                seen = seen and view.region_low[c] <= target[c] and target[c] <= view.region_high[c]
    if len(view.region_low) > 0:
        k, place = ground_into(z, view, key, t, centre, slot)
    else:
        k = clutter_into(z, view, key, t, centre, buffer)
        place = int(slot * (k + 1))
    if not seen:
        return k, -1
    return insert_into(z, k, place, target)


@kernel(nogil=True)
def scans_into(first, last, R, z, *given):
    """One scan of each of the episodes from `first` to before `last` of n, by a sensor of noise R (p, p), to
    z (n, capacity, p). What is given is the rest of what `_scans_into` takes."""
    p = len(R)
    _scans_into(
        first, last, np.zeros(p), np.empty(p), np.empty(p), factor(R), buffer_for(z.shape[1]), z, *given
    )


@leaf_kernel
def _scans_into(
    first, last, centre, measurement, normal, L, buffer,
    z, mask, origin, was, view, window_motion, chance, key, expected, of, t, estimates,
):  # fmt: skip
    """Scan t[i] of the episode with key[i] (n, 2), or nothing where it has none of that number. What the
    sensor would say of the truth without noise is `expected` (m, T, p), in the row of[i]; the target's
    probability of detection is `chance`, and the estimate (n, d) of the scan before, as `carried`, places the
    window. For `mask`, `origin` and `was` (n, 2) see `label_into`."""
    for i in range(first, last):
        k, place, now = 0, -1, t[i]
        if now < expected.shape[1]:
            centre_into(centre, window_motion, estimates[i])
            for c in range(len(measurement)):
                measurement[c] = expected[of[i], now, c]
            detection_draw, slot = add_noise(measurement, key[i], now, L, normal)
            k, place = scan_by(
                z[i], view, key[i], now, centre, measurement, detection_draw < chance, slot, buffer
            )
        label_into(z[i], mask[i], origin[i], was[i], k, place)


@leaf_kernel
def label_into(z, mask, origin, was, k, place):
    """Tells of a scan of k detections in the rows of z (capacity, p): mask (capacity,) 1 for a detection and
    0 for none, origin (capacity,) 0 in the target's row `place`, unless that is -1, then -1, and -2 for no
    detection; rows from k on are zeros. All of it has been so of an earlier scan, whose k and place `was`
    (2,) holds, and then holds these; 0 and -1 for nothing, of which z and mask are zeros, origin -2."""
    filled, stood = was[0], was[1]
    for i in range(filled, k):
        mask[i], origin[i] = 1, -1
    if stood >= 0:
        origin[stood] = -1
    for i in range(k, filled):
        mask[i], origin[i] = 0, -2
        for c in range(z.shape[1]):
            z[i, c] = 0.0
    if place >= 0:
        origin[place] = 0
    was[0], was[1] = k, place


@leaf_kernel
def centre_into(centre, window_motion, estimate):
    """Where the next scan's window stands (p,) after the estimate (d,): nowhere else for no motion."""
    F, offset, H = window_motion
    d = len(F)
    for c in range(len(H)):
        centre[c] = 0.0
        for i in range(d):
            moved = offset[i]
            for j in range(d):
                moved += F[i, j] * estimate[j]
            centre[c] += H[c, i] * moved


@leaf_kernel
def insert_into(z, k, place, target):
    """Puts the target (p,) in its place among the first k rows of z, whose order says nothing; the row that
    stood there becomes the last. Returns k + 1 and the place."""
    for c in range(len(target)):
        z[k, c] = z[place, c]
        z[place, c] = target[c]
    return k + 1, place


@leaf_kernel
def clutter_into(z, view, key, t, centre, buffer):
    """Clutter of scan t, uniform in the window placed at centre (p,), one point a row of z (capacity, p), by
    way of `buffer_for` as many; returns how many, always less than the rows."""
    at = (t, ZERO, ZERO)
    k = min(poisson(view.clutter_rate, key, COUNT, at), len(z) - 1)
    points_into(z, k, view.low, view.high, centre, key, PLACES, at, buffer)
    return k


# said, or it would be compiled as its callers are
@kernel(_nrt=True)
def ground_into(z, view, key, t, centre, slot):
    """What a window at centre (2,) shows of the clutter of scan t that stands fast on a region's ground, one
    point a row of z (capacity, 2); returns how many, always less than the rows, and how many of them rank
    below `slot`.

    It is a Poisson process, drawn square by square from streams that each square of the grid about the
    region's corner has to itself. Its order is by ranks of its own: that of the squares would give the
    target away."""
    low, high, squares = np.empty(2), np.empty(2), np.empty((2, 2), np.int64)
    corner, expected = view.region_low, view.clutter_rate * CELL**2
    for c in range(2):
        low[c] = max(view.low[c] + centre[c], corner[c])
        high[c] = min(view.high[c] + centre[c], view.region_high[c])
        expected /= view.high[c] - view.low[c]
        if not low[c] < high[c]:
            return 0, 0
        squares[c, 0], squares[c, 1] = (low[c] - corner[c]) // CELL, (high[c] - corner[c]) // CELL
    ranks, k, none, one = np.empty(len(z)), ZERO, np.zeros(3), np.ones(3)
    for i in range(squares[0, 0], squares[0, 1] + 1):
        for j in range(squares[1, 0], squares[1, 1] + 1):
            # squares are counted from 1: 0 is where the episode's other streams are
            at = (t, i + 1, j + 1)
            points = np.empty((poisson(expected, key, GROUND_COUNT, at), 3))
            buffer = buffer_for(len(points))
            points_into(points, len(points), none, one, none, key, GROUND_PLACES, at, buffer)
            for n in range(len(points)):
                x, y = corner[0] + CELL * (i + points[n, 0]), corner[1] + CELL * (j + points[n, 1])
                if low[0] <= x <= high[0] and low[1] <= y <= high[1] and k < len(z) - 1:
                    z[k, 0], z[k, 1], ranks[k] = x, y, points[n, 2]
                    k += 1
    _sort(z, ranks, k)
    place = 0
    while place < k and ranks[place] < slot:
        place += 1
    return k, place


@kernel
def _sort(z, ranks, k):
    """Puts the first k rows of z (capacity, 2) in the order of their ranks (Shell 1959)."""
    gap = k
    while gap > 1:
        gap = max(1, int(gap / 2.25))
        for i in range(gap, k):
            x, y, rank, j = z[i, 0], z[i, 1], ranks[i], i
            while j >= gap and ranks[j - gap] > rank:
                z[j, 0], z[j, 1], ranks[j] = z[j - gap, 0], z[j - gap, 1], ranks[j - gap]
                j -= gap
            z[j, 0], z[j, 1], ranks[j] = x, y, rank
