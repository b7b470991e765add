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

from numbers import Real

import numpy as np

from gmr_gym.checks import check_choice, check_count, check_not_negative
from gmr_gym.mixture import Mixture
from gmr_gym.reduction.distances import pack
from gmr_gym.reduction.measures import MEASURES
from gmr_gym.reduction.protocol import Reduced, at_unit, grouped, through
from gmr_gym.reduction.pruning import weighing
from gmr_gym.reduction.runnalls import runnalls
from gmr_gym.reduction.transport_descent import Descent, descent, shares, stepping
from gmr_gym.reduction.transport_sweeps import divergences, half_log_determinants

STARTS = 10_000  # at most
ALIKE = 1e-8  # divergence below which two Gaussians of a soft form have become one


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
        the same. At most 10 000.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,): the Gaussian with the largest part of each component.

    Raises
    ------
    ValueError
        For an unknown cost, a negative or infinite entropy, `starts` or `components` below 1, too many
        `starts`, components too far apart to be merged, or a mixture that fails `checked`.

    Warns
    -----
    UserWarning
        Where 300 sweeps do not converge, or a barycentre is not reached.

    Warnings
    --------
    By "reverse-kl" and "wasserstein", components far apart in one group are left as a narrow Gaussian between
    them, where the mixture has no weight. By "wasserstein" the units of the states count.

    Notes
    -----
    Departs: a component at equal cost from several Gaussians goes to the first of them, and is not split.

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
    if best is None:
        return q, place
    q, share = _unlike(best) if entropy > 0 else best[:2]
    return q, through(place, share.argmax(axis=0))


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

    Expectation maximisation on virtual samples of the components, of each as many, whatever its weight. The
    fewer they are, the more components are shared among Gaussians.

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
    q, share = _unlike(descent(q, group, "kl", 1.0 / samples, weighted=True))
    return q, through(place, share.argmax(axis=0))


def _best(
    p: Mixture, components: int, cost: str, entropy: float, starts: int
) -> tuple[Mixture, np.ndarray, Descent | None]:
    """The mixture without components of weight zero, its origin, and the best descent if it needs one."""
    check_choice("cost", cost, MEASURES)
    if not check_not_negative("entropy", entropy) < np.inf:
        raise ValueError(f"entropy must be finite, got {entropy}")
    components, starts = check_count(components), check_count(starts, "starts")
    if starts > STARTS:
        raise ValueError(f"starts must be at most {STARTS}, got {starts}")
    q, place = weighing(p)
    if len(q.w) <= components:
        return q, place, None
    _, group = runnalls(q, components)
    temperature = entropy * _scale(q, group, cost) if entropy > 0 else 0.0
    groups = [group, *_random_groups(len(group), components, starts - 1)] if starts > 1 else [group]
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


def _unlike(found: Descent) -> tuple[Mixture, np.ndarray]:
    """The Gaussians of a descent, those merged that have become alike, and the shares of what is left."""
    q, share, _ = found
    same = divergences(pack(q.m, q.P), half_log_determinants(q.P), *q) < ALIKE
    first, group = np.unique(same.argmax(axis=0), return_inverse=True)
    return grouped(q, group, len(first)), np.array([share[group == g].sum(axis=0) for g in range(len(first))])
