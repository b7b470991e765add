"""Lv, Lian and Han, "Unknown clutter estimation by FMM approach in multitarget tracking algorithm", section
7.1: three targets that cross groups of clutter, which trackers take for uniform. Velocities, accelerations
and the time of the spawn are not given; they are ours, as are the expected numbers of births."""

from functools import partial
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_probability
from gmr_gym.mixture import Mixture
from gmr_gym.models.clutter import Clutter, no_components, uniform_clutter
from gmr_gym.models.gating import gate_threshold
from gmr_gym.models.kalman import Motion, position_sensor
from gmr_gym.models.motions import constant_acceleration, constant_velocity
from gmr_gym.models.multi_target import multi_target_model
from gmr_gym.scenarios.planar import shortened
from gmr_gym.simulation.multi_target import MultiTargetScenario

LOW, HIGH = np.array([[-1000.0, -1000.0], [1000.0, 1000.0]])  # m, corners of the region
SCANS = 100
PERIOD = 1.0  # s
SENSOR_DEVIATION = 12.5  # m
PROCESS = 0.01  # m/s^2, of the truth
SURVIVAL = 0.99  # P_S
UNIFORM_SHARE = 0.3
# share of the clutter, centre and semi-axes, m (Table 1)
GROUPS = (
    (0.3, (400.0, 200.0), (300.0, 200.0)),
    (0.2, (-200.0, 400.0), (200.0, 200.0)),
    (0.2, (200.0, -200.0), (200.0, 200.0)),
)
ELLIPSE_95 = gate_threshold(0.95, 2)  # squared Mahalanobis distance
# expected number a scan, and where
BIRTHS = ((0.02, (200.0, 800.0)), (0.02, (800.0, -800.0)))
SPAWNS = 0.01  # expected of a target, a scan
# deviations of a new target's position, m (printed), velocity, m/s, and acceleration, m/s^2, about those
# places at rest, or about where its parent moves
NEW = (10.0, 15.0, 0.3)
TOLD_PROCESS = 0.3  # m/s^2: what is told is so loose that a wrong detection or two can be survived
LITTLE = 1e-6  # false detections a scan, told where there are none
# scans (from 1) of birth and last sight, state at birth; target 3 spawns from target 2
FIRST = (1, 70, (200.0, 800.0, -12.0, -16.0, 0.0, 0.1))
SECOND = (20, 90, (800.0, -800.0, -15.0, 9.0, 0.04, 0.1))
THIRD = (45, 100, (-2.0, 20.0))  # velocity, m/s


class Group(NamedTuple):
    """Clutter that crowds in an ellipse along the axes."""

    share: float
    centre: np.ndarray  # (2,), m, at the first scan
    axes: np.ndarray  # (2,), m, semi-axes
    drift: np.ndarray  # (2,), m/s


