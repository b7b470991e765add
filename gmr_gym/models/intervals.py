"""Motion models over any interval of time, compiled: two short intervals give what the long one gives.

The noise is white in continuous time, so that F(s + t) = F(s) F(t) and Q(s + t) = F(t) Q(s) F(t)' + Q(t) to
rounding; the models of `motions`, of noise that is constant within a period, do not have the second property.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gmr_gym.kernels import kernel

MOTIONS = ("constant-velocity", "constant-acceleration", "singer", "coordinated-turn")
CONSTANT_VELOCITY, CONSTANT_ACCELERATION, SINGER, COORDINATED_TURN = range(4)
FORGOTTEN = 1e-3  # m/s^2, see `motions.with_accelerations`
NODES, WEIGHTS = np.polynomial.legendre.leggauss(20)


class Mode(NamedTuple):
    """A motion model by name.

    Attributes
    ----------
    motion : str
        One of `MOTIONS`.
    deviation : float
        Of white noise, what is added in one second: to the velocity (m/s) by constant velocity and turns, to
        the acceleration (m/s^2) by constant acceleration. Of Singer's model, that of the acceleration, m/s^2.
    parameter : float
        Correlation time of Singer's model, s; rate of a turn, rad/s from x towards y; otherwise not used.
    """

    motion: str
    deviation: float
    parameter: float = 0.0


class Modes(NamedTuple):
    """Motion models of one state, and the switching between them; `modes` makes a checked one.

    Attributes
    ----------
    motion : ndarray of int (r,)
        Indices into `MOTIONS`.
    parameters : ndarray (r, 2)
        Deviation and parameter of each `Mode`.
    powers, left, right : ndarray of complex (r,), (r, r), (r, r)
        Eigenvalues and eigenvectors of the transition matrix of one second, left diag(powers) right.
    """

    motion: np.ndarray
    parameters: np.ndarray
    powers: np.ndarray
    left: np.ndarray
    right: np.ndarray

    def states(self, axes: int) -> int:
        """Dimension of the common state: with accelerations if one of the models has them."""
        return axes * (3 if ((self.motion == 1) | (self.motion == 2)).any() else 2)


def stay_or_switch(count: int, stay: float) -> np.ndarray:
    """Transition matrix in which all other modes are equally likely.

    Parameters
    ----------
    count : int
        r, the number of modes.
    stay : float
        Probability of the same mode one second later.

    Returns
    -------
    ndarray (r, r)
    """
    if count == 1:
        return np.ones((1, 1))
    other = (1.0 - stay) / (count - 1)
    return np.where(np.eye(count, dtype=bool), stay, other)


def modes(of: Sequence[Mode], switching: np.ndarray) -> Modes:
    """Make checked modes.

    Parameters
    ----------
    of : sequence of Mode
        r motion models.
    switching : array_like (r, r)
        Probabilities of the mode (row) after one second, given the mode (column) before.

    Returns
    -------
    Modes

    Raises
    ------
    ValueError
        For an unknown motion, a number out of range, and for a matrix that is not one of probabilities or
        that no switching in continuous time gives.
    """
    for mode in of:
        if mode.motion not in MOTIONS:
            raise ValueError(f"motion must be one of {', '.join(MOTIONS)}, got {mode.motion!r}")
        if not 0 < mode.deviation < np.inf:
            raise ValueError(f"deviation of {mode.motion} must be positive, got {mode.deviation}")
        if mode.motion == "singer" and not 0 < mode.parameter < np.inf:
            raise ValueError(f"the correlation time of singer must be positive, got {mode.parameter} s")
    switching = np.asarray(switching, float)
    r = len(of)
    if switching.shape != (r, r) or (switching < 0).any() or abs(switching.sum(axis=0) - 1).max() > 1e-9:
        raise ValueError(
            f"switching must have shape ({r}, {r}) and columns of probabilities, got {switching.tolist()}"
        )
    powers, left = np.linalg.eig(switching.astype(complex))
    if abs(np.linalg.det(left)) < 1e-9 or not _in_continuous_time(powers, left):
        raise ValueError(
            f"switching {switching.tolist()} is that of no process in continuous time; raise its diagonal"
        )
    return Modes(
        np.array([MOTIONS.index(mode.motion) for mode in of]),
        np.array([mode[1:] for mode in of], float),
        powers, left, np.linalg.inv(left),
    )  # fmt: skip


def _in_continuous_time(powers: np.ndarray, left: np.ndarray) -> bool:
    """Whether the logarithm of the matrix is a matrix of rates."""
    if (abs(powers) < 1e-300).any():
        return False
    rates = (left * np.log(powers)) @ np.linalg.inv(left)
    off_diagonal = rates.real[~np.eye(len(powers), dtype=bool)]
    return abs(rates.imag).max() < 1e-9 and off_diagonal.min(initial=0.0) > -1e-9


@kernel
def switching_over(modes, dt):
    """Transition matrix (r, r) of the modes over dt seconds: of the mode after (row) given that before."""
    r = len(modes.powers)
    out = np.zeros((r, r))
    for k in range(r):
        power = modes.powers[k] ** dt
        for a in range(r):
            for b in range(r):
                out[a, b] += (modes.left[a, k] * power * modes.right[k, b]).real
    return np.maximum(out, 0.0)


@kernel
def transition(modes, mode, dt, axes, d):
    """F and Q (d, d) of a mode over dt seconds.

    Over a negative dt the state goes back along its motion, and Q is that of as many seconds forward: what
    was not known then is not known better now.
    """
    F, Q = np.eye(d), np.zeros((d, d))
    if dt == 0.0:
        return F, Q
    motion, s, b = modes.motion[mode], modes.parameters[mode, 0], modes.parameters[mode, 1]
    if motion == COORDINATED_TURN:
        _turn_into(F, Q, s, b, dt)
    elif motion == CONSTANT_VELOCITY:
        _expand_into(F, Q, _white_noise(s, dt, 2), axes)
    elif motion == CONSTANT_ACCELERATION:
        _expand_into(F, Q, _white_noise(s, dt, 3), axes)
    else:
        _expand_into(F, Q, _singer(s, b, dt), axes)
    if d > 2 * axes and (motion == COORDINATED_TURN or motion == CONSTANT_VELOCITY):
        for i in range(2 * axes, d):
            F[i, i], Q[i, i] = 0.0, FORGOTTEN**2
    return F, Q


@kernel
def _expand_into(F, Q, of_axis, axes):
    """The Kronecker products of F and Q of one axis with the identity of the axes."""
    F_axis, Q_axis = of_axis
    for r in range(len(F_axis)):
        for c in range(len(F_axis)):
            for i in range(axes):
                F[r * axes + i, c * axes + i] = F_axis[r, c]
                Q[r * axes + i, c * axes + i] = Q_axis[r, c]


@kernel
def _white_noise(s, dt, order):
    r"""F and Q (order, order) of an axis whose highest derivative is driven by white noise of density s^2.

    Notes
    -----
    With the coefficients :math:`f_i = t^{n-1-i} / (n-1-i)!` of order n

    .. math:: Q_{ij} = s^2 \int_0^T f_i(t) f_j(t) dt

    (Bar-Shalom, Li and Kirubarajan 2001, secs. 6.2.2 and 6.2.3).
    """
    factorial = np.array([1.0, 1.0, 2.0])
    F, Q = np.eye(order), np.empty((order, order))
    for i in range(order):
        for j in range(order):
            a, b = order - 1 - i, order - 1 - j
            Q[i, j] = s**2 * abs(dt) ** (a + b + 1) / ((a + b + 1) * factorial[a] * factorial[b])
            if j > i:
                F[i, j] = dt ** (j - i) / factorial[j - i]
    return F, Q


@kernel
def _singer(s, time_constant, dt):
    """F and Q (3, 3) of an axis of `motions.singer`, Q by quadrature."""
    F, Q = np.eye(3), np.zeros((3, 3))
    x = dt / time_constant
    scale = np.array([time_constant**2, time_constant, 1.0])
    F[0, 1], F[2, 2] = dt, np.exp(-x)
    F[0, 2], F[1, 2] = scale[0] * _second(x), -time_constant * np.expm1(-x)
    far = abs(x)
    pieces = int(far / 4.0) + 1
    half, f = far / pieces / 2.0, np.empty(3)
    for piece in range(pieces):
        for node in range(len(NODES)):
            t = half * (2 * piece + 1 + NODES[node])
            f[0], f[1], f[2] = _second(t), -np.expm1(-t), np.exp(-t)
            for i in range(3):
                for j in range(3):
                    Q[i, j] += 2.0 * s**2 * half * WEIGHTS[node] * scale[i] * scale[j] * f[i] * f[j]
    return F, Q


@kernel
def _second(t):
    """t - 1 + exp(-t), by its series where the sum would cancel."""
    if abs(t) >= 1.0:
        return t + np.expm1(-t)
    out, term = 0.0, -t
    for k in range(2, 20):
        term = -term * t / k
        out += term
    return out


@kernel
def _turn_into(F, Q, s, rate, dt):
    r"""F and Q of a turn of known rate in the plane, with white acceleration of density s^2.

    Notes
    -----
    With :math:`x = \omega T` and R the rotation by it, the noise of the position and of the velocity is

    .. math::

        Q_{pp} = \frac{2 s^2}{\omega^3} (x - \sin x) I, \qquad Q_{vv} = s^2 T I, \qquad
        Q_{pv} = \frac{s^2}{\omega^2}
        \begin{bmatrix} 1 - \cos x & x - \sin x \\ \sin x - x & 1 - \cos x \end{bmatrix}

    the integral of :math:`F(t) G G^T F(t)^T`, G the columns of F that velocity enters by.
    """
    x, t = rate * dt, abs(dt)
    y = abs(x)
    # (1 - cos x) / x^2 and (x - sin x) / x^3, which cancel at small x
    second = 0.5 * np.sinc(x / 2.0 / np.pi) ** 2
    third = (y - np.sin(y)) / y**3 if y > 0.1 else (1.0 - y**2 / 20.0 * (1.0 - y**2 / 42.0)) / 6.0
    F[0, 2] = F[1, 3] = dt * np.sinc(x / np.pi)
    F[1, 2] = dt * x * second
    F[0, 3] = -F[1, 2]
    F[2, 2] = F[3, 3] = np.cos(x)
    F[3, 2] = np.sin(x)
    F[2, 3] = -F[3, 2]
    for i in range(2):
        Q[i, i], Q[2 + i, 2 + i] = 2.0 * s**2 * t**3 * third, s**2 * t
        Q[i, 2 + i] = Q[2 + i, i] = s**2 * t**2 * second
    Q[0, 3] = Q[3, 0] = s**2 * t**2 * (rate * t) * third
    Q[1, 2] = Q[2, 1] = -Q[0, 3]
