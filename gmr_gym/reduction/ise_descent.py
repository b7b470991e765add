"""Quasi-Newton descent of the integral squared error: the BFGS method."""

import numpy as np

from gmr_gym.mixture import Mixture
from gmr_gym.reduction.ise_gradient import Problem, moved, objective

FARTHEST = 0.3  # change of a parameter, in a step that is tried first
TOLERANCE = 1e-7  # of the decrease that the next step promises, relative to the error
FLOOR = 1e-11  # the same, relative to J_ff: below it there may be a thousand steps to go, for nothing
TRIALS = 25  # of the length of a step
LEAST = 1e-300  # second derivative, relative to J_ff: what has less stays


def descend(problem: Problem, steps: int) -> tuple[Mixture, bool]:
    """The mixture where J is least, downhill from the start, and whether it was found within that many
    steps."""
    n, d = problem.start.m.shape
    x = np.zeros((n, 1 + d + d * d))
    error, gradient = objective(problem, x)
    H = _first_metric(problem, gradient)
    for _ in range(steps):
        step = -_times(H, gradient.ravel()).reshape(x.shape)
        promised = -np.vdot(step, gradient)  # twice the decrease, as J is nearly quadratic
        if not promised > 2 * (TOLERANCE * error + FLOOR):
            return moved(problem, x), True
        there, ahead, least = _along(problem, x, step, error, promised)
        if not least < error:  # within rounding
            return moved(problem, x), True
        _learn(H, (there - x).ravel(), (ahead - gradient).ravel())
        x, gradient, error = there, ahead, least
    return moved(problem, x), False


def _first_metric(problem: Problem, gradient: np.ndarray) -> np.ndarray:
    """Inverse of a rough second derivative of J / J_ff, diagonal: v^2 J_jj for component j, or as much more
    as keeps its first step short."""
    curvature = np.maximum(problem.own / problem.square, np.linalg.norm(gradient, axis=1) / FARTHEST)
    inverse = np.divide(1.0, curvature, out=np.zeros(len(curvature)), where=curvature > LEAST)
    return np.diag(np.repeat(inverse, gradient.shape[1]))


def _along(
    problem: Problem, x: np.ndarray, step: np.ndarray, error: float, promised: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """A point along the step, its gradient and its error: there J has fallen by a part of what was promised,
    and its slope has become less steep (the weak Wolfe conditions)."""
    t, low, high = min(1.0, FARTHEST / np.abs(step).max()), 0.0, np.inf
    for _ in range(TRIALS):
        there = x + t * step
        least, ahead = objective(problem, there)
        if not least <= error - 1e-4 * t * promised:
            high = t
            if low == 0 and least < np.inf:  # to the least of the parabola
                t *= min(max(0.5 * promised * t / (least - error + promised * t), 0.1), 0.5)
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
