"""Gaussian mixtures as plain arrays, component axis first."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import doubles, refuse_unsound, sound
from gmr_gym.first_calls import for_few_calls
from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, log_gaussian_scale, mahalanobis_squared, pairwise_sum


class Mixture(NamedTuple):
    """Gaussian mixture: the sum of w[i] N(x; m[i], P[i]) over n components in d dimensions.

    The weights sum to 1 for a posterior and to the expected number of targets for an intensity. Only
    `normalised` rescales them. `mixture` makes a checked one.

    Attributes
    ----------
    w : ndarray (n,)
        Weights, not negative.
    m : ndarray (n, d)
        Means.
    P : ndarray (n, d, d)
        Covariances.
    """

    w: np.ndarray
    m: np.ndarray
    P: np.ndarray


def mixture(w, m, P) -> Mixture:
    """Checked Mixture from array-likes, copied to float64.

    Parameters
    ----------
    w : array_like (n,)
        Weights, n >= 1, not negative, not all zero.
    m : array_like (n, d)
        Means.
    P : array_like (n, d, d)
        Covariances, symmetric positive definite.

    Raises
    ------
    ValueError
        As `checked`, and for a mixture without components or without weight.

    Examples
    --------
    >>> p = mixture([0.25, 0.75], [[0.0], [4.0]], [[[1.0]], [[1.0]]])
    >>> p.w.tolist(), p.m.shape, p.P.shape
    ([0.25, 0.75], (2, 1), (2, 1, 1))
    """
    w, m, P = (doubles(name, a).copy() for name, a in (("w", w), ("m", m), ("P", P)))
    if w.ndim != 1 or len(w) == 0:
        raise ValueError(f"w must have shape (n,) with n >= 1, got {w.shape}")
    p = checked(Mixture(w, m, P), at="", often=False)
    if not w.sum() > 0:
        raise ValueError("w must be finite and non-negative with a positive sum")
    return p


def gaussian(m, P) -> Mixture:
    """Mixture of one component of weight 1, checked as in `mixture`.

    Parameters
    ----------
    m : array_like (d,)
        Mean.
    P : array_like (d, d)
        Covariance.

    Examples
    --------
    >>> gaussian([1.0, 2.0], [[4.0, 0.0], [0.0, 9.0]]).m.tolist()
    [[1.0, 2.0]]
    """
    return mixture([1.0], [m], [P])


def checked(p: Mixture, at: str = "p.", often: bool = True) -> Mixture:
    """The mixture, validated, in arrays that kernels take.

    It may have no component, and components of weight zero. It is returned as it is where its arrays are
    float64, C-ordered and writeable; otherwise as a copy in float64.

    Parameters
    ----------
    p : Mixture
    at : str
        Prefix of the names w, m and P in error messages.
    often : bool
        False where most programs come once, and need not wait for the compiler.

    Raises
    ------
    ValueError
        Naming the argument: for a masked entry, an entry that is not a real number, a shape that does not
        fit, a number that is not finite, a negative weight, or a covariance that is not symmetric positive
        definite.
    """
    w, m, P = arrays_of(p, at)
    if not (sound if often else _sound_once)(w, m, P):
        refuse_unsound(at, w, m, P)
    return p if type(p) is Mixture and w is p.w and m is p.m and P is p.P else Mixture(w, m, P)


def arrays_of(p: Mixture, at: str = "p.") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The arrays of the mixture as kernels take them, `checked` but for what `sound` looks at."""
    try:
        w, m, P = p
    except (TypeError, ValueError):
        raise ValueError(f"{at[:-1]} must be a Mixture (w, m, P), got {type(p).__name__}") from None
    w, m, P = doubles("w", w, at), doubles("m", m, at), doubles("P", P, at)
    if not (w.ndim == 1 and m.ndim == 2 and P.ndim == 3):
        refuse_unsound(at, w, m, P)
    return w, m, P


