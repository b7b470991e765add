"""The intensity of clutter, and intensities in general: densities whose integral is an expected number."""

from typing import NamedTuple

import numpy as np

from gmr_gym.mixture import Mixture, log_density
from gmr_gym.models.gating import unit_ball


class Clutter(NamedTuple):
    """Intensity of false detections in a scan, over a box: uniform, Gaussian and elliptic parts."""

    low: np.ndarray  # (p,), m
    high: np.ndarray  # (p,), m
    uniform: float  # expected number, uniform in the box
    gaussians: Mixture  # weights are expected numbers; may hold none, shapes (0,), (0, p), (0, p, p)
    ellipses: Mixture  # likewise, each uniform where (z - m)' P^-1 (z - m) <= 1

    @property
    def expected(self) -> float:
        """Number of false detections in a scan."""
        return float(self.uniform + self.gaussians.w.sum() + self.ellipses.w.sum())

    @property
    def volume(self) -> float:
        """Of the box, m^p."""
        return np.prod(self.high - self.low)

    def density(self, z: np.ndarray) -> np.ndarray:
        """kappa(z) (k,), per unit of the detections' space, at detections z (k, p): Gaussians are not cut off
        at the box, and the uniform part is taken to go on beyond it, so that nothing has no explanation."""
        kappa = np.full(len(z), self.uniform / self.volume)
        if len(self.gaussians.w):
            kappa += np.exp(log_density(self.gaussians, z))
        for w, m, P in zip(*self.ellipses, strict=True):
            L = np.linalg.cholesky(P)
            inside = (np.linalg.solve(L, (z - m).T) ** 2).sum(axis=0) <= 1
            kappa += inside * w / (unit_ball(len(m)) * np.prod(np.diag(L)))
        return kappa


def uniform_clutter(low, high, expected: float) -> Clutter:
    """`expected` false detections a scan, uniform between two opposite corners (p,)."""
    low, high = np.array(low, float), np.array(high, float)
    return Clutter(low, high, float(expected), no_components(len(low)), no_components(len(low)))


def no_components(d: int) -> Mixture:
    """The intensity of no component in d dimensions."""
    return Mixture(np.empty(0), np.empty((0, d)), np.empty((0, d, d)))
