"""Mixture reduction by Runnalls' cost of a merge.

Every reduction takes a Mixture and returns (Mixture, origin): origin (n,) is the output index of each input
component, -1 where it was dropped. Merging keeps the total weight, mean and covariance. Pruning and capping
lower the total weight and leave rescaling to `normalised`. Components of weight zero are always dropped, and
an empty mixture stays empty. A mixture that fails `checked` raises ValueError.
"""

from dataclasses import dataclass

import numpy as np

from gmr_gym.checks import UNLIMITED, check_choice, check_count, check_loss_bound, refuse_unsound, sound
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture, arrays_of
from gmr_gym.reduction.consistent_merging import merged_within
from gmr_gym.reduction.greedy_merging import merge_greedily
from gmr_gym.reduction.measures import TELESCOPING
from gmr_gym.reduction.merge_cost import merge_costs, total_cost
from gmr_gym.reduction.protocol import TOO_FAR, Reduced
from gmr_gym.reduction.pruning import above_threshold, select, weighing


def runnalls(p: Mixture, components: int) -> Reduced:
    """Greedy merging of the pair with the least cost B until `components` remain.

    Parameters
    ----------
    p : Mixture
    components : int
        Upper limit of the number of components that remain.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,).

    Raises
    ------
    ValueError
        For `components` below 1, or a mixture that fails `checked`.

    Notes
    -----
    The cost B of a merge is defined in `gmr_gym.reduction.merge_cost`.

    References
    ----------
    Runnalls 2007; D'Ortenzio, eq. 13 and section 3.1.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> p = mixture([0.25, 0.25, 0.5], [[0.0], [2.0], [9.0]], [[[1.0]]] * 3)
    >>> q, origin = runnalls(p, 2)
    >>> q.m.tolist(), origin.tolist()
    ([[1.0], [9.0]], [0, 0, 1])
    """
    return Greedy(check_count(components))(p)


def adaptive(p: Mixture, loss_bound: float, components: int | None = None, measure: str = "kl") -> Reduced:
    """Greedy merging by cost B while the relative loss stays within `loss_bound`.

    Parameters
    ----------
    p : Mixture
    loss_bound : float
        Bound alpha, in [0, 1], of the sum of the costs of the merges relative to that of merging everything,
        for "kl" `total_merge_cost`.
    components : int, optional
        Upper limit of the number of components that remain: merging goes on beyond the bound until it is met.
    measure : {"kl", "reverse-kl"}
        What the costs are by: B, or the cost and the barycentre of `consistent` by the reverse divergence.
        Only by these two does any order of merges cost the same, so that the relative loss is that of the
        result.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,).

    Raises
    ------
    ValueError
        For a `loss_bound` outside [0, 1], an unknown measure, `components` below 1, or a mixture that fails
        `checked`.

    Warnings
    --------
    By "reverse-kl" a pair far apart becomes a narrow Gaussian between the two, where the mixture has no
    weight.

    Notes
    -----
    Departs: the listing lowers m after a merge that it has rejected and has no guard at m = 1; here the last
    accepted mixture is returned, and a single component is left as it is.

    References
    ----------
    D'Ortenzio, eqs. 14-15, Algorithm 1 and section 3.3.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> p = mixture([0.25, 0.25, 0.5], [[0.0], [0.1], [9.0]], [[[1.0]]] * 3)
    >>> q, origin = adaptive(p, loss_bound=0.05)
    >>> len(q.w), origin.tolist()
    (2, [0, 0, 1])
    """
    merging = greedy(components, loss_bound)
    check_choice("measure", measure, TELESCOPING)
    if measure == "kl":
        return merging(p)
    return merged_within(p, merging.components, measure, merging.loss_bound)


@dataclass(frozen=True)
class Greedy:
    """Greedy merging, as in `runnalls` and `adaptive`, as plain numbers that a compiled scan takes."""

    components: int  # upper limit of those that remain
    loss_bound: float = -1.0  # alpha; negative for Runnalls' reduction, which stops at `components`

    def __call__(self, p: Mixture) -> Reduced:
        arrays = arrays_of(p)
        good, kept, *merged, origin = _checked_merging(*arrays, self.components, self.loss_bound)
        if not good:
            refuse_unsound("p.", *arrays)
        if not kept:
            raise ValueError(TOO_FAR)
        return Mixture(*merged), origin


def greedy(components: int | None, loss_bound: float) -> Greedy:
    """Checked Greedy of `adaptive`; ValueError for a loss bound outside [0, 1] and for `components` below
    1."""
    bound = check_loss_bound(loss_bound)
    return Greedy(UNLIMITED if components is None else check_count(components), bound)


def total_merge_cost(p: Mixture) -> float:
    """Cost of merging everything into one Gaussian: the sum of w_i KL(component i || moment match).

    Notes
    -----
    Departs: D'Ortenzio, eq. 14 divides by the total weight. Undivided, it is the sum of the costs B of any
    sequence of merges down to one, whatever the weights sum to.

    References
    ----------
    D'Ortenzio, eq. 14.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> round(total_merge_cost(mixture([0.5, 0.5], [[0.0], [2.0]], [[[1.0]], [[1.0]]])), 4)
    0.3466
    """
    q, _ = weighing(p)
    return float(total_cost(*q)[0]) if len(q.w) else 0.0


@kernel
def _checked_merging(w, m, P, components, loss_bound):
    """Whether the mixture is sound, whether what is left of it is, and `merge_by_cost`: in one call, since
    three would cost a small reduction a tenth of its time."""
    if not sound(w, m, P):
        return False, False, w, m, P, np.empty(0, np.int64)
    w, m, P, origin = merge_by_cost(w, m, P, components, loss_bound)
    return True, sound(w, m, P), w, m, P, origin


@kernel(inline="always")
def merge_by_cost(w, m, P, components, loss_bound):
    """`adaptive`, or `runnalls` for a negative bound: w, m, P and origin (n,) of the reduced mixture."""
    kept, alive = above_threshold(w, w, 0.0), np.arange(len(w))
    left = kept.sum()
    merging = left > 1 and (loss_bound >= 0.0 or left > components)
    if left < len(w) or not merging:  # else the merging itself makes a copy
        w, m, P, alive = select(w, m, P, kept)
    if not merging:
        return w, m, P, alive
    # at a bound of 1 the rounding of the sum must not prevent the last merge
    budget = np.inf if loss_bound == 1.0 else -1.0
    if 0.0 <= loss_bound < 1.0:
        budget = loss_bound * total_cost(w, m, P)[0]
    w, m, P, origin = merge_greedily(w, m, P, components, budget)
    for i in range(len(alive)):
        if alive[i] >= 0:
            alive[i] = origin[alive[i]]
    return w, m, P, alive


@kernel
def merge_down(w, m, P, components):
    """`runnalls` of components of positive weight: w, m, P and origin (n,) of the reduced mixture, and the
    number of costs that were evaluated."""
    n = len(w)
    if n <= components:
        return w, m, P, np.arange(n), 0
    w, m, P, origin = merge_greedily(w, m, P, components, -1.0)
    return w, m, P, origin, merge_costs(n, components)
