"""Motion models: nearly constant velocity and acceleration, Singer's model, coordinated turns."""

import numpy as np

from gmr_gym.models.kalman import Motion, motion


def constant_velocity(period: float, acceleration: float, axes: int = 2) -> Motion:
    """Nearly constant velocity, state [positions, velocities].

    Per axis Q = s^2 G G' with G = [T^2/2; T], T the period and s the standard deviation of the acceleration.

    Parameters
    ----------
    period : float
        T, s.
    acceleration : float
        s, m/s^2; white, constant within a period.
    axes : int

    References
    ----------
    D'Ortenzio, eqs. 17-18.

    Examples
    --------
    >>> m = constant_velocity(1.0, 2.0, axes=1)
    >>> m.F.tolist(), m.Q.tolist()
    ([[1.0, 1.0], [0.0, 1.0]], [[1.0, 2.0], [2.0, 4.0]])
    """
    eye = np.eye(axes)
    F = np.block([[eye, period * eye], [np.zeros((axes, axes)), eye]])
    G = np.vstack([period**2 / 2 * eye, period * eye])
    return motion(F, acceleration**2 * G @ G.T)


def constant_acceleration(period: float, deviation: float, axes: int = 2) -> Motion:
    """Nearly constant acceleration, state [positions, velocities, accelerations].

    Per axis Q = s^2 G G' with G = [T^2/2; T; 1], T the period and s the standard deviation of the change of
    the acceleration from scan to scan.

    Parameters
    ----------
    period : float
        T, s.
    deviation : float
        s, m/s^2.
    axes : int

    References
    ----------
    Maybeck, eqs. 18-19.
    """
    eye, zero = np.eye(axes), np.zeros((axes, axes))
    F = np.block([[eye, period * eye, period**2 / 2 * eye], [zero, eye, period * eye], [zero, zero, eye]])
    G = np.vstack([period**2 / 2 * eye, period * eye, eye])
    return motion(F, deviation**2 * G @ G.T)


def singer(period: float, time_constant: float, deviation: float, axes: int = 3) -> Motion:
    r"""Singer's model: the acceleration is exponentially correlated in time. State [positions, velocities,
    accelerations].

    Exact for any ratio of the two times.

    Parameters
    ----------
    period : float
        T, s.
    time_constant : float
        Correlation time tau of the acceleration, s.
    deviation : float
        Standard deviation sigma of the acceleration, m/s^2.
    axes : int

    Raises
    ------
    ValueError
        For a period, time constant or deviation that is not positive and finite.

    Notes
    -----
    Per axis:

    .. math::

        F(t) = \begin{bmatrix} 1 & t & \tau^2 (t/\tau - 1 + e^{-t/\tau}) \\ 0 & 1 & \tau (1 - e^{-t/\tau}) \\
        0 & 0 & e^{-t/\tau} \end{bmatrix}, \qquad
        Q = \frac{2 \sigma^2}{\tau} \int_0^T f(t) f(t)^T dt

    with F = F(T), and f the last column of F(t).

    References
    ----------
    Singer 1970.

    Examples
    --------
    >>> singer(1.0, 20.0, 5.0, axes=1).F.round(4).tolist()
    [[1.0, 1.0, 0.4918], [0.0, 1.0, 0.9754], [0.0, 0.0, 0.9512]]
    """
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
    """t - 1 + exp(-t), by its series where the sum would cancel."""
    small = np.minimum(t, 1.0)
    series, term = np.zeros_like(small), np.ones_like(small)
    for k in range(1, 20):
        term = -term * small / k
        if k > 1:
            series = series + term
    return np.where(t < 1, series, t + np.expm1(-t))


def _singer_noise(x: float) -> np.ndarray:
    """Integral over t from 0 to x of f f' (3, 3), f = [t - 1 + exp(-t), 1 - exp(-t), exp(-t)]; by
    Gauss-Legendre quadrature where the closed form would cancel."""
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
    """A motion of [positions, velocities] as one of [positions, velocities, accelerations].

    For mixing with motion models that have accelerations. The accelerations of the state before are ignored,
    and those after are zero with the standard deviation `forgotten`: with none, covariances would be
    singular.

    Parameters
    ----------
    motion : Motion
    forgotten : float
        m/s^2.
    """
    d = len(motion.F)
    axes = d // 2
    F, Q = np.zeros((d + axes, d + axes)), np.zeros((d + axes, d + axes))
    F[:d, :d], Q[:d, :d] = motion.F, motion.Q
    Q[d:, d:] = forgotten**2 * np.eye(axes)
    return Motion(F, Q, np.append(motion.offset, np.zeros(axes)))


def coordinated_turn(period: float, rate: float, acceleration: float) -> Motion:
    """Turn at a known rate, state [x, y, vx, vy].

    The acceleration noise is that of `constant_velocity`, and at rate 0 so is the transition matrix.

    Parameters
    ----------
    period : float
        s.
    rate : float
        rad/s, from x towards y.
    acceleration : float
        Standard deviation of the white acceleration, m/s^2.

    Examples
    --------
    >>> turn = coordinated_turn(1.0, np.pi / 2, 0.0)
    >>> (turn.F @ [0.0, 0.0, 1.0, 0.0]).round(4).tolist()
    [0.6366, 0.6366, 0.0, 1.0]
    """
    a = rate * period
    across = period * np.sinc(a / np.pi)
    along = period * np.sin(a / 2) * np.sinc(a / 2 / np.pi)
    turn = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
    F = np.block([[np.eye(2), np.array([[across, -along], [along, across]])], [np.zeros((2, 2)), turn]])
    return motion(F, constant_velocity(period, acceleration).Q)
