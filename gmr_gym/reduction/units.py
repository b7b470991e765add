"""Coordinates in which a mixture has weight 1, mean 0 and unit covariance."""

from typing import NamedTuple

import numpy as np

from gmr_gym.checks import sound
from gmr_gym.mixture import Mixture, mean_and_covariance


class Units(NamedTuple):
    """What the coordinates are made with."""

    total: float  # weight
    mean: np.ndarray  # (d,)
    root: np.ndarray  # (d, d), Cholesky factor of the covariance


def standard(p: Mixture) -> tuple[Units, Mixture]:
    """The Units of a checked mixture and the mixture in them; LinAlgError where a covariance is lost in
    rounding."""
    mean, covariance = mean_and_covariance(p)
    units = Units(p.w.sum(), mean, np.linalg.cholesky(covariance))
    f = into(units, p)
    if not sound(*f):
        raise np.linalg.LinAlgError("a covariance is lost in rounding")
    return units, f


def into(units: Units, q: Mixture) -> Mixture:
    """The mixture in these coordinates."""
    half = np.linalg.solve(units.root, q.P).transpose(0, 2, 1)
    m = np.linalg.solve(units.root, (q.m - units.mean).T).T
    return Mixture(q.w / units.total, m.copy(), symmetric(np.linalg.solve(units.root, half)))


def out_of(units: Units, q: Mixture) -> Mixture:
    """Inverse of `into`."""
    P = symmetric(units.root @ q.P @ units.root.T)
    return Mixture(units.total * q.w, units.mean + q.m @ units.root.T, P)


def symmetric(P: np.ndarray) -> np.ndarray:
    """Symmetric part of matrices (n, d, d)."""
    return 0.5 * (P + P.transpose(0, 2, 1))
