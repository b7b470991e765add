"""What a reduction costs: how far the reduced mixture is from the original, and the time it takes."""

from collections.abc import Callable
from functools import partial
from time import perf_counter
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_count
from gmr_gym.mixture import Mixture, checked, log_density, normalised, take
from gmr_gym.reduction.distances import integral_squared_difference, normalised_integral_squared_difference
from gmr_gym.reduction.protocol import Reduced, check_reduced
from gmr_gym.reduction.runnalls import total_merge_cost

DEVIATIONS = np.array([-12, -9, -7, -6, -5, -4, -3, -2, -1, 0, 1, 2, 3, 4, 5, 6, 7, 9, 12.0])
NODES = 12  # of the quadrature between two of them
SAMPLES = 50_000
LONG_ENOUGH = 0.05  # s of calls that are timed


class Cost(NamedTuple):
    """What a reduction costs.

    Attributes
    ----------
    components : int
        That remain.
    ise : float
        Integral squared error, of the weights as they are.
    nise : float
        The same divided by Jff + Jgg, in [0, 1].
    divergence : float
        Kullback-Leibler divergence of the original from the reduced mixture, both normalised.
    standard_error : float
        Of the divergence where it is estimated; 0 in one dimension.
    reverse_divergence : float
        Kullback-Leibler divergence of the reduced mixture from the original, both normalised.
    reverse_standard_error : float
        Of that.
    seconds : float
        Time of a call.
    """

    components: int
    ise: float
    nise: float
    divergence: float
    standard_error: float
    reverse_divergence: float
    reverse_standard_error: float
    seconds: float


class Step(NamedTuple):
    """A mixture reduced to one component less than before.

    Attributes
    ----------
    mixture : Mixture
        The original one, reduced.
    origin : ndarray of int (n,)
        Component of `mixture` that each original one went into, -1 where it was dropped.
    ise : float
        Integral squared error from the original mixture.
    into : ndarray of int (k,) or None
        Component of `mixture` that each one of the step before went into, -1 where it was dropped; None where
        this step is no merging of the one before, as in clustering.
    merge_cost : float
        Runnalls' cost B of the merges since the step before; nan where there were none, or not merges alone.
    """

    mixture: Mixture
    origin: np.ndarray
    ise: float
    into: np.ndarray | None
    merge_cost: float


def cost(p: Mixture, reduce: Callable[[Mixture], Reduced]) -> Cost:
    """Reduce a mixture, and compare the two.

    Parameters
    ----------
    p : Mixture
    reduce : callable
        A reduction of a Mixture, as of `gmr_gym.reduction.reducer`. It is called several times, to be timed.

    Returns
    -------
    Cost

    Raises
    ------
    ValueError
        For a mixture that fails `checked`, and as the reduction.
    """
    q, _ = reduced(p, reduce)
    return Cost(
        len(q.w), integral_squared_difference(p, q), normalised_integral_squared_difference(p, q),
        *divergence(p, q), *divergence(q, p), _seconds(p, reduce),
    )  # fmt: skip


def reduced(p: Mixture, reduce: Callable[[Mixture], Reduced]) -> Reduced:
    """What a reduction gives for a mixture, checked to be a mixture with weight, and the origin of its parts.

    Raises
    ------
    ValueError
        For a reduction that returns anything else.
    """
    result = reduce(p)
    check_reduced(result, len(p.w))
    checked(result[0], "the reduced ")
    if not result[0].w.sum() > 0:
        raise ValueError("the reduction leaves a mixture without weight")
    return result


def divergence(p: Mixture, q: Mixture, samples: int = SAMPLES) -> tuple[float, float]:
    r"""Kullback-Leibler divergence of p from q, both normalised, and its standard error.

    Of an original f and the reduced g, `divergence(f, g)` is large where g has forgotten mass of f, and
    `divergence(g, f)` where g has put mass where f has none.

    Parameters
    ----------
    p, q : Mixture
        Of the same dimension.
    samples : int
        Points that estimate it in more than one dimension.

    Returns
    -------
    divergence : float
        By quadrature in one dimension, else the mean over points drawn from p, always the same.
    standard_error : float
        0 by quadrature.

    Notes
    -----
    .. math::

        D(p \| q) = \int p(x) \log \frac{p(x)}{q(x)} \, dx

    Examples
    --------
    >>> from gmr_gym.mixture import gaussian
    >>> kl, error = divergence(gaussian([0.0], [[1.0]]), gaussian([1.0], [[1.0]]))
    >>> round(kl, 9), error
    (0.5, 0.0)
    """
    p, q, samples = normalised(checked(p)), normalised(checked(q, "q.")), check_count(samples, "samples")
    if p.m.shape[1] == 1:
        x, weight = _nodes(p, q)
        log_p = log_density(p, x)
        return float(weight @ (np.exp(log_p) * (log_p - log_density(q, x)))), 0.0
    x = _samples(p, samples)
    ratio = log_density(p, x) - log_density(q, x)
    return float(ratio.mean()), float(ratio.std(ddof=1) / np.sqrt(len(x)))


