"""Dissimilarity of two components of a mixture, for all pairs at once.

Merging i and j, of weights wi and wj, into their moment match c of weight wc = wi + wj changes the mixture by

    D = integral of (wi Ni + wj Nj - wc Nc)^2
      = wi^2 <Ni, Ni> + wj^2 <Nj, Nj> + 2 wi wj <Ni, Nj> + wc^2 <Nc, Nc> - 2 wc <wi Ni + wj Nj, Nc>

the integral squared difference from the mixture before (Zhang, eq. 3), whatever the other components are.
"""

import numpy as np

from gmr_gym.checks import check_choice
from gmr_gym.kernels import ZERO, kernel
from gmr_gym.mixture import Mixture, checked
from gmr_gym.reduction.distances import dimension, known, pack, products_of_columns, products_with
from gmr_gym.reduction.merge_cost import components_last, cost_row, pair_covariances

MEASURES = ("isd", "correlation", "runnalls")


def dissimilarity(p: Mixture, measure: str) -> np.ndarray:
    """Dissimilarity of every two components: symmetric, zero on the diagonal, never negative.

    Parameters
    ----------
    p : Mixture
    measure : {"isd", "correlation", "runnalls"}
        "isd": the integral squared difference of the mixtures before and after merging the two, accurate to
        about 1e-16 of the integral of the square of the two components.

        "correlation": 1 - <Ni, Nj> / sqrt(<Ni, Ni> <Nj, Nj>), in [0, 1]; the weights play no part.

        "runnalls": the cost B of merging the two; infinite where they lie more than about 1e8 standard
        deviations apart and B is lost in rounding.

    Returns
    -------
    ndarray (n, n)

    Raises
    ------
    ValueError
        For an unknown measure, a mixture that fails `checked`, or weights whose squares overflow in "isd".

    Notes
    -----
    Departs: the line below Zhang's eq. 3 prints + Jfg, which is not the expansion of the square.

    References
    ----------
    Zhang, eq. 3; D'Ortenzio, eq. 13.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> p = mixture([0.5, 0.5], [[0.0], [2.0]], [[[1.0]], [[1.0]]])
    >>> dissimilarity(p, "correlation").round(4).tolist()
    [[0.0, 0.6321], [0.6321, 0.0]]
    """
    check_choice("measure", measure, MEASURES)
    p = checked(p)
    table = dissimilarities(p, measure)
    if measure == "isd" and not np.isfinite(table).all():
        raise ValueError(
            f"isd has squares of weights beyond the range of floats, got weights up to {p.w.max():g}; "
            "pass normalised(p)"
        )
    return table


def dissimilarities(p: Mixture, measure: str) -> np.ndarray:
    """`dissimilarity` for a checked mixture and measure."""
    if measure == "isd":
        return isd_table(p.w, pack(p.m, p.P))
    if measure == "correlation":
        return _uncorrelatedness(pack(p.m, p.P))
    return _merge_costs(p.w, p.m, p.P)


@kernel
def isd_table(w, M):
    """D (n, n) of merging any two of the Gaussians packed in M (T, n)."""
    n = len(w)
    table, own = np.zeros((n, n)), own_products(M)
    for i in range(1, n):
        row = isd_row(i, np.arange(i), w, M, own)
        for j in range(i):
            table[i, j] = table[j, i] = row[j]
    return table


@kernel
def isd_row(i, others, w, M, own):
    """D (k,) of merging i with each of `others` (k,), all packed in M (T, n), with <N, N> in own."""
    T, k = len(M), len(others)
    first = T - dimension(T)  # the row where the means begin
    # the others and last i itself, relative to the mean of i: no digits are lost far from the origin
    near, weight = np.empty((T, k + 1)), np.empty(k + 1)
    for t in range(T):
        origin = M[t, i] if t >= first else 0.0
        near[t, k] = M[t, i] - origin
        for j in range(k):
            near[t, j] = M[t, others[j]] - origin
    weight[k] = w[i]
    for j in range(k):
        weight[j] = w[others[j]]
    pair, share = np.empty((T, k)), np.empty(k)
    pair_covariances(k, 0, k, weight, near[first:], near[:first], share, pair)
    for t in range(first, T):
        for j in range(k):
            pair[t, j] = (1 - share[j]) * near[t, j]
    x = near[:, k].copy()
    ij, ic = products_with(x, near, k), products_with(x, pair, k)
    jc, cc = products_of_columns(near, pair, k), products_of_columns(pair, pair, k)
    out = np.empty(k)
    for j in range(k):
        wi, wj = weight[k], weight[j]
        wc = wi + wj
        two = wi * wi * known(own[i]) + wj * wj * known(own[others[j]]) + 2 * wi * wj * known(ij[j])
        one = wc * wc * known(cc[j])
        # for two equal components rounding may give -1e-16
        out[j] = max(two + one - 2 * wc * (wi * known(ic[j]) + wj * known(jc[j])), 0.0)
    return out


@kernel
def own_products(M):
    """Integrals (n,) of the squares of the Gaussians packed in M (T, n)."""
    own = products_of_columns(M, M, M.shape[1])
    for x in own:
        if not 0.0 < x < np.inf:
            raise ValueError(
                "a covariance of the mixture is not positive definite, or the square of its density "
                "lies outside the range of floats: choose units nearer to the spread of the states"
            )
    return own


@kernel
def _uncorrelatedness(M):
    n = M.shape[1]
    table, own = np.zeros((n, n)), own_products(M)
    for i in range(1, n):
        row = products_with(M[:, i], M, i)
        for j in range(i):
            r = row[j] / np.sqrt(own[i]) / np.sqrt(own[j])
            table[i, j] = table[j, i] = max(1.0 - r, 0.0)  # for two equals rounding may give -1e-16
    return table


@kernel
def _merge_costs(w, m, P):
    n = len(w)
    columns, room = components_last(w, m, P)
    table = np.zeros((n, n))
    for i in range(1, n):
        cost_row(i, ZERO, i, columns, room, table[i])
        for j in range(i):
            # two components of weight zero have no moment match and cost nothing
            table[i, j] = table[j, i] = table[i, j] if w[i] + w[j] > 0.0 else 0.0
    return table
