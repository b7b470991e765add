"""Lv, Lian and Han, "Unknown clutter estimation by FMM approach in multitarget tracking algorithm", section
7.1.

Three targets that cross groups of clutter, where trackers assume uniform clutter. Velocities, accelerations
and the time of the spawn are not given in the paper; they are ours, as are the expected numbers of births.
"""

from functools import partial
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_probability
from gmr_gym.kernels import leaf_kernel
from gmr_gym.mixture import Mixture
from gmr_gym.models.clutter import Clutter, no_components, uniform_clutter
from gmr_gym.models.gating import gate_threshold
from gmr_gym.models.kalman import Motion, position_sensor
from gmr_gym.models.motions import constant_acceleration, constant_velocity
from gmr_gym.models.multi_target import multi_target_model
from gmr_gym.scenarios.paths import many_given, shortened, unvaried
from gmr_gym.simulation.multi_target import MultiTargetScenario

LOW, HIGH = np.array([[-1000.0, -1000.0], [1000.0, 1000.0]])  # m, corners of the region
SCANS = 100
PERIOD = 1.0  # s
SENSOR_DEVIATION = 12.5  # m
PROCESS = 0.01  # m/s^2, of the truth
ACCELERATING, STRAIGHT = constant_acceleration(PERIOD, PROCESS), constant_velocity(PERIOD, PROCESS)
SURVIVAL = 0.99  # P_S
UNIFORM_SHARE = 0.3
# share of the clutter, centre and semi-axes, m (Table 1)
GROUPS = (
    (0.3, (400.0, 200.0), (300.0, 200.0)),
    (0.2, (-200.0, 400.0), (200.0, 200.0)),
    (0.2, (200.0, -200.0), (200.0, 200.0)),
)
ELLIPSE_95 = gate_threshold(0.95, 2)  # squared Mahalanobis distance
# expected number per scan, and position
BIRTHS = ((0.02, (200.0, 800.0)), (0.02, (800.0, -800.0)))
SPAWNS = 0.01  # expected number per target and scan
# standard deviations of a new target's position, m (printed), velocity, m/s, and acceleration, m/s^2: about
# the birth position at rest, or about the predicted state of its parent
NEW = (10.0, 15.0, 0.3)
TOLD_PROCESS = 0.3  # m/s^2, of the filter model: so loose that a track survives a wrong detection or two
LITTLE = 1e-6  # false alarms per scan that the filter model has where there are none
# scans (from 1) of birth and last sight, state at birth; target 3 spawns from target 2
FIRST = (1, 70, (200.0, 800.0, -12.0, -16.0, 0.0, 0.1))
SECOND = (20, 90, (800.0, -800.0, -15.0, 9.0, 0.04, 0.1))
THIRD = (45, 100, (-2.0, 20.0))  # velocity, m/s


class Group(NamedTuple):
    """A group of clutter in an ellipse along the axes."""

    share: float
    centre: np.ndarray  # (2,), m, at the first scan
    axes: np.ndarray  # (2,), m, semi-axes
    drift: np.ndarray  # (2,), m/s


