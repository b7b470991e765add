"""Real aircraft as truth: recorded flights, seen through the sensor and clutter of
D'Ortenzio, section 4."""

from gmr_gym.data.loader import flight
from gmr_gym.scenarios.planar import along, following_box, path, shortened
from gmr_gym.simulation.single_target import Scenario

PERIOD = 1.0  # s
PAPER_DENSITY = 150 / (1316.5 * 662.5)  # m^-2, D'Ortenzio, Table 1


def recorded_flight(
    segment: str = "zero-gravity-departure",
    clutter_rate: float | None = None,
    clutter_density: float | None = None,
    detection_probability: float = 0.9,
    sensor_deviation: float = 60**0.5,
    told_sensor_deviation: float = 70**0.5,
    told_acceleration_deviation: float = 6.0,
    horizon: int | None = None,
    window=(1000.0, 1000.0),
) -> Scenario:
    """A recorded flight in clutter of the paper's density, in a window (width, height), m, that
    follows the submitted estimate: a box about the path would give the path away.

    segment: one of gmr_gym.data.flight_names(); the rest as in TurningTarget, except that the filter
    is told 6 m/s^2, since these aircraft pull up to 8 where the paper's target pulls 3.
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
