"""Maybeck, Kozak and Smith, "Mixed-model multiple-hypothesis tracking of targets in clutter", section V.

An F-16 that flies level, turns and jinks, seen in the north-up plane.
"""

from bisect import bisect_right
from functools import partial

import numpy as np

from gmr_gym.checks import check_probability
from gmr_gym.data.loader import f16_flight
from gmr_gym.mixture import gaussian
from gmr_gym.models.kalman import position_sensor
from gmr_gym.models.model import Model, model
from gmr_gym.models.motions import constant_acceleration
from gmr_gym.scenarios.paths import moving_by_model, shortened, states_given
from gmr_gym.scenarios.planar import following_box
from gmr_gym.simulation.loss import detection_outside_gates
from gmr_gym.simulation.single_target import Scenario, Truth, scripted

PERIOD = 0.5  # s
SENSOR_DEVIATION = 10.0  # m, R = 100 m^2
JERKS = (0.5, 4.0)  # benign and aggressive
SWITCHING = ((0.9, 0.1), (0.1, 0.9))  # eq. 20; its own transpose
# Departs: not given. The variance of the position is the sensor's, the others are of a few units
PRIOR = (100.0, 100.0, 25.0, 25.0, 4.0, 4.0)  # m^2, m^2/s^2, m^2/s^4
PATIENCE = 5  # scans in a row
WILDEST = 20.0  # m/s^2: a target drawn with larger jerks may leave the action space


def agile_flight(
    clutter_density: float = 1e-4,
    detection_probability: float = 1.0,
    side: float = 200 * SENSOR_DEVIATION,
    jerks=JERKS,
    switching=SWITCHING,
    trajectory=None,
    horizon: int | None = None,
) -> Scenario:
    """The paper's scenario on a reconstructed flight; the paper's own is not published.

    Parameters
    ----------
    clutter_density : float
        False alarms per m^2 and scan.
    detection_probability : float
        P_D, of the truth and of the filter model.
    side : float
        Side of the square, m, in which clutter falls, centred on the predicted estimate.
    jerks : array_like (r,)
        Standard deviations of the change of the acceleration from scan to scan, m/s^2, one motion model each.
    switching : array_like (r, r)
        Transition matrix of the filter model, column-stochastic; not used for one motion model.
    trajectory : array_like (T, 6) or "drawn", optional
        Another truth, two scans per second: [north, up], velocities, accelerations, m and s. "drawn": a
        target that moves by the filter model, its motion models switching by `switching`, drawn anew in every
        episode.
    horizon : int, optional
        Number of scans; all of the path by default.

    Returns
    -------
    Scenario

    Raises
    ------
    ValueError
        Naming the argument that is invalid.

    References
    ----------
    Maybeck, Kozak and Smith, section V and eq. 20.
    """
    drawn = isinstance(trajectory, str)
    if drawn and trajectory != "drawn":
        raise ValueError(f"trajectory must be states (T, 6) or 'drawn', got {trajectory!r}")
    x = f16_flight() if trajectory is None or drawn else states_given("trajectory", trajectory, (6,), least=1)
    start = constant_acceleration(-PERIOD, 0.0).F @ x[0]
    if not 0 <= clutter_density <= 0.1:
        raise ValueError(f"clutter_density must lie between 0 and 0.1 per m^2, got {clutter_density}")
    check_probability("detection_probability", detection_probability)
    view = following_box((side, side))
    rate = clutter_density * view.volume
    if rate > 1e5:
        raise ValueError(f"clutter must be at most 1e5 false alarms per scan, got {rate:g} in the window")
    assumed = model(
        tuple(constant_acceleration(PERIOD, jerk) for jerk in _positive("jerks", jerks)),
        position_sensor(SENSOR_DEVIATION, rates=2),
        detection_probability,
        gate_probability=0.99 if rate > 0 else 1.0,
        clutter_density=max(clutter_density, np.finfo(float).tiny),
        prior=gaussian(start, np.diag(PRIOR)),
        switching=np.ones((1, 1)) if np.size(jerks) == 1 else switching,
    )
    if drawn and np.max(jerks) > WILDEST:
        raise ValueError(f"jerks must be at most {WILDEST} m/s^2 for a drawn target, got {jerks}")
    x = shortened(x, horizon)
    return Scenario(
        model=assumed,
        truth=partial(_switching, assumed, len(x)) if drawn else partial(scripted, x),
        sensor=assumed.sensor,
        detection_probability=detection_probability,
        clutter_rate=float(rate),
        window=view,
        horizon=len(x),
        period=PERIOD,
        position=(0, 1),
        velocity=(2, 3),
        loss_rule=detection_outside_gates,
        patience=PATIENCE,
        cutoff=500.0,
    )


def _switching(assumed: Model, horizon: int, rng: np.random.Generator) -> Truth:
    """One truth drawn from the filter model: a Markov chain of modes, and the motions of those modes."""
    now, mode = rng.choice(len(assumed.motions), p=assumed.mode_prior), np.empty(horizon, int)
    cumulated = assumed.switching.cumsum(axis=0)
    columns = (cumulated / cumulated[-1]).T.tolist()
    for t, u in enumerate(rng.random(horizon).tolist()):  # `rng.choice` would look at the columns every time
        mode[t] = now = bisect_right(columns[now], u)
    return moving_by_model(assumed, mode, rng)


def _positive(name: str, values) -> list[float]:
    values = np.atleast_1d(np.array(values, float))
    if values.ndim != 1 or not ((values > 0) & np.isfinite(values)).all():
        raise ValueError(f"{name} must be positive numbers, got {values.tolist()}")
    return values.tolist()