def unknown_clutter(
    clutter: str = "groups",
    clutter_rate: float = 50.0,
    detection_probability: float = 0.98,
    *,
    uniform_share: float = UNIFORM_SHARE,
    groups=GROUPS,
    group_density: float = 1.0,
    births=None,
    trajectory=None,
    horizon: int | None = None,
    told: str | bool = "uniform",
) -> MultiTargetScenario:
    """Three targets in a square of 2 km, and clutter in groups.

    Half of the clutter of a group is uniform in its ellipse, half Gaussian with that ellipse as its 95 %
    ellipse.

    Parameters
    ----------
    clutter : {"groups", "uniform", "dense"}
        "uniform" has no groups and spreads all of `clutter_rate` evenly; "dense" has groups four times
        denser.
    clutter_rate : float
        False alarms per scan. The share `uniform_share` is uniform, the rest in groups.
    detection_probability : float
        P_D, of the truth and of the filter model.
    uniform_share : float
        Share of the uniform clutter; with the groups' shares it sums to 1.
    groups : sequence of (share, (x, y), (semi-axis, semi-axis)[, (vx, vy)])
        Centre and semi-axes, m, and a drift, m/s, after the first scan.
    group_density : float
        Factor on the clutter of the groups; it adds to `clutter_rate`.
    births : sequence of (expected number per scan, (x, y)), optional
        Births that trackers assume. By default 0.02 at the paper's two positions, or where the targets of
        `trajectory` first appear.
    trajectory : array_like (T, m, 4) or (T, m, 6), optional
        States [x, y, vx, vy], or with [ax, ay], m and s; nan or masked where a target is absent.
    horizon : int, optional
        Number of scans; all of the path by default.
    told : {"uniform", "true"}
        Clutter that trackers assume: the true expected number spread evenly, or the true intensity.

    Returns
    -------
    MultiTargetScenario

    Raises
    ------
    ValueError
        Naming the argument that is invalid.

    References
    ----------
    Lv, Lian and Han, section 7.1 and Table 1.

    Departs: Q has T^2 in the middle where eq. 35 has T^2/2, which is no covariance; states are in the order
    above, not axis by axis.
    """
    check_probability("detection_probability", detection_probability)
    if clutter not in ("groups", "uniform", "dense"):
        raise ValueError(f"clutter must be groups, uniform or dense, got {clutter!r}")
    if told is True:  # a command line reads true as a literal
        told = "true"
    if told not in ("uniform", "true"):
        raise ValueError(f"told must be uniform or true, got {told!r}")
    if not 0 <= clutter_rate <= 1e4:
        raise ValueError(f"clutter_rate must lie between 0 and 1e4 per scan, got {clutter_rate}")
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
        raise ValueError("told must be uniform where groups drift: a tracker assumes one intensity")
    if told == "true" and clutter_rate > 0:
        believed = true(0)
    else:
        believed = uniform_clutter(LOW, HIGH, max(true(0).expected, LITTLE))
    x = None if trajectory is None else many_given("trajectory", trajectory, (4, 6))
    scans = len(shortened(np.empty(SCANS) if x is None else x, horizon))
    if births is None:
        births = BIRTHS if x is None else [(BIRTHS[0][0], position) for position in _appearances(x)]
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
        truth=partial(_three, scans) if x is None else partial(unvaried, x[:scans]),
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
    """States of the paper's targets, with its process noise.

    Two move at constant acceleration, born at the two positions of the paper. One moves at constant velocity,
    spawned at the position of the second. Initial positions are off by 10 m (standard deviation) on each
    axis.

    Parameters
    ----------
    rng : Generator

    Returns
    -------
    ndarray (100, 3, 6)
        m and s; nan where a target is absent.
    """
    x = np.full((SCANS, 3, 6), np.nan)
    for i, (born, last, state) in enumerate((FIRST, SECOND)):
        x[born - 1 : last, i] = _flown(ACCELERATING, np.array(state), last - born + 1, rng)
    born, last, velocity = THIRD
    parent = x[born - 1, 1, :2]
    x[born - 1 : last, 2] = 0.0
    x[born - 1 : last, 2, :4] = _flown(STRAIGHT, np.array([*parent, *velocity]), last - born + 1, rng)
    return x


def _three(scans: int, rng: np.random.Generator) -> np.ndarray:
    return three_targets(rng)[:scans]


def _flown(motion: Motion, state: np.ndarray, scans: int, rng: np.random.Generator) -> np.ndarray:
    """States (scans, d) from an initial state whose position has the standard deviation of `NEW`."""
    x = np.empty((scans, len(state)))
    x[0] = state
    x[0, :2] += NEW[0] * rng.standard_normal(2)
    # the noise is singular
    noise = rng.multivariate_normal(np.zeros(len(state)), motion.Q, scans, "ignore", method="eigh")
    _fly(x, motion.F, noise)
    return x


@leaf_kernel
def _fly(x, F, noise):
    """Writes the states x[1], x[2], ... after x[0], each F times the one before plus its noise."""
    for t in range(1, len(x)):
        for r in range(len(F)):
            moved = 0.0
            for c in range(len(F)):
                moved += F[r, c] * x[t - 1, c]
            x[t, r] = moved + noise[t, r]


def _intensity(groups: list[Group], uniform: float, rate: float, t: int) -> Clutter:
    """The true clutter at scan t (from 0): `uniform` points, and of `rate` the share of each group."""
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
        positions = np.array([position for _, position in births], float)
        fits = len(w) > 0 and w.ndim == 1 and positions.shape == (len(w), 2)
    except (TypeError, ValueError):
        fits = False
    if not fits:
        raise ValueError(f"births must be (expected number, (x, y)) each, got {births}")
    if not ((w > 0) & (w <= 100)).all() or not (np.abs(positions) <= 1e6).all():
        raise ValueError(f"births must be of positive numbers at finite positions, got {births}")
    return Mixture(w, np.hstack([positions, np.zeros((len(w), 4))]), np.tile(P, (len(w), 1, 1)))


def _appearances(x: np.ndarray) -> np.ndarray:
    """Positions (m, 2) at which the targets first appear."""
    first = np.argmax(~np.isnan(x[:, :, 0]), axis=0)
    return x[first, np.arange(x.shape[1]), :2]
