"""Linear-Gaussian motion and sensing, over whole stacks of Gaussians."""

from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_covariance
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture
from gmr_gym.models.sensing import PredictedDetections


class Motion(NamedTuple):
    """x' = F x + offset + noise of covariance Q, over one scan period."""

    F: np.ndarray  # (d, d)
    Q: np.ndarray  # (d, d), positive semidefinite
    offset: np.ndarray  # (d,), the known input; zeros when there is none


class Sensor(NamedTuple):
    """z = H x + noise of covariance R."""

    H: np.ndarray  # (p, d)
    R: np.ndarray  # (p, p)

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names (p,), with units, of what it detects: a position in the plane or in space."""
        return tuple(f"{axis}_m" for axis in "xyz"[: len(self.H)])

    def measure(self, x: np.ndarray) -> np.ndarray:
        """What it would say of states x (..., d), without noise (..., p)."""
        return x @ self.H.T

    def gates(self, p: Mixture) -> tuple[np.ndarray, np.ndarray]:
        """Predicted detections (n, p) and their innovation covariances (n, p, p)."""
        return innovation(p.m, p.P, self.H, self.R)[:2]

    def relative(self, z: np.ndarray, centre: np.ndarray) -> np.ndarray:
        """Detections (..., p) as seen from a centre (p,)."""
        return z - centre

    def wrap_and_validate(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (k, p) of its space as it would report them, and which of them it can (k,)."""
        return z, np.ones(len(z), bool)

    def to_gate_space(self, z: np.ndarray) -> np.ndarray:
        """Detections z (k, p) where the gates stand."""
        return z

    def density(self, density: float, at: np.ndarray) -> np.ndarray:
        """What a density in the sensor's own space is in that of the gates, at places (n, p)."""
        return np.full(len(at), density)

    def predict_detections(
        self, p: Mixture, z_hat: np.ndarray, S: np.ndarray, z: np.ndarray
    ) -> PredictedDetections:
        """The scan z (k, p) as the components of p see it, whose gates are (expected, S)."""
        none = np.empty((0, *self.R.shape))
        C = _cross(p.P, self.H)
        return PredictedDetections(z_hat, S, C, z[None], none, np.zeros(len(z)), self.H[None], self.R[None])


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


def position_sensor(deviation: float, axes: int = 2, rates: int = 1) -> Sensor:
    """Positions of the state [positions, velocities, ...] with `rates` rates of change beside them, noise
    `deviation` (m) on each axis (D'Ortenzio, eq. 19)."""
    H = np.eye(axes, axes * (1 + rates))
    return sensor(H, deviation**2 * np.eye(axes))


def predict(p: Mixture, motion: Motion) -> Mixture:
    """Every component carried forward one period: F m + offset, F P F' + Q."""
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
def innovation(m, P, H, R):
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
