"""Where detections and tracks lie: in local coordinates, and on Earth."""

import numpy as np

from gmr_gym.recorded.detections import POLAR, Detections
from gmr_gym.recorded.geodesy import from_local

MARGIN, LEAST_MARGIN = 0.1, 100.0  # of the extent of the detections, and m, in which targets may be beside it


def local_positions(detections: Detections) -> np.ndarray:
    """Positions (n, p) in local coordinates, m, NaN in those that a sensor does not measure.

    Polar detections of range and azimuth alone are taken to lie in the plane of their sensor.

    Parameters
    ----------
    detections : Detections
    """
    found = np.array(detections.z)
    for i, spec in enumerate(detections.sensors):
        rows = detections.sensor == i
        if spec.kind == POLAR:
            z = detections.z[rows]
            elevation = z[:, 2] if spec.p > 2 else np.zeros(len(z))
            across, azimuth = z[:, 0] * np.cos(elevation), z[:, 1]
            away = [across * np.cos(azimuth), across * np.sin(azimuth), z[:, 0] * np.sin(elevation)]
            found[rows, : spec.p] = (detections.origin[rows] + np.stack(away, axis=1))[:, : spec.p]
    return found


def box_of(detections: Detections) -> tuple[np.ndarray, np.ndarray]:
    """Corners (p,) of the box in which targets may be, m: all detections, and some room beside them.

    Parameters
    ----------
    detections : Detections

    Raises
    ------
    ValueError
        If there are none.
    """
    if not len(detections.time):
        raise ValueError("there are no detections to track")
    points = local_positions(detections)
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    margin = np.maximum(MARGIN * (high - low), LEAST_MARGIN)
    return low - margin, high + margin


def geodetic(points: np.ndarray, reference: tuple[float, float, float]) -> np.ndarray:
    """Latitude and longitude, deg, and height, m, (m, 3) of local points (m, 2) or (m, 3), m.

    Points of the plane are put on the ellipsoid at the height of the reference, east and north of it as they
    are.
    """
    there = np.zeros((len(points), 3))
    there[:, : points.shape[1]] = points
    found = from_local(there, reference)
    if points.shape[1] == 2:
        for _ in range(3):  # each leaves about 1e-3 of the error
            there[:, 2] += reference[2] - found[:, 2]
            found = from_local(there, reference)
    return found
