"""Descent of the composite transportation divergence from groups of components, sweep by sweep."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from gmr_gym.mixture import Mixture, mean_and_covariance
from gmr_gym.reduction.distances import pack
from gmr_gym.reduction.measures import KL, MEASURES
from gmr_gym.reduction.overlap_descent import STEPS
from gmr_gym.reduction.protocol import at_unit, definite, warn_unfinished
from gmr_gym.reduction.transport_sweeps import (
    GATHERED,
    half_log_determinants,
    keep_better,
    moment_matches,
    share_out,
)

SWEEPS = 300  # at most; the hard form needs some ten
CONVERGED = 1e-9  # fall of the objective in the last sweep, relative


class Descent(NamedTuple):
    """Where the sweeps have ended."""

    reduced: Mixture  # the L Gaussians that components are left with
    share: np.ndarray  # (L, n) parts of the weights of the components, of any unit
    objective: np.ndarray  # (sweeps,) after every sweep


def descent(p: Mixture, group: np.ndarray, cost: str, temperature: float, weighted: bool = False) -> Descent:
    """Sweeps from groups of the components until the objective falls no further.

    Parameters
    ----------
    p : Mixture
        Checked, without components of weight zero.
    group : ndarray (n,)
        Group of each component, from 0.
    cost : str
    temperature : float
        The lambda of the objective, in the unit of the cost.
    weighted : bool
        Whether parts are proportional to the weights of the Gaussians, too, as in `dphem`.
    """
    step, w = stepping(cost, p), at_unit(p.w)
    objective: list[float] = []
    share = shares(w, group)
    v, c, S, table, exact = step(share)
    while len(objective) < SWEEPS:
        fresh, value = share_out(table, w, v, temperature, weighted)
        least_fall = CONVERGED * (abs(value) + temperature * w.sum())
        if objective and not objective[-1] - value > least_fall:
            break
        share = fresh
        objective.append(value)
        v, *new, new_exact = step(share)
        exact &= new_exact
        if cost == "kl":  # whose barycentre is sure to be the least
            c, S, table = new
        else:
            keep_better(share, c, S, table, *new)
    else:
        warn_unfinished("the descent of the transportation divergence", SWEEPS)
    if not exact:
        warn_unfinished(f"the barycentre by {cost}", STEPS)
    unit = p.w.max() / w.max()
    left = v > 0
    reduced = definite(Mixture(unit * v[left], c[left], S[left]))
    return Descent(reduced, share[left], unit * np.array(objective))


def stepping(cost: str, p: Mixture) -> Callable[[np.ndarray], tuple]:
    """The function of shares (L, n) of the components that gives the weights (L,), means and covariances of
    the barycentres of the rows, the costs (L, n) from them, and whether no barycentre was cut short."""
    mean, code = mean_and_covariance(p)[0], MEASURES.index(cost)
    x = p.m - mean  # no digits are lost far from the origin
    packed = (pack(x, p.P), half_log_determinants(p.P)) if code == KL else ()

    def step(share: np.ndarray) -> tuple:
        if code == KL:
            v, c, *others = moment_matches(share, x, p.P, *packed)
        else:
            v, c, *others = GATHERED[code](share, x, p.P)
        return v, c + mean, *others

    return step


def shares(w: np.ndarray, group: np.ndarray) -> np.ndarray:
    """Shares (L, n) of components of weights w, each whole in its group (n,)."""
    return np.where(group == np.arange(group.max() + 1)[:, None], w, 0.0)
