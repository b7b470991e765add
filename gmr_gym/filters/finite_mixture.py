"""The detections of one scan as a finite mixture, fitted by expectation maximisation.

Clutter is a uniform part and Gaussians, targets are Gaussians of known covariance. All weights sum to 1; a
part of weight w accounts for n w of the n detections (Lv, Lian and Han 2014). `gibbs.py` fits the same
mixture by Gibbs sampling.
"""

from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_whole
from gmr_gym.filters.clutter_estimation import responsibilities
from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, mahalanobis_squared
from gmr_gym.mixture import Mixture, match

ROUNDING = 1e-14  # below this ratio of eigenvalues a covariance may be indefinite by rounding
LEAST_UNIFORM = (
    1e-12  # least weight of the uniform part, which accounts for detections far from all Gaussians
)


class ScanMixture(NamedTuple):
    """A finite mixture of detections: the uniform part, Gaussians of clutter, then targets.

    Attributes
    ----------
    w : ndarray, shape (1 + c + t,)
        Weights; they sum to 1.
    m : ndarray, shape (c + t, p)
        Means, m.
    P : ndarray, shape (c + t, p, p)
        Covariances, m^2; those of targets are known.
    origin : ndarray, shape (t,)
        Number of the predicted target that each came from. When targets merge, the least is kept.
    """

    w: np.ndarray
    m: np.ndarray
    P: np.ndarray
    origin: np.ndarray

    @property
    def gaussians(self) -> int:
        """Number of Gaussians of clutter, c."""
        return len(self.m) - len(self.origin)


class EmOptions(NamedTuple):
    """When parts merge, when they are pruned and when a fit ends; `em_options` makes a checked one.

    Attributes
    ----------
    merging : float
        U of eq. 23, squared Mahalanobis distance.
    clutter_least : float
        D_c: a Gaussian of clutter with fewer detections is pruned.
    target_least : float
        D_t: a target with fewer detections is pruned.
    deviation : float
        Least standard deviation of a Gaussian of clutter in any direction, m.
    tolerance : float
        epsilon, relative change of the log-likelihood.
    iterations : int
        Most steps.
    repaired : bool
        Whether targets are treated as repaired, see `fit_em` and `gibbs.fit_gibbs`.
    """

    merging: float
    clutter_least: float
    target_least: float
    deviation: float
    tolerance: float
    iterations: int
    repaired: bool


def em_options(
    merging: float = 4.0,
    clutter_least: float = 3.0,
    target_least: float = 0.5,
    deviation: float = 15.0,
    tolerance: float = 1e-5,
    iterations: int = 100,
    repaired: bool = False,
) -> EmOptions:
    """Make checked options of a fit.

    Parameters
    ----------
    merging : float
        U of eq. 23.
    clutter_least, target_least : float
        D_c and D_t, detections.
    deviation : float
        Least standard deviation of a Gaussian of clutter, m.
    tolerance : float
        Relative change of the log-likelihood that ends the fit.
    iterations : int
        Most steps.
    repaired : bool
        Whether targets are treated as repaired rather than as printed.

    Returns
    -------
    EmOptions

    Raises
    ------
    ValueError
        Naming the parameter that is out of range.

    Notes
    -----
    Defaults are those of Lv, section 7.2; `deviation`, `tolerance` and `iterations` are not printed.

    Departs: the covariance of a Gaussian of clutter has a floor, `deviation`. Without one it collapses on a
    detection, where the likelihood is infinite, as printed or repaired.
    """
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
    """Mixture from which a fit starts, all weights equal.

    Parameters
    ----------
    clutter : Mixture
        Gaussians of clutter of the last scan (eq. 8).
    places : ndarray, shape (g0, p)
        Means of new Gaussians of clutter; their variance is that of eq. 9, at least deviation^2.
    z : ndarray, shape (k, p)
        Detections.
    targets : Mixture
        Predicted detections of the targets.
    deviation : float
        Least standard deviation of a Gaussian of clutter, m.

    Returns
    -------
    ScanMixture

    References
    ----------
    Lv, eqs. 8, 9 and 15.
    """
    p = z.shape[1]
    wide = np.tile(variance(z, deviation) * np.eye(p), (len(places), 1, 1))
    m = np.concatenate([clutter.m, places, targets.m])
    w = np.full(len(m) + 1, 1 / (len(m) + 1))
    return ScanMixture(w, m, np.concatenate([clutter.P, wide, targets.P]), np.arange(len(targets.m)))


def variance(z: np.ndarray, deviation: float) -> float:
    """Variance of a new Gaussian of clutter, m^2: a tenth of the mean variance of the detections.

    Parameters
    ----------
    z : ndarray, shape (k, p)
        Detections.
    deviation : float
        The result is at least deviation^2.

    Returns
    -------
    float

    References
    ----------
    Lv, eq. 9.
    """
    return max(float(z.var(axis=0).mean()) / 10, deviation**2) if len(z) else deviation**2


