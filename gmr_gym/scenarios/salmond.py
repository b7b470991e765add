"""A target of a second-order model in uniform clutter, in the plane: the problem that Salmond's reduction was
tried on, in units of the sensor's deviation and of the time between scans.

The units settle every number but two: how fast the target manoeuvres, and how dense the clutter is. Crouse,
Willett, Pattipati and Svensson try reductions in a problem of this kind, whose numbers are not known.
"""

from functools import partial

import numpy as np

from gmr_gym.checks import check_not_negative, check_probability
from gmr_gym.mixture import gaussian
from gmr_gym.models.kalman import position_sensor
from gmr_gym.models.model import Model, model
from gmr_gym.models.motions import constant_velocity
from gmr_gym.scenarios.paths import moving_by_model
from gmr_gym.scenarios.planar import following_box
from gmr_gym.simulation.loss import truth_outside_gates
from gmr_gym.simulation.single_target import Scenario, Truth

SCANS = 50
GATE_PROBABILITY = 0.999
KNOWN = 1e-4  # variance of the initial state, which is known exactly in the paper
SIDE = 60.0  # of the window about the prediction in which clutter falls


def second_order(
    acceleration: float = 0.3, clutter: float = 0.02, detection_probability: float = 1.0
) -> Scenario:
    """The problem; the filter has the true model. A track is lost when the true position lies outside every
    gate.

    Parameters
    ----------
    acceleration : float
        Standard deviation of the target's acceleration, s T^2 / r in the sensor's deviation r, m, and the
        time T between scans, s: the manoeuvre index.
    clutter : float
        False alarms per scan and r^2.
    detection_probability : float
        P_D.

    Returns
    -------
    Scenario

    Raises
    ------
    ValueError
        Naming the argument that is invalid.

    References
    ----------
    Salmond, Mixture reduction algorithms for target tracking in clutter, SPIE 1305, 1990.
    """
    if not 0 < acceleration <= 100:
        raise ValueError(f"acceleration must be positive and at most 100, got {acceleration}")
    if check_not_negative("clutter", clutter) > 10:
        raise ValueError(f"clutter must be at most 10, got {clutter}")
    check_probability("detection_probability", detection_probability)
    window = following_box((SIDE, SIDE))
    assumed = model(
        constant_velocity(1.0, acceleration),
        position_sensor(1.0),
        detection_probability,
        gate_probability=GATE_PROBABILITY,
        clutter_density=max(clutter, np.finfo(float).tiny),
        prior=gaussian(np.zeros(4), KNOWN * np.eye(4)),
    )
    return Scenario(
        model=assumed,
        truth=partial(_moving, assumed),
        sensor=assumed.sensor,
        detection_probability=detection_probability,
        clutter_rate=clutter * window.volume,
        window=window,
        horizon=SCANS,
        period=1.0,
        position=(0, 1),
        velocity=(2, 3),
        loss_rule=partial(truth_outside_gates, assumed.sensor.H),
        patience=1,
        cutoff=SIDE,
    )


def _moving(assumed: Model, rng: np.random.Generator) -> Truth:
    return moving_by_model(assumed, np.zeros(SCANS, int), rng)
