"""Clutter learned from scan to scan: a uniform and Gaussians, fitted to the detections of the past, each
counted by its probability of being false and by its age.

The fit is expectation maximisation that takes from every Gaussian what its own description costs, so that
those which explain too little vanish (Figueiredo and Jain 2002); where the uniform part has to explain too
many detections, a Gaussian is added.
"""

from typing import NamedTuple

import numpy as np
from numba import njit

from gmr_gym.mixture import LOG_2PI, Mixture, cholesky_into, mahalanobis_squared
from gmr_gym.multitarget import Clutter

NEIGHBOURHOOD = 12  # a new Gaussian is looked for in squares of so many to a side of the box


class Learner(NamedTuple):
    """How clutter is learned; `learner` checks one."""

    memory: int  # scans, after which a detection counts 1 / e of what it did; after twice as many, nothing
    deviation: float  # m, on each axis: no Gaussian is narrower
    most: int  # Gaussians
    iterations: int  # of expectation maximisation, a scan


class Lessons(NamedTuple):
    """What has been learned, and the detections that it was learned from."""

    z: np.ndarray  # (n, p), detections of the scans remembered
    false: np.ndarray  # (n,), probability that each was false
    age: np.ndarray  # (n,), scans since
    scans: int  # remembered
    clutter: Clutter


def learner(memory: int = 20, deviation: float = 15.0, most: int = 12, iterations: int = 2) -> Learner:
    """Checked Learner; ValueError naming the parameter."""
    if not 0 < deviation < np.inf:
        raise ValueError(f"deviation must be positive, got {deviation}")
    for name, value in (("memory", memory), ("most", most), ("iterations", iterations)):
        if isinstance(value, bool) or value != int(value) or value < 1:
            raise ValueError(f"{name} must be a whole number, at least 1, got {value}")
    return Learner(int(memory), float(deviation), int(most), int(iterations))


def first_lesson(clutter: Clutter) -> Lessons:
    """Nothing has been seen; `clutter` is what was told, whose box stays and whose uniform part counts as one
    scan's evidence."""
    p = len(clutter.low)
    return Lessons(np.empty((0, p)), np.empty(0), np.empty(0, int), 0, clutter)


def learn(told: Clutter, lessons: Lessons, z: np.ndarray, false: np.ndarray, how: Learner) -> Lessons:
    """The lessons after a scan z (k, p) whose detections are false with probabilities `false` (k,).

    `told` is what was believed at first: it counts as one scan of clutter, spread as it says."""
    kept = lessons.age + 1 < 2 * how.memory
    points = np.concatenate([lessons.z[kept], z])
    probability = np.concatenate([lessons.false[kept], false])
    age = np.concatenate([lessons.age[kept] + 1, np.zeros(len(z), int)])
    remembered = min(lessons.scans + 1, 2 * how.memory)
    weight = probability * np.exp(-age / how.memory)
    scans = np.exp(-np.arange(remembered) / how.memory).sum()
    flat = 1 / np.prod(told.high - told.low)
    a = np.append(lessons.clutter.uniform, lessons.clutter.gaussians.w) * scans
    m, P = lessons.clutter.gaussians.m, lessons.clutter.gaussians.P
    if len(m) < how.most and len(z):
        a, m, P = added(z, points, weight, a, m, P, flat, how.deviation)
    for _ in range(how.iterations):
        a, m, P = fitted(points, weight, a, m, P, flat, how.deviation)
    # one scan's worth of what was told, uniform, so that no place is without clutter
    w = a / (scans + 1.0)
    uniform = w[0] + told.expected / (scans + 1.0)
    learned = told._replace(uniform=uniform, gaussians=Mixture(w[1:], m, P))
    return Lessons(points, probability, age, remembered, learned)


