r"""Barycentres of Gaussians: the one Gaussian with the least weighted sum of a measure.

Notes
-----
With shares a of the weights and sums over the components, the barycentre N(m, S) solves

.. math::

    \text{KL:}\quad m &= \textstyle\sum a_i m_i, \qquad S = \sum a_i (P_i + (m_i - m)(m_i - m)^T) \\
    \text{reverse KL:}\quad S^{-1} &= \textstyle\sum a_i P_i^{-1}, \qquad m = S \sum a_i P_i^{-1} m_i \\
    \text{Wasserstein:}\quad m &= \textstyle\sum a_i m_i, \qquad
    S = \sum a_i (S^{1/2} P_i S^{1/2})^{1/2} \\
    \text{Cauchy-Schwarz:}\quad 0 &= \textstyle\sum a_i T_i (m_i - m), \qquad
    S^{-1} = 2 \sum a_i (T_i - T_i (m_i - m)(m_i - m)^T T_i), \qquad T_i = (P_i + S)^{-1}

The symmetrised divergence takes the geometric mean of the covariances of the two kinds. The barycentre of the
integral squared difference is also the one Gaussian with the least integral squared difference from the whole
mixture; as that has several minima where components lie far apart, the lower of those found from the moment
match and from the best component is taken.

That of reverse KL and of Wasserstein forget the spread of the means: of components far apart it is a narrow
Gaussian between them, where the mixture has no weight.
"""

import numpy as np

from gmr_gym.checks import check_choice
from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, inverse_into, orthogonalise, solve_lower, solve_upper
from gmr_gym.mixture import Mixture
from gmr_gym.reduction.measures import CAUCHY_SCHWARZ, ISD, MEASURES, aligned, isd_cost
from gmr_gym.reduction.overlap_descent import EXACT, STEPS, descend
from gmr_gym.reduction.protocol import definite, warn_unfinished
from gmr_gym.reduction.pruning import weighing

NEAR = 1.1  # of 18 000 random pairs, a second start led lower in 383, whose first sum was above 1.23 bounds


def barycentre(p: Mixture, measure: str = "kl") -> Mixture:
    """The one Gaussian q with the least sum of w D(component, q), with the weight of all.

    Parameters
    ----------
    p : Mixture
        At least one component of positive weight.
    measure : str
        D, one of `MEASURES`: "kl", "reverse-kl", "symmetrised-kl", "wasserstein" (squared),
        "cauchy-schwarz" or "isd".

    Returns
    -------
    Mixture
        Of one component.

    Raises
    ------
    ValueError
        For an unknown measure, a mixture that fails `checked` or has no weight, and components so far apart
        that the covariance is lost in rounding.

    Warns
    -----
    UserWarning
        Where the iteration stops at its limit of 2000 steps.

    Warnings
    --------
    Of components far apart, the barycentre of "reverse-kl" and of "wasserstein" is a narrow Gaussian between
    them where the mixture has no weight: it is no summary of what a tracker believes.

    References
    ----------
    D'Ortenzio, Manes and Orguner 2022, of fixed points; Agueh and Carlier 2011, of Wasserstein's.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> p = mixture([0.5, 0.5], [[-1.0], [1.0]], [[[1.0]], [[1.0]]])
    >>> [round(float(barycentre(p, measure).P[0, 0, 0]), 4) for measure in MEASURES[:5]]
    [2.0, 1.0, 1.4142, 1.0, 2.4142]
    """
    check_choice("measure", measure, MEASURES)
    q, _ = weighing(p)
    if len(q.w) == 0:
        raise ValueError("p must have a component of positive weight")
    mean, covariance, steps = BARYCENTRES[MEASURES.index(measure)](*q, EXACT)
    if steps == STEPS:
        warn_unfinished(f"the barycentre by {measure}", STEPS)
    return definite(Mixture(np.array([q.w.sum()]), mean[None], covariance[None]))


# A barycentre is a kernel of positive weights (n,), means and covariances, and of the relative change that
# ends its iteration: the sum is then the least to the square of it. It returns the mean (d,), the covariance
# (d, d), not positive definite where it is lost in rounding, and the steps; at `STEPS` the iteration was cut
# short. Every measure has a kernel of its own, or it would wait for the compilation of all.


