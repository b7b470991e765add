"""Clutter estimated recursively: a uniform density and Gaussians, fitted to the detections of past scans.

Every detection is weighted by its probability of being a false alarm and by its age. The fit is expectation
maximisation in which every Gaussian is charged the cost of its own parameters, so that a Gaussian with too
few detections vanishes (Figueiredo and Jain 2002). A Gaussian is added where detections assigned to the
uniform density cluster.
"""

from numbers import Real
from typing import NamedTuple

import numpy as np

from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, log_gaussian_scale
from gmr_gym.mixture import Mixture
from gmr_gym.models.clutter import Clutter, no_components

NEIGHBOURHOOD = 12  # squares along a side of the box; a new Gaussian must stand out in one


class EstimatorOptions(NamedTuple):
    """Options of the clutter estimator; `options` makes a checked one.

    Attributes
    ----------
    memory : int
        Scans after which a detection counts 1 / e; after twice as many it is forgotten.
    deviation : float
        Least standard deviation of a Gaussian on each axis, m.
    max_gaussians : int
        Most Gaussians.
    iterations : int
        Steps of expectation maximisation per scan.
    """

    memory: int
    deviation: float
    max_gaussians: int
    iterations: int


class ClutterEstimate(NamedTuple):
    """State of the clutter estimator: the estimate, and the detections it is fitted to.

    Attributes
    ----------
    z : ndarray, shape (n, p)
        Detections of the scans in memory.
    p_clutter : ndarray, shape (n,)
        Probability that each was a false alarm.
    age : ndarray, shape (n,)
        Scans since then.
    scans : int
        Number of scans in memory.
    clutter : Clutter
        The estimated clutter.
    """

    z: np.ndarray
    p_clutter: np.ndarray
    age: np.ndarray
    scans: int
    clutter: Clutter


def options(
    memory: int = 20, deviation: float = 15.0, max_gaussians: int = 12, iterations: int = 2
) -> EstimatorOptions:
    """Make checked options of the clutter estimator.

    Parameters
    ----------
    memory : int
        Scans after which a detection counts 1 / e.
    deviation : float
        Least standard deviation of a Gaussian, m.
    max_gaussians : int
        Most Gaussians.
    iterations : int
        Steps of expectation maximisation per scan.

    Returns
    -------
    EstimatorOptions

    Raises
    ------
    ValueError
        Naming the parameter that is out of range.
    """
    if not 0 < deviation < np.inf:
        raise ValueError(f"deviation must be positive, got {deviation}")
    for name, value in (("memory", memory), ("max_gaussians", max_gaussians), ("iterations", iterations)):
        if isinstance(value, bool) or not isinstance(value, Real) or not value >= 1 or value % 1 != 0:
            raise ValueError(f"{name} must be a whole number, at least 1, got {value!r}")
    return EstimatorOptions(int(memory), float(deviation), int(max_gaussians), int(iterations))


def initial_estimate(clutter: Clutter) -> ClutterEstimate:
    """State of the estimator before the first scan.

    Parameters
    ----------
    clutter : Clutter
        Assumed clutter. Its box is kept. Its expected number counts as one scan of uniform clutter, its
        Gaussians start the fit, its ellipses are left for the fit to find.

    Returns
    -------
    ClutterEstimate
    """
    p = len(clutter.low)
    return ClutterEstimate(np.empty((0, p)), np.empty(0), np.empty(0, int), 0, clutter)


