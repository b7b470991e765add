r"""Reduction by the composite transportation divergence, descended by majorisation and minimisation.

Notes
-----
The components f_i of a mixture, of weights w_i, are shared out among the Gaussians g_j of the reduced one so
that with a cost c of two Gaussians

.. math::

    \sum_{ij} \pi_{ij} \, c(f_i, g_j) + \lambda \sum_{ij} \pi_{ij} \log \frac{\pi_{ij}}{w_i},
    \qquad \pi_{ij} \ge 0, \quad \sum_j \pi_{ij} = w_i

is least. A sweep makes every g_j the barycentre of what it has been given, of that weight, and then shares
the components out anew. Neither step raises the sum.
"""

from collections.abc import Callable
from numbers import Real
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_choice, check_count, check_not_negative
from gmr_gym.mixture import Mixture, mean_and_covariance
from gmr_gym.reduction.distances import pack
from gmr_gym.reduction.measures import KL, MEASURES
from gmr_gym.reduction.overlap_descent import STEPS
from gmr_gym.reduction.protocol import Reduced, at_unit, definite, grouped, through, warn_unfinished
from gmr_gym.reduction.pruning import weighing
from gmr_gym.reduction.runnalls import runnalls
from gmr_gym.reduction.transport_sweeps import (
    barycentres,
    divergences,
    half_log_determinants,
    keep_better,
    moment_matches,
    share_out,
)  # fmt: skip

SWEEPS = 300  # at most; the hard form needs some ten
CONVERGED = 1e-9  # fall of the objective in the last sweep, relative
ALIKE = 1e-8  # divergence below which two Gaussians of a soft form have become one


class Descent(NamedTuple):
    """Where the sweeps have ended."""

    reduced: Mixture  # the L Gaussians that components are left with
    share: np.ndarray  # (L, n) parts of the weights of the components, of any unit
    objective: np.ndarray  # (sweeps,) after every sweep


def transportation(
    p: Mixture, components: int, cost: str = "kl", entropy: float = 0.0, starts: int = 1
) -> Reduced:
    """Least composite transportation divergence, descended from the groups of `runnalls`.

    Without entropy every component goes whole to the Gaussian of least cost, which is k-means by that cost.
    With entropy it is shared among all. Gaussians that all components have left are dropped; those that
    have become alike, all of them at a large entropy, are merged.

    Parameters
    ----------
    p : Mixture
    components : int
        Upper limit of the number of components that remain.
    cost : {"kl", "reverse-kl", "symmetrised-kl", "wasserstein", "cauchy-schwarz", "isd"}
        Cost of two Gaussians, see `gmr_gym.reduction.measures`.
    entropy : float
        Weight lambda of the entropy, as a multiple of the median cost of the components that do not start
        alone in their groups.
    starts : int
        Groups to start from, of whose ends the best is taken: those of `runnalls`, then random ones, always
        the same.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,): the Gaussian with the largest part of each component.

    Raises
    ------
    ValueError
        For an unknown cost, a negative or infinite entropy, `starts` or `components` below 1, components too
        far apart to be merged, or a mixture that fails `checked`.

    Warns
    -----
    UserWarning
        Where 300 sweeps do not converge.

    References
    ----------
    Zhang, Zhang and Chen 2024.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> p = mixture([0.25, 0.25, 0.5], [[0.0], [2.0], [9.0]], [[[1.0]]] * 3)
    >>> q, origin = transportation(p, 2)
    >>> q.m.tolist(), origin.tolist()
    ([[1.0], [9.0]], [0, 0, 1])
    """
    q, place, best = _best(p, components, cost, entropy, starts)
    return (q, place) if best is None else _reduced(best, place)


def transportation_objective(
    p: Mixture, components: int, cost: str = "kl", entropy: float = 0.0, starts: int = 1
) -> np.ndarray:
    """What `transportation` lowers, after each of its sweeps.

    Returns
    -------
    ndarray (sweeps,)
        Of the best start, in the unit of the cost times that of the weights; never rises. A mixture that
        needs no reduction has a single 0.

    Raises
    ------
    ValueError
        As `transportation`.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> p = mixture([0.25, 0.25, 0.5], [[0.0], [2.0], [9.0]], [[[1.0]]] * 3)
    >>> transportation_objective(p, 2).round(4).tolist()
    [0.1733]
    """
    _, _, best = _best(p, components, cost, entropy, starts)
    return np.zeros(1) if best is None else best.objective


def dphem(p: Mixture, components: int, samples: float | None = None) -> Reduced:
    r"""Density-preserving hierarchical expectation maximisation, from the groups of `runnalls`.

    Expectation maximisation on as many virtual samples of every component. The fewer they are, the more
    components are shared among Gaussians.

    Parameters
    ----------
    p : Mixture
    components : int
        Upper limit of the number of components that remain.
    samples : float, optional
        Virtual samples I of a component; by default as many as there are components. With infinitely many
        it is `transportation`.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,): the Gaussian with the largest part of each component.

    Raises
    ------
    ValueError
        For `samples` that are not positive, `components` below 1, components too far apart to be merged, or
        a mixture that fails `checked`.

    Warns
    -----
    UserWarning
        Where 300 sweeps do not converge.

    Notes
    -----
    With v_j the share of the whole weight that Gaussian j has, the part of component i that it is given is

    .. math::

        z_{ij} \propto v_j \exp(-I \, \mathrm{KL}(f_i \,\|\, g_j))

    References
    ----------
    Yu, Yang and Chan 2018.
    """
    components = check_count(components)
    q, place = weighing(p)
    samples = max(len(q.w), 1) if samples is None else samples
    if not isinstance(samples, Real) or not samples > 0:
        raise ValueError(f"samples must be positive, got {samples!r}")
    if len(q.w) <= components:
        return q, place
    _, group = runnalls(q, components)
    return _reduced(descent(q, group, "kl", 1.0 / samples, weighted=True), place)