def unknown_clutter(
    clutter: str = "groups",
    clutter_rate: float = 50.0,
    detection_probability: float = 0.98,
    uniform_share: float = UNIFORM_SHARE,
    groups=GROUPS,
    group_density: float = 1.0,
    births=None,
    trajectory=None,
    horizon: int | None = None,
    told: str | bool = "uniform",
) -> MultiTargetScenario:
    """Three targets in a square of 2 km, and clutter in groups.

    clutter: "groups", "uniform" (no groups: all of clutter_rate is spread evenly) or "dense" (groups four
    times denser).
    clutter_rate: false detections a scan, uniform_share of them uniform, the rest in groups.
    groups: (share, (x, y), (semi-axis, semi-axis)), m, each perhaps with a drift (vx, vy), m/s, after the
    first scan; half of a group is uniform in its ellipse, half Gaussian with that 95 % ellipse. The shares
    and uniform_share sum to 1.
    group_density: a factor on the groups' false detections, which adds to clutter_rate.
    births: what trackers are told, (expected number a scan, (x, y)) each; where left out, 0.02 at the two
    places of the paper, or where the targets of `trajectory` first appear.
    trajectory: (T, m, 4) or (T, m, 6) states [x, y, vx, vy] or with [ax, ay], nan or masked where a
        target is absent.
    told: "uniform", as much clutter as there is but spread evenly, or "true".

    Departs: Q has T^2 in the middle where eq. 35 has T^2/2, which is no covariance; states are in the order
    above, not axis by axis. Raises ValueError naming the argument.
    """
    check_probability("detection_probability", detection_probability)
    if clutter not in ("groups", "uniform", "dense"):
        raise ValueError(f"clutter must be groups, uniform or dense, got {clutter!r}")
    if told is True:  # as a literal it reads so
        told = "true"
    if told not in ("uniform", "true"):
        raise ValueError(f"told must be uniform or true, got {told!r}")
    if not 0 <= clutter_rate <= 1e4:
        raise ValueError(f"clutter_rate must lie between 0 and 1e4 a scan, got {clutter_rate}")
    if not 0 < group_density <= 100:
        raise ValueError(f"group_density must be positive and at most 100, got {group_density}")
    if clutter == "uniform":
        if groups is not GROUPS:
            raise ValueError("groups cannot be given with clutter='uniform', which has none")
        parts, share = [], 1.0
    else:
        parts, share = _groups(groups), uniform_share
        total = share + sum(group.share for group in parts)
        if not (0 < share <= 1 and abs(total - 1) < 1e-6):
            raise ValueError(
                f"uniform_share must be positive and make 1 with the groups' shares, got {uniform_share} "
                f"and {total:g} in all"
            )
    density = 4 * group_density if clutter == "dense" else group_density
    true = partial(_intensity, parts, share * clutter_rate, density * clutter_rate)
    if told == "true" and any(group.drift.any() for group in parts):
        raise ValueError("told must be uniform where groups drift: a tracker is told of one intensity")
    if told == "true" and clutter_rate > 0:
        believed = true(0)
    else:
        believed = uniform_clutter(LOW, HIGH, max(true(0).expected, LITTLE))
    x = None if trajectory is None else _states(trajectory)
    scans = len(shortened(np.empty(SCANS) if x is None else x, horizon))
    if births is None:
        births = BIRTHS if x is None else [(BIRTHS[0][0], place) for place in _appearances(x)]
    new = np.diag(np.repeat(NEW, 2) ** 2)
    sensor = position_sensor(SENSOR_DEVIATION, rates=2)
    return MultiTargetScenario(
        model=multi_target_model(
            constant_acceleration(PERIOD, TOLD_PROCESS),
            sensor,
            detection_probability,
            SURVIVAL,
            _births(births, new),
            believed,
            SPAWNS,
            new,
        ),
        truth=partial(_three, scans) if x is None else partial(_given, x[:scans]),
        targets=3 if x is None else x.shape[1],
        sensor=sensor,
        detection_probability=float(detection_probability),
        clutter=true,
        horizon=scans,
        period=PERIOD,
        position=(0, 1),
        velocity=(2, 3),
        cutoff=100.0,
        order=2.0,
    )


def three_targets(rng: np.random.Generator) -> np.ndarray:
    """States (100, 3, 6) of the paper's targets, nan where absent, with its process noise: two at constant
    acceleration, born at the two places, and one at constant velocity, spawned where the second is; each
    begins off by 10 m on each axis."""
    x = np.full((SCANS, 3, 6), np.nan)
    accelerating, straight = constant_acceleration(PERIOD, PROCESS), constant_velocity(PERIOD, PROCESS)
    for i, (born, last, state) in enumerate((FIRST, SECOND)):
        x[born - 1 : last, i] = _flown(accelerating, np.array(state), last - born + 1, rng)
    born, last, velocity = THIRD
    parent = x[born - 1, 1, :2]
    x[born - 1 : last, 2] = 0.0
    x[born - 1 : last, 2, :4] = _flown(straight, np.array([*parent, *velocity]), last - born + 1, rng)
    return x


def _three(scans: int, rng: np.random.Generator) -> np.ndarray:
    return three_targets(rng)[:scans]


