"""Zhang and Liu, "Single maneuvering target tracking in clutter based on multiple model algorithm with
Gaussian mixture reduction", section 6.1.

A target that switches between constant accelerations.
"""

from functools import partial
from itertools import pairwise

import numpy as np

from gmr_gym.checks import check_probability
from gmr_gym.mixture import gaussian
from gmr_gym.models.kalman import Motion, motion, sensor
from gmr_gym.models.model import Model, model
from gmr_gym.models.switching import sticky_switching
from gmr_gym.scenarios.paths import moving_by_model
from gmr_gym.scenarios.planar import fixed_box, following_box
from gmr_gym.simulation.loss import truth_outside_gates
from gmr_gym.simulation.single_target import Scenario, Truth, Window

PERIOD = 1.0  # s
# [px, py, vx, vy], m and m/s. Departs: the states are in the order of the other scenarios, the paper's
# is [x, vx, y, vy]; y_0 is printed as 2 000 000
START = (250_000.0, 200_000.0, -100.0, -300.0)
PRIOR = (1000.0, 1000.0, 10.0, 10.0)  # m^2 and m^2/s^2, the diagonal of P_0
SENSOR_VARIANCE = 10.0  # m^2
ACCELERATIONS = ((0.0, 0.0), (0.0, 2.0), (2.0, 0.0), (0.0, -2.0), (-2.0, 0.0))  # Table 2, m/s^2
SCANS = 45
# Departs: when and to what the target switches is not given beyond "at k = 16 and k = 30"; scans 1 to
# 15 are the first model's, 16 to 29 and 30 to 45 another's, each of the others equally likely
SWITCHES = (16, 30)
# Departs: not given; a mode lasts fifteen scans on average, as in the truth
STAY = 14 / 15
# Departs: both cases print 3e-3, though the second is said to be denser; the first gate then holds 240
# false alarms and most tracks are lost
CLUTTER = {"1": 1e-4, "2": 3e-4, "stress": 1e-3, "clear": 0.0}  # m^-2
GATE = 25.0  # squared Mahalanobis distance; the paper gives none
MARGIN = 2750.0  # m, of the region about the nominal path: 10 km by 19 km for the paper's models
WIDEST = 20_000.0  # m, of a window on clutter: twice the region
DENSEST = 0.1  # m^-2, a hundred times the stress case: clutter is drawn by cells of 500 m


def jump_markov(
    case: str | int = "1",
    clutter_density: float | None = None,
    detection_probability: float = 1.0,
    process_variance: float = 1.0,
    discretisation: str = "printed",
    accelerations=ACCELERATIONS,
    stay: float = STAY,
    window=(1000.0, 1000.0),
) -> Scenario:
    """The paper's scenario; every number can be changed. The filter has the true motion models.

    Clutter fills a region of 10 km by 19 km and lies on its ground; the window follows the estimate.

    Parameters
    ----------
    case : {"1", "2", "stress", "clear"}
        Clutter of 1e-4, 3e-4, 1e-3 or no false alarms per m^2.
    clutter_density : float, optional
        False alarms per m^2 and scan, instead of the case's.
    detection_probability : float
        P_D, of the truth and of the filter model.
    process_variance : float
        Q is this times the identity: (m/s)^2 as printed, (m/s^2)^2 in the standard form.
    discretisation : {"printed", "standard"}
        "printed": B = [0; T] and G = [T; 1] per axis; "standard": both [T^2/2; T].
    accelerations : array_like (r, 2)
        m/s^2, one motion model each. The target starts with the first.
    stay : float
        Probability of keeping a motion model, in the filter model; the others share the rest equally.
    window : (width, height)
        Size of the window, m.

    Returns
    -------
    Scenario

    Raises
    ------
    ValueError
        Naming the argument that is invalid.

    References
    ----------
    Zhang and Liu, section 6.1 and Table 2.
    """
    view = following_box(window)
    density = _checked_density(case, clutter_density, view)
    if not 0 <= stay <= 1:
        raise ValueError(f"stay must lie in [0, 1], got {stay}")
    check_probability("detection_probability", detection_probability)
    motions = _motions(accelerations, process_variance, discretisation)
    assumed = model(
        motions,
        sensor(np.eye(2, 4), SENSOR_VARIANCE * np.eye(2)),
        detection_probability,
        # a target outside every gate at acquisition would be lost for good: the gates leave out 4 in a
        # million, and at P_D = 1 a miss keeps that weight. Without clutter nothing is gated
        gate_probability=float(-np.expm1(-GATE / 2)) if density > 0 else 1.0,
        clutter_density=max(density, np.finfo(float).tiny),
        prior=gaussian(START, np.diag(PRIOR)),
        switching=sticky_switching(stay, len(motions)),
    )
    return Scenario(
        model=assumed,
        truth=partial(_jumping, assumed),
        sensor=assumed.sensor,
        detection_probability=detection_probability,
        clutter_rate=density * view.volume,
        window=view,
        horizon=SCANS,
        period=PERIOD,
        position=(0, 1),
        velocity=(2, 3),
        loss_rule=partial(truth_outside_gates, assumed.sensor.H),
        patience=1,
        cutoff=100.0,
        region=_region(np.abs(accelerations).max(), process_variance),
    )


