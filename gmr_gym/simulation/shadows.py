"""Places in which a sensor sees less: a detection probability that depends on where a target is."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from gmr_gym.checks import check_probability


@dataclass(frozen=True)
class Shadows:
    """Detection probability P_D of a state: one outside all circles, and in each circle one of its own.

    Where circles overlap the lowest counts.
    """

    clear: float  # P_D outside
    circles: tuple[tuple[float, float, float, float], ...]  # x, y and radius, m, and P_D inside

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """P_D of states.

        Parameters
        ----------
        x : ndarray (..., d)
            States whose first two numbers are the position, m; nan where a target is absent.

        Returns
        -------
        ndarray (...)
        """
        p = np.full(x.shape[:-1], self.clear)
        for *centre, radius, inside in self.circles:
            within = ((x[..., :2] - centre) ** 2).sum(axis=-1) <= radius**2
            p[within] = np.minimum(p[within], inside)
        return p


def shadowed(detection_probability: float, shadows: Any) -> float | Shadows:
    """P_D with places in which it is another, as settings give it.

    Parameters
    ----------
    detection_probability : float
        P_D outside of them.
    shadows : sequence of ((x, y), radius, P_D)
        Circles, m, and P_D inside, from 0 to 1.

    Returns
    -------
    float or Shadows
        A number where there are no shadows.

    Raises
    ------
    ValueError
        Naming the argument that is invalid.

    Examples
    --------
    >>> p = shadowed(0.9, [((0, 0), 50.0, 0.2)])
    >>> p(np.array([[0.0, 30.0], [0.0, 60.0]])).tolist()
    [0.2, 0.9]
    """
    check_probability("detection_probability", detection_probability)
    circles = []
    try:
        for (x, y), radius, p in shadows:
            circles.append((float(x), float(y), float(radius), float(p)))
    except (TypeError, ValueError):
        raise ValueError(f"shadows must be ((x, y), radius, probability) each, got {shadows!r}") from None
    for circle in circles:
        x, y, radius, p = circle
        if not (abs(x) <= 1e6 and abs(y) <= 1e6 and 0 < radius <= 1e6 and 0 <= p <= 1):
            raise ValueError(
                "shadows must have a finite centre, a positive radius and a probability from 0 to 1, "
                f"got {circle}"
            )
    return Shadows(float(detection_probability), tuple(circles)) if circles else float(detection_probability)
