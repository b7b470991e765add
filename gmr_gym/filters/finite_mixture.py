"""The detections of one scan as a finite mixture, fitted by expectation maximisation (Lv, Lian and Han 2014;
by Gibbs in `gibbs.py`): clutter is a uniform part and Gaussians, targets are Gaussians of known covariance,
and the weights of all of them sum to 1. What a part's weight comes to in detections is n times it.
"""

from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_whole
from gmr_gym.filters.clutter_estimation import responsibilities
from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, mahalanobis_squared
from gmr_gym.mixture import Mixture, match

ROUNDING = 1e-14  # a covariance with a smaller ratio of eigenvalues may not be positive definite
LEAST_UNIFORM = 1e-12  # weight; a detection far from all Gaussians must have an explanation


class ScanMixture(NamedTuple):
    """A finite mixture of detections, in that order: uniform, Gaussians of clutter, targets."""

    w: np.ndarray  # (1 + c + t,), one simplex
    m: np.ndarray  # (c + t, p), m
    P: np.ndarray  # (c + t, p, p), m^2, those of targets known
    origin: np.ndarray  # (t,), the number each target began with: when targets merge, the least is kept

    @property
    def gaussians(self) -> int:
        """Number of the clutter's Gaussians, c."""
        return len(self.m) - len(self.origin)


class EmOptions(NamedTuple):
    """How parts come to be merged and pruned, and when a fit ends; `em_options` checks one."""

    merging: float  # U, squared distance, eq. 23
    clutter_least: float  # D_c, detections
    target_least: float  # D_t, detections
    deviation: float  # m, in no direction is a Gaussian of clutter narrower
    tolerance: float  # epsilon, of the log-likelihood
    iterations: int  # at most
    repaired: bool  # of targets, see `fit_em` and `gibbs.fit_gibbs`


def em_options(
    merging: float = 4.0,
    clutter_least: float = 3.0,
    target_least: float = 0.5,
    deviation: float = 15.0,
    tolerance: float = 1e-5,
    iterations: int = 100,
    repaired: bool = False,
) -> EmOptions:
    """Checked Management, by default of Lv, section 7.2; deviation, tolerance and iterations are not printed.

    Departs: a Gaussian of clutter has a floor, `deviation`. Without one it collapses on a detection, where
    the likelihood is infinite, whether the rest is as printed or repaired. ValueError names the parameter."""
    for name, value in (
        ("merging", merging), ("clutter_least", clutter_least), ("target_least", target_least),
        ("tolerance", tolerance),
    ):  # fmt: skip
        if not 0 <= value < np.inf:
            raise ValueError(f"{name} must be non-negative and finite, got {value}")
    if not 0 < deviation < np.inf:
        raise ValueError(f"deviation must be positive and finite, got {deviation}")
    check_whole("iterations", iterations, 1)
    if not isinstance(repaired, bool):
        raise ValueError(f"repaired must be True or False, got {repaired!r}")
    least = float(clutter_least), float(target_least)
    return EmOptions(float(merging), *least, float(deviation), float(tolerance), int(iterations), repaired)


def initial(
    clutter: Mixture, places: np.ndarray, z: np.ndarray, targets: Mixture, deviation: float
) -> ScanMixture:
    """The mixture that a fit begins with, all weights alike (eq. 15): the last scan's Gaussians of clutter
    (eq. 8), one more about each of the places (g0, p) as wide as eq. 9 says but for the floor `deviation`,
    and the targets."""
    p = z.shape[1]
    wide = np.tile(variance(z, deviation) * np.eye(p), (len(places), 1, 1))
    m = np.concatenate([clutter.m, places, targets.m])
    w = np.full(len(m) + 1, 1 / (len(m) + 1))
    return ScanMixture(w, m, np.concatenate([clutter.P, wide, targets.P]), np.arange(len(targets.m)))


def variance(z: np.ndarray, deviation: float) -> float:
    """sigma^2, m^2, a tenth of the mean variance of the detections z (k, p) (eq. 9), at least deviation^2."""
    return max(float(z.var(axis=0).mean()) / 10, deviation**2) if len(z) else deviation**2


def fit_em(
    z: np.ndarray, parts: ScanMixture, uniform_density: float, options: EmOptions
) -> tuple[ScanMixture, float]:
    """The mixture fitted to the scan z (k, p), and its log-likelihood (Lv, Algorithm 1); `flat` is the
    density of the uniform part. Nothing changes, likelihood 1, where there are no detections.

    Departs: epsilon is of the log-likelihood and not of the likelihood, which is beyond floating point; a
    fit does not end on a step that merged or pruned. After pruning the weights are made to sum to 1. If
    `repaired`, a target is pruned only in a step in which no Gaussian of clutter goes: as printed, one that
    is about to vanish takes a target's only detection with it."""
    if len(z) == 0:
        return parts, 0.0
    floored = floor_eigenvalues(parts.P, parts.gaussians, options.deviation)
    w, m, P, origin, value = _em(z, parts.w, parts.m, floored, parts.origin, uniform_density, *options)
    return ScanMixture(w, m, P, origin), value