@kernel
def moment_match(w, m, P, _):
    """Barycentre of the Kullback-Leibler divergence."""
    a, x, centre = _about_mean(w, m)
    return centre, _covariance_about_mean(a, x, P), 0


@kernel
def intersection(w, m, P, _):
    """Barycentre of the reverse divergence."""
    a, x, centre = _about_mean(w, m)
    R, h = _joint_precision(a, x, P)
    if np.isnan(R[0, 0]):
        return centre, R, 0
    root = np.eye(len(R))
    solve_upper(R, h)
    solve_upper(R, root)
    return centre + h[:, 0], _square(root), 0


@kernel
def geometric_mean(w, m, P, exact):
    """Barycentre of the symmetrised divergence."""
    a, x, centre = _about_mean(w, m)
    R, h = _joint_precision(a, x, P)
    if np.isnan(R[0, 0]):
        return centre, R, 0
    root, steps = _geometric(h[:, 0], _seen_through(R, _covariance_about_mean(a, x, P)), exact)
    solve_upper(R, h)
    solve_upper(R, root)
    return centre + h[:, 0], _square(root), steps


@kernel
def transported(w, m, P, exact):
    """Barycentre of the Wasserstein distance."""
    a, _, centre = _about_mean(w, m)
    S, steps = _transported(a, P, exact)
    return centre, S, steps


@kernel
def best_correlation(w, m, P, exact):
    """Barycentre of the Cauchy-Schwarz measure."""
    a, x, centre = _about_mean(w, m)
    S = _covariance_about_mean(a, x, P)
    mean, S, steps, _ = descend(CAUCHY_SCHWARZ, a, x, P, np.zeros(len(centre)), S, exact)
    return centre + mean, S, steps


@kernel
def least_difference(w, m, P, exact):
    """Barycentre of the integral squared difference."""
    a, x, centre = _about_mean(w, m)
    mean, S, steps = _best_overlap(a, x, P, exact)
    return centre + mean, S, steps


BARYCENTRES = moment_match, intersection, geometric_mean, transported, best_correlation, least_difference


@kernel
def _about_mean(w, m):
    """Shares (n,), the means (n, d) about that of the whole, and that (d,): about it no digits are lost far
    from the origin."""
    n, d = m.shape
    a, x, centre = w / w.sum(), np.empty((n, d)), np.zeros(d)
    for i in range(n):
        for r in range(d):
            centre[r] += a[i] * m[i, r]
    for i in range(n):
        for r in range(d):
            x[i, r] = m[i, r] - centre[r]
    return a, x, centre


@kernel
def _covariance_about_mean(a, x, P):
    n, d = x.shape
    S = np.zeros((d, d))
    for i in range(n):
        for r in range(d):
            for c in range(d):
                S[r, c] += a[i] * (P[i, r, c] + x[i, r] * x[i, c])
    return S


@kernel
def _square(root):
    """root root' (d, d)."""
    d = len(root)
    out = np.zeros((d, d))
    for r in range(d):
        for c in range(r + 1):
            for k in range(d):
                out[r, c] += root[r, k] * root[c, k]
            out[c, r] = out[r, c]
    return out


@kernel
def _joint_precision(a, x, P):
    """The Cholesky factor of the mean of the inverses, nan where it has none, and the mean (d, 1) of the
    reverse divergence where its covariance is the identity."""
    n, d = x.shape
    precision, h, R, T = np.zeros((d, d)), np.zeros((d, 1)), np.zeros((d, d)), np.empty((d, d))
    for i in range(n):
        inverse_into(T, P[i], R)
        for r in range(d):
            for c in range(d):
                precision[r, c] += a[i] * T[r, c]
                h[r, 0] += a[i] * T[r, c] * x[i, c]
    if not cholesky_into(R, precision):
        R[:], h[:] = np.nan, 0.0
    solve_lower(R, h)
    return R, h


