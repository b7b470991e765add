"""A square in which a sensor of positions sees many targets: what such scenarios share."""

from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.checks import _check_positive, check_choice, check_whole
from gmr_gym.mixture import Mixture
from gmr_gym.models.clutter import Clutter, uniform_clutter
from gmr_gym.models.kalman import Motion, position_sensor
from gmr_gym.models.multi_target import multi_target_model
from gmr_gym.scenarios.paths import many_given, shortened, unvaried
from gmr_gym.simulation.multi_target import MultiTargetScenario
from gmr_gym.simulation.shadows import shadowed

SIDE = 1000.0  # m, of the square about 0
PERIOD = 1.0  # s
SURVIVAL = 0.99  # P_S
SPREAD = SIDE / 3  # m, standard deviation of births on each axis
CUTOFF = 25.0  # m, of the distance between sets
MOST = 1000  # targets


class Assumed(NamedTuple):
    """What trackers assume of the targets."""

    motions: tuple[Motion, ...]
    speed: float  # m/s, standard deviation of a new target's velocity on each axis
    born: float  # expected number of births a scan
    there: float  # expected number of targets before the first scan
    switching: np.ndarray | None = None  # of the motions


class Seen(NamedTuple):
    """How the sensor sees the square."""

    detection_probability: float
    clutter_rate: float  # false alarms a scan, uniform
    sensor_deviation: float  # m
    shadows: Any  # see `shadowed`
    hot_spots: Any  # (false alarms a scan, (x, y), deviation), m
    told: Any  # "uniform", or "true" for trackers that assume shadows and hot spots too


def in_square(
    assumed: Assumed,
    seen: Seen,
    paths: Callable[[np.random.Generator], np.ndarray],
    targets: int,
    scans: int,
    trajectory: Any,
    horizon: int | None,
) -> MultiTargetScenario:
    """Scenario of targets in the square.

    Unless they are told, trackers assume P_D as outside all shadows, and the expected number of false alarms
    spread evenly.

    Parameters
    ----------
    assumed : Assumed
    seen : Seen
    paths : callable
        Draws the states (scans, targets, 4), nan where a target is absent.
    targets, scans : int
    trajectory : array_like (T, m, 4) or None
        States that are taken in their place.
    horizon : int or None
        Number of scans; all for None.

    Returns
    -------
    MultiTargetScenario

    Raises
    ------
    ValueError
        Naming the argument that is invalid.
    """
    probability = shadowed(seen.detection_probability, seen.shadows)
    _check_positive(sensor_deviation=seen.sensor_deviation)
    told = "true" if seen.told is True else seen.told  # a command line reads true as a literal
    check_choice("told", told, ("uniform", "true"))
    true = _clutter(seen)
    evenly = uniform_clutter(true.low, true.high, true.expected)
    P_D, clutter = (probability, true) if told == "true" else (seen.detection_probability, evenly)
    if trajectory is None:
        scans = len(shortened(np.empty(scans), horizon))
        truth = partial(_first, paths, scans)
    else:
        x = shortened(many_given("trajectory", trajectory, (4,)), horizon)
        scans, targets = x.shape[:2]
        truth = partial(unvaried, x)
    sensor = position_sensor(seen.sensor_deviation)
    where = np.zeros((1, 4)), np.diag(np.repeat([SPREAD, assumed.speed], 2) ** 2)[None]
    return MultiTargetScenario(
        model=multi_target_model(
            assumed.motions, sensor, P_D, SURVIVAL, Mixture(np.array([assumed.born]), *where),
            clutter, initial=Mixture(np.array([assumed.there]), *where), switching=assumed.switching,
        ),
        truth=truth,
        targets=targets,
        sensor=sensor,
        detection_probability=probability,
        clutter=partial(constant_clutter, true),
        horizon=scans,
        period=PERIOD,
        position=(0, 1),
        velocity=(2, 3),
        cutoff=CUTOFF,
        order=2.0,
    )  # fmt: skip


def check_number(n: int) -> None:
    """ValueError where n is no number of targets."""
    check_whole("n", n, 1)
    if n > MOST:
        raise ValueError(f"n must be at most {MOST} targets, got {n}")


def inside(x: np.ndarray, middle: int) -> np.ndarray:
    """States (T, m, 4), nan from where a target leaves the square, before and after the scan `middle`."""
    there = (np.abs(x[:, :, :2]) <= SIDE / 2).all(axis=2)
    there[middle:] = np.logical_and.accumulate(there[middle:])
    there[: middle + 1] = np.logical_and.accumulate(there[middle::-1])[::-1]
    return np.where(there[..., None], x, np.nan)


def constant_clutter(clutter: Clutter, t: int) -> Clutter:
    """The clutter of a scenario in which it is the same at every scan t."""
    return clutter


def _clutter(seen: Seen) -> Clutter:
    if not 0 < seen.clutter_rate <= 1e4:
        raise ValueError(f"clutter_rate must be positive and at most 1e4 per scan, got {seen.clutter_rate}")
    clutter = uniform_clutter(np.full(2, -SIDE / 2), np.full(2, SIDE / 2), seen.clutter_rate)
    try:
        spots = [(float(rate), (float(x), float(y)), float(off)) for rate, (x, y), off in seen.hot_spots]
    except (TypeError, ValueError):
        raise ValueError(
            f"hot_spots must be (false alarms a scan, (x, y), deviation) each, got {seen.hot_spots!r}"
        ) from None
    for rate, centre, off in spots:
        if not (0 < rate <= 1e4 and max(map(abs, centre)) <= 1e6 and 0 < off <= 1e6):
            raise ValueError(
                f"hot_spots must be of positive rates at finite places, got {(rate, centre, off)}"
            )
    if not spots:
        return clutter
    w, m, deviation = (np.array(part, float) for part in zip(*spots, strict=True))
    return clutter._replace(gaussians=Mixture(w, m, deviation[:, None, None] ** 2 * np.eye(2)))


def _first(paths: Callable, scans: int, rng: np.random.Generator) -> np.ndarray:
    return paths(rng)[:scans]
