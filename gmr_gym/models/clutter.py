"""The intensity of clutter. An intensity is a density whose integral is an expected number."""

from typing import NamedTuple

import numpy as np

from gmr_gym.mixture import Mixture, log_density
from gmr_gym.models.gating import unit_ball


class Clutter(NamedTuple):
    """Intensity of false alarms per scan, over a box: a uniform, a Gaussian and an elliptic part.

    Attributes
    ----------
    low, high : ndarray (p,)
        Opposite corners of the box, m.
    uniform : float
        Expected number of false alarms that are uniform in the box.
    gaussians : Mixture
        Gaussian parts; the weights are expected numbers. For none the shapes are (0,), (0, p), (0, p, p).
    ellipses : Mixture
        Likewise, each uniform where (z - m)' P^-1 (z - m) <= 1.
    """

    low: np.ndarray
    high: np.ndarray
    uniform: float
    gaussians: Mixture
    ellipses: Mixture

    @property
    def expected(self) -> float:
        """Expected number of false alarms per scan."""
        return float(self.uniform + self.gaussians.w.sum() + self.ellipses.w.sum())

    @property
    def volume(self) -> float:
        """Volume of the box, m^p."""
        return np.prod(self.high - self.low)

    def density(self, z: np.ndarray) -> np.ndarray:
        """Clutter density kappa(z), per unit volume of the sensor's space.

        The Gaussians are not truncated at the box, and the uniform part extends beyond it, so that the
        density is positive everywhere.

        Parameters
        ----------
        z : ndarray (k, p)
            Detections.

        Returns
        -------
        ndarray (k,)
        """
        kappa = np.full(len(z), self.uniform / self.volume)
        if len(self.gaussians.w):
            kappa += np.exp(log_density(self.gaussians, z))
        for w, m, P in zip(*self.ellipses, strict=True):
            L = np.linalg.cholesky(P)
            inside = (np.linalg.solve(L, (z - m).T) ** 2).sum(axis=0) <= 1
            kappa += inside * w / (unit_ball(len(m)) * np.prod(np.diag(L)))
        return kappa


def uniform_clutter(low, high, expected: float) -> Clutter:
    """Clutter that is uniform in a box.

    Parameters
    ----------
    low, high : array_like (p,)
        Opposite corners of the box, m.
    expected : float
        Expected number of false alarms per scan.

    Examples
    --------
    >>> clutter = uniform_clutter([0.0, 0.0], [100.0, 100.0], expected=10.0)
    >>> clutter.expected, clutter.density(np.zeros((1, 2))).tolist()
    (10.0, [0.001])
    """
    low, high = np.array(low, float), np.array(high, float)
    return Clutter(low, high, float(expected), no_components(len(low)), no_components(len(low)))


def no_components(d: int) -> Mixture:
    """The intensity without components in d dimensions."""
    return Mixture(np.empty(0), np.empty((0, d)), np.empty((0, d, d)))
