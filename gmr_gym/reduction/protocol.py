"""What a reduction returns."""

import numpy as np

from gmr_gym.checks import sound
from gmr_gym.mixture import Mixture, match_groups

Reduced = tuple[Mixture, np.ndarray]


TOO_FAR = (
    "components lie too far apart: over more than some 1e8 standard deviations, the covariance of their "
    "merge is lost in rounding"
)


def check_reduced(reduced, n: int) -> None:
    """Raise ValueError unless a reduction of n components has returned a Mixture and an origin (n,)."""
    try:
        mixture, origin = reduced
        sound = isinstance(mixture, Mixture) and np.shape(origin) == (n,)
    except (TypeError, ValueError):
        sound = False
    if not sound:
        raise ValueError(f"a reduction must return a Mixture and the origin ({n},) of what it was given")


def at_unit(w: np.ndarray) -> np.ndarray:
    """The weights w (n,) times the power of two, which rounds nothing, that brings the largest just below 1:
    products of tiny ones do not underflow."""
    return np.ldexp(w, -np.frexp(w.max())[1])


def grouped(p: Mixture, group: np.ndarray, count: int) -> Mixture:
    """Moment match of each of `count` groups of a checked mixture; none of them empty.

    Raises ValueError where the covariance of one has drowned in the distance between its members."""
    return _definite(match_groups(p, group, count))


def through(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Origin (n,) of a reduction of what another has left."""
    return np.append(second, -1)[first]


def _definite(q: Mixture) -> Mixture:
    """The mixture; ValueError where a covariance is none any more."""
    if not sound(*q):
        raise ValueError(TOO_FAR)
    return q