def steps(p: Mixture, reduction: Callable[..., Reduced], components: int = 1) -> list[Step]:
    """A mixture reduced to every number of its components, from all of them down.

    Each step is a reduction of the whole mixture. For greedy methods they are its merges one by one.

    Parameters
    ----------
    p : Mixture
    reduction : callable
        A function of a mixture and `components`, the number that may remain.
    components : int
        The last number.

    Returns
    -------
    list of Step
        The first is the mixture itself.

    Raises
    ------
    ValueError
        For a mixture that fails `checked` or has fewer than `components`, and as the reduction.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> from gmr_gym.reduction import west
    >>> p = mixture([0.2, 0.7, 0.1], [[0.0], [2.0], [9.0]], [[[1.0]]] * 3)
    >>> [step.into.tolist() for step in steps(p, west)]
    [[0, 1, 2], [0, 1, 1], [0, 0]]
    """
    p, n = checked(p), len(p.w)
    if check_count(components) > n:
        raise ValueError(f"components must be at most the {n} of the mixture, got {components}")
    found = [Step(p, np.arange(n), 0.0, np.arange(n), np.nan)]
    for left in range(n - 1, components - 1, -1):
        q, origin = reduced(p, partial(reduction, components=left))
        into = _into(found[-1], origin)
        error = integral_squared_difference(p, q)
        found.append(Step(q, origin, error, into, _merge_cost(found[-1].mixture, into)))
    return found


def _into(before: Step, origin: np.ndarray) -> np.ndarray | None:
    """Where each component of the step before went; None where its members went apart."""
    into = np.full(len(before.mixture.w), -1)
    members = before.origin >= 0
    into[before.origin[members]] = origin[members]
    followed = np.where(members, np.append(into, -1)[before.origin], -1)
    return into if np.array_equal(followed, origin) else None


def _merge_cost(before: Mixture, into: np.ndarray | None) -> float:
    if into is None or (into < 0).any() or len(set(into)) == len(into):
        return np.nan
    return sum(total_merge_cost(take(before, into == j)) for j in set(into) if (into == j).sum() > 1)


def _nodes(p: Mixture, q: Mixture) -> tuple[np.ndarray, np.ndarray]:
    """Points (k, 1) and weights (k,) of a quadrature that resolves both mixtures and reaches as far as p."""
    own, other = ((m + DEVIATIONS * np.sqrt(P[:, 0])).ravel() for _, m, P in (p, q))
    edges = np.unique(np.clip(np.concatenate([own, other]), own.min(), own.max()))
    x, weight = np.polynomial.legendre.leggauss(NODES)
    half = np.diff(edges)[:, None] / 2
    return (edges[:-1, None] + half * (1 + x)).reshape(-1, 1), (half * weight).ravel()


def _samples(p: Mixture, count: int) -> np.ndarray:
    """Points (count, d) drawn from a mixture whose weights sum to 1, always the same."""
    rng = np.random.default_rng(0)
    i = rng.choice(len(p.w), count, p=p.w)
    L = np.linalg.cholesky(p.P)
    return p.m[i] + np.einsum("nij,nj->ni", L[i], rng.standard_normal((count, p.m.shape[1])))


def _seconds(p: Mixture, reduce: Callable[[Mixture], Reduced]) -> float:
    """Median time of a call, after one that warms up."""
    reduce(p)
    times: list[float] = []
    while len(times) < 3 or sum(times) < LONG_ENOUGH:
        begun = perf_counter()
        reduce(p)
        times.append(perf_counter() - begun)
    return float(np.median(times))