def normalised(p: Mixture) -> Mixture:
    """The mixture with weights that sum to 1. Only the weights are checked.

    Raises
    ------
    ValueError
        For weights that are negative, not finite, or sum to 0.

    Examples
    --------
    >>> normalised(mixture([1.0, 3.0], [[0.0], [4.0]], [[[1.0]], [[1.0]]])).w.tolist()
    [0.25, 0.75]
    """
    w = doubles("p.w", p.w)
    if w.ndim != 1 or not ((w >= 0) & (w < np.inf)).all():
        raise ValueError(f"p.w must be finite and non-negative with shape (n,), got {w}")
    return p._replace(w=rescaled(w))


def take(p: Mixture, index: np.ndarray) -> Mixture:
    """The components at `index`, integers or a boolean mask (n,)."""
    return Mixture(p.w[index], p.m[index], p.P[index])


def joined(parts: Sequence[Mixture]) -> Mixture:
    """The components of all parts, one part after another."""
    return Mixture(*map(np.concatenate, zip(*parts, strict=True)))


def moments(p: Mixture) -> tuple[np.ndarray, np.ndarray]:
    r"""Mean and covariance of the normalised mixture.

    Parameters
    ----------
    p : Mixture
        At least one component; weights of any sum.

    Returns
    -------
    mean : ndarray (d,)
    covariance : ndarray (d, d)

    Notes
    -----
    .. math::

        \bar w_i = w_i / \textstyle\sum_j w_j, \qquad m = \sum_i \bar w_i m_i, \qquad
        P = \sum_i \bar w_i \left( P_i + (m_i - m)(m_i - m)^T \right)

    References
    ----------
    D'Ortenzio, eqs. 12, 21, 22.

    Examples
    --------
    >>> mean, covariance = moments(mixture([0.25, 0.75], [[0.0], [4.0]], [[[1.0]], [[1.0]]]))
    >>> mean.tolist(), covariance.tolist()
    ([3.0], [[4.0]])
    """
    return mean_and_covariance(checked(p, often=False), often=False)


def collapsed(p: Mixture) -> Mixture:
    """The one Gaussian with the total weight, mean and covariance of the mixture.

    Examples
    --------
    >>> p = collapsed(mixture([0.25, 0.75], [[0.0], [4.0]], [[[1.0]], [[1.0]]]))
    >>> p.w.tolist(), p.m.tolist(), p.P.tolist()
    ([1.0], [[3.0]], [[[4.0]]])
    """
    return match_all(checked(p))


def match_all(p: Mixture) -> Mixture:
    """`collapsed` without checks, for a mixture already checked."""
    mean, covariance = mean_and_covariance(p)
    return Mixture(np.array([p.w.sum()]), mean[None], covariance[None])


def mean_and_covariance(p: Mixture, often: bool = True) -> tuple[np.ndarray, np.ndarray]:
    """`moments` without checks, for a mixture already checked; `often` as in `checked`."""
    if len(p.w) == 0:
        raise ValueError("p has no component, so it has no moments")
    _, m, P = (match if often else _match_once)(*p, np.zeros(len(p.w), np.int64), 1)
    return m[0], P[0]


def matched(p: Mixture, group: np.ndarray, count: int) -> Mixture:
    r"""Moment match of each group of components.

    Parameters
    ----------
    p : Mixture
    group : array_like of int (n,)
        Group of every component, below `count`; -1 for a component in no group.
    count : int
        Number of groups.

    Returns
    -------
    Mixture
        One component per group. A group whose components all have weight zero is matched as if they had
        equal weights.

    Raises
    ------
    ValueError
        As `checked`, and for a `group` of another shape, not of integers, or beyond `count`.

    Notes
    -----
    With the sums over the components i of group g:

    .. math::

        w_g = \sum w_i, \qquad m_g = \frac{1}{w_g} \sum w_i m_i, \qquad
        P_g = \frac{1}{w_g} \sum w_i \left( P_i + (m_i - m_g)(m_i - m_g)^T \right)

    References
    ----------
    Zhang, eqs. 4-5.

    Examples
    --------
    >>> p = mixture([1.0, 1.0, 2.0], [[0.0], [2.0], [9.0]], [[[1.0]], [[1.0]], [[1.0]]])
    >>> q = matched(p, [0, 0, 1], 2)
    >>> q.w.tolist(), q.m.tolist(), q.P.ravel().tolist()
    ([2.0, 2.0], [[1.0], [9.0]], [2.0, 1.0])
    """
    p, group = checked(p), np.asarray(group)
    if group.shape != p.w.shape or group.dtype.kind != "i":
        raise ValueError(f"group must hold an integer for each of {len(p.w)} components, got {group!r}")
    return match_groups(p, np.require(group, np.int64, ["C", "A", "W"]), count)


