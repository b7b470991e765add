"""Clutter learned from scan to scan: a uniform and Gaussians, fitted to the detections of the past, each
counted by its probability of being false and by its age.

The fit is expectation maximisation that takes from every Gaussian what its own description costs, so that
those which explain too little vanish (Figueiredo and Jain 2002); where the uniform part has to explain too
many detections, a Gaussian is added.
"""

from numbers import Real
from typing import NamedTuple

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, log_gaussian_scale
from gmr_gym.mixture import Mixture
from gmr_gym.models.clutter import Clutter, no_components

NEIGHBOURHOOD = 12  # a new Gaussian is looked for in squares of so many to a side of the box


class EstimatorOptions(NamedTuple):
    """How clutter is learned; `options` checks one."""

    memory: int  # scans, after which a detection counts 1 / e of what it did; after twice as many, nothing
    deviation: float  # m, on each axis: no Gaussian is narrower
    max_gaussians: int  # Gaussians
    iterations: int  # of expectation maximisation, a scan


class ClutterEstimate(NamedTuple):
    """What has been learned, and the detections that it was learned from."""

    z: np.ndarray  # (n, p), detections of the scans remembered
    p_clutter: np.ndarray  # (n,), probability that each was false
    age: np.ndarray  # (n,), scans since
    scans: int  # remembered
    clutter: Clutter


def options(
    memory: int = 20, deviation: float = 15.0, max_gaussians: int = 12, iterations: int = 2
) -> EstimatorOptions:
    """Checked Learner; ValueError naming the parameter."""
    if not 0 < deviation < np.inf:
        raise ValueError(f"deviation must be positive, got {deviation}")
    for name, value in (("memory", memory), ("max_gaussians", max_gaussians), ("iterations", iterations)):
        if isinstance(value, bool) or not isinstance(value, Real) or not value >= 1 or value % 1 != 0:
            raise ValueError(f"{name} must be a whole number, at least 1, got {value!r}")
    return EstimatorOptions(int(memory), float(deviation), int(max_gaussians), int(iterations))


def initial_estimate(clutter: Clutter) -> ClutterEstimate:
    """Nothing has been seen; `clutter` is what was told. Its box stays; all that it expects counts as one
    scan of uniform clutter, its Gaussians are where the fit begins, its ellipses are for the fit to find."""
    p = len(clutter.low)
    return ClutterEstimate(np.empty((0, p)), np.empty(0), np.empty(0, int), 0, clutter)


def update_estimate(
    prior_clutter: Clutter,
    estimate: ClutterEstimate,
    z: np.ndarray,
    p_clutter: np.ndarray,
    options: EstimatorOptions,
) -> ClutterEstimate:
    """The lessons after a scan z (k, p) whose detections are false with probabilities `false` (k,).

    `told` is what was believed at first, see `initial_estimate`."""
    kept = estimate.age + 1 < 2 * options.memory
    points = np.concatenate([estimate.z[kept], z])
    probability = np.concatenate([estimate.p_clutter[kept], p_clutter])
    age = np.concatenate([estimate.age[kept] + 1, np.zeros(len(z), int)])
    remembered = min(estimate.scans + 1, 2 * options.memory)
    fading = np.exp(-np.arange(remembered) / options.memory)
    weight, scans = probability * fading[age], fading.sum()
    uniform_density = 1 / prior_clutter.volume
    a = np.append(estimate.clutter.uniform, estimate.clutter.gaussians.w) * scans
    m, P = estimate.clutter.gaussians.m, estimate.clutter.gaussians.P
    share = responsibilities(points, a, m, P, uniform_density)
    if len(m) < options.max_gaussians:
        new = new_gaussian(z, points, weight * share[:, 0], uniform_density, options.deviation)
        if len(new.w):
            a = np.append(a, new.w)
            a[0] -= min(a[-1], a[0] / 2)
            m, P = np.concatenate([m, new.m]), np.concatenate([P, new.P])
            share = responsibilities(points, a, m, P, uniform_density)
    a, m, P = fit_gaussians(points, weight, share, options.deviation)
    for _ in range(options.iterations - 1):
        a, m, P = fit_gaussians(
            points, weight, responsibilities(points, a, m, P, uniform_density), options.deviation
        )
    # one scan's worth of what was told, uniform, so that no place is without clutter
    w = a / (scans + 1.0)
    uniform = w[0] + prior_clutter.expected / (scans + 1.0)
    learned = prior_clutter._replace(
        uniform=uniform, gaussians=Mixture(w[1:], m, P), ellipses=no_components(m.shape[1])
    )
    return ClutterEstimate(points, probability, age, remembered, learned)


