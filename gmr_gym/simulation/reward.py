"""What an episode pays for an estimate, and when it gives the target up: one rule for all environments."""

from collections.abc import Sequence
from math import sqrt

from numba.extending import register_jitable

SCANS_OFF = 10  # scans in a row beyond the cutoff that end an episode


# not a kernel: a call of one from Python takes as long as a tenth of a step of one environment
@register_jitable
def score(
    error: float, cutoff: float, cost: float, scans_off: int, left: int
) -> tuple[float, int, bool, bool]:
    """Score one estimate.

    Parameters
    ----------
    error : float
        Distance of the estimate from the truth.
    cutoff : float
        An error beyond counts as this much.
    cost : float
        Of the scan, in the unit of the error.
    scans_off : int
        Scans in a row beyond the cutoff before this one.
    left : int
        Scans to come.

    Returns
    -------
    reward : float
        Minus the error and the cost. A target that is given up also costs the cutoff for each scan left.
    scans_off : int
    terminated, truncated : bool
        Whether the target is given up, and whether the episode has ended otherwise.
    """
    scans_off = scans_off + 1 if error > cutoff else 0
    terminated = scans_off >= SCANS_OFF
    reward = -min(error, cutoff) - cost
    if terminated:
        reward -= cutoff * left
    return reward, scans_off, terminated, left == 0 and not terminated


@register_jitable
def distance(estimate: Sequence[float], truth: Sequence[float], position: Sequence[int]) -> float:
    """Distance of two states (d,) in the given coordinates, summed in order."""
    total = 0.0
    for i in position:
        off = estimate[i] - truth[i]
        total = total + off * off
    return sqrt(total)
