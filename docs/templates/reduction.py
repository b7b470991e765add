"""Keeps the heaviest component, and merges all others into a second."""

import numpy as np

from gmr_gym.checks import check_count
from gmr_gym.mixture import Mixture, checked, matched
from gmr_gym.reduction.protocol import Reduced


def heaviest_and_rest(p: Mixture, components: int) -> Reduced:
    """The heaviest component and the moment match of all others; of one component, the match of all."""
    p, components = checked(p), check_count(components)
    origin = np.where(np.arange(len(p.w)) == p.w.argmax(), 0, 1)
    if components < 2:
        origin[:] = 0
    origin[p.w == 0] = -1  # dropped: what has no weight has no part in a mean
    return matched(p, origin, origin.max() + 1), origin
