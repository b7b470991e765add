"""Descent to the barycentre of Gaussians by the measures of overlap, Cauchy-Schwarz and the integral squared
difference, along the steps of their fixed points."""

import numpy as np

from gmr_gym.kernels import kernel, leaf_kernel
from gmr_gym.linalg import inverse_into
from gmr_gym.reduction.measures import CAUCHY_SCHWARZ, LOG_2

STEPS = 500  # of a fixed point
EXACT = 1e-10  # change of a fixed point, relative to standard deviations, that ends it
LONGEST = 50.0  # of the steps of a fixed point taken at once
ROUNDING = 1e-15  # of a sum, relative to log determinants


@kernel
def descend(code, a, x, P, mean, S, exact):
    """A minimum of the sum of a D(component, N(mean, S)), reached from a start and never above it: mean,
    covariance, steps, and the sum but for terms without N, in a unit that P alone decides.

    `code` is that of Cauchy-Schwarz or of the integral squared difference; the shares a (n,) sum to 1. Steps
    are multiples of those of the fixed point, by the rule of Barzilai and Borwein, halved where they lead
    up or to a matrix that is not positive definite. For Cauchy-Schwarz they are of the inverse of the
    covariance. They end at a change of `exact` relative to the standard deviations.
    """
    d, inverted = len(mean), code == CAUCHY_SCHWARZ
    room, step, new_step = np.empty((4, d, d)), np.empty((d + 1, d)), np.empty((d + 1, d))
    mean, S, new_mean, new_S, new_point = mean.copy(), S.copy(), mean.copy(), S.copy(), S.copy()
    scale, half = inverse_into(room[0], P[0], room[1]), inverse_into(room[0], S, room[1])
    point = room[0].copy() if inverted else S.copy()
    value = _overlap_step(inverted, (a, x, P), (mean, S, half), scale, room, step)
    part, steps = 1.0, 0
    while steps < STEPS and not _is_small(step, point, inverted, exact):
        new_value = np.inf
        rounding = ROUNDING * (1.0 + abs(scale) + abs(half)) * (abs(value) + (1.0 if inverted else 0.0))
        while not new_value <= value + rounding and part > EXACT:
            for r in range(d):
                new_mean[r] = mean[r] + part * step[d, r]
                for c in range(d):
                    new_point[r, c] = point[r, c] + part * step[r, c]
            half = inverse_into(room[0], new_point, room[1])
            new_S[:] = room[0] if inverted else new_point
            half = -half if inverted else half
            new_value = _overlap_step(inverted, (a, x, P), (new_mean, new_S, half), scale, room, new_step)
            steps += 1
            if not new_value <= value + rounding:
                part = 1.0 if part > 1.0 else 0.5 * part
        if not new_value <= value + rounding:
            break
        part = _next_part(part, step, new_step, new_point, inverted)
        value, mean, new_mean, S, new_S = new_value, new_mean, mean, new_S, S
        step, new_step, point, new_point = new_step, step, new_point, point
    return mean, S, steps, value


@leaf_kernel
def _is_small(step, point, inverted, exact):
    """Whether a step moves no entry of the mean and of the covariance."""
    d = len(point)
    for r in range(d):
        for c in range(r + 1):
            if not abs(step[r, c]) <= exact * np.sqrt(point[r, r]) * np.sqrt(point[c, c]):
                return False
        if not abs(step[d, r]) <= exact * (1.0 / np.sqrt(point[r, r]) if inverted else np.sqrt(point[r, r])):
            return False
    return True


@leaf_kernel
def _next_part(part, old, new, point, inverted):
    """How many steps of the fixed point to take at once, from the change that the last made in them."""
    d, along, square = len(point), 0.0, 0.0
    for r in range(d + 1):
        for c in range(d):
            if r < d:
                scale = 1.0 / (point[r, r] * point[c, c])
            else:
                scale = point[c, c] if inverted else 1.0 / point[c, c]
            change = new[r, c] - old[r, c]
            along -= scale * old[r, c] * change
            square += scale * change * change
    return min(max(part * along / square, 0.5), LONGEST) if along > 0.0 else 1.0


@leaf_kernel
def _overlap_step(logs, group, q, scale, room, step):
    """The sum of a D(component, N(mean, S)) but for terms without N, of Cauchy-Schwarz where `logs`, else of
    the integral squared difference, with densities in a unit of their own; infinite where S is not positive
    definite, when log|S| / 2 = `half` is nan.

    Writes to `step` what the fixed point changes there: in its first rows the covariance, or its inverse for
    Cauchy-Schwarz, in the last one the mean.
    """
    (a, x, P), (mean, S, half) = group, q
    n, d = x.shape
    T, L, G, H = room
    if np.isnan(half):
        return np.inf
    value, total, shift = (-0.5 * half if logs else np.exp(scale - half)), 0.0, step[d]
    for r in range(d):
        shift[r] = 0.0
        for c in range(d):
            G[r, c] = H[r, c] = 0.0
    for i in range(n):
        for r in range(d):
            for c in range(r + 1):
                step[r, c] = P[i, r, c] + S[r, c]
        log_J = scale + 0.5 * d * LOG_2 - inverse_into(T, step[:d], L)
        for r in range(d):
            L[0, r] = 0.0  # T (m_i - m) from here on
            for c in range(d):
                L[0, r] += T[r, c] * (x[i, c] - mean[c])
            log_J -= 0.5 * L[0, r] * (x[i, r] - mean[r])
        share = a[i] if logs else a[i] * np.exp(log_J)
        value -= a[i] * log_J if logs else 2.0 * share
        total += share
        for r in range(d):
            shift[r] += share * L[0, r]
            for c in range(d):
                H[r, c] += share * T[r, c]
                G[r, c] += share * (T[r, c] - L[0, r] * L[0, c])
    if logs:
        inverse_into(T, S, L)
        for r in range(d):
            for c in range(d):
                step[r, c] = 2.0 * G[r, c] - T[r, c]
        inverse_into(T, H, L)
        _times(T, shift, 1.0, L[0])
        return value
    # the product of a component with N has covariance S - S T S and mean S T (m_i - m) from its own; where
    # every component is too far away nothing moves
    factor = 1.0 / total if total > 0.0 else 0.0
    peak = 0.5 * np.exp(scale - half) * factor
    _times(S, shift, factor, L[0])
    for r in range(d):
        for c in range(d):
            T[r, c] = 0.0
            for k in range(d):
                T[r, c] += S[r, k] * G[k, c]
    for r in range(d):
        for c in range(r + 1):
            inner = 0.0
            for k in range(d):
                inner += T[r, k] * S[k, c]
            step[r, c] = step[c, r] = peak * S[r, c] - factor * inner - shift[r] * shift[c]
    return value


@leaf_kernel
def _times(A, x, factor, room):
    """Overwrites x (d,) with factor A x."""
    for r in range(len(x)):
        room[r] = 0.0
        for c in range(len(x)):
            room[r] += factor * A[r, c] * x[c]
    for r in range(len(x)):
        x[r] = room[r]
