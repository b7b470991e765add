"""Weights of a reduced mixture by least squares: a quadratic programme in the weights alone."""

import numpy as np

from gmr_gym.checks import check_choice, check_count, check_flag
from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, solve_lower, solve_upper
from gmr_gym.mixture import Mixture
from gmr_gym.reduction.distances import pack, products, products_of_columns, products_with
from gmr_gym.reduction.protocol import TOO_FAR, Reduced, grouped, through, warn_unfinished
from gmr_gym.reduction.pruning import weighing
from gmr_gym.reduction.units import into, standard

WHEN = ("each-merge", "end")
RIDGE = 1e-12  # beside entries of H of at most 1: components that are nearly equal leave it singular
FLOOR = 1e-16  # decrease of the error that is lost in its rounding
DEPENDENT = 1e-9  # relative: rows of `kept` that depend on the others
CHANGES = 20  # limit of the changes of the components at zero, for each component


def refit(p: Mixture, components: int, reduction: str = "runnalls", keep_mean: bool = False) -> Reduced:
    r"""Any reduction, then the weights of what is left that have the least integral squared error.

    The total weight is that of the reduction. The mean moves, unless `keep_mean`; the covariance of the whole
    is not kept. Where the covariance of the whole is lost in rounding, the reduction is returned as it is.

    Parameters
    ----------
    p : Mixture
    components : int
        Upper limit of the number of components that remain.
    reduction : str
        A name that `reducer` takes.
    keep_mean : bool
        Whether the mean stays that of the reduction.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,). Components whose weight becomes zero are left out, and the
        origin of their members is -1.

    Raises
    ------
    ValueError
        For `components` below 1, an unknown `reduction`, or a mixture that fails `checked`.

    Warns
    -----
    UserWarning
        Where the search for the components of positive weight stops at its limit.

    Notes
    -----
    With w, mu, P of the original and v, m, S of the reduced mixture:

    .. math::

        \min_v v^T H v - 2 c^T v, \quad v \ge 0, \quad \sum_j v_j \text{ kept}, \qquad
        H_{jk} = \mathcal{N}(m_j; m_k, S_j + S_k), \quad c_j = \sum_i w_i \mathcal{N}(m_j; \mu_i, S_j + P_i)

    References
    ----------
    Crouse et al. 2011; without the bound v >= 0, Chen, Chang and Smith 2010.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> p = mixture([0.3, 0.3, 0.4], [[0.0], [1.0], [2.5]], [[[1.0]], [[0.5]], [[1.0]]])
    >>> q, origin = refit(p, 2)
    >>> q.w.round(4).tolist(), origin.tolist()
    ([0.5958, 0.4042], [0, 0, 1])
    """
    from gmr_gym.reduction.registry import reducer  # which knows this reduction by its name

    check_flag("keep_mean", keep_mean)
    p, place = weighing(p)
    start, group = reducer(reduction, components)(p)
    if len(start.w) == len(p.w):
        return p, place
    try:
        units, f = standard(p)
    except np.linalg.LinAlgError:
        return start, through(place, group)
    v = _fitted(f, into(units, start), keep_mean)
    q, left = weighing(start._replace(w=units.total * v))
    return q, through(place, through(group, left))


def cowa(p: Mixture, components: int, when: str = "each-merge", keep_mean: bool = False) -> Reduced:
    r"""Merges the component of least weight over size with the one of most similar shape and place, until
    `components` remain, and fits the weights as `refit` does.

    Size is the trace of the covariance relative to that of the whole mixture. Most similar are the two
    densities, both of weight 1, of least integral squared difference.

    Parameters
    ----------
    p : Mixture
    components : int
        Upper limit of the number of components that remain.
    when : {"each-merge", "end"}
        Whether the weights are fitted after every merge, which then change what is merged next, or once.
    keep_mean : bool
        Whether the fit leaves the mean as it is.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,), -1 for the members of components whose weight became zero.

    Raises
    ------
    ValueError
        For `components` below 1, an unknown `when`, or a mixture that fails `checked`.

    Warns
    -----
    UserWarning
        As `refit`.

    Notes
    -----
    Constraint-optimised weight adaptation. The error may end above that of another order of merging: weights
    fitted early mislead later merges.

    Departs: sizes are taken in coordinates where the whole has unit covariance; else the units of the state
    would decide. Merging ends at `components` alone, and at no distance.

    References
    ----------
    Chen, Chang and Smith 2010; with weights that are not negative, Crouse et al. 2011.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> p = mixture([0.3, 0.3, 0.4], [[0.0], [1.0], [2.5]], [[[1.0]], [[0.5]], [[1.0]]])
    >>> q, origin = cowa(p, 2)
    >>> q.w.round(4).tolist(), origin.tolist()
    ([0.5958, 0.4042], [0, 0, 1])
    """
    check_choice("when", when, WHEN)
    check_flag("keep_mean", keep_mean)
    components = check_count(components)
    p, place = weighing(p)
    if len(p.w) <= components:
        return p, place
    try:
        units, f = standard(p)
    except np.linalg.LinAlgError:
        raise ValueError(TOO_FAR) from None
    g, group = p, np.arange(len(p.w))
    while len(g.w) > components:
        merged = _similar_together(into(units, g))
        g = grouped(g, merged, len(g.w) - 1)
        if when == "each-merge" or len(g.w) == components:
            g = g._replace(w=units.total * _fitted(f, into(units, g), keep_mean))
        g, left = weighing(g)
        group = through(group, through(merged, left))
    return g, through(place, group)


