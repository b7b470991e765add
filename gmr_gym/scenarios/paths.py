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


def many_given(name: str, given: Any, widths: Sequence[int]) -> np.ndarray:
    """Check the states of many targets.

    Parameters
    ----------
    name : str
        Of the argument, for errors.
    given : array_like (T, m, one of widths)
        States, m and s; nan or masked where a target is absent.
    widths : sequence of int
        Numbers that a state may have: positions and velocities, and so on.

    Returns
    -------
    ndarray (T, m, last of widths)
        Derivatives that are not given are 0.

    Raises
    ------
    ValueError
        For another shape, a state of which only some is nan, a number out of bounds, and a target that is
        absent throughout.
    """
    shapes = " or ".join(f"(T, m, {width})" for width in widths)
    try:
        states: np.ma.MaskedArray = np.ma.array(given, float)
    except (TypeError, ValueError):
        raise ValueError(f"{name} must be numbers of shape {shapes}") from None
    x = np.array(states.data)
    if x.ndim != 3 or x.shape[2] not in widths or min(x.shape) < 1:
        raise ValueError(f"{name} must have shape {shapes}, got {x.shape}")
    x[np.ma.getmaskarray(states).any(axis=2)] = np.nan
    absent = np.isnan(x).all(axis=2)
    if not (np.abs(x[~absent]) <= 1e6).all():
        raise ValueError(f"{name} must be finite and within a million of zero, or nan in a whole state")
    if never := np.flatnonzero(absent.all(axis=0)).tolist():
        raise ValueError(f"{name} must show every target, but {never} are absent throughout")
    missing = np.where(absent, np.nan, 0.0)[..., None].repeat(widths[-1] - x.shape[2], axis=2)
    return np.concatenate((x, missing), axis=2)


def unvaried(x: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The truth of a scenario whose targets always fly the paths x (T, m, d)."""
    return x


def both_ways(middle: np.ndarray, at: int, F: np.ndarray, noise: np.ndarray) -> np.ndarray:
    """Paths that run forward and backward from their states in the middle.

    Parameters
    ----------
    middle : ndarray (m, d)
        States at scan `at`, from 0.
    at : int
    F : ndarray (T, m, d, d) or (1, m, d, d) or (1, 1, d, d)
        Transition matrix from scan t to t + 1 of each target.
    noise : ndarray (T, m, d)
        Process noise: that of scan t is added after the transition to it and, backward, before that from it.

    Returns
    -------
    ndarray (T, m, d)
    """
    x = np.empty(noise.shape)
    F = np.broadcast_to(F, (*noise.shape, noise.shape[-1]))
    back = np.linalg.inv(F)
    x[at] = middle
    for t in range(at + 1, len(x)):
        x[t] = (F[t - 1] @ x[t - 1, :, :, None])[..., 0] + noise[t]
    for t in range(at - 1, -1, -1):
        x[t] = (back[t] @ (x[t + 1] + noise[t])[..., None])[..., 0]
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
