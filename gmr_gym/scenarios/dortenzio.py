"""D'Ortenzio, Manes and Orguner, "Adaptive mixture approximation for target tracking in clutter",
section 4: one turning target, a fixed field of view, a filter that is told a little wrong."""

import numpy as np

from gmr_gym.models.motions import constant_velocity
from gmr_gym.scenarios.planar import along, bounding_box, fixed_box, following_box, path, shortened
from gmr_gym.simulation.single_target import Scenario

PERIOD = 1.0  # s
START = (0.0, 0.0, 10.0, -10.0)  # [px, py, vx, vy], m and m/s
# Departs: eq. 20 prints u2 = [0, 2], whose path spans 1316 x 3521 m and leaves the stated field of
# view of about 700 x 1300 m; with the lost minus sign it spans 1316.5 x 662.5 m.
ACCELERATIONS = ((50, (0.2, 0.6)), (25, (0.0, -2.0)), (25, (-3.0, 1.0)))  # scans, m/s^2


def turning_target(
    clutter_rate: float | None = None,
    clutter_density: float | None = None,
    detection_probability: float = 0.9,
    sensor_deviation: float = 60**0.5,
    told_sensor_deviation: float = 70**0.5,
    told_acceleration_deviation: float = 3.0,
    horizon: int | None = None,
    box=None,
    window=None,
    trajectory=None,
) -> Scenario:
    """The paper's scenario, 150 false detections a scan, every number of it open to change.

    clutter_rate (per scan) or clutter_density (per m^2): 150 a scan when neither is given.
    sensor_deviation: of the detections, m; the told_ figures (m, m/s^2) are the filter's.
    box: ((x, y), (x, y)), m, the field of view on the ground; the path's bounding box when None.
    window: (width, height), m, of a field of view that follows the submitted estimate instead.
    trajectory: (T, 2) or (T, 4), another truth at one scan a second, m and m/s.
    """
    if trajectory is None:
        x, start = printed_path(), np.array(START)
    else:
        x, start = path(trajectory, PERIOD)
    if box is not None and window is not None:
        raise ValueError("give either box (fixed on the ground) or window (following the estimate)")
    if window is not None:
        view = following_box(window)
    elif box is not None:
        view = fixed_box(*box)
    else:
        view = bounding_box(np.vstack([start, x])[:, :2])
    if clutter_rate is None and clutter_density is None:
        clutter_rate = 150.0
    return along(
        shortened(x, horizon),  # after the box: a shorter episode has no denser clutter
        start,
        view,
        period=PERIOD,
        clutter_rate=clutter_rate,
        clutter_density=clutter_density,
        detection_probability=detection_probability,
        sensor_deviation=sensor_deviation,
        told_sensor_deviation=told_sensor_deviation,
        told_acceleration_deviation=told_acceleration_deviation,
    )


def printed_path() -> np.ndarray:
    """States (100, 4) of eq. 20; the truth has no process noise."""
    F = constant_velocity(PERIOD, 1.0).F
    x, states = np.array(START), []
    for scans, acceleration in ACCELERATIONS:
        u = np.array(acceleration)
        for _ in range(scans):
            x = F @ x + np.concatenate((PERIOD**2 / 2 * u, PERIOD * u))
            states.append(x)
    return np.array(states)