@kernel
def _em(
    z,
    w,
    m,
    P,
    origin,
    uniform_density,
    merging,
    clutter_least,
    target_least,
    deviation,
    tolerance,
    iterations,
    repaired,
):
    share = responsibilities(z, w, m, P, uniform_density)
    value = log_likelihood(share, w[0] * uniform_density)
    for _ in range(iterations):
        before, parts, c = value, len(m), len(m) - len(origin)
        w, m, P = maximised(z, share, m, P, c, deviation)
        least = 0.0 if repaired else target_least
        w, m, P, origin = merge_and_prune(w, m, P, origin, len(z), merging, merging, clutter_least, least)
        if repaired and len(m) - len(origin) == c:
            w, m, P, origin = merge_and_prune(w, m, P, origin, len(z), 0.0, 0.0, 0.0, target_least)
        share = responsibilities(z, w, m, P, uniform_density)
        value = log_likelihood(share, w[0] * uniform_density)
        if len(m) == parts and abs(value - before) <= tolerance * abs(before):
            break
    return w, m, P, origin, value


@kernel
def log_likelihood(share, uniform):
    """Log-likelihood of the scan (eq. 7): the share of the uniform part, whose weighted density is `uniform`,
    tells what it was divided by."""
    total = 0.0
    for j in range(len(share)):
        total += np.log(uniform) - np.log(share[j, 0])
    return total


@kernel
def maximised(z, share, m, P, c, deviation):
    """Weights, means and covariances that maximise eq. 19 given shares (n, 1 + c + t) (eqs. 20-22); the
    first c covariances, of clutter, no less than deviation^2 in any direction, the others as they were."""
    (n, p), g = z.shape, len(m)
    w, m_out, P_out = np.zeros(g + 1), m.copy(), P.copy()
    for i in range(g + 1):
        for j in range(n):
            w[i] += share[j, i]
    for i in range(g):
        if not w[i + 1] > 0.0:
            continue
        for r in range(p):
            total = 0.0
            for j in range(n):
                total += share[j, i + 1] * z[j, r]
            m_out[i, r] = total / w[i + 1]
        if i < c:
            for r in range(p):
                for s in range(r + 1):
                    total = 0.0
                    for j in range(n):
                        total += share[j, i + 1] * (z[j, r] - m_out[i, r]) * (z[j, s] - m_out[i, s])
                    P_out[i, r, s] = P_out[i, s, r] = total / w[i + 1]
    w = np.maximum(w, 0.0) / n
    w[0] = max(w[0], LEAST_UNIFORM)
    return w / w.sum(), m_out, floor_eigenvalues(P_out, c, deviation)


@kernel
def floor_eigenvalues(P, c, deviation):
    """The first c of P (g, p, p) with no eigenvalue below deviation^2: of all such matrices the likeliest. No
    eigenvalue is so far below the largest that rounding would lose it."""
    out = P.copy()
    p = P.shape[1]
    L = np.zeros((p, p))
    for i in range(c):
        if cholesky_into(L, P[i] - deviation**2 * np.eye(p)):
            continue
        values, vectors = np.linalg.eigh(P[i])
        least = max(deviation**2, ROUNDING * values[p - 1])
        for r in range(p):
            for s in range(p):
                total = 0.0
                for k in range(p):
                    total += vectors[r, k] * max(values[k], least) * vectors[s, k]
                out[i, r, s] = total
    return out


@kernel
def merge_and_prune(w, m, P, origin, n, clutter_merging, target_merging, clutter_least, target_least):
    """The parts merged and pruned (section 4.3): clutter with clutter, targets with targets. The uniform
    part is never pruned.

    Departs: eq. 24 has brackets about the deviation. Of targets that merge the one that began first keeps
    its number and its known covariance, for survivors come before births and those before the spawned."""
    t = len(origin)
    c = len(m) - t
    groups, count = _groups(w[1 : c + 1], m[:c], P[:c], clutter_merging)
    w_c, m_c, P_c = match(w[1 : c + 1], m[:c], P[:c], groups, count)
    groups, count = _groups(w[c + 1 :], m[c:], P[c:], target_merging)
    w_t, m_t, P_t = match(w[c + 1 :], m[c:], P[c:], groups, count)
    first = np.full(count, t)
    for i in range(t):
        first[groups[i]] = min(first[groups[i]], i)
    order = np.argsort(first)  # numbers ascend, so that the first of a group has the least
    first = first[order]
    w_t, m_t, P_t, number = w_t[order], m_t[order], P[c:][first], origin[first]
    keep_c, keep_t = n * w_c >= clutter_least, n * w_t >= target_least
    w_out = np.concatenate((w[:1], w_c[keep_c], w_t[keep_t]))
    m_out = np.concatenate((m_c[keep_c], m_t[keep_t]))
    P_out = np.concatenate((P_c[keep_c], P_t[keep_t]))
    return w_out / w_out.sum(), m_out, P_out, number[keep_t]


@kernel
def _groups(w, m, P, merging):
    """Groups (n,) that merge: about the heaviest part j all i with (m_i - m_j)' P_j^-1 (m_i - m_j) <= U
    (eq. 23), then so with the rest; their number."""
    n, p = m.shape
    group, count = np.full(n, -1), 0
    L, y = np.zeros((p, p)), np.empty(p)
    for j in np.argsort(-w, kind="mergesort"):
        if group[j] >= 0:
            continue
        if not cholesky_into(L, P[j]):
            raise ValueError("a covariance of the mixture is not positive definite")
        for i in range(n):
            if i == j or (group[i] < 0 and mahalanobis_squared(L, m[i], m[j], y) <= merging):
                group[i] = count
        count += 1
    return group, count
