"""Linear-Gaussian motion models and sensors, for all components of a mixture at once."""

from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_covariance
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture
from gmr_gym.models.sensing import PredictedDetections


class Motion(NamedTuple):
    """Linear motion model over one scan period: x' = F x + offset + noise of covariance Q. `motion` makes
    a checked one.

    Attributes
    ----------
    F : ndarray (d, d)
        Transition matrix.
    Q : ndarray (d, d)
        Covariance of the process noise, positive semidefinite.
    offset : ndarray (d,)
        Known input; zeros for none.
    """

    F: np.ndarray
    Q: np.ndarray
    offset: np.ndarray


class Sensor(NamedTuple):
    """Linear measurement model: z = H x + noise of covariance R. `sensor` makes a checked one.

    Attributes
    ----------
    H : ndarray (p, d)
        Measurement matrix.
    R : ndarray (p, p)
        Covariance of the measurement noise.
    """

    H: np.ndarray
    R: np.ndarray

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names (p,) of the coordinates of a detection, with units."""
        return tuple(f"{axis}_m" for axis in "xyz"[: len(self.H)])

    def measure(self, x: np.ndarray) -> np.ndarray:
        """Noise-free detections (..., p) of states x (..., d)."""
        return x @ self.H.T

    def gates(self, p: Mixture) -> tuple[np.ndarray, np.ndarray]:
        """Predicted detections (n, p) and their innovation covariances (n, p, p)."""
        return innovation(p.m, p.P, self.H, self.R)[:2]

    def relative(self, z: np.ndarray, centre: np.ndarray) -> np.ndarray:
        """Detections z (..., p) relative to a centre (p,)."""
        return z - centre

    def wrap_and_validate(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Detections (k, p), unchanged, and a mask (k,) of those the sensor could report: all."""
        return z, np.ones(len(z), bool)

    def to_gate_space(self, z: np.ndarray) -> np.ndarray:
        """Detections z (k, p) in the gates' space, which is the sensor's own."""
        return z

    def density(self, density: float, at: np.ndarray) -> np.ndarray:
        """Density (n,) in the gates' space at points `at` (n, p) of a density in the sensor's own space:
        the same."""
        return np.full(len(at), density)

    def predict_detections(
        self, p: Mixture, z_hat: np.ndarray, S: np.ndarray, z: np.ndarray
    ) -> PredictedDetections:
        """Predicted detections of every component, their innovation covariances, and the scan in the same
        coordinates.

        Parameters
        ----------
        p : Mixture
            n predicted components.
        z_hat : ndarray (n, p)
            Centres of their gates.
        S : ndarray (n, p, p)
            Covariances of their gates.
        z : ndarray (k, p)
            The scan.
        """
        no_noise = np.empty((0, *self.R.shape))
        C = _cross(p.P, self.H)
        H, R = self.H[None], self.R[None]
        return PredictedDetections(z_hat, S, C, z[None], no_noise, np.zeros(len(z)), H, R)


def motion(F, Q, offset=None) -> Motion:
    """Checked Motion.

    Parameters
    ----------
    F : array_like (d, d)
        Transition matrix.
    Q : array_like (d, d)
        Covariance of the process noise.
    offset : array_like (d,), optional
        Known input.

    Raises
    ------
    ValueError
        For a shape that does not fit, a number that is not finite, and a Q that is not symmetric positive
        semidefinite.

    Examples
    --------
    >>> m = motion([[1.0, 1.0], [0.0, 1.0]], [[0.25, 0.5], [0.5, 1.0]])
    >>> m.offset.tolist()
    [0.0, 0.0]
    """
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
    """Checked Sensor.

    Parameters
    ----------
    H : array_like (p, d)
        Measurement matrix.
    R : array_like (p, p)
        Covariance of the measurement noise.

    Raises
    ------
    ValueError
        For a shape that does not fit, a number that is not finite, and an R that is not symmetric positive
        definite.
    """
    H, R = np.array(H, float), np.array(R, float)
    if H.ndim != 2 or not np.isfinite(H).all():
        raise ValueError(f"H must be a finite matrix (p, d), got shape {H.shape}")
    if R.shape != (len(H), len(H)):
        raise ValueError(f"R must have shape {(len(H), len(H))} to fit H, got {R.shape}")
    check_covariance("R", R)
    return Sensor(H, R)


def position_sensor(deviation: float, axes: int = 2, rates: int = 1) -> Sensor:
    """Sensor of the position, of a state [positions, velocities, ...].

    Parameters
    ----------
    deviation : float
        Standard deviation of the measurement noise along each axis, m.
    axes : int
        Number of positions.
    rates : int
        Derivatives of the position in the state: 1 for velocities, 2 for accelerations too.

    References
    ----------
    D'Ortenzio, eq. 19.

    Examples
    --------
    >>> s = position_sensor(10.0)
    >>> s.H.tolist(), s.R.tolist()
    ([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]], [[100.0, 0.0], [0.0, 100.0]])
    """
    H = np.eye(axes, axes * (1 + rates))
    return sensor(H, deviation**2 * np.eye(axes))


def predict(p: Mixture, motion: Motion) -> Mixture:
    """Kalman prediction of every component over one period: F m + offset, F P F' + Q.

    Parameters
    ----------
    p : Mixture
    motion : Motion

    Returns
    -------
    Mixture
        With the same weights.

    Examples
    --------
    >>> from gmr_gym.mixture import gaussian
    >>> q = predict(gaussian([0.0, 1.0], np.eye(2)), motion([[1.0, 1.0], [0.0, 1.0]], np.zeros((2, 2))))
    >>> q.m.tolist(), q.P.tolist()
    ([[1.0, 1.0]], [[[2.0, 1.0], [1.0, 1.0]]])
    """
    m, P = predict_all(p.m, p.P, motion.F, motion.Q, motion.offset)
    return Mixture(p.w, m, P)


@kernel(inline="always")
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


@kernel(inline="always")
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


@kernel(inline="always")
def predict_detections(m, P, H, R, z):
    """`Sensor.predict_detections` with the gates of the components."""
    (k, p), d = z.shape, m.shape[1]
    z_hat, S, C = innovation(m, P, H, R)
    return PredictedDetections(
        z_hat, S, C, z.reshape(1, k, p), np.empty((0, p, p)), np.zeros(k),
        np.ascontiguousarray(H).reshape(1, p, d), np.ascontiguousarray(R).reshape(1, p, p),
    )  # fmt: skip


@kernel(inline="always")
def innovation(m, P, H, R):
    """Predicted detections H m (n, p), S = H P H' + R (n, p, p) and H P (n, p, d) of every component."""
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
