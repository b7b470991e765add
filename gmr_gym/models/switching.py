"""Transition matrices of the modes of a target."""

import numpy as np


def sticky_switching(probability: float, modes: int) -> np.ndarray:
    """Transition matrix (r, r) that keeps the mode with `probability`, and has equal probabilities
    otherwise.

    Parameters
    ----------
    probability : float
        In [0, 1].
    modes : int
        r.

    Examples
    --------
    >>> sticky_switching(0.5, 3).tolist()
    [[0.5, 0.25, 0.25], [0.25, 0.5, 0.25], [0.25, 0.25, 0.5]]
    """
    if not 0 <= probability <= 1:
        raise ValueError(f"probability must lie in [0, 1], got {probability}")
    if modes < 1:
        raise ValueError(f"modes must be at least 1, got {modes}")
    if modes == 1:
        return np.ones((1, 1))
    leaving = (1 - probability) / (modes - 1)
    return np.full((modes, modes), leaving) + (probability - leaving) * np.eye(modes)


def check_switching(switching, modes: int) -> np.ndarray:
    """The transition matrix as floats (r, r); ValueError unless every column is a distribution over the
    modes."""
    switching = np.array(switching, float)
    if switching.shape != (modes, modes):
        raise ValueError(f"switching must have shape {(modes, modes)}, got {switching.shape}")
    if not ((switching >= 0) & (switching <= 1)).all():
        raise ValueError("switching must hold probabilities between 0 and 1")
    totals = switching.sum(axis=0)
    if not np.allclose(totals, 1, rtol=0, atol=1e-9):
        rows = switching.sum(axis=1)
        hint = "; its rows do, so pass the transpose" if np.allclose(rows, 1, rtol=0, atol=1e-9) else ""
        raise ValueError(
            f"switching must be column-stochastic, switching[q, p] the probability of mode q after "
            f"mode p, but its columns sum to {np.round(totals, 6).tolist()}{hint}"
        )
    return switching