@kernel
def _seen_through(R, M):
    """R' M R for a lower triangular R."""
    d = len(R)
    half, out = np.zeros((d, d)), np.zeros((d, d))
    for r in range(d):
        for c in range(d):
            for k in range(c, d):
                half[r, c] += M[r, k] * R[k, c]
    for r in range(d):
        for c in range(d):
            for k in range(r, d):
                out[r, c] += R[k, r] * half[k, c]
    return out


@kernel
def _geometric(y, M, exact):
    """Root of the covariance of the symmetrised barycentre, and steps, in coordinates where the reverse one
    has unit covariance and the mean y (d,), which is overwritten by the mean of the symmetrised one.

    M is the covariance of the whole about the origin, its mean. The covariance is the root of M + y y'.
    """
    d = len(y)
    start, before, length = y.copy(), y.copy(), np.empty(d)
    K, A, root = np.zeros((d, d)), np.empty((d, d)), np.empty((d, d))
    steps, moving = 0, True
    while moving and steps < STEPS:
        steps += 1
        for r in range(d):
            before[r] = y[r]
            for c in range(d):
                A[r, c] = M[r, c] + y[r] * y[c]
        cholesky_into(K, A)
        for r in range(d):
            y[r] = 0.0
            for c in range(d):
                A[r, c], root[r, c] = K[c, r], 1.0 if r == c else 0.0
        orthogonalise(A, root)
        for k in range(d):
            squared, along = 0.0, 0.0
            for r in range(d):
                squared += A[r, k] * A[r, k]
                along += root[r, k] * start[r]
            length[k] = max(np.sqrt(squared), 1.0)  # but for rounding, M is at least the identity
            along *= length[k] / (1.0 + length[k])
            for r in range(d):
                y[r] += along * root[r, k]
        moved, size = 0.0, 1.0
        for r in range(d):
            moved, size = moved + (y[r] - before[r]) ** 2, size + y[r] * y[r]
        moving = moved > exact * exact * size
    for r in range(d):
        for k in range(d):
            root[r, k] *= np.sqrt(length[k])
    return root, steps


@kernel
def _transported(a, P, exact):
    """Covariance of Wasserstein's barycentre, and steps; two components need only one."""
    n, d = len(P), P.shape[1]
    L, roots, root = np.zeros((d, d)), np.zeros((n, d, d)), np.empty((d, d))
    S, before = P[np.argmax(a)].copy(), np.empty((d, d))
    for step in range(1, STEPS + 1):
        definite = cholesky_into(L, S)
        for i in range(n):
            definite &= step > 1 or cholesky_into(roots[i], P[i])
        if not definite:
            return np.full((d, d), np.nan), 0
        root[:], before[:] = 0.0, S
        for i in range(n):
            near = aligned(L, roots[i])
            for r in range(d):
                for c in range(d):
                    root[r, c] += a[i] * near[r, c]
        S = _square(root)
        if n <= 2 or _settled(before, S, exact):
            break
    return S, step


@kernel
def _settled(before, after, exact):
    """Whether no entry of a covariance has moved."""
    for r in range(len(after)):
        for c in range(r + 1):
            limit = exact * np.sqrt(before[r, r]) * np.sqrt(before[c, c])
            if not abs(after[r, c] - before[r, c]) <= limit:
                return False
    return True


@kernel
def _best_overlap(a, x, P, exact):
    """The lower of the minima of the integral squared difference reached from the moment match and, where the
    first is not near the least of all functions, from the best component."""
    n, d = x.shape
    cost = np.zeros(n)
    for k in range(n):
        for i in range(k):
            apart = isd_cost(x[i], P[i], x[k], P[k])
            cost[k] += a[i] * apart
            cost[i] += a[k] * apart
    S = _covariance_about_mean(a, x, P)
    mean, S, steps, least = descend(ISD, a, x, P, np.zeros(d), S, exact)
    total, bound, at = 0.0, 0.0, np.argmin(cost)
    for i in range(n):
        bound += 0.5 * a[i] * cost[i]  # of the mixture itself
        total += a[i] * isd_cost(x[i], P[i], mean, S)
    if total > NEAR * bound:
        mean_k, S_k, steps_k, value = descend(ISD, a, x, P, x[at], P[at], exact)
        steps = max(steps, steps_k)
        if value < least:
            mean, S = mean_k, S_k
    return mean, S, steps