@kernel
def responsibilities(z, a, m, P, uniform_density):
    """Which part each point z (n, p) is of: probabilities (n, 1 + k), the first that of the uniform part of
    density `flat`, by numbers a (1 + k,) of points, means m (k, p) and covariances P (k, p, p)."""
    (n, p), k = z.shape, len(m)
    share, total = np.zeros((1 + k, n)), np.full(n, a[0] * uniform_density)
    share[0] = total
    L, y = np.zeros((p, p)), np.empty((p, n))
    # Gaussian by Gaussian: all but the exponential is then done to several points at once
    for i in range(k):
        if not cholesky_into(L, P[i]):
            raise ValueError("a covariance of the clutter is not positive definite")
        log_peak = np.log(a[i + 1]) + log_gaussian_scale(L)
        joint = share[i + 1]
        for r in range(p):  # L y = z - m
            for j in range(n):
                y[r, j] = z[j, r] - m[i, r]
            for c in range(r):
                for j in range(n):
                    y[r, j] -= L[r, c] * y[c, j]
            for j in range(n):
                y[r, j] /= L[r, r]
                joint[j] += y[r, j] ** 2
        for j in range(n):
            joint[j] = np.exp(log_peak - 0.5 * joint[j])
            total[j] += joint[j]
    for i in range(1 + k):
        for j in range(n):
            share[i, j] /= total[j]
    return share.T


@kernel(fastmath={"reassoc"})  # sums in any order, several terms at once
def fit_gaussians(z, weight, share, deviation):
    """What explains best the points z (n, p), each counted `weight` (n,) times, of which the parts have those
    shares (n, 1 + k): numbers (1 + k,) of points, means (k, p) and covariances (k, p, p), each with
    deviation^2 more along every axis. A Gaussian is charged half its parameters (Figueiredo and Jain, eq. 17)
    and goes when nothing is left of it; what it loses the uniform part has."""
    (n, p), k = z.shape, share.shape[1] - 1
    cost = (p + p * (p + 1) / 2) / 2
    number, m, P = np.zeros(1 + k), np.zeros((k, p)), np.zeros((k, p, p))
    off = np.empty((p, n))
    number[0] = (weight * share[:, 0]).sum()
    for i in range(k):
        r = weight * share[:, i + 1]
        total = r.sum()
        number[i + 1] = max(total - cost, 0.0)
        number[0] += total - number[i + 1]
        if number[i + 1] == 0.0:
            continue
        for c in range(p):
            mean = 0.0
            for j in range(n):
                mean += r[j] * z[j, c]
            m[i, c] = mean / total
            off[c] = z[:, c] - m[i, c]
            for d in range(c + 1):
                scatter = 0.0
                for j in range(n):
                    scatter += r[j] * off[c, j] * off[d, j]
                P[i, c, d] = P[i, d, c] = scatter / total
            P[i, c, c] += deviation**2
    alive = np.flatnonzero(number[1:] > 0.0)
    return np.append(number[:1], number[1:][alive]), m[alive], P[alive]


def new_gaussian(
    candidates: np.ndarray, z: np.ndarray, left: np.ndarray, uniform_density: float, deviation: float
) -> Mixture:
    """A new Gaussian, or none: where of all the candidates (c, p) most of the points z (n, p) lie about, if
    these are more than there would be by chance. left (n,) is what of each point no Gaussian explains."""
    p = z.shape[1]
    width = (1 / uniform_density) ** (1 / p) / NEIGHBOURHOOD
    about = _about(candidates, z, left, np.argsort(z[:, 0]), width / 2)
    expected = left.sum() * uniform_density * width**p
    excess = about.max(initial=0.0) - expected
    if excess < 3 * np.sqrt(expected) + (p + p * (p + 1) / 2) / 2:
        return no_components(p)
    # where two places tie, the order of detections is not to decide
    place = candidates[np.lexsort((*candidates.T, -about.round(9)))[0]]
    return Mixture(np.array([excess]), place[None], (width**2 / 12 + deviation**2) * np.eye(p)[None])


@kernel
def _about(candidates, z, left, order, half):
    """What is left (c,) of the points within `half` of each candidate along every axis; `order` (n,) is that
    of the points along the first."""
    x, left = z[order].T.copy(), left[order]
    first = np.searchsorted(x[0], candidates[:, 0] - half)
    last = np.searchsorted(x[0], candidates[:, 0] + half, side="right")
    out = np.empty(len(candidates))
    for i in range(len(candidates)):
        within = left[first[i] : last[i]].copy()
        for c in range(1, len(x)):
            along = x[c, first[i] : last[i]]
            for j in range(len(within)):
                within[j] = within[j] if abs(along[j] - candidates[i, c]) <= half else 0.0
        out[i] = within.sum()
    return out