def _checked_density(case, clutter_density, view: Window) -> float:
    if str(case) not in CLUTTER:
        raise ValueError(f"case must be one of {', '.join(CLUTTER)}, got {case!r}")
    density = CLUTTER[str(case)] if clutter_density is None else clutter_density
    if not 0 <= density <= DENSEST:
        raise ValueError(f"clutter_density must lie between 0 and {DENSEST} per m^2, got {density}")
    if density * view.volume > 1e5:
        raise ValueError(
            f"clutter must be at most 1e5 false alarms per scan, got {density * view.volume:g} in the window"
        )
    if density > 0 and (view.high > WIDEST / 2).any():
        raise ValueError(f"window must be at most {WIDEST:g} m wide and high where there is clutter")
    return density


def _motions(accelerations, process_variance, discretisation) -> tuple[Motion, ...]:
    """Eq. 1 with the matrices of section 6.1. Departs: F is printed as diag(1, T, 1, T), and G under
    the name of F."""
    try:
        accelerations = np.array(accelerations, float)
    except (TypeError, ValueError):
        raise ValueError(f"accelerations must be rows (ax, ay) of numbers, got {accelerations}") from None
    if accelerations.ndim != 2 or accelerations.shape[1] != 2 or len(accelerations) == 0:
        raise ValueError(f"accelerations must have shape (r, 2) with r >= 1, got {accelerations.shape}")
    if not (np.abs(accelerations) <= 100).all():
        raise ValueError("accelerations must be finite and within 100 m/s^2")
    if not 0 < process_variance <= 1e4:
        raise ValueError(f"process_variance must be positive and at most 1e4, got {process_variance}")
    T, eye = PERIOD, np.eye(2)
    columns = {
        "printed": ((0.0, T), (T, 1.0)),
        "standard": ((T**2 / 2, T), (T**2 / 2, T)),
    }
    if discretisation not in columns:
        raise ValueError(f"discretisation must be one of {', '.join(columns)}, got {discretisation!r}")
    B, G = (np.vstack([position * eye, velocity * eye]) for position, velocity in columns[discretisation])
    F = np.block([[eye, T * eye], [np.zeros((2, 2)), eye]])
    Q = process_variance * G @ G.T
    return tuple(motion(F, Q, B @ u) for u in accelerations)


def _jumping(assumed: Model, rng: np.random.Generator) -> Truth:
    """One truth: the first motion model, at each switch one of the others, with process noise throughout."""
    mode = np.zeros(SCANS, int)
    for first, last in pairwise((*SWITCHES, SCANS + 1)):
        others = np.delete(np.arange(len(assumed.motions)), mode[first - 2])
        mode[first - 1 : last - 1] = rng.choice(others) if len(others) else 0
    return moving_by_model(assumed, mode, rng)


def _region(acceleration, process_variance):
    """Ground that targets of the largest acceleration (m/s^2) and the process noise do not leave."""
    start = np.array(START)
    path = start[:2] + np.outer((0, SCANS * PERIOD), start[2:])
    margin = MARGIN * max(1.0, acceleration / np.max(ACCELERATIONS), process_variance**0.5)
    return fixed_box(path.min(axis=0) - margin, path.max(axis=0) + margin)
