"""Paths of targets: states that are given, shortened, or drawn from a model."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from gmr_gym.models.model import Model
from gmr_gym.points import check_unmasked
from gmr_gym.simulation.single_target import Truth


def states_given(name: str, given: Any, widths: Sequence[int], least: int) -> np.ndarray:
    """Check the states of a path.

    Parameters
    ----------
    name : str
        Of the argument, for errors.
    given : array_like (T, one of widths)
        Positions, or positions and velocities and so on, m and s.
    widths : sequence of int
        Numbers that a state may have.
    least : int
        Fewest states.

    Returns
    -------
    ndarray (T, one of widths)

    Raises
    ------
    ValueError
        For another shape, fewer states, and for a number that is masked, not finite or out of bounds.
    """
    check_unmasked(name, given)
    shapes = " or ".join(f"(T, {width})" for width in widths)
    try:
        x = np.array(given, float)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be numbers of shape {shapes}") from None
    if x.ndim != 2 or x.shape[1] not in widths or len(x) < least:
        raise ValueError(f"{name} must have shape {shapes} with T >= {least}, got {x.shape}")
    if not (np.abs(x) <= 1e6).all():
        raise ValueError(f"{name} must be finite and within a million metres, and m/s, of zero")
    return x


def shortened(x: np.ndarray, horizon: int | None) -> np.ndarray:
    """The first scans of a path.

    Parameters
    ----------
    x : ndarray (T, ...)
    horizon : int or None
        Number of scans; all for None.

    Returns
    -------
    ndarray (horizon, ...)

    Raises
    ------
    ValueError
        If x has fewer scans, or `horizon` is not a whole number.
    """
    if horizon is None:
        return x
    if not 1 <= horizon <= len(x) or horizon != int(horizon):
        raise ValueError(
            f"horizon must be between 1 and the {len(x)} scans of the path, whole, got {horizon}"
        )
    return x[: int(horizon)]


def moving_by_model(assumed: Model, mode: np.ndarray, rng: np.random.Generator) -> Truth:
    """Draw a truth from the filter model.

    Parameters
    ----------
    assumed : Model
        The filter model. The target starts from its prior, one period before the first scan.
    mode : ndarray (T,)
        Index of the motion model of each scan.
    rng : Generator

    Returns
    -------
    Truth
    """
    w, m, P = assumed.prior
    first = rng.choice(len(w), p=w) if len(w) > 1 else 0
    x = rng.multivariate_normal(m[first], P[first], method="cholesky")
    states = np.empty((len(mode), len(x)))
    factors = np.array([_factor(motion.Q) for motion in assumed.motions])
    normal = rng.standard_normal((len(mode), 1, len(x)))
    noise = (normal @ factors[mode].transpose(0, 2, 1))[:, 0]
    for t, p in enumerate(mode):
        F, _, offset = assumed.motions[p]
        x = states[t] = F @ x + offset + noise[t]
    return Truth(states, mode)


def _factor(Q: np.ndarray) -> np.ndarray:
    """A (d, d) with A A' = Q, which may be singular: the one of numpy's method "eigh"."""
    values, vectors = np.linalg.eigh(Q)
    return vectors * np.sqrt(np.abs(values))