def _given(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return x


def _flown(motion: Motion, state: np.ndarray, scans: int, rng: np.random.Generator) -> np.ndarray:
    """States (scans, d) from one whose position is off by `NEW`."""
    x = np.empty((scans, len(state)))
    x[0] = state
    x[0, :2] += NEW[0] * rng.standard_normal(2)
    # the noise is singular
    noise = rng.multivariate_normal(np.zeros(len(state)), motion.Q, scans, method="eigh")
    for t in range(1, scans):
        x[t] = motion.F @ x[t - 1] + noise[t]
    return x


def _intensity(groups: list[Group], uniform: float, rate: float, t: int) -> Clutter:
    """The true clutter at scan t (from 0): `uniform` points, and of `rate` what each group has as its
    share."""
    if not groups:
        return Clutter(LOW, HIGH, float(uniform), no_components(2), no_components(2))
    half = rate / 2 * np.array([group.share for group in groups])
    m = np.array([group.centre + t * PERIOD * group.drift for group in groups])
    shape = np.array([np.diag(group.axes**2) for group in groups])
    return Clutter(LOW, HIGH, float(uniform), Mixture(half, m, shape / ELLIPSE_95), Mixture(half, m, shape))


def _groups(groups) -> list[Group]:
    out = []
    for i, group in enumerate(groups):
        name = f"groups[{i}]"
        try:
            share, centre, axes, drift = [np.array(part, float) for part in (*group, (0, 0))[:4]]
            fits = share.shape == () and centre.shape == axes.shape == drift.shape == (2,)
            fits = fits and len(group) in (3, 4)
        except (TypeError, ValueError):
            fits = False
        if not fits:
            wanted = "(share, (x, y), (semi-axis, semi-axis)[, (vx, vy)])"
            raise ValueError(f"{name} must be {wanted}, got {group}")
        if not 0 < share < 1:
            raise ValueError(f"{name} must have a share between 0 and 1, got {share}")
        if not (np.abs(centre) <= 1e6).all() or not (np.abs(drift) <= 1e4).all():
            raise ValueError(f"{name} must be finite and near, got centre {centre} and drift {drift}")
        if not ((axes > 0) & (axes <= 1e6)).all():
            raise ValueError(f"{name} must have positive semi-axes, m, got {axes}")
        out.append(Group(float(share), centre, axes, drift))
    return out


def _births(births, P: np.ndarray) -> Mixture:
    try:
        w = np.array([expected for expected, _ in births], float)
        places = np.array([place for _, place in births], float)
        fits = len(w) > 0 and w.ndim == 1 and places.shape == (len(w), 2)
    except (TypeError, ValueError):
        fits = False
    if not fits:
        raise ValueError(f"births must be (expected number, (x, y)) each, got {births}")
    if not ((w > 0) & (w <= 100)).all() or not (np.abs(places) <= 1e6).all():
        raise ValueError(f"births must be of positive numbers at finite places, got {births}")
    return Mixture(w, np.hstack([places, np.zeros((len(w), 4))]), np.tile(P, (len(w), 1, 1)))


def _states(trajectory) -> np.ndarray:
    """States (T, m, 6) of (T, m, 4) or (T, m, 6), accelerations 0 where not given."""
    try:
        given: np.ma.MaskedArray = np.ma.array(trajectory, float)
    except (TypeError, ValueError):
        raise ValueError("trajectory must be numbers of shape (T, m, 4) or (T, m, 6)") from None
    x = np.array(given.data)
    if x.ndim != 3 or x.shape[2] not in (4, 6) or min(x.shape) < 1:
        raise ValueError(f"trajectory must have shape (T, m, 4) or (T, m, 6), got {x.shape}")
    x[np.ma.getmaskarray(given).any(axis=2)] = np.nan
    absent = np.isnan(x).all(axis=2)
    if not (np.abs(x[~absent]) <= 1e6).all():
        raise ValueError("trajectory must be finite and within a million of zero, or nan in a whole state")
    if never := np.flatnonzero(absent.all(axis=0)).tolist():
        raise ValueError(f"trajectory must show every target, but of {never} there is nothing")
    if x.shape[2] == 4:
        x = np.concatenate((x, np.where(absent, np.nan, 0.0)[..., None].repeat(2, axis=2)), axis=2)
    return x


def _appearances(x: np.ndarray) -> np.ndarray:
    """Positions (m, 2) at which the targets are first there."""
    first = np.argmax(~np.isnan(x[:, :, 0]), axis=0)
    return x[first, np.arange(x.shape[1]), :2]
