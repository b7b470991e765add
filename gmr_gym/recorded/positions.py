"""Where detections lie, in local coordinates."""

import numpy as np

from gmr_gym.recorded.detections import POLAR, Detections


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