@njit(cache=True, error_model="numpy")
def fitted(z, weight, a, m, P, flat, deviation):
    """One step of expectation maximisation: numbers a (1 + k,) of detections, the first those of the uniform
    part of density `flat`, means m (k, p) and covariances P (k, p, p), of the points z (n, p), each counted
    `weight` (n,) times. A Gaussian is charged half its parameters (Figueiredo and Jain, eq. 17) and goes when
    nothing is left of it; what it loses the uniform part has."""
    (n, p), k = z.shape, len(m)
    share = responsibilities(z, a, m, P, flat)
    cost = (p + p * (p + 1) / 2) / 2
    left = np.zeros(k)
    m_out, P_out = np.zeros((k, p)), np.zeros((k, p, p))
    a_out = np.zeros(k + 1)
    for j in range(n):
        a_out[0] += weight[j] * share[j, 0]
    for i in range(k):
        total = 0.0
        for j in range(n):
            r = weight[j] * share[j, i + 1]
            total += r
            for c in range(p):
                m_out[i, c] += r * z[j, c]
        left[i] = max(total - cost, 0.0)
        if left[i] > 0:
            m_out[i] /= total
            for j in range(n):
                r = weight[j] * share[j, i + 1] / total
                for c in range(p):
                    for d in range(p):
                        P_out[i, c, d] += r * (z[j, c] - m_out[i, c]) * (z[j, d] - m_out[i, d])
            for c in range(p):
                P_out[i, c, c] += deviation**2
        a_out[0] += total - left[i]
        a_out[i + 1] = left[i]
    alive = np.flatnonzero(left > 0)
    numbers = np.empty(len(alive) + 1)
    numbers[0] = a_out[0]
    for at in range(len(alive)):
        numbers[at + 1] = a_out[alive[at] + 1]
    return numbers, m_out[alive], P_out[alive]


@njit(cache=True, error_model="numpy")
def responsibilities(z, a, m, P, flat):
    """Which part each point z (n, p) is of: probabilities (n, 1 + k), the first that of the uniform part."""
    (n, p), k = z.shape, len(m)
    out = np.empty((n, k + 1))
    L, y = np.zeros((p, p)), np.empty(p)
    out[:, 0] = a[0] * flat
    for i in range(k):
        if not cholesky_into(L, P[i]):
            raise ValueError("a covariance of the clutter is not positive definite")
        scale = -0.5 * p * LOG_2PI
        for r in range(p):
            scale -= np.log(L[r, r])
        for j in range(n):
            out[j, i + 1] = a[i + 1] * np.exp(scale - 0.5 * mahalanobis_squared(L, z[j], m[i], y))
    for j in range(n):
        out[j] /= out[j].sum()
    return out


@njit(cache=True, error_model="numpy")
def added(candidates, z, weight, a, m, P, flat, deviation):
    """With one Gaussian more, if there is a place among the candidates (c, p) about which more of the points
    z (n, p) lie than the uniform part, which alone explains them, would put there by chance."""
    n, p = z.shape
    share = responsibilities(z, a, m, P, flat)
    width = (1 / flat) ** (1 / p) / NEIGHBOURHOOD
    best, at, left = 0.0, 0, 0.0
    for j in range(n):
        left += weight[j] * share[j, 0]
    for i in range(len(candidates)):
        total = 0.0
        for j in range(n):
            near = True
            for c in range(p):
                near &= abs(z[j, c] - candidates[i, c]) <= width / 2
            if near:
                total += weight[j] * share[j, 0]
        if total > best:
            best, at = total, i
    expected = left * flat * width**p
    excess = best - expected
    if excess < 3 * np.sqrt(expected) + (p + p * (p + 1) / 2) / 2:
        return a, m, P
    k = len(m)
    a_out, m_out, P_out = np.empty(k + 2), np.empty((k + 1, p)), np.zeros((k + 1, p, p))
    a_out[: k + 1], m_out[:k], P_out[:k] = a, m, P
    a_out[0], a_out[k + 1] = a[0] - min(excess, a[0] / 2), excess
    m_out[k] = candidates[at]
    for c in range(p):
        P_out[k, c, c] = width**2 / 12 + deviation**2
    return a_out, m_out, P_out
