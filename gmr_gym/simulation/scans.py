"""Scans made in place: the target's detection among clutter that a key and the scan's number decide."""

from typing import NamedTuple

import numpy as np

from gmr_gym.kernels import ZERO, kernel, leaf_kernel
from gmr_gym.linalg import cholesky_into
from gmr_gym.simulation.philox import buffer_for, normals_into, pair, points_into, poisson

CELL = 500.0  # m, side of the square cells in which clutter on the ground is drawn
# streams of an episode's key
NOISE, DETECTION, COUNT, GROUND_COUNT = map(np.int64, range(4))
POSITIONS, GROUND_POSITIONS = np.int64(4), np.int64(8)  # and those after them, one for every two coordinates


class Region(NamedTuple):
    """Ground of the plane, with clutter and in view."""

    low: np.ndarray  # (2,), m
    high: np.ndarray  # (2,), m


class View(NamedTuple):
    """What `scan_into` needs of a scenario; `single_target.view_of` makes it."""

    clutter_rate: float  # expected false alarms in the window, per scan
    low: np.ndarray  # (p,), m, of the window, relative to its centre
    high: np.ndarray  # (p,), m
    limits_view: bool
    region: Region | None


class Scene(NamedTuple):
    """What `scans_into` needs of a scenario; `single_target.scene_of` makes it."""

    field_of_view: View  # numba has its own `view`
    capacity: int  # detections that a scan has room for
    R: np.ndarray  # (p, p), of the true measurement noise
    detection_probability: float  # of the target
    # F (d, d), offset (d,) and H (p, d) by which `centre_into` places the window: empty for a fixed one
    window_motion: tuple[np.ndarray, np.ndarray, np.ndarray] | None  # None where the sensor is not linear


class Running(NamedTuple):
    """n episodes that are played side by side. Episode i follows the truth of[i] of m."""

    key: np.ndarray  # (n, 2)
    z_hat: np.ndarray  # (m, T, p), noise-free measurements of the truth
    of: np.ndarray  # (n,)
    t: np.ndarray  # (n,), the scan shown, T for none


class TargetDetection(NamedTuple):
    """The detection of the target that a scan may hold."""

    z: np.ndarray  # (p,)
    detected: bool
    slot: float  # in [0, 1): decides its place among the clutter


@kernel(plain_first=True)
def measure_all(z, key, R):
    """Adds measurement noise of covariance R (p, p), drawn by the key (2,), to the measurements z (T, p).

    Returns `detection_draw` and `slot` (T,), uniform in [0, 1). The target is detected where the first is
    below its detection probability; the second decides its detection's place among the clutter.
    """
    L, normal, detection_draw, slot = factor(R), np.empty(len(R)), np.empty(len(z)), np.empty(len(z))
    for t in range(len(z)):
        detection_draw[t], slot[t] = add_noise(z[t], key, t, L, normal)
    return detection_draw, slot


@leaf_kernel
def add_noise(z, key, t, L, normal):
    """`measure_all` for scan t alone, z (p,), with noise of covariance L L'; `normal` (p,) is overwritten."""
    at = (t, ZERO, ZERO)
    normals_into(normal, key, NOISE, at)
    for r in range(len(L)):
        noise = 0.0
        for c in range(r + 1):
            noise += L[r, c] * normal[c]
        z[r] += noise
    return pair(key, DETECTION, ZERO, at)


@kernel
def factor(R):
    """Lower Cholesky factor L (p, p) of the covariance R = L L'."""
    L = np.zeros_like(R)
    cholesky_into(L, R)
    return L


@kernel(plain_first=True)
def scan_into(z, view, key, t, centre, target, detected, slot):
    """Writes the k detections of scan t to the first rows of z (capacity, p), for a linear sensor.

    The view is placed at centre (p,), zeros for a fixed window. The target's detection (p,) is among them
    where it is `detected` and in view; `slot` in [0, 1) decides its place. Returns k and the target's row, -1
    for none. The rows from k on stay as they are.
    """
    return scan_by(z, view, key, t, centre, TargetDetection(target, detected, slot), buffer_for(len(z)))


@leaf_kernel
def scan_by(z, view, key, t, centre, own, buffer):
    """`scan_into` of a TargetDetection, with a buffer from `buffer_for` of as many points as z has rows."""
    target, seen, slot = own
    if view.limits_view:
        for c in range(len(target)):
            away = target[c] - centre[c]
            seen = seen and view.low[c] <= away and away <= view.high[c]
        seen = seen and _within(view.region, target)
    k, place = _clutter(z, view, view.region, key, t, centre, slot, buffer)
    if not seen:
        return k, -1
    return insert_into(z, k, place, target)


# numba leaves the other branch out for a region that is an argument of type None
@leaf_kernel
def _within(region, target):
    if region is None:
        return True
    for c in range(len(target)):
        if not (region.low[c] <= target[c] and target[c] <= region.high[c]):
            return False
    return True


@leaf_kernel
def _clutter(z, view, region, key, t, centre, slot, buffer):
    """`clutter_into`, or `ground_into` of a region, and the place of the target's detection."""
    if region is None:
        k = clutter_into(z, view, key, t, centre, buffer)
        return k, int(slot * (k + 1))
    return ground_into(z, view, key, t, centre, slot)


