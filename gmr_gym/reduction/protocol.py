"""The return value of a reduction."""

import warnings

import numpy as np

from gmr_gym.checks import sound
from gmr_gym.mixture import Mixture, match_groups

Reduced = tuple[Mixture, np.ndarray]
_WARNED: dict = {}  # what Python keeps of warnings that are shown once


TOO_FAR = (
    "components lie too far apart: over more than some 1e8 standard deviations, the covariance of their "
    "merge is lost in rounding"
)


def check_reduced(reduced, n: int) -> None:
    """Raise ValueError unless a reduction of n components has returned a Mixture and an origin (n,)."""
    try:
        mixture, origin = reduced
        fits = isinstance(mixture, Mixture) and np.shape(origin) == (n,)
    except (TypeError, ValueError):
        fits = False
    if not fits:
        raise ValueError(f"a reduction must return a Mixture and the origin ({n},) of its input")


def at_unit(w: np.ndarray) -> np.ndarray:
    """The weights w (n,) scaled by a power of two, without rounding, so that the largest is just below 1:
    products of tiny weights do not underflow."""
    return np.ldexp(w, -np.frexp(w.max())[1])


def grouped(p: Mixture, group: np.ndarray, count: int) -> Mixture:
    """Moment match of each of `count` groups of a checked mixture, none of them empty; ValueError where a
    merged covariance is lost in rounding beside the distance between its members."""
    return definite(match_groups(p, group, count))


def through(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Origin (n,) of two reductions, one after the other."""
    return np.append(second, -1)[first]


def warn_unfinished(what: str, limit: int) -> None:
    """Warns, in one line and once, that an iteration has stopped at its limit."""
    # without a file: its source would be printed as a second line
    message = f"{what} has stopped at its limit of {limit} iterations"
    warnings.warn_explicit(message, UserWarning, "gmr_gym", 1, registry=_WARNED)


def definite(q: Mixture) -> Mixture:
    """The mixture; ValueError where a covariance is no longer positive definite."""
    if not sound(*q):
        raise ValueError(TOO_FAR)
    return q