def update_estimate(
    prior_clutter: Clutter,
    estimate: ClutterEstimate,
    z: np.ndarray,
    p_clutter: np.ndarray,
    options: EstimatorOptions,
) -> ClutterEstimate:
    r"""Update the clutter estimate with a scan.

    Parameters
    ----------
    prior_clutter : Clutter
        Clutter assumed at the start, see `initial_estimate`.
    estimate : ClutterEstimate
        State before the scan.
    z : ndarray, shape (k, p)
        Detections of the scan.
    p_clutter : ndarray, shape (k,)
        Probability that each is a false alarm.
    options : EstimatorOptions

    Returns
    -------
    ClutterEstimate
        State after the scan.

    Notes
    -----
    A detection of age :math:`t` scans counts :math:`p_j e^{-t / \tau}`, where :math:`\tau` is the memory. The
    expected number per scan of every part is its weighted count over the sum of :math:`e^{-t / \tau}` and
    one; the one is a scan of uniform prior clutter, so that the density is nowhere zero.
    """
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
    # one scan of uniform prior clutter keeps the density positive everywhere
    w = a / (scans + 1.0)
    uniform = w[0] + prior_clutter.expected / (scans + 1.0)
    learned = prior_clutter._replace(
        uniform=uniform, gaussians=Mixture(w[1:], m, P), ellipses=no_components(m.shape[1])
    )
    return ClutterEstimate(points, probability, age, remembered, learned)


@kernel
def responsibilities(z, a, m, P, uniform_density):
    """Probability (n, 1 + k) that each point z (n, p) belongs to each part, the uniform part first.

    a (1 + k,) are the numbers of points of the parts, m (k, p) and P (k, p, p) the Gaussians.
    """
    (n, p), k = z.shape, len(m)
    share, total = np.zeros((1 + k, n)), np.full(n, a[0] * uniform_density)
    share[0] = total
    L, y = np.zeros((p, p)), np.empty((p, n))
    # Gaussian by Gaussian: everything but the exponential is then vectorised over points
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


@kernel(fastmath={"reassoc"})  # lets sums be vectorised
def fit_gaussians(z, weight, share, deviation):
    r"""One step of expectation maximisation: numbers (1 + k,), means (k, p) and covariances (k, p, p).

    z (n, p) are the points, weight (n,) their weights, share (n, 1 + k) the responsibilities.

    Notes
    -----
    With :math:`r_j` the weight of point j times its responsibility, a Gaussian has

    .. math::

        a = \max\Big(0, \sum_j r_j - \tfrac12 \big(p + \tfrac{p (p + 1)}{2}\big)\Big), \quad
        m = \frac{\sum_j r_j z_j}{\sum_j r_j}, \quad
        P = \frac{\sum_j r_j (z_j - m) (z_j - m)^T}{\sum_j r_j} + \sigma^2 I

    where :math:`\sigma` is `deviation`. Half the number of its parameters is subtracted (Figueiredo and Jain,
    eq. 17); a Gaussian of :math:`a = 0` is deleted. What is subtracted goes to the uniform part.
    """
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
    """Start a new Gaussian about the candidate with the most detections around it, or none.

    Parameters
    ----------
    candidates : ndarray, shape (c, p)
        Possible means.
    z : ndarray, shape (n, p)
        Detections in memory.
    left : ndarray, shape (n,)
        Weight of each that no Gaussian accounts for.
    uniform_density : float
        Density of the uniform part.
    deviation : float
        Least standard deviation, m.

    Returns
    -------
    Mixture
        One Gaussian whose weight is the excess over uniform clutter; no component where the excess is within
        three standard deviations of the expected number plus the cost of a Gaussian's parameters.
    """
    p = z.shape[1]
    width = (1 / uniform_density) ** (1 / p) / NEIGHBOURHOOD
    about = _about(candidates, z, left, np.argsort(z[:, 0]), width / 2)
    expected = left.sum() * uniform_density * width**p
    excess = about.max(initial=0.0) - expected
    if excess < 3 * np.sqrt(expected) + (p + p * (p + 1) / 2) / 2:
        return no_components(p)
    # ties are broken by position, not by the order of detections
    place = candidates[np.lexsort((*candidates.T, -about.round(9)))[0]]
    return Mixture(np.array([excess]), place[None], (width**2 / 12 + deviation**2) * np.eye(p)[None])


@kernel
def _about(candidates, z, left, order, half):
    """Sum (c,) of `left` over the points within `half` of each candidate on every axis.

    order (n,) sorts the points by the first axis.
    """
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