@kernel(nogil=True)
def scans_into(first, last, emitted, scene, running, estimates):
    """One scan of each of the running episodes first, ..., last - 1, empty past the last scan.

    It is written to `emitted`: z (n, capacity, p), and mask and origin (n, capacity) as `label_into` writes
    them. The estimates (n, d) are those of the scan before.
    """
    p, buffer = len(scene.R), buffer_for(scene.capacity)
    scratch = np.zeros(p), np.empty(p), np.empty(p), factor(scene.R), buffer
    _scans_into(first, last, scratch, emitted, scene, running, estimates)


@leaf_kernel
def _scans_into(first, last, scratch, emitted, scene, running, estimates):
    """`scans_into` without reference counting; with `scratch` last it took 3 % longer."""
    centre, measurement, normal, L, buffer = scratch
    z, mask, origin = emitted
    for i in range(first, last):
        k, place, t = 0, -1, running.t[i]
        if t < running.z_hat.shape[1]:
            centre_into(centre, scene.window_motion, estimates[i])
            for c in range(len(measurement)):
                measurement[c] = running.z_hat[running.of[i], t, c]
            detection_draw, slot = add_noise(measurement, running.key[i], t, L, normal)
            own = TargetDetection(measurement, detection_draw < scene.detection_probability, slot)
            k, place = scan_by(z[i], scene.field_of_view, running.key[i], t, centre, own, buffer)
        label_into(z[i], mask[i], origin[i], k, place)


@leaf_kernel(plain_first=True)
def label_into(z, mask, origin, k, place):
    """Writes mask and origin (capacity,) of a scan of k detections in the first rows of z (capacity, p).

    mask is 1 for a detection, else 0. origin is 0 in the target's row `place` (-1 for none), -1 for clutter
    and -2 for no detection. Rows of z from k on become zeros. All is written, whatever the arrays held:
    memory is faster from end to end than in parts, and slices than rows one by one.
    """
    mask[:k], origin[:k] = 1, -1
    mask[k:], origin[k:], z[k:] = 0, -2, 0.0
    if place >= 0:
        origin[place] = 0


@leaf_kernel(plain_first=True)
def centre_into(centre, window_motion, estimate):
    """Writes the centre (p,) of the next scan's window after the estimate (d,): zeros for an empty motion."""
    F, offset, H = window_motion
    d = len(F)
    for c in range(len(H)):
        centre[c] = 0.0
        for i in range(d):
            moved = offset[i]
            for j in range(d):
                moved += F[i, j] * estimate[j]
            centre[c] += H[c, i] * moved


@leaf_kernel(plain_first=True)
def insert_into(z, k, place, target):
    """Writes the target (p,) to row `place` of the first k rows of z; the row there before becomes the last.

    The order of the rows carries no information. Returns k + 1 and the place.
    """
    for c in range(len(target)):
        z[k, c] = z[place, c]
        z[place, c] = target[c]
    return k + 1, place


@leaf_kernel(plain_first=True)
def clutter_into(z, view, key, t, centre, buffer):
    """Writes the clutter of scan t, uniform in the window at centre (p,), to the first rows of z (capacity,
    p).

    `buffer` comes from `buffer_for`. Returns the number of points, always less than the rows.
    """
    at = (t, ZERO, ZERO)
    k = min(poisson(view.clutter_rate, key, COUNT, at), len(z) - 1)
    points_into(z[:k], view.low, view.high, centre, key, POSITIONS, at, buffer)
    return k


# it allocates: without the option it would be compiled as its callers, without reference counting
@kernel(_nrt=True)
def ground_into(z, view, key, t, centre, slot):
    """Writes the clutter of scan t that lies on the ground of a region and in the window at centre (2,).

    It goes to the first rows of z (capacity, 2). Returns the number of points, always less than the rows, and
    how many of them rank below `slot`. The clutter is a Poisson process, drawn cell by cell; each cell of the
    grid about the region's corner has its own streams. The points are ordered by ranks of their own: the
    order of the cells would show where the target is.
    """
    low, high, cells = np.empty(2), np.empty(2), np.empty((2, 2), np.int64)
    corner, expected = view.region.low, view.clutter_rate * CELL**2
    for c in range(2):
        low[c] = max(view.low[c] + centre[c], corner[c])
        high[c] = min(view.high[c] + centre[c], view.region.high[c])
        expected /= view.high[c] - view.low[c]
        if not low[c] < high[c]:
            return 0, 0
        cells[c, 0], cells[c, 1] = (low[c] - corner[c]) // CELL, (high[c] - corner[c]) // CELL
    ranks, k, none, one = np.empty(len(z)), ZERO, np.zeros(3), np.ones(3)
    for i in range(cells[0, 0], cells[0, 1] + 1):
        for j in range(cells[1, 0], cells[1, 1] + 1):
            # cells are counted from 1: counter word 0 holds the episode's other streams
            at = (t, i + 1, j + 1)
            points = np.empty((poisson(expected, key, GROUND_COUNT, at), 3))
            buffer = buffer_for(len(points))
            points_into(points, none, one, none, key, GROUND_POSITIONS, at, buffer)
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