def descent(p: Mixture, group: np.ndarray, cost: str, temperature: float, weighted: bool = False) -> Descent:
    """Sweeps from groups of the components until the objective falls no further.

    Parameters
    ----------
    p : Mixture
        Checked, without components of weight zero.
    group : ndarray (n,)
        Group of each component, from 0.
    cost : str
    temperature : float
        The lambda of the objective, in the unit of the cost.
    weighted : bool
        Whether parts are proportional to the weights of the Gaussians, too, as in `dphem`.
    """
    step, w = stepping(cost, p), at_unit(p.w)
    objective: list[float] = []
    share = shares(w, group)
    v, c, S, table, exact = step(share)
    while len(objective) < SWEEPS:
        fresh, value = share_out(table, w, v, temperature, weighted)
        least_fall = CONVERGED * (abs(value) + temperature * w.sum())
        if objective and not objective[-1] - value > least_fall:
            break
        share = fresh
        objective.append(value)
        v, *new, new_exact = step(share)
        exact &= new_exact
        if cost == "kl":  # whose barycentre is sure to be the least
            c, S, table = new
        else:
            keep_better(share, c, S, table, *new)
    else:
        warn_unfinished("the descent of the transportation divergence", SWEEPS)
    if not exact:
        warn_unfinished(f"the barycentre by {cost}", STEPS)
    unit = p.w.max() / w.max()
    left = v > 0
    reduced = definite(Mixture(unit * v[left], c[left], S[left]))
    return Descent(reduced, share[left], unit * np.array(objective))


def stepping(cost: str, p: Mixture) -> Callable[[np.ndarray], tuple]:
    """The function of shares (L, n) of the components that gives the weights (L,), means and covariances of
    the barycentres of the rows, the costs (L, n) from them, and whether no barycentre was cut short."""
    mean, code = mean_and_covariance(p)[0], MEASURES.index(cost)
    x = p.m - mean  # no digits are lost far from the origin
    more = (pack(x, p.P), half_log_determinants(p.P)) if code == KL else None

    def step(share: np.ndarray) -> tuple:
        of_rows = barycentres(code, share, x, p.P) if more is None else moment_matches(share, x, p.P, *more)
        v, c, *rest = of_rows
        return v, c + mean, *rest

    return step


def shares(w: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Shares (L, n) of components of weights w, each whole in its group (n,)."""
    return np.where(group == np.arange(group.max() + 1)[:, None], w, 0.0)


def _best(
    p: Mixture, components: int, cost: str, entropy: float, starts: int
) -> tuple[Mixture, np.ndarray, Descent | None]:
    """The mixture without components of weight zero, its origin, and the best descent if it needs one."""
    check_choice("cost", cost, MEASURES)
    if not check_not_negative("entropy", entropy) < np.inf:
        raise ValueError(f"entropy must be finite, got {entropy}")
    components, starts = check_count(components), check_count(starts, "starts")
    q, place = weighing(p)
    if len(q.w) <= components:
        return q, place, None
    _, group = runnalls(q, components)
    temperature = entropy * _scale(q, group, cost) if entropy > 0 else 0.0
    groups = [group, *_random_groups(len(group), components, starts - 1)]
    return q, place, min((descent(q, g, cost, temperature) for g in groups), key=lambda d: d.objective[-1])


def _random_groups(n: int, components: int, count: int) -> list[np.ndarray]:
    """Random groups (n,), none of them empty."""
    rng = np.random.default_rng(0)
    return [rng.permutation(np.append(np.arange(components), rng.integers(components, size=n - components)))
            for _ in range(count)]  # fmt: skip


def _scale(p: Mixture, group: np.ndarray, cost: str) -> float:
    """Median cost of the components that are not alone in their groups."""
    *_, table, _ = stepping(cost, p)(shares(at_unit(p.w), group))
    shared = np.bincount(group)[group] > 1
    return float(np.median(table[group, np.arange(len(group))][shared]))


def _reduced(best: Descent, place: np.ndarray) -> Reduced:
    """The Gaussians of a descent that have weight, those merged that have become alike."""
    q, share = best.reduced, best.share
    same = divergences(pack(q.m, q.P), half_log_determinants(q.P), *q) < ALIKE
    _, group = np.unique(same.argmax(axis=0), return_inverse=True)
    share = np.array([share[group == g].sum(axis=0) for g in range(group.max() + 1)])
    return grouped(q, group, len(share)), through(place, share.argmax(axis=0))