def fit_em(
    z: np.ndarray, parts: ScanMixture, uniform_density: float, options: EmOptions
) -> tuple[ScanMixture, float]:
    r"""Fit the mixture to a scan by expectation maximisation.

    Parameters
    ----------
    z : ndarray, shape (k, p)
        Detections. An empty scan leaves the mixture unchanged.
    parts : ScanMixture
        Start of the fit, see `initial`.
    uniform_density : float
        Density of the uniform part.
    options : EmOptions

    Returns
    -------
    mixture : ScanMixture
    log_likelihood : float
        0 for an empty scan.

    Notes
    -----
    E step, with :math:`N_i` the density of part i:

    .. math:: \rho_{ji} = \frac{w_i N_i(z_j)}{\sum_l w_l N_l(z_j)}

    M step; covariances of targets are known and kept:

    .. math::

        w_i = \frac1k \sum_j \rho_{ji}, \qquad
        m_i = \frac{\sum_j \rho_{ji} z_j}{\sum_j \rho_{ji}}, \qquad
        P_i = \frac{\sum_j \rho_{ji} (z_j - m_i) (z_j - m_i)^T}{\sum_j \rho_{ji}}

    Then parts are merged and pruned, see `merge_and_prune`.

    Departs: epsilon bounds the relative change of the log-likelihood; the likelihood itself underflows. A fit
    does not end on a step that merged or pruned. After pruning the weights are normalised. If `repaired`, a
    target is pruned only in a step in which no Gaussian of clutter is: as printed, a Gaussian of clutter
    about to be pruned takes a target's only detection with it.

    References
    ----------
    Lv, Algorithm 1 and eqs. 18-22.
    """
    if len(z) == 0:
        return parts, 0.0
    floored = floor_eigenvalues(parts.P, parts.gaussians, options.deviation)
    return _em(z, parts._replace(P=floored), uniform_density, options)


@kernel
def _em(z, parts, uniform_density, options):
    merging, clutter_least, target_least = options.merging, options.clutter_least, options.target_least
    w, m, P, origin = parts
    share = responsibilities(z, w, m, P, uniform_density)
    value = log_likelihood(share, w[0] * uniform_density)
    for _ in range(options.iterations):
        before, g, c = value, len(m), len(m) - len(origin)
        w, m, P = maximised(z, share, m, P, c, options.deviation)
        least = 0.0 if options.repaired else target_least
        fitted = ScanMixture(w, m, P, origin)
        w, m, P, origin = merge_and_prune(fitted, len(z), merging, merging, clutter_least, least)
        if options.repaired and len(m) - len(origin) == c:
            fitted = ScanMixture(w, m, P, origin)
            w, m, P, origin = merge_and_prune(fitted, len(z), 0.0, 0.0, 0.0, target_least)
        share = responsibilities(z, w, m, P, uniform_density)
        value = log_likelihood(share, w[0] * uniform_density)
        if len(m) == g and abs(value - before) <= options.tolerance * abs(before):
            break
    return ScanMixture(w, m, P, origin), value


@kernel
def log_likelihood(share, uniform):
    """Log-likelihood of the scan (eq. 7) from the responsibilities (n, 1 + g) of its parts.

    uniform is the weight of the uniform part times its density, which over its responsibility is the density
    of the whole mixture.
    """
    total = 0.0
    for j in range(len(share)):
        total += np.log(uniform) - np.log(share[j, 0])
    return total


@kernel
def maximised(z, share, m, P, c, deviation):
    """M step: weights, means and covariances given responsibilities (n, 1 + c + t) (eqs. 19-22).

    The first c covariances, of clutter, have no eigenvalue below deviation^2; the others are kept.
    """
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
    """P (g, p, p) with the eigenvalues of the first c raised to deviation^2: the likeliest such matrices.

    Eigenvalues are also kept within 1 / ROUNDING of the largest, so that a Cholesky factor exists.
    """
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
def merge_and_prune(parts, n, clutter_merging, target_merging, clutter_least, target_least):
    """Merge and prune the parts of a ScanMixture of n detections, clutter and targets apart; the uniform part
    is never pruned (section 4.3).

    Departs: eq. 24 has brackets around the deviation. Targets that merge keep the number and known
    covariance of the first, since survivors are listed before births and births before spawned targets.
    """
    w, m, P, origin = parts
    t = len(origin)
    c = len(m) - t
    groups, count = _groups(w[1 : c + 1], m[:c], P[:c], clutter_merging)
    w_c, m_c, P_c = match(w[1 : c + 1], m[:c], P[:c], groups, count)
    groups, count = _groups(w[c + 1 :], m[c:], P[c:], target_merging)
    w_t, m_t, P_t = match(w[c + 1 :], m[c:], P[c:], groups, count)
    first = np.full(count, t)
    for i in range(t):
        first[groups[i]] = min(first[groups[i]], i)
    order = np.argsort(first)  # numbers ascend: the first of a group has the least
    first = first[order]
    w_t, m_t, P_t, number = w_t[order], m_t[order], P[c:][first], origin[first]
    keep_c, keep_t = n * w_c >= clutter_least, n * w_t >= target_least
    w_out = np.concatenate((w[:1], w_c[keep_c], w_t[keep_t]))
    m_out = np.concatenate((m_c[keep_c], m_t[keep_t]))
    P_out = np.concatenate((P_c[keep_c], P_t[keep_t]))
    return ScanMixture(w_out / w_out.sum(), m_out, P_out, number[keep_t])


@kernel
def _groups(w, m, P, merging):
    """Groups (n,) of parts to merge, and their number.

    Around the heaviest part j all i with (m_i - m_j)' P_j^-1 (m_i - m_j) <= U (eq. 23) merge; then the same
    among the rest.
    """
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
