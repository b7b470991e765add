"""The interface of a sensor, linear or not."""

from typing import NamedTuple, Protocol

import numpy as np

from gmr_gym.mixture import Mixture


class PredictedDetections(NamedTuple):
    """Predicted detections of every component, their innovation covariances, and the scan in the same
    coordinates."""

    z_hat: np.ndarray  # (n, p), predicted detections
    S: np.ndarray  # (n, p, p), innovation covariances, without the noise R of the detection
    C: np.ndarray  # (n, p, d), covariances of detection and state, H P
    z: np.ndarray  # (n, k, p) the scan, or (1, k, p) where it is the same for all components
    R: np.ndarray  # (k, p, p), noise covariance that depends on the detection; (0, p, p) for none
    log_jacobian: np.ndarray  # (k,), log of the volume here per unit volume of the sensor's own space
    H: np.ndarray  # (n, p, d), or (1, p, d) where all are equal: derivative of z_hat by the state
    noise: np.ndarray  # (n, p, p), or (1, p, p): S - H P H'


class MeasurementModel(Protocol):
    """Interface of a sensor, linear or not. Detections and gates both have p dimensions, but may be in
    different spaces: a radar detects ranges and angles, and its gates are in metres."""

    @property
    def H(self) -> np.ndarray:
        """Matrix (p, d) from a state to the gates' space."""

    @property
    def R(self) -> np.ndarray:
        """Covariance (p, p) of the measurement noise."""

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names (p,) of the coordinates of a detection, with units."""

    def measure(self, x: np.ndarray) -> np.ndarray:
        """Noise-free detections (..., p) of states x (..., d)."""

    def relative(self, z: np.ndarray, centre: np.ndarray) -> np.ndarray:
        """Detections z (..., p) relative to a centre (p,)."""

    def wrap_and_validate(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Detections (k, p) with angles wrapped, and a mask (k,) of those the sensor could report."""

    def to_gate_space(self, z: np.ndarray) -> np.ndarray:
        """Detections z (k, p) in the gates' space."""

    def gates(self, p: Mixture) -> tuple[np.ndarray, np.ndarray]:
        """Centres (n, p) and covariances (n, p, p) of the gates of n predicted components."""

    def density(self, density: float, at: np.ndarray) -> np.ndarray:
        """Density (n,) in the gates' space at points `at` (n, p) of a density in the sensor's own space."""

    def predict_detections(
        self, p: Mixture, z_hat: np.ndarray, S: np.ndarray, z: np.ndarray
    ) -> PredictedDetections:
        """Predicted detections of every component of p, whose gates have centres z_hat (n, p) and
        covariances S, their innovation covariances, and the scan z (k, p) in the same coordinates."""