def _similar_together(g):
    """Groups (n,) of the components, of which two form one and every other is alone."""
    columns, n = pack(g.m, g.P), len(g.w)
    i = int(np.argmin(g.w / np.trace(g.P, axis1=1, axis2=2)))
    own = products_of_columns(columns, columns, n)
    apart = own[i] + own - 2 * products_with(columns[:, i].copy(), columns, n)
    apart[i] = np.inf
    first, second = sorted((i, int(np.argmin(apart))))
    group = np.arange(n) - (np.arange(n) > second)
    group[second] = first
    return group


def _fitted(f, g, keep_mean):
    """Weights (L,) of g with the least error from f, of the same sum and, if asked, of the same mean."""
    columns = pack(g.m, g.P)
    kept = np.vstack([np.ones(len(g.w)), *(g.m.T if keep_mean else ())])
    return fit_weights(products(columns, columns), products(columns, pack(f.m, f.P)) @ f.w, g.w, kept)


def fit_weights(H: np.ndarray, c: np.ndarray, v: np.ndarray, kept: np.ndarray) -> np.ndarray:
    """The v (L,) of least v'Hv - 2c'v where v >= 0 and kept v is as it is, by the primal active-set method.

    Parameters
    ----------
    H : ndarray (L, L)
        Symmetric, positive semidefinite.
    c : ndarray (L,)
    v : ndarray (L,)
        Where to start, positive. The result is nowhere above it.
    kept : ndarray (r, L)

    Warns
    -----
    UserWarning
        Where the components at zero still change after 20 L changes.

    References
    ----------
    Nocedal and Wright 2006, Algorithm 16.3.
    """
    top, n = np.abs(H).max(), len(v)
    if not 0 < top < np.inf:
        return v
    H, c, free = H / top, c / top, np.ones(n, bool)
    for _ in range(CHANGES * n):
        slope, step = np.einsum("jk,k", H, v) - c, np.zeros(n)
        step[free], price = _step(H[np.ix_(free, free)], slope[free], kept[:, free])
        if -slope @ step > FLOOR:
            reach = np.full(n, np.inf)
            np.divide(-v, step, out=reach, where=step < 0)
            first = int(reach.argmin())
            v = np.maximum(v + min(reach[first], 1.0) * step, 0)
            if reach[first] <= 1:
                v[first], free[first] = 0.0, False
            continue
        gain = np.where(free, np.inf, slope - price @ kept)
        least = int(gain.argmin())
        if not gain[least] < -RIDGE:
            return v
        free[least] = True
    warn_unfinished("the fit of weights", CHANGES * n)
    return v


def _step(H, slope, kept):
    """The step to the least of the quadratic where `kept` does not change, and the slope per unit of each of
    what is kept (r,)."""
    U, size, rows = np.linalg.svd(kept, full_matrices=False)
    known = size > DEPENDENT * size[0]
    Q = rows[known]  # an orthonormal basis of what must not change
    price = U[:, known] / size[known] @ (Q @ slope)
    QH = Q @ H
    across = Q.T @ QH
    # H where nothing kept changes, and the identity beside it
    within = H + RIDGE * np.eye(len(H)) - across - across.T + Q.T @ (QH @ Q.T + np.eye(len(Q))) @ Q
    step = _solve(within, Q.T @ (Q @ slope) - slope)
    return step - Q.T @ (Q @ step), price


@kernel
def _solve(H, y):
    """H^-1 y, by Cholesky; 0 where rounding has left H indefinite. LAPACK would share the work among threads,
    for which small matrices wait longer than it takes."""
    L, x = np.zeros(H.shape), y.copy().reshape(-1, 1)
    if not cholesky_into(L, H):
        return np.zeros(len(y))
    solve_lower(L, x)
    solve_upper(L, x)
    return x[:, 0]
