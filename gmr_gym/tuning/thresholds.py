"""The thresholds of adaptive merging as numbers that somebody sets scan by scan."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gmr_gym.filters.mht import MAX_HYPOTHESES, merge_costs, reduce_scan
from gmr_gym.kernels import kernel
from gmr_gym.points import check_unmasked
from gmr_gym.reduction.merge_cost import total_cost


class Thresholds(NamedTuple):
    """What decides how far a posterior is reduced; by default as D'Ortenzio sets it, section 4."""

    alpha: float = 0.05  # of the cost of merging everything, the share that merging may spend
    prune: float = 5e-4  # gamma: a hypothesis that weighs less does not enter the merging
    prune_density: float = 1e-10  # gamma~, s^2/m^4 for a planar position and velocity
    components: int = 100  # N_M: merging goes on past alpha down to so many


DORTENZIO = Thresholds()
# An action of -1 and of 1; in between it is the logarithm that is linear. Below 1e-4 alpha merges next to
# nothing and above a half everything that matters is gone. gamma multiplies the work by about three a decade,
# and at 1e-2 it leaves a few hypotheses.
RANGES = {"alpha": (1e-4, 0.5), "prune": (1e-6, 1e-2), "prune_density": (1e-14, 1e-6), "components": (2, 200)}

LIMITS, COMPONENTS = np.array(list(RANGES.values()), float), list(RANGES).index("components")


def from_action(action: np.ndarray, parameters: Sequence[str], rest: Thresholds = DORTENZIO) -> Thresholds:
    """The thresholds that an action (k,) in [-1, 1] stands for, one of `parameters` each, on a logarithmic
    scale over RANGES; the others are those of `rest`. Raises ValueError for another shape, and for a number
    that is not finite or outside the box."""
    check_unmasked("action", action)
    try:
        action = np.array(action).astype(float, casting="same_kind", copy=False)
    except (TypeError, ValueError):
        raise ValueError(f"action must be numbers of shape {(len(parameters),)}") from None
    if action.shape != (len(parameters),):
        raise ValueError(
            f"action must have shape {(len(parameters),)}, one number each for {', '.join(parameters)}, "
            f"got {action.shape}"
        )
    if not (np.abs(action) <= 1).all():
        raise ValueError(f"action must be finite and within [-1, 1], got {action.tolist()}")
    row = from_actions(action[None], threshold_index(parameters), np.array(rest, float))[0].tolist()
    return Thresholds(*row)._replace(components=int(row[COMPONENTS]))


def check_actions(actions: np.ndarray, n: int, parameters: Sequence[str], used: np.ndarray) -> np.ndarray:
    """Actions (n, k) as floats; ValueError for another shape, and for what `from_action` refuses in one that
    is `used` (n,)."""
    shape = n, len(parameters)
    check_unmasked("actions", actions)
    try:
        actions = np.array(actions, order="C").astype(float, casting="same_kind")
    except (TypeError, ValueError):
        raise ValueError(f"actions must be numbers of shape {shape}") from None
    if actions.shape != shape:
        raise ValueError(
            f"actions must have shape {shape}, one number each for {', '.join(parameters)}, "
            f"got {actions.shape}"
        )
    bad = used & ~(np.abs(actions) <= 1).all(axis=1)
    if bad.any():
        raise ValueError(
            f"action must be finite and within [-1, 1], got {actions[bad.argmax()].tolist()} for environment "
            f"{bad.argmax()}"
        )
    return actions


def threshold_index(parameters: Sequence[str]) -> np.ndarray:
    """Where the named thresholds stand (k,) among all."""
    return np.array([Thresholds._fields.index(name) for name in parameters])


@kernel
def from_actions(actions, places, rest):
    """`from_action` for actions (n, k) that set the thresholds at `places` (k,): rows (n, 4)."""
    out = np.empty((len(actions), len(rest)))
    for i in range(len(actions)):
        out[i] = rest
        for a in range(len(places)):
            low, high = LIMITS[places[a]]
            value = low * (high / low) ** ((actions[i, a] + 1) / 2)
            out[i, places[a]] = np.rint(value) if places[a] == COMPONENTS else value
    return out


def to_action(thresholds: Thresholds, parameters: Sequence[str]) -> np.ndarray:
    """The action (k,) that stands for the thresholds named in `parameters`: `from_action` backwards.
    ValueError for one outside its range."""
    action = np.empty(len(parameters))
    for i, name in enumerate(parameters):
        value, (low, high) = getattr(thresholds, name), RANGES[name]
        if not low <= value <= high:
            raise ValueError(f"{name} must lie in [{low:g}, {high:g}] to be an action, got {value}")
        action[i] = 2 * np.log(value / low) / np.log(high / low) - 1
    return np.clip(action, -1, 1)  # rounding may step over the edge


def check_parameters(parameters: Sequence[str]) -> tuple[str, ...]:
    """The names of thresholds as a tuple; ValueError for another kind, for none, for one twice and
    for an unknown one."""
    if not isinstance(parameters, Sequence) or isinstance(parameters, str) or not parameters:
        raise ValueError(f"parameters must be a list of different thresholds, got {parameters!r}")
    for name in parameters:
        if name not in Thresholds._fields:
            raise ValueError(f"unknown threshold {name!r}; choose from {', '.join(Thresholds._fields)}")
    if len(set(parameters)) < len(parameters):
        raise ValueError(f"parameters must be a list of different thresholds, got {parameters!r}")
    return tuple(parameters)


@kernel
def adapt(w, m, P, thresholds, cost, gated):
    """The posterior pruned, merged adaptively and pruned again (D'Ortenzio, Adaptive) by thresholds (4,),
    where merging all of it costs `cost` and `gated` of its Gaussians were updated. Returns w, m and P of what
    is left, weights that sum to 1; its mean (d,) and covariance (d, d); the share of the cost that is gone
    from it; and the work, Gaussians that were updated and costs of pairs that were evaluated."""
    alpha, prune, density = thresholds[0], thresholds[1], thresholds[2]
    w, m, P, entered, left = reduce_scan(
        w, m, P, prune, np.int64(MAX_HYPOTHESES), int(thresholds[COMPONENTS]), alpha, density
    )
    after, mean, covariance = total_cost(w, m, P)
    # what is left of the greedy way to one Gaussian is the cost of what is left, see `total_merge_cost`
    relative_loss = max(0.0, 1 - after / cost) if cost > 0.0 else 0.0
    return w, m, P, mean, covariance, relative_loss, gated + merge_costs(entered, left)
