"""Figures of quality, each with what it is expected to be."""

from typing import NamedTuple

import numpy as np


class Figure(NamedTuple):
    """A figure, and between what it is expected; NaN where nothing is."""

    name: str
    value: float
    unit: str = ""
    of: int = 0  # how many of what it rests on
    low: float = np.nan
    high: float = np.nan

    @property
    def sound(self) -> bool:
        """Whether it lies where it is expected, or nothing is known of that."""
        return not (self.value < self.low or self.value > self.high)


def wilson(hits: int, of: int) -> tuple[float, float]:
    """The ends of Wilson's 95 % interval of a probability.

    Parameters
    ----------
    hits, of : int
        `of` is positive.
    """
    z = 1.959963984540054
    middle, share = (hits + z**2 / 2) / (of + z**2), hits / of
    half = z * np.sqrt(share * (1 - share) / of + z**2 / (4 * of**2)) / (1 + z**2 / of)
    return float(middle - half), float(middle + half)
