"""Li, Wu and Zhang, "An interacting multiple models probabilistic data association algorithm for maneuvering
target tracking in clutter", section 4.

A highly manoeuvring target, seen by an aircraft's radar. The paper gives only the period and the models; all
other numbers are ours.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_probability
from gmr_gym.mixture import gaussian
from gmr_gym.models.model import Model, model
from gmr_gym.models.motions import constant_velocity, singer, with_accelerations
from gmr_gym.models.radar import WIDEST, modified_unbiased, radar, spherical
from gmr_gym.models.switching import sticky_switching
from gmr_gym.scenarios.paths import moving_by_model, shortened, states_given
from gmr_gym.simulation.loss import truth_outside_gates
from gmr_gym.simulation.single_target import Scenario, Truth, Window, scripted

DURATION = 60.0  # s, of the legs
SCANS = 600  # of a drawn target
SPEED = 298.0  # m/s, of the target
HEADING = -0.1  # rad, from x towards y, at first
WANDERING = 2.0  # m/s^2, standard deviation of the acceleration of a target that flies straight, per scan
PLATFORM = np.array([250.0, 0.0, 0.0])  # m/s, of the radar's aircraft, which flies straight
GRAVITY = 9.80665  # m/s^2
# seconds, turn about the vertical and pull out of the horizontal, g, with which the target flies: straight, a
# turn of 5.5 g, straight, a turn back at 6 g, straight, a climb and a dive at 5 g, straight
LEGS = (
    (8.0, 0.0, 0.0), (9.0, 5.5, 0.0), (6.0, 0.0, 0.0), (9.0, -6.0, 0.0), (6.0, 0.0, 0.0), (4.0, 0.0, 5.0),
    (8.0, 0.0, -5.0), (4.0, 0.0, 5.0), (6.0, 0.0, 0.0),
)  # fmt: skip
JERK_TIME = 0.5  # s, in which a load comes on
SIGHT = 8.0  # standard deviations of an angle, half the window's width
DEPTH = 500.0  # m, half the window's depth, or
BENT = 8.0  # times r s^2 where that is more: r s^2 is the scale of the range bias from angle errors
UNSURE = (0.0, 20.0, 10.0)  # m/s and m/s^2, standard deviations of the prior's velocity and acceleration
PATIENCE = 10  # scans in a row


class Regime(NamedTuple):
    """Distance of the target and accuracy of the radar. What counts is r s^2 / s_r."""

    start: tuple[float, float, float]  # m, of the target relative to the radar
    range_deviation: float  # m
    angle_deviation: float  # rad


REGIMES = {
    "near": Regime((11_200.0, 4_100.0, 1_500.0), 20.0, 0.002),
    "far": Regime((51_500.0, 18_800.0, 4_000.0), 20.0, 0.025),
    "extreme": Regime((137_500.0, 50_000.0, 8_000.0), 5.0, 0.040),
}


def airborne_radar(
    regime: str = "far",
    clutter_rate: float = 25.0,
    detection_probability: float = 0.9,
    *,
    range_deviation: float | None = None,
    angle_deviation: float | None = None,
    update: str = "debiased",
    time_constant: float = 5.0,
    acceleration: float = 30.0,
    stay: float = 0.95,
    period: float = 0.1,
    trajectory=None,
    platform=None,
    horizon: int | None = None,
) -> Scenario:
    """A target that flies straight, turns at 5 to 6 g, climbs and dives, seen from a moving aircraft.

    Every episode displaces the default path by one draw from the prior: in position by the covariance of one
    detection, in velocity by 20 m/s on each axis. What is tracked is the target relative to the platform.

    Parameters
    ----------
    regime : {"near", "far", "extreme"}
        Where the target starts, and the accuracy of the radar.
    clutter_rate : float
        False alarms per scan, uniform in range, azimuth and elevation about the submitted estimate.
    detection_probability : float
        P_D, of the truth and of the filter model.
    range_deviation, angle_deviation : float, optional
        Standard deviations of range, m, and of azimuth and elevation, rad, instead of the regime's.
    update : str
        How a tracker updates a Gaussian by a detection, one of `gmr_gym.models.radar.UPDATES`.
    time_constant, acceleration : float
        Time constant, s, and acceleration, m/s^2, of the Singer model, which the filter model has beside
        nearly constant velocity.
    stay : float
        Probability that a motion model lasts from scan to scan.
    period : float
        Time between scans, s.
    trajectory : array_like (T, 3) or (T, 6), or "drawn", optional
        Positions of the target, or positions and velocities, one row per scan. "drawn": a target that moves
        by the filter model, nearly constant velocity alone, drawn anew in every episode.
    platform : array_like (T, 3) or (T, 6), optional
        The same of the radar. Its turns are unknown to the tracker.
    horizon : int, optional
        Number of scans; all of the path by default.

    Returns
    -------
    Scenario

    Raises
    ------
    ValueError
        Naming the argument that is invalid; also if target and platform come within 10 standard deviations of
        the range of each other, where a bearing means nothing.

    References
    ----------
    Li, Wu and Zhang, section 4.
    """
    if regime not in REGIMES:
        raise ValueError(f"regime must be one of {', '.join(REGIMES)}, got {regime!r}")
    chosen = REGIMES[regime]
    sharp = chosen.range_deviation if range_deviation is None else range_deviation
    angle = chosen.angle_deviation if angle_deviation is None else angle_deviation
    if not 0 < sharp < np.inf:
        raise ValueError(f"range_deviation must be positive and finite, got {sharp}")
    if not 0 < angle <= WIDEST:
        raise ValueError(f"angle_deviation must be positive and at most {WIDEST} rad, got {angle}")
    check_probability("detection_probability", detection_probability)
    if not 0 <= clutter_rate <= 1e5:
        raise ValueError(f"clutter_rate must lie between 0 and 1e5 per scan, got {clutter_rate}")
    if not 0.01 <= period <= 10:
        raise ValueError(f"period must lie between 0.01 and 10 s, got {period}")
    drawn = isinstance(trajectory, str) and trajectory == "drawn"
    if drawn:
        velocity = SPEED * np.array([np.cos(HEADING), np.sin(HEADING), 0.0])
        target = _straight(chosen.start, velocity, horizon or SCANS, period)
    elif trajectory is None:
        target = flight(np.array(chosen.start), period)
    else:
        target = _states("trajectory", trajectory, period)
    if platform is None:
        radars = _straight(np.zeros(3), PLATFORM, len(target), period)
    else:
        radars = _states("platform", platform, period)
    if len(radars) != len(target):
        raise ValueError(f"platform must have as many scans as the target, {len(target)}, got {len(radars)}")
    x = shortened(target - radars, horizon)
    nearest = np.linalg.norm(x[:, :3], axis=1).min()
    if nearest < 10 * sharp:
        raise ValueError(
            f"platform and target must keep 10 sigma of the range apart, but come within {nearest:g} m"
        )
    # at most one full turn, beyond which clutter would fall twice
    bend = float(np.linalg.norm(x[0, :3])) * angle**2
    half = np.array([max(DEPTH, BENT * bend), min(SIGHT * angle, np.pi), SIGHT * angle])
    # without clutter there is no need to hide detections outside the window
    window = Window(-half, half, follows=True, limits_view=clutter_rate > 0)
    density = clutter_rate / window.volume
    start = x[0].copy()
    start[:3] -= period * start[3:6]
    start[6:] = 0.0
    prior = np.diag(np.repeat(UNSURE, 3) ** 2)
    # the position has the covariance of one detection
    prior[:3, :3] = modified_unbiased(spherical(start[None, :3]), (sharp, angle, angle)).R[0]
    motions = [with_accelerations(constant_velocity(period, WANDERING, 3))]
    if not drawn:
        motions.append(singer(period, time_constant, acceleration, 3))
    assumed = model(
        tuple(motions),
        radar((sharp, angle, angle), 9, update),
        detection_probability,
        gate_probability=0.999 if clutter_rate > 0 else 1.0,
        clutter_density=max(density, np.finfo(float).tiny),
        prior=gaussian(start, prior),
        switching=sticky_switching(stay, len(motions)),
    )  # fmt: skip
    truth = partial(scripted, x)
    if drawn:
        truth = partial(_nearly_constant_velocity, assumed, len(x))
    elif trajectory is None:
        truth = partial(_displaced, x, period, prior[:6, :6])
    return Scenario(
        model=assumed,
        truth=truth,
        sensor=assumed.sensor,
        detection_probability=detection_probability,
        clutter_rate=float(clutter_rate),
        window=window,
        horizon=len(x),
        period=period,
        position=(0, 1, 2),
        velocity=(3, 4, 5),
        loss_rule=partial(truth_outside_gates, assumed.sensor.H),
        patience=PATIENCE,
        cutoff=5 * float(np.sqrt(np.trace(prior[:3, :3]))),
    )


def _nearly_constant_velocity(assumed: Model, horizon: int, rng: np.random.Generator) -> Truth:
    return moving_by_model(assumed, np.zeros(horizon, int), rng)


def _displaced(x: np.ndarray, period: float, P: np.ndarray, rng: np.random.Generator) -> Truth:
    """The path x (T, 9), displaced by one draw of covariance P (6, 6) for the position and velocity one
    period before the first scan.
    """
    off = np.linalg.cholesky(P) @ rng.standard_normal(6)
    time = period * np.arange(1, len(x) + 1)[:, None]
    displaced = x.copy()
    displaced[:, :3] += off[:3] + time * off[3:]
    displaced[:, 3:6] += off[3:]
    return scripted(displaced, rng)


def flight(start: np.ndarray, period: float) -> np.ndarray:
    """States of the target at the scans of one minute, flown at constant speed.

    The target follows `LEGS`; each load comes on and off within `JERK_TIME`.

    Parameters
    ----------
    start : ndarray (3,)
        Position one period before the first scan, m.
    period : float
        Time between scans, s.

    Returns
    -------
    ndarray (T, 9)
        Positions, velocities and accelerations, m and s.
    """
    step = 1e-3
    times = step * np.arange(1, round(DURATION / step) + 1)
    ends = np.cumsum([seconds for seconds, _, _ in LEGS])
    leg = np.minimum(np.searchsorted(ends, times, side="left"), len(LEGS) - 1)
    smooth = np.ones(int(JERK_TIME / step)) * step / JERK_TIME
    loads = GRAVITY * np.array([load for _, *load in LEGS])[leg]
    turn, pull = (np.convolve(load, smooth)[: len(times)] for load in loads.T)
    climb = np.cumsum(pull) * step / SPEED
    heading = HEADING + np.cumsum(turn / np.cos(climb)) * step / SPEED
    v = SPEED * np.stack([np.cos(climb) * np.cos(heading), np.cos(climb) * np.sin(heading), np.sin(climb)], 1)
    level = np.stack([-np.sin(heading), np.cos(heading), 0 * heading], 1)
    up = np.stack([-np.sin(climb) * np.cos(heading), -np.sin(climb) * np.sin(heading), np.cos(climb)], 1)
    states = np.hstack([start + np.cumsum(v, axis=0) * step, v, turn[:, None] * level + pull[:, None] * up])
    scans = period * np.arange(1, int(DURATION / period + 1e-9) + 1)
    return np.stack([np.interp(scans, times, state) for state in states.T], axis=1)


def _straight(start, velocity: np.ndarray, scans: int, period: float) -> np.ndarray:
    """States (T, 9) of a straight flight from `start`, one period before the first."""
    t = period * np.arange(1, scans + 1)[:, None]
    return np.hstack([start + t * velocity, np.tile(velocity, (scans, 1)), np.zeros((scans, 3))])


def _states(name: str, path, period: float) -> np.ndarray:
    """Positions (T, 3), or with velocities (T, 6), as states (T, 9); missing derivatives by differences."""
    x = states_given(name, path, (3, 6), least=3)
    if x.shape[1] == 3:
        x = np.hstack([x, np.gradient(x, period, axis=0)])
    return np.hstack([x, np.gradient(x[:, 3:], period, axis=0)])
