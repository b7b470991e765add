"""Which of several ways are on the front: what none of the others betters at no more cost."""

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
