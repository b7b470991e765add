"""Linear-Gaussian motion and sensing, over whole stacks of Gaussians."""

from typing import NamedTuple

import numpy as np
from numba import njit

from gmr_gym.mixture import (
    Mixture,
    check_covariance,
    cholesky_into,
    log_gaussian_scale,
    mahalanobis_squared,
)


class Motion(NamedTuple):
    """x' = F x + offset + noise of covariance Q, over one scan period."""

    F: np.ndarray  # (d, d)
    Q: np.ndarray  # (d, d), positive semidefinite
    offset: np.ndarray  # (d,), the known input; zeros when there is none


class Look(NamedTuple):
    """A scan as the components of a mixture see it: what each expects, and the detections to compare."""

    expected: np.ndarray  # (n, p)
    S: np.ndarray  # (n, p, p), innovation covariances, less what a detection itself brings
    C: np.ndarray  # (n, p, d), covariances of detection and state, H P
    z: np.ndarray  # (n, k, p), or (1, k, p) where all components see the same
    R: np.ndarray  # (k, p, p), noise that goes with the detection; (0, p, p) for none
    log_stretch: np.ndarray  # (k,), log of the volume here that a unit of the sensor's own space fills


class Sensor(NamedTuple):
    """z = H x + noise of covariance R."""

    H: np.ndarray  # (p, d)
    R: np.ndarray  # (p, p)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names (p,), with units, of what it detects: a position in the plane or in space."""
        return tuple(f"{axis}_m" for axis in "xyz"[: len(self.H)])

    def observed(self, x: np.ndarray) -> np.ndarray:
        """What it would say of states x (..., d), without noise (..., p)."""
        return x @ self.H.T

    def gates(self, p: Mixture) -> tuple[np.ndarray, np.ndarray]:
        """Predicted detections (n, p) and their innovation covariances (n, p, p)."""
        return _innovation(p.m, p.P, self.H, self.R)[:2]

    def relative(self, z: np.ndarray, centre: np.ndarray) -> np.ndarray:
        """Detections (..., p) as seen from a centre (p,)."""
        return z - centre

    def settled(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (k, p) of its space as it would report them, and which of them it can (k,)."""
        return z, np.ones(len(z), bool)

    def placed(self, z: np.ndarray) -> np.ndarray:
        """Detections z (k, p) where the gates stand."""
        return z

    def density(self, density: float, at: np.ndarray) -> np.ndarray:
        """What a density in the sensor's own space is in that of the gates, at places (n, p)."""
        return np.full(len(at), density)

    def look(self, p: Mixture, expected: np.ndarray, S: np.ndarray, z: np.ndarray) -> Look:
        """The scan z (k, p) as the components of p see it, whose gates are (expected, S)."""
        none = np.empty((0, *self.R.shape))
        return Look(expected, S, _cross(p.P, self.H), z[None], none, np.zeros(len(z)))


def motion(F, Q, offset=None) -> Motion:
    """Checked Motion; ValueError when a shape does not fit or Q is not positive semidefinite."""
    F, Q = np.array(F, float), np.array(Q, float)
    offset = np.zeros(len(F)) if offset is None else np.array(offset, float)
    if F.ndim != 2 or F.shape[0] != F.shape[1] or not np.isfinite(F).all():
        raise ValueError(f"F must be a finite square matrix, got shape {F.shape}")
    if Q.shape != F.shape or not np.isfinite(Q).all():
        raise ValueError(f"Q must be finite with the shape of F {F.shape}, got {Q.shape}")
    if offset.shape != F.shape[:1] or not np.isfinite(offset).all():
        raise ValueError(f"offset must be finite with shape {F.shape[:1]}, got {offset.shape}")
    size = np.abs(Q).max()
    if not np.allclose(Q, Q.T, rtol=1e-9, atol=1e-12 * size) or np.linalg.eigvalsh(Q)[0] < -1e-9 * size:
        raise ValueError("Q must be symmetric positive semidefinite")
    return Motion(F, Q, offset)


def sensor(H, R) -> Sensor:
    """Checked Sensor; ValueError when a shape does not fit or R is not positive definite."""
    H, R = np.array(H, float), np.array(R, float)
    if H.ndim != 2 or not np.isfinite(H).all():
        raise ValueError(f"H must be a finite matrix (p, d), got shape {H.shape}")
    if R.shape != (len(H), len(H)):
        raise ValueError(f"R must have shape {(len(H), len(H))} to fit H, got {R.shape}")
    check_covariance("R", R)
    return Sensor(H, R)


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


def position_sensor(deviation: float, axes: int = 2, rates: int = 1) -> Sensor:
    """Positions of the state [positions, velocities, ...] with `rates` rates of change beside them, noise
    `deviation` (m) on each axis (D'Ortenzio, eq. 19)."""
    H = np.eye(axes, axes * (1 + rates))
    return sensor(H, deviation**2 * np.eye(axes))


def predict(p: Mixture, motion: Motion) -> Mixture:
    """Every component carried forward one period: F m + offset, F P F' + Q."""
    m, P = predict_all(p.m, p.P, motion.F, motion.Q, motion.offset)
    return Mixture(p.w, m, P)


def innovation(p: Mixture, sensor: Sensor) -> tuple[np.ndarray, np.ndarray]:
    """Predicted detections H m (n, p) and innovation covariances S = H P H' + R (n, p, p)."""
    return sensor.gates(p)


def condition(p: Mixture, sensor: Sensor, z: np.ndarray) -> tuple[Mixture, np.ndarray]:
    """Each component i updated by its own detection z[i] (n, p), weights kept; and
    log N(z[i]; H m, S) (n,)."""
    m, P, log_likelihood = _condition(p.m, p.P, sensor.H, sensor.R, z)
    return Mixture(p.w, m, P), log_likelihood


@njit(cache=True, error_model="numpy")
def predict_all(m, P, F, Q, offset):
    n, d = m.shape
    m_out = np.empty((n, d))
    P_out = np.empty((n, d, d))
    FP = np.empty((d, d))
    for i in range(n):
        for r in range(d):
            total = offset[r]
            for c in range(d):
                total += F[r, c] * m[i, c]
            m_out[i, r] = total
        for r in range(d):
            for c in range(d):
                total = 0.0
                for k in range(d):
                    total += F[r, k] * P[i, k, c]
                FP[r, c] = total
        for r in range(d):
            for c in range(r + 1):
                total = Q[r, c]
                for k in range(d):
                    total += FP[r, k] * F[c, k]
                P_out[i, r, c] = P_out[i, c, r] = total
    return m_out, P_out


@njit(cache=True, error_model="numpy")
def _cross(P, H):
    """H P[i] (n, p, d)."""
    n, (p, d) = len(P), H.shape
    C = np.empty((n, p, d))
    for i in range(n):
        for r in range(p):
            for c in range(d):
                total = 0.0
                for k in range(d):
                    total += H[r, k] * P[i, k, c]
                C[i, r, c] = total
    return C


@njit(cache=True, error_model="numpy")
def _innovation(m, P, H, R):
    n = len(m)
    p, d = H.shape
    z = np.empty((n, p))
    S = np.empty((n, p, p))
    C = _cross(P, H)
    for i in range(n):
        for r in range(p):
            total = 0.0
            for c in range(d):
                total += H[r, c] * m[i, c]
            z[i, r] = total
        for r in range(p):
            for c in range(r + 1):
                total = R[r, c]
                for k in range(d):
                    total += C[i, r, k] * H[c, k]
                S[i, r, c] = S[i, c, r] = total
    return z, S, C


@njit(cache=True, error_model="numpy")
def posterior_into(P_out, K, W, L, P, C):
    """The one covariance update: with S = L L' and W = L^-1 C, C = H P, P_out = P - W'W = P - K S K'
    and the gain K = W' L^-1 (d, p). All arguments but P, C and L are written to."""
    p, d = C.shape
    for c in range(d):
        for r in range(p):
            total = C[r, c]
            for k in range(r):
                total -= L[r, k] * W[k, c]
            W[r, c] = total / L[r, r]
        for r in range(p - 1, -1, -1):
            total = W[r, c]
            for k in range(r + 1, p):
                total -= L[k, r] * K[c, k]
            K[c, r] = total / L[r, r]
    for r in range(d):
        for c in range(r + 1):
            total = P[r, c]
            for k in range(p):
                total -= W[k, r] * W[k, c]
            P_out[r, c] = P_out[c, r] = total


@njit(cache=True, error_model="numpy")
def _condition(m, P, H, R, z):
    n, d = m.shape
    p = len(H)
    z_hat, S, C = _innovation(m, P, H, R)
    m_out, P_out = m.copy(), np.empty((n, d, d))
    log_likelihood = np.empty(n)
    L, K, W, y = np.zeros((p, p)), np.empty((d, p)), np.empty((p, d)), np.empty(p)
    for i in range(n):
        if not cholesky_into(L, S[i]):
            raise ValueError("an innovation covariance S = H P H' + R is not positive definite")
        posterior_into(P_out[i], K, W, L, P[i], C[i])
        log_likelihood[i] = log_gaussian_scale(L) - 0.5 * mahalanobis_squared(L, z[i], z_hat[i], y)
        for r in range(d):
            for k in range(p):
                m_out[i, r] += K[r, k] * (z[i, k] - z_hat[i, k])
    return m_out, P_out, log_likelihood
