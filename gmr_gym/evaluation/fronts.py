"""Which of several ways are on the front: what none of the others betters at no more cost."""

import numpy as np
from numpy.typing import ArrayLike


def front(cost: ArrayLike, figure: ArrayLike) -> np.ndarray:
    """Points that no other one betters in cost or figure without being worse in the other.

    Parameters
    ----------
    cost, figure : array_like (n,)
        The smaller the better; points with a nan, or an infinite figure, are on no front.

    Returns
    -------
    ndarray of bool (n,)

    Examples
    --------
    >>> front([1.0, 2.0, 3.0], [0.5, 0.7, 0.1]).tolist()
    [True, False, True]
    """
    cost, figure = np.asarray(cost, float), np.asarray(figure, float)
    found = np.zeros(len(cost), bool)
    last = np.nan, np.inf
    for i in np.lexsort((figure, cost)):
        if not np.isnan(cost[i]) and (figure[i] < last[1] or (cost[i], figure[i]) == last):
            found[i], last = True, (cost[i], figure[i])
    return found
