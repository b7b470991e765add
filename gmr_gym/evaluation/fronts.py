"""Of several ways those that none of the others betters at no more cost, and how much such a front covers."""

import numpy as np


def front(cost: np.ndarray, figure: np.ndarray) -> np.ndarray:
    """Points that no other one betters in cost or figure without being worse in the other.

    Parameters
    ----------
    cost, figure : ndarray (n,)
        The smaller the better; points with a nan, or an infinite figure, are on no front.

    Returns
    -------
    ndarray of bool (n,)

    Examples
    --------
    >>> import numpy as np
    >>> from gmr_gym.evaluation.fronts import front
    >>> front(np.array([1.0, 2.0, 3.0]), np.array([0.5, 0.7, 0.1])).tolist()
    [True, False, True]
    """
    found = np.zeros(len(cost), bool)
    last = np.nan, np.inf
    for i in np.lexsort((figure, cost)):
        if not np.isnan(cost[i]) and (figure[i] < last[1] or (cost[i], figure[i]) == last):
            found[i], last = True, (cost[i], figure[i])
    return found


def hypervolume(cost: np.ndarray, figure: np.ndarray, worst: tuple[float, float]) -> np.ndarray:
    """Area of what the points better, up to a worst cost and figure.

    Parameters
    ----------
    cost, figure : ndarray (..., n)
        The smaller the better; for an area in decades, the logarithm of a cost to the base 10. A point with a
        nan, or beyond the worst, adds nothing.
    worst : tuple of two float
        Cost and figure.

    Returns
    -------
    ndarray (...)
        In units of the cost times those of the figure; the larger the better.

    References
    ----------
    Zitzler and Thiele, "Multiobjective evolutionary algorithms", IEEE Transactions on Evolutionary
    Computation 3, 1999.

    Examples
    --------
    >>> import numpy as np
    >>> from gmr_gym.evaluation.fronts import hypervolume
    >>> float(hypervolume(np.array([1.0, 2.0]), np.array([0.5, 0.25]), (3.0, 1.0)))
    1.25
    """
    out = np.isnan(cost) | np.isnan(figure)
    cost, figure = (
        np.minimum(np.where(out, end, x), end) for x, end in zip((cost, figure), worst, strict=True)
    )
    order = np.argsort(cost, axis=-1)
    cost, figure = (np.take_along_axis(x, order, axis=-1) for x in (cost, figure))
    width = np.diff(cost, axis=-1, append=worst[0])
    return (width * (worst[1] - np.minimum.accumulate(figure, axis=-1))).sum(axis=-1)


def at_cost(cost: np.ndarray, figure: np.ndarray, wanted: float) -> np.ndarray:
    """Figure of the front of the points at a cost: linear between its corners.

    Parameters
    ----------
    cost, figure : ndarray (..., n)
        The smaller the better.
    wanted : float

    Returns
    -------
    ndarray (...)
        nan where the front begins at more than that cost.
    """
    shape = cost.shape[:-1]
    rows = zip(cost.reshape(-1, cost.shape[-1]), figure.reshape(-1, cost.shape[-1]), strict=True)
    found = [np.interp(wanted, *_corners(*row), left=np.nan) for row in rows]
    return np.reshape(found, shape)


def _corners(cost: np.ndarray, figure: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cost and figure of the points on the front, the cheapest first."""
    on = np.flatnonzero(front(cost, figure))
    on = on[np.argsort(cost[on])]
    return cost[on], figure[on]
