"""How targets move: nearly constant velocity and acceleration, Singer's model, turns."""

import numpy as np

from gmr_gym.models.kalman import Motion, motion


def constant_velocity(period: float, acceleration: float, axes: int = 2) -> Motion:
    """Nearly constant velocity, state [positions, velocities]: Q = s^2 G G' with G = [T^2/2; T]
    per axis, T the period (s) and s the acceleration's standard deviation (m/s^2)
    (D'Ortenzio, eqs. 17-18)."""
    eye = np.eye(axes)
    F = np.block([[eye, period * eye], [np.zeros((axes, axes)), eye]])
    G = np.vstack([period**2 / 2 * eye, period * eye])
    return motion(F, acceleration**2 * G @ G.T)


def constant_acceleration(period: float, deviation: float, axes: int = 2) -> Motion:
    """Nearly constant acceleration, state [positions, velocities, accelerations]: Q = s^2 G G' with
    G = [T^2/2; T; 1] per axis, T the period (s) and s the deviation (m/s^2) by which the acceleration
    changes from scan to scan (Maybeck, eqs. 18-19)."""
    eye, none = np.eye(axes), np.zeros((axes, axes))
    F = np.block([[eye, period * eye, period**2 / 2 * eye], [none, eye, period * eye], [none, none, eye]])
    G = np.vstack([period**2 / 2 * eye, period * eye, eye])
    return motion(F, deviation**2 * G @ G.T)


def singer(period: float, time_constant: float, deviation: float, axes: int = 3) -> Motion:
    """Acceleration that is forgotten exponentially (Singer 1970), state [positions, velocities,
    accelerations]: correlation time time_constant (s), standard deviation `deviation` (m/s^2), period (s).
    Exact for any ratio of the two times.

    Raises ValueError for a number that is not positive."""
    for name, value in (("period", period), ("time_constant", time_constant), ("deviation", deviation)):
        if not 0 < value < np.inf:
            raise ValueError(f"{name} must be positive and finite, got {value}")
    x = period / time_constant
    F = np.array([
        [1.0, period, time_constant**2 * float(_second(np.array(x)))],
        [0.0, 1.0, -time_constant * np.expm1(-x)],
        [0.0, 0.0, np.exp(-x)],
    ])  # fmt: skip
    scale = np.array([time_constant**2, time_constant, 1.0])
    Q = 2 * deviation**2 * np.outer(scale, scale) * _singer_noise(x)
    eye = np.eye(axes)
    return motion(np.kron(F, eye), np.kron(Q, eye))


def _second(t: np.ndarray) -> np.ndarray:
    """t - 1 + exp(-t), by its series where that would cancel."""
    small = np.minimum(t, 1.0)
    series, term = np.zeros_like(small), np.ones_like(small)
    for k in range(1, 20):
        term = -term * small / k
        if k > 1:
            series = series + term
    return np.where(t < 1, series, t + np.expm1(-t))


def _singer_noise(x: float) -> np.ndarray:
    """Integral over t from 0 to x of f f' (3, 3), f = [t - 1 + exp(-t), 1 - exp(-t), exp(-t)]: by
    Gauss-Legendre where the closed form would cancel."""
    if x < 8:
        nodes, weights = np.polynomial.legendre.leggauss(40)
        t = x * (nodes + 1) / 2
        f = np.stack([_second(t), -np.expm1(-t), np.exp(-t)])
        return x / 2 * (f * weights) @ f.T
    e, e2 = np.exp(-x), np.exp(-2 * x)
    Q = np.empty((3, 3))
    Q[0, 0] = (1 - e2 + 2 * x + 2 * x**3 / 3 - 2 * x**2 - 4 * x * e) / 2
    Q[0, 1] = Q[1, 0] = (e2 + 1 - 2 * e + 2 * x * e - 2 * x + x**2) / 2
    Q[0, 2] = Q[2, 0] = (1 - e2 - 2 * x * e) / 2
    Q[1, 1] = (4 * e - 3 - e2 + 2 * x) / 2
    Q[1, 2] = Q[2, 1] = (e2 + 1 - 2 * e) / 2
    Q[2, 2] = (1 - e2) / 2
    return Q


def with_accelerations(motion: Motion, forgotten: float = 1e-3) -> Motion:
    """A motion of [positions, velocities] as one of [positions, velocities, accelerations], so that it can
    be mixed with motions that know accelerations: those it is given it forgets, and leaves one of standard
    deviation `forgotten` (m/s^2) rather than none, which would leave covariances without an inverse."""
    d = len(motion.F)
    axes = d // 2
    F, Q = np.zeros((d + axes, d + axes)), np.zeros((d + axes, d + axes))
    F[:d, :d], Q[:d, :d] = motion.F, motion.Q
    Q[d:, d:] = forgotten**2 * np.eye(axes)
    return Motion(F, Q, np.append(motion.offset, np.zeros(axes)))


def coordinated_turn(period: float, rate: float, acceleration: float) -> Motion:
    """A turn at a known rate (rad/s, from x towards y), state [x, y, vx, vy], with white acceleration of
    standard deviation `acceleration` (m/s^2) per scan as in `constant_velocity`. At rate 0 that is it."""
    a = rate * period
    across = period * np.sinc(a / np.pi)
    along = period * np.sin(a / 2) * np.sinc(a / 2 / np.pi)
    turn = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    F = np.block([[np.eye(2), np.array([[across, -along], [along, across]])], [np.zeros((2, 2)), turn]])
    return motion(F, constant_velocity(period, acceleration).Q)
