"""Greedy merging that stops by its own costs, by the rule of 2023; `adaptive` has that of 2022."""

from gmr_gym.checks import UNLIMITED, check_choice, check_count, check_loss_bound, check_not_negative
from gmr_gym.mixture import Mixture
from gmr_gym.reduction.consistent_merging import merged_within
from gmr_gym.reduction.measures import TELESCOPING
from gmr_gym.reduction.protocol import Reduced


def adaptive_2023(
    p: Mixture,
    components: int | None = None,
    loss_bound: float = 1.0,
    ratio: float = 0.5,
    measure: str = "kl",
) -> Reduced:
    r"""Greedy merging until the next merge costs much more than those that would follow.

    With m components left it stops where the cost of the next merge exceeds `ratio` times 2 / m of the cost
    of merging all m, or where the relative loss would exceed `loss_bound`.

    Parameters
    ----------
    p : Mixture
    components : int, optional
        Upper limit of the number of components that remain: merging goes on beyond the bounds until it is
        met.
    loss_bound : float
        Bound, in [0, 1], of the sum of the costs of the merges relative to that of merging all.
    ratio : float
        Bound alpha of the cost of a merge. Below 1, the last two components are never merged.
    measure : {"kl", "reverse-kl"}
        What the costs are by, see `consistent`.

    Returns
    -------
    Reduced
        The reduced mixture and the origin (n,). The total weight is kept, and by "kl" the mean and
        covariance.

    Raises
    ------
    ValueError
        For a `loss_bound` outside [0, 1], a negative `ratio`, an unknown measure, `components` below 1, or a
        mixture that fails `checked`.

    Notes
    -----
    The cost of merging everything, c, is the sum of the costs of any sequence of merges down to one; what is
    left of it with m components is what their m - 1 merges will cost, so 2 / m of it is near twice their
    mean. With the next cost B and s the sum of those before, it stops where

    .. math::

        B > \alpha \frac{2}{m} (c - s) \qquad \text{or} \qquad s + B > \text{loss bound} \cdot c

    Departs: the rule is inferred from a public implementation, not from the paper, whose text could not be
    read. A slack of four roundings of c lets a `ratio` of 1 merge the last two.

    References
    ----------
    D'Ortenzio, Manes, Orguner and De Iuliis 2023, Adaptive Mixture Model Reduction based on the Composite
    Transportation Dissimilarity, FUSION 2023.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> p = mixture([0.2, 0.3, 0.25, 0.25], [[0.0], [0.1], [9.0], [9.1]], [[[1.0]]] * 4)
    >>> q, origin = adaptive_2023(p)
    >>> origin.tolist()
    [0, 0, 1, 1]
    """
    check_choice("measure", measure, TELESCOPING)
    limit = UNLIMITED if components is None else check_count(components)
    loss_bound, ratio = check_loss_bound(loss_bound), check_not_negative("ratio", ratio)
    return merged_within(p, limit, measure, loss_bound, ratio)
