"""Recorded flights as truth, with the sensor and clutter of D'Ortenzio, section 4."""

from gmr_gym.data.loader import flight
from gmr_gym.scenarios.paths import shortened
from gmr_gym.scenarios.planar import along, following_box, path
from gmr_gym.simulation.single_target import Scenario

PERIOD = 1.0  # s
PAPER_DENSITY = 150 / (1316.5 * 662.5)  # m^-2, D'Ortenzio, Table 1


def recorded_flight(
    segment: str = "zero-gravity-departure",
    clutter_rate: float | None = None,
    clutter_density: float | None = None,
    detection_probability: float = 0.9,
    *,
    sensor_deviation: float = 60**0.5,
    told_sensor_deviation: float = 70**0.5,
    told_acceleration_deviation: float = 6.0,
    horizon: int | None = None,
    window=(1000.0, 1000.0),
) -> Scenario:
    """A recorded flight in clutter of D'Ortenzio's density, in a window that follows the submitted estimate.

    A box about the path would show where the path is.

    Parameters
    ----------
    segment : str
        One of `gmr_gym.data.flight_names()`.
    clutter_rate : float, optional
        False alarms per scan.
    clutter_density : float, optional
        False alarms per m^2 and scan; the paper's when neither is given.
    detection_probability : float
        P_D, of the truth and of the filter model.
    sensor_deviation : float
        Standard deviation of the true measurement noise, m.
    told_sensor_deviation : float
        Standard deviation of the measurement noise that the filter assumes, m.
    told_acceleration_deviation : float
        Standard deviation of the process noise that the filter assumes, m/s^2. These aircraft reach 8 m/s^2,
        where the paper's target reaches 3.
    horizon : int, optional
        Number of scans; all of the flight by default.
    window : (width, height)
        Size of the window, m.

    Returns
    -------
    Scenario

    Raises
    ------
    ValueError
        Naming the argument that is invalid.
    """
    x, start = path(flight(segment), PERIOD)
    if clutter_rate is None and clutter_density is None:
        clutter_density = PAPER_DENSITY
    return along(
        shortened(x, horizon),
        start,
        following_box(window),
        period=PERIOD,
        clutter_rate=clutter_rate,
        clutter_density=clutter_density,
        detection_probability=detection_probability,
        sensor_deviation=sensor_deviation,
        told_sensor_deviation=told_sensor_deviation,
        told_acceleration_deviation=told_acceleration_deviation,
    )
