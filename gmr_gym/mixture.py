"""Gaussian mixtures as plain arrays, component axis first."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import doubles, refuse_unsound, sound
from gmr_gym.kernels import kernel
from gmr_gym.linalg import cholesky_into, log_gaussian_scale, mahalanobis_squared, pairwise_sum


class Mixture(NamedTuple):
    """Sum of w[i] N(x; m[i], P[i]) over n components in d dimensions.

    Weights mean what they sum to: 1 for a posterior, the expected number of targets for an
    intensity. Only `normalised` rescales them.
    """

    w: np.ndarray  # (n,)
    m: np.ndarray  # (n, d)
    P: np.ndarray  # (n, d, d)


def mixture(w, m, P) -> Mixture:
    """Checked Mixture from array-likes w (n,), m (n, d), P (n, d, d), copied to float64.

    Raises ValueError as `checked` does, and where there is no component or none weighs anything.
    """
    w, m, P = (doubles(name, a).copy() for name, a in (("w", w), ("m", m), ("P", P)))
    if w.ndim != 1 or len(w) == 0:
        raise ValueError(f"w must have shape (n,) with n >= 1, got {w.shape}")
    p = checked(Mixture(w, m, P), at="")
    if not w.sum() > 0:
        raise ValueError("w must be finite and non-negative with a positive sum")
    return p


def gaussian(m, P) -> Mixture:
    """Mixture of one component: mean m (d,), covariance P (d, d); checked as in `mixture`."""
    return mixture([1.0], [m], [P])


def checked(p: Mixture, at: str = "p.") -> Mixture:
    """The mixture, of any number of components, none at all and those of weight zero included, in arrays that
    kernels take: itself where it has such, else a copy in float64.

    Raises ValueError naming the argument, `at` before w, m or P, when something is masked or no real
    number, a shape does not fit, a number is not finite, a weight is negative or a covariance is not
    symmetric positive definite.
    """
    w, m, P = arrays_of(p, at)
    if not sound(w, m, P):
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
    """The same shape with weights that sum to 1; ValueError when nothing is left to rescale and for weights
    that are no numbers or negative. Nothing but the weights is looked at."""
    w = doubles("p.w", p.w)
    if w.ndim != 1 or not ((w >= 0) & (w < np.inf)).all():
        raise ValueError(f"p.w must be finite and non-negative with shape (n,), got {w}")
    return p._replace(w=rescaled(w))


def take(p: Mixture, index: np.ndarray) -> Mixture:
    """The components at `index`, integers or a boolean mask (n,)."""
    return Mixture(p.w[index], p.m[index], p.P[index])


def joined(parts: Sequence[Mixture]) -> Mixture:
    """All the components of the parts, one after another."""
    return Mixture(*map(np.concatenate, zip(*parts, strict=True)))


def moments(p: Mixture) -> tuple[np.ndarray, np.ndarray]:
    """Mean (d,) and covariance (d, d) of the normalised mixture (D'Ortenzio, eqs. 12, 21, 22)."""
    return mean_and_covariance(checked(p))


def collapsed(p: Mixture) -> Mixture:
    """The one Gaussian with the total weight, mean and covariance of the mixture."""
    return match_all(checked(p))


def match_all(p: Mixture) -> Mixture:
    """`collapsed` for a mixture made here."""
    mean, covariance = mean_and_covariance(p)
    return Mixture(np.array([p.w.sum()]), mean[None], covariance[None])


def mean_and_covariance(p: Mixture) -> tuple[np.ndarray, np.ndarray]:
    """`moments` for a mixture made here."""
    if len(p.w) == 0:
        raise ValueError("p has no component, and a mixture of none has no moments")
    _, m, P = match(*p, np.zeros(len(p.w), np.int64), 1)
    return m[0], P[0]


def matched(p: Mixture, group: np.ndarray, count: int) -> Mixture:
    """Moment match of each of `count` groups: group (n,) holds the group of every component, -1 for
    none (Zhang, eqs. 4-5). Components that all weigh nothing are matched as if of equal weight.

    Raises ValueError for a mixture that is not `checked`, and for a group that is not of every component or
    beyond the count."""
    p, group = checked(p), np.asarray(group)
    if group.shape != p.w.shape or group.dtype.kind != "i":
        raise ValueError(f"group must hold an integer for each of {len(p.w)} components, got {group!r}")
    return match_groups(p, np.require(group, np.int64, ["C", "A", "W"]), count)


def match_groups(p: Mixture, group: np.ndarray, count: int) -> Mixture:
    """`matched` for a mixture made here."""
    if group.max(initial=-1) >= count:
        raise ValueError(f"group names group {group.max()}, but there are only {count}")
    return Mixture(*match(p.w, p.m, p.P, group, count))


def log_density(p: Mixture, x: np.ndarray) -> np.ndarray:
    """Log of the mixture at the points x (k, d), shape (k,); the weights are not normalised."""
    p, x = checked(p), doubles("x", x)
    if x.ndim != 2 or x.shape[1] != p.m.shape[1]:
        raise ValueError(f"x must have shape (k, {p.m.shape[1]}), got {x.shape}")
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


@kernel(inline="always")
def rescaled(w):
    """The weights w (n,) divided by their sum."""
    whole = pairwise_sum(w)
    if not whole > 0.0:
        raise ValueError("the weights sum to 0 or are no numbers; a mixture needs at least one above 0")
    return w / whole


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
            terms[j, i] = log_scale - 0.5 * mahalanobis_squared(L, x[j], m[i], y)
    out = np.empty(len(x))
    for j in range(len(x)):
        top = terms[j].max()
        out[j] = top + np.log(np.exp(terms[j] - top).sum()) if top > -np.inf else top
    return out