def match_groups(p: Mixture, group: np.ndarray, count: int) -> Mixture:
    """`matched` without checks of the mixture, for one already checked."""
    if group.max(initial=-1) >= count:
        raise ValueError(f"group must hold indices below count = {count}, got {group.max()}")
    return Mixture(*match(p.w, p.m, p.P, group, count))


def log_density(p: Mixture, x: np.ndarray) -> np.ndarray:
    """Log of the mixture's density at points; the weights are not normalised.

    Parameters
    ----------
    p : Mixture
    x : array_like (k, d)
        Points.

    Returns
    -------
    ndarray (k,)
        Minus infinity at infinity.

    Raises
    ------
    ValueError
        As `checked`, and for points of another dimension or with a nan.

    Examples
    --------
    >>> log_density(gaussian([0.0], [[1.0]]), [[0.0], [1.0]]).round(4).tolist()
    [-0.9189, -1.4189]
    """
    p, x = checked(p), doubles("x", x)
    if x.ndim != 2 or x.shape[1] != p.m.shape[1]:
        raise ValueError(f"x must have shape (k, {p.m.shape[1]}), got {x.shape}")
    for row in np.flatnonzero(np.isnan(x).any(axis=1))[:1]:
        raise ValueError(f"x must have no nan; row {row} is {x[row].tolist()}")
    return _log_density(p.w, p.m, p.P, x)


@kernel
def match(w, m, P, group, count):
    n, d = m.shape
    w_out, m_out, P_out = np.zeros(count), np.zeros((count, d)), np.zeros((count, d, d))
    members = np.zeros(count)
    for i in range(n):
        if group[i] >= 0:
            w_out[group[i]] += w[i]
            members[group[i]] += 1.0
    share = np.zeros(n)
    for i in range(n):
        g = group[i]
        if g >= 0:
            share[i] = w[i] / w_out[g] if w_out[g] > 0.0 else 1.0 / members[g]
            for r in range(d):
                m_out[g, r] += share[i] * m[i, r]
    for i in range(n):
        g = group[i]
        if g >= 0:
            for r in range(d):
                for c in range(r + 1):
                    spread = (m[i, r] - m_out[g, r]) * (m[i, c] - m_out[g, c])
                    P_out[g, r, c] += share[i] * (P[i, r, c] + spread)
    for g in range(count):
        for r in range(d):
            for c in range(r):
                P_out[g, c, r] = P_out[g, r, c]
    return w_out, m_out, P_out


_sound_once, _match_once = for_few_calls(sound), for_few_calls(match)


@kernel(inline="always")
def rescaled(w):
    """The weights w (n,) divided by their sum."""
    total = pairwise_sum(w)
    if not total > 0.0:
        raise ValueError("the weights sum to 0 or are not numbers; at least one must be positive")
    return w / total


@kernel
def _log_density(w, m, P, x):
    n, d = m.shape
    terms = np.empty((len(x), n))
    L, y = np.zeros((d, d)), np.empty(d)
    for i in range(n):
        if not cholesky_into(L, P[i]):
            raise ValueError("a covariance of the mixture is not positive definite")
        log_scale = np.log(w[i]) + log_gaussian_scale(L)
        for j in range(len(x)):
            d2 = mahalanobis_squared(L, x[j], m[i], y)
            # nan where infinities cancel: as far away as any
            terms[j, i] = log_scale - 0.5 * d2 if d2 < np.inf else -np.inf
    out = np.empty(len(x))
    for j in range(len(x)):
        top = terms[j].max()
        out[j] = top + np.log(np.exp(terms[j] - top).sum()) if top > -np.inf else top
    return out
