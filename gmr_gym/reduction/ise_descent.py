"""Quasi-Newton descent by the BFGS method, of an error that is a difference of near equals of order one."""

from collections.abc import Callable

import numpy as np

Objective = Callable[[np.ndarray], tuple[float, np.ndarray]]

FARTHEST = 0.3  # change of a parameter, in a step that is tried first
TOLERANCE = 1e-7  # of the decrease that the next step promises, relative to the error
FLOOR = 1e-11  # the same, relative to J_ff: below it there may be a thousand steps to go, for nothing
TRIALS = 25  # of the length of a step
LEAST = 1e-300  # second derivative: what has less stays


def descend(objective: Objective, curvature: np.ndarray, p: int, steps: int) -> tuple[np.ndarray, bool]:
    """Parameters x (L, p) where a function is least, downhill from 0, and whether they were found within that
    many steps.

    Parameters
    ----------
    objective : callable
        The value at x, which may be infinite but at 0, and its gradient (L, p).
    curvature : ndarray (L,)
        A rough second derivative with respect to the parameters in each row.
    p : int
    steps : int
    """
    x = np.zeros((len(curvature), p))
    value, gradient = objective(x)
    H = _first_metric(curvature, gradient)
    for _ in range(steps):
        step = -_times(H, gradient.ravel()).reshape(x.shape)
        promised = -np.vdot(step, gradient)  # twice the decrease, if the function is quadratic
        if not promised > 2 * (TOLERANCE * value + FLOOR):
            return x, True
        there, ahead, least = _along(objective, x, step, value, promised)
        if not least < value:  # within rounding
            return x, True
        _learn(H, (there - x).ravel(), (ahead - gradient).ravel())
        x, gradient, value = there, ahead, least
    return x, False


def _first_metric(curvature: np.ndarray, gradient: np.ndarray) -> np.ndarray:
    """Inverse of the second derivative, diagonal: of the curvature, or of as much more as keeps the first
    step of a row short."""
    curvature = np.maximum(curvature, np.linalg.norm(gradient, axis=1) / FARTHEST)
    inverse = np.divide(1.0, curvature, out=np.zeros(len(curvature)), where=curvature > LEAST)
    return np.diag(np.repeat(inverse, gradient.shape[1]))


def _along(
    objective: Objective, x: np.ndarray, step: np.ndarray, value: float, promised: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """A point along the step, its gradient and its value, which has fallen by a part of what was promised and
    falls less steeply there (the weak Wolfe conditions)."""
    t, low, high = min(1.0, FARTHEST / np.abs(step).max()), 0.0, np.inf
    for _ in range(TRIALS):
        there = x + t * step
        least, ahead = objective(there)
        if not least <= value - 1e-4 * t * promised:
            high = t
            if low == 0 and least < np.inf:  # to the least of the parabola
                t *= min(max(0.5 * promised * t / (least - value + promised * t), 0.1), 0.5)
                continue
        elif -np.vdot(ahead, step) > 0.9 * promised:
            low = t
        else:
            break
        t = 0.5 * (low + high) if high < np.inf else 2 * t
    return there, ahead, least


def _learn(H: np.ndarray, s: np.ndarray, y: np.ndarray) -> None:
    """The BFGS update of the inverse H of the second derivative, in place, from a step s and the change y of
    the gradient; none where the slope has not risen along it."""
    sy, Hy = s @ y, _times(H, y)
    if sy > 0:
        across = np.outer(s, 0.5 * (1 + y @ Hy / sy) * s - Hy) / sy
        H += across
        H += across.T


def _times(H: np.ndarray, y: np.ndarray) -> np.ndarray:
    """H y. BLAS would share it among threads, for which small ones wait longer than it takes."""
    return np.einsum("ij,j", H, y)
