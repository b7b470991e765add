"""Gaussian states and their mixtures, as Stone Soup has them and as arrays."""

from collections.abc import Iterable, Sequence
from datetime import datetime
from typing import Any

import numpy as np
from stonesoup.types.angle import Angle
from stonesoup.types.array import CovarianceMatrix, StateVector
from stonesoup.types.mixture import GaussianMixture
from stonesoup.types.state import (
    GaussianState,
    StateMutableSequence,
    TaggedWeightedGaussianState,
    WeightedGaussianState,
)

from gmr_gym.mixture import Mixture, joined, mixture


def rows_of(name: str, vectors: Sequence[Any], angles: bool = False) -> np.ndarray:
    """State vectors as an array.

    Parameters
    ----------
    name : str
        What they are of, for the error message.
    vectors : sequence of k StateVector (d, 1)
        At least one.
    angles : bool
        Whether entries may be angles of Stone Soup, which become radians.

    Returns
    -------
    ndarray (k, d)

    Raises
    ------
    ValueError
        For vectors of different sizes, and for an angle where there should be none.
    """
    try:
        x = np.asarray(np.concatenate(vectors, axis=1)).T
    except ValueError:
        raise ValueError(f"{name} must have one size, got {sorted({len(v) for v in vectors})}") from None
    if x.dtype == object and not angles:
        for value in x.flat:
            if isinstance(value, Angle):
                raise ValueError(f"{name} must be lengths, got an angle, a {type(value).__name__}")
    return np.ascontiguousarray(x, float)


def mixture_of(state: Any) -> Mixture:
    """The mixture of a state of Stone Soup.

    Parameters
    ----------
    state : GaussianState, GaussianMixture, Track, or sequence of WeightedGaussianState
        Of a Track, its last state. A GaussianState has the weight 1.

    Returns
    -------
    Mixture
        With the weights as they are.

    Raises
    ------
    ValueError
        For a state without a covariance, one with angles, and as `gmr_gym.mixture.mixture`.
    """
    if isinstance(state, StateMutableSequence):
        state = state.state
    parts = state if isinstance(state, GaussianMixture | Sequence) else [state]
    for part in parts:
        if not isinstance(part, GaussianState):
            raise ValueError(f"a state must be a GaussianState or a GaussianMixture, got {_kind(part)}")
    if isinstance(state, Sequence) and any(isinstance(part, GaussianMixture) for part in parts):
        return joined([mixture_of(part) for part in parts])
    w = [float(getattr(part, "weight", 1.0)) for part in parts]
    m = rows_of("states", [part.state_vector for part in parts])
    return mixture(w, m, np.array([part.covar for part in parts], float))


def components_of(
    p: Mixture, timestamp: datetime | None = None, tags: Iterable[str] | None = None
) -> list[WeightedGaussianState]:
    """The components of a mixture as Stone Soup has them.

    Parameters
    ----------
    p : Mixture
    timestamp : datetime, optional
        Of all of them.
    tags : iterable of n str, optional
        With tags they are TaggedWeightedGaussianState, as its filters of many targets take them.

    Returns
    -------
    list of n WeightedGaussianState
    """
    each = [(vector(m), CovarianceMatrix(P), timestamp, float(w)) for w, m, P in zip(*p, strict=True)]
    if tags is None:
        return [WeightedGaussianState(x, P, time, weight=w) for x, P, time, w in each]
    return [
        TaggedWeightedGaussianState(x, P, time, weight=w, tag=tag)
        for (x, P, time, w), tag in zip(each, tags, strict=True)
    ]


def vector(x: np.ndarray) -> StateVector:
    """The array (d,) as a StateVector (d, 1)."""
    return x.reshape(-1, 1).view(StateVector)


def _kind(thing: Any) -> str:
    return f"a {type(thing).__name__}"
