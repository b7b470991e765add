"""The finite mixture of one scan fitted by Gibbs sampling (Lv, Lian and Han 2014, section 5)."""

import numpy as np

from gmr_gym.filters.clutter_estimation import responsibilities
from gmr_gym.filters.finite_mixture import (
    LEAST_UNIFORM,
    EmOptions,
    ScanMixture,
    floor_eigenvalues,
    merge_and_prune,
    variance,
)
from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into

DIRICHLET = 1.0  # a_j of eq. 25, the same for every part
PRIOR_MEANS, PRIOR_SPREADS = 0.01, 2  # prior counts, in detections, of a mean and of a covariance


def fit_gibbs(
    z: np.ndarray,
    parts: ScanMixture,
    uniform_density: float,
    options: EmOptions,
    rng: np.random.Generator,
    burn: int = 20,
    sweeps: int = 40,
) -> ScanMixture:
    r"""Fit the mixture to a scan by Gibbs sampling: the average of `sweeps` draws after `burn` draws.

    Parameters
    ----------
    z : ndarray, shape (k, p)
        Detections. An empty scan leaves the mixture unchanged.
    parts : ScanMixture
        Start of the chain.
    uniform_density : float
        Density of the uniform part.
    options : EmOptions
    rng : Generator
    burn : int
        Sweeps before the average.
    sweeps : int
        Sweeps averaged.

    Returns
    -------
    ScanMixture

    Notes
    -----
    One sweep draws, with :math:`n_i` the number of detections with label i and :math:`\bar z_i` their mean,

    .. math::

        \ell_j \sim \mathrm{Categorical}(\rho_{j0}, \dots, \rho_{jg}), \qquad
        w \sim \mathrm{Dirichlet}(1 + n_0, \dots, 1 + n_g)

    .. math::

        (m_i, P_i) \sim \mathrm{NIW}\left(
            \frac{\kappa_0 \bar z + n_i \bar z_i}{\kappa_0 + n_i},\; \kappa_0 + n_i,\; \nu_0 + n_i,\; \Psi_i
            \right)
        \quad \text{(clutter)}, \qquad
        m_i \sim \mathcal{N}(\bar z_i, P_i / n_i) \quad \text{(targets)}

    where :math:`\rho` are the responsibilities of the E step, :math:`\bar z` is the mean of the scan,
    :math:`\kappa_0 = 0.01`, :math:`\nu_0 = p + 3` and, with the variance :math:`\sigma^2` of eq. 9,

    .. math::

        \Psi_i = 2 \sigma^2 I + \sum_{\ell_j = i} (z_j - \bar z_i) (z_j - \bar z_i)^T
            + \frac{\kappa_0 n_i}{\kappa_0 + n_i} (\bar z_i - \bar z) (\bar z_i - \bar z)^T

    Departs: labels are drawn, where eqs. 26 and 29 use their probabilities. A Gaussian of clutter has the
    conjugate normal-inverse-Wishart prior, about the mean of the scan and with the variance of eq. 9, where
    eq. 27 has a Wishart of a variance. The mean of a target is drawn about that of its detections with its
    known covariance over their number, where eqs. 28-29 use the whole covariance and swap two symbols;
    without a detection it returns to its predicted value, so that a target between two detections is not
    lost. Parts are merged and pruned (section 5.3) by the number of labels, before the weights are drawn,
    during the burn-in only, so that draws can be averaged, and once more at the end. Targets are pruned only
    at the end, by their average, because a target with one detection lacks it in many draws.

    If `options.repaired` the mean of a target stays at its predicted value, since H P H' + R is already the
    covariance of a detection about its prediction. Targets then merge only at the end, where those that
    shared a detection have the same mean.

    References
    ----------
    Lv, section 5.
    """
    if len(z) == 0:
        return parts
    floored = floor_eigenvalues(parts.P, parts.gaussians, options.deviation)
    spread = variance(z, options.deviation)
    return _gibbs(z, parts._replace(P=floored), uniform_density, options, spread, burn, sweeps, rng)


