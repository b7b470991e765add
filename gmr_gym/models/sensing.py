"""What a sensor, linear or not, has to know."""

from typing import NamedTuple, Protocol

import numpy as np

from gmr_gym.mixture import Mixture


class PredictedDetections(NamedTuple):
    """A scan as the components of a mixture see it: what each expects, and the detections to compare."""

    z_hat: np.ndarray  # (n, p)
    S: np.ndarray  # (n, p, p), innovation covariances, less what a detection itself brings
    C: np.ndarray  # (n, p, d), covariances of detection and state, H P
    z: np.ndarray  # (n, k, p), or (1, k, p) where all components see the same
    R: np.ndarray  # (k, p, p), noise that goes with the detection; (0, p, p) for none
    log_jacobian: np.ndarray  # (k,), log of the volume here that a unit of the sensor's own space fills
    H: np.ndarray  # (n, p, d), or (1, p, d) where all have the same: what is expected, by the state
    noise: np.ndarray  # (n, p, p), or (1, p, p): what of S is not H P H'


class MeasurementModel(Protocol):
    """What a sensor, linear or not, has to know. Its detections and its gates have p dimensions alike, but
    may be of different spaces: a radar says ranges and angles, and is gated in metres."""

    @property
    def H(self) -> np.ndarray:
        """(p, d), from a state to the place of the gates."""

    @property
    def R(self) -> np.ndarray:
        """(p, p), covariance of the noise of what it says."""

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of what it says, with their units."""

    def measure(self, x: np.ndarray) -> np.ndarray:
        """What it would say of states x (..., d), without noise (..., p)."""

    def relative(self, z: np.ndarray, centre: np.ndarray) -> np.ndarray:
        """Detections (..., p) as seen from a centre (p,)."""

    def wrap_and_validate(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points (k, p) of its space as it would report them, and which of them it can (k,)."""

    def to_gate_space(self, z: np.ndarray) -> np.ndarray:
        """Detections z (k, p) where the gates stand."""

    def gates(self, p: Mixture) -> tuple[np.ndarray, np.ndarray]:
        """Centres (n, p) and covariances (n, p, p) of the gates of n predicted components."""

    def density(self, density: float, at: np.ndarray) -> np.ndarray:
        """What a density in the sensor's own space is in that of the gates, at places (n, p)."""

    def predict_detections(
        self, p: Mixture, z_hat: np.ndarray, S: np.ndarray, z: np.ndarray
    ) -> PredictedDetections:
        """The scan z (k, p) as the components of p see it, whose gates are (expected, S)."""