@kernel
def _gibbs(z, parts, uniform_density, options, spread, burn, sweeps, rng):
    merging, clutter_least, repaired = options.merging, options.clutter_least, options.repaired
    w, m, P, origin = parts
    n, p = z.shape
    centre = np.zeros(p)
    for j in range(n):
        centre += z[j] / n
    began = np.zeros((origin.max() + 1 if len(origin) else 0, p))
    began[origin] = m[len(m) - len(origin) :]
    m_sum, P_sum, w_sum, z_sum = m, P, w, m  # sums over the draws after the burn-in
    for sweep in range(burn + sweeps):
        share = responsibilities(z, w, m, P, uniform_density)
        if sweep == burn:
            m_sum, P_sum = np.zeros_like(m), np.zeros_like(P)
            w_sum, z_sum = np.zeros_like(w), np.zeros_like(m)
        if sweep >= burn:
            for j in range(n):
                w_sum += share[j]
                for i in range(len(m)):
                    z_sum[i] += share[j, i + 1] * z[j]
        label = _labels(share, rng)
        number = np.zeros(len(w))
        for j in range(n):
            number[label[j]] += 1.0
        c = len(m) - len(origin)
        m, P = m.copy(), P.copy()
        for i in range(len(m)):
            if i < c:
                m[i], P[i] = _drawn_gaussian(z, label == i + 1, number[i + 1], centre, spread, rng)
            elif number[i + 1] > 0.0 and not repaired:
                mean = np.zeros(p)
                for j in range(n):
                    if label[j] == i + 1:
                        mean += z[j] / number[i + 1]
                m[i] = _drawn_mean(mean, P[i] / number[i + 1], rng)
            else:
                m[i] = began[origin[i - c]]
        P = floor_eigenvalues(P, c, options.deviation)
        if sweep < burn:
            number[0] = max(number[0], n * LEAST_UNIFORM)
            drawn = ScanMixture(number / number.sum(), m, P, origin)
            target_merging = 0.0 if repaired else merging
            shares, m, P, origin = merge_and_prune(drawn, n, merging, target_merging, clutter_least, 0.0)
            number = n * shares
        else:
            m_sum += m
            P_sum += P
        # eq. 25: normalised gamma variates are a Dirichlet draw
        w = np.empty(len(number))
        for i in range(len(w)):
            w[i] = rng.standard_gamma(DIRICHLET + number[i])
        w[0] = max(w[0], n * LEAST_UNIFORM)
        w /= w.sum()
    for i in range(len(m)):
        if i < len(m) - len(origin):
            m[i], P[i] = m_sum[i] / sweeps, P_sum[i] / sweeps
        elif w_sum[i + 1] > 0.0:
            m[i] = z_sum[i] / w_sum[i + 1]
    average = ScanMixture(w_sum / w_sum.sum(), m, P, origin)
    return merge_and_prune(average, n, merging, merging, clutter_least, options.target_least)


@kernel
def _labels(share, rng):
    """Label (n,) of each detection, drawn with probabilities share (n, g)."""
    n, g = share.shape
    label = np.zeros(n, np.int64)
    for j in range(n):
        left = rng.random()
        for i in range(g):
            left -= share[j, i]
            if left < 0.0:
                label[j] = i
                break
    return label


@kernel
def _drawn_mean(mean, P, rng):
    """A draw (p,) of N(mean, P)."""
    p = len(mean)
    L = np.zeros((p, p))
    if not cholesky_into(L, P):
        raise ValueError("a covariance of the mixture is not positive definite")
    out = mean.copy()
    for r in range(p):
        e = rng.standard_normal()
        for s in range(r, p):
            out[s] += L[s, r] * e
    return out


@kernel
def _drawn_gaussian(z, members, number, centre, spread, rng):
    """A draw of the mean (p,) and covariance (p, p) given the `number` points of z (n, p) in members (n,).

    The prior is normal-inverse-Wishart about centre (p,) and spread I.
    """
    n, p = z.shape
    mean = np.zeros(p)
    for j in range(n):
        if members[j]:
            mean += z[j] / number
    scatter = PRIOR_SPREADS * spread * np.eye(p)
    scaled = PRIOR_MEANS + number
    for r in range(p):
        for s in range(p):
            for j in range(n):
                if members[j]:
                    scatter[r, s] += (z[j, r] - mean[r]) * (z[j, s] - mean[s])
            off = PRIOR_MEANS * number / scaled
            scatter[r, s] += off * (mean[r] - centre[r]) * (mean[s] - centre[s])
    # with scatter = L L' and A of Bartlett's decomposition, L A'^-1 A^-1 L' is inverse Wishart
    L = np.zeros((p, p))
    if not cholesky_into(L, scatter):
        raise ValueError("the scatter of a scan is not positive definite")
    A = np.zeros((p, p))
    freedom = PRIOR_SPREADS + p + 1 + number
    for r in range(p):
        A[r, r] = np.sqrt(rng.chisquare(freedom - r))
        for s in range(r):
            A[r, s] = rng.standard_normal()
    B = np.linalg.solve(A, L.T)
    P = np.zeros((p, p))
    for r in range(p):
        for s in range(p):
            for k in range(p):
                P[r, s] += B[k, r] * B[k, s]
    return _drawn_mean((PRIOR_MEANS * centre + number * mean) / scaled, P / scaled, rng), P
