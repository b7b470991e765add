"""Thresholds of a reduction, and factors on the filter model: numbers set scan by scan, and actions."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from gmr_gym.checks import UNLIMITED, check_choice
from gmr_gym.filters.mht import MAX_HYPOTHESES, cluster_scan, reduce_scan
from gmr_gym.filters.n_scan import n_scan_reduce
from gmr_gym.filters.trace import origin_of_reduction
from gmr_gym.kernels import kernel
from gmr_gym.mixture import Mixture, rescaled
from gmr_gym.points import check_unmasked
from gmr_gym.reduction.heaviest_first import Clustering
from gmr_gym.reduction.merge_cost import merge_costs, total_cost
from gmr_gym.reduction.n_scan import NScan
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.reduction.pruning import entering, heaviest_mask, select
from gmr_gym.reduction.runnalls import Greedy


class Thresholds(NamedTuple):
    """What is set scan by scan: thresholds of the reduction of a posterior, by default those of D'Ortenzio,
    section 4, and factors on what the filter model assumes of the scan that comes next.

    Examples
    --------
    >>> from gmr_gym.tuning import Thresholds
    >>> Thresholds(alpha=0.1)[:4]
    (0.1, 0.0005, 1e-10, 100)
    """

    alpha: float = 0.05  # share of the cost of merging everything that merging may spend
    prune: float = 5e-4  # gamma: a hypothesis that weighs less does not enter the merging
    prune_density: float = 1e-10  # gamma~, s^2/m^4 for a planar position and velocity
    components: int = 100  # N_M: most hypotheses after the reduction
    history: int = 2  # N: hypotheses that share their last N detections are merged
    distance: float = 4.0  # squared, by the covariance of the heaviest: what lies within it is merged
    process_noise: float = 1.0  # factor on the standard deviation of the process noise
    coasting_noise: float = 1.0  # a further factor for hypotheses that the last scan missed
    measurement_noise: float = 1.0  # factor on the standard deviation of the measurement noise
    detection_odds: float = 1.0  # factor on P_D / (1 - P_D)
    fading: float = 1.0  # factor on the covariances before the prediction: a memory that fades


DORTENZIO = Thresholds()
DEPTH = 5  # most detections of the past that hypotheses are told apart by
FACTORS = ("process_noise", "measurement_noise", "detection_odds", "fading")
# and the thresholds that each of them heeds
REDUCERS = {
    "adaptive": ("alpha", "prune", "prune_density", "components"),
    "n-scan": ("history", "prune", "prune_density", "components", "coasting_noise"),
    "cluster": ("distance", "prune", "prune_density", "components"),
}
# Thresholds of the actions -1 and 1; the scale between is logarithmic. Below 1e-4 alpha merges next to
# nothing, above a half it merges all that matters. Each decade of gamma changes the work by a factor of about
# three, and at 1e-2 it leaves a few hypotheses.
RANGES = {
    "alpha": (1e-4, 0.5), "prune": (1e-6, 1e-2), "prune_density": (1e-14, 1e-6), "components": (2, 200),
    "history": (1, DEPTH), "distance": (0.25, 25), "process_noise": (0.25, 8), "coasting_noise": (0.5, 8),
    "measurement_noise": (0.5, 2), "detection_odds": (0.125, 8), "fading": (1.0, 2.0),
}  # fmt: skip

LIMITS = np.array(list(RANGES.values()), float)
PRUNE, COMPONENTS = (list(RANGES).index(name) for name in ("prune", "components"))
HISTORY, DISTANCE, COASTING = (list(RANGES).index(name) for name in ("history", "distance", "coasting_noise"))
PROCESS, MEASUREMENT, ODDS, FADING = (list(RANGES).index(name) for name in FACTORS)
ADAPTIVE, N_SCAN, _ = range(len(REDUCERS))
WHOLE = np.array([name in ("components", "history") for name in RANGES])


def from_action(action: np.ndarray, parameters: Sequence[str], rest: Thresholds = DORTENZIO) -> Thresholds:
    """The thresholds that an action stands for.

    Parameters
    ----------
    action : array_like (k,)
        Numbers in [-1, 1], on a logarithmic scale over `RANGES`.
    parameters : sequence of k str
        Names of the thresholds that the action sets.
    rest : Thresholds
        Where the other thresholds come from.

    Returns
    -------
    Thresholds

    Raises
    ------
    ValueError
        For another shape, and for a number that is not finite or outside the box.

    Examples
    --------
    >>> from gmr_gym.tuning.thresholds import from_action
    >>> from_action([1.0, -1.0], ["alpha", "components"])[:4]
    (0.5, 0.0005, 1e-10, 2)
    """
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
    return from_row(from_actions(action[None], threshold_index(parameters), np.array(rest, float))[0])


def from_row(row: np.ndarray) -> Thresholds:
    """The thresholds of a row of `from_actions`."""
    values = zip(row.tolist(), WHOLE, strict=True)
    return Thresholds(*(int(value) if whole else value for value, whole in values))


def check_actions(actions: np.ndarray, n: int, parameters: Sequence[str], used: np.ndarray) -> np.ndarray:
    """Check the actions of n environments.

    Parameters
    ----------
    actions : array_like (n, k)
    n : int
    parameters : sequence of k str
        Names of the thresholds that the actions set.
    used : ndarray of bool (n,)
        The rows that must be finite and in [-1, 1].

    Returns
    -------
    ndarray (n, k)

    Raises
    ------
    ValueError
        For another shape, and for an invalid action in a row that is used.
    """
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
    """Indices (k,) of the named thresholds among the fields of `Thresholds`."""
    return np.array([Thresholds._fields.index(name) for name in parameters])


@kernel
def from_actions(actions, at, rest):
    """`from_action` for actions (n, k) that set the fields of the indices `at` (k,); rows as `Thresholds`."""
    out = np.empty((len(actions), len(rest)))
    for i in range(len(actions)):
        out[i] = rest
        for a in range(len(at)):
            low, high = LIMITS[at[a]]
            value = low * (high / low) ** ((actions[i, a] + 1) / 2)
            out[i, at[a]] = np.rint(value) if WHOLE[at[a]] else value
    return out


def to_action(thresholds: Thresholds, parameters: Sequence[str]) -> np.ndarray:
    """The action that stands for thresholds: the inverse of `from_action`.

    Parameters
    ----------
    thresholds : Thresholds
    parameters : sequence of k str
        Names of the thresholds in the action.

    Returns
    -------
    ndarray (k,)

    Raises
    ------
    ValueError
        For a threshold outside its range.

    Examples
    --------
    >>> from gmr_gym.tuning import Thresholds
    >>> from gmr_gym.tuning.thresholds import to_action
    >>> to_action(Thresholds(alpha=0.5, components=20), ["alpha", "components"]).round(3).tolist()
    [1.0, 0.0]
    """
    action = np.empty(len(parameters))
    for i, name in enumerate(parameters):
        value, (low, high) = getattr(thresholds, name), RANGES[name]
        if not low <= value <= high:
            raise ValueError(f"{name} must lie in [{low:g}, {high:g}] to be an action, got {value}")
        action[i] = 2 * np.log(value / low) / np.log(high / low) - 1
    return np.clip(action, -1, 1)  # rounding may step over the bound


def check_parameters(parameters: Sequence[str], reducer: str = "adaptive") -> tuple[str, ...]:
    """The names of what an action sets, as a tuple.

    Raises
    ------
    ValueError
        For an unknown reducer, and if they are not a sequence of different names of its thresholds and of
        `FACTORS`, at least one.
    """
    check_choice("reducer", reducer, tuple(REDUCERS))
    known = *REDUCERS[reducer], *FACTORS
    if not isinstance(parameters, Sequence) or isinstance(parameters, str) or not parameters:
        raise ValueError(f"parameters must be a list of different thresholds, got {parameters!r}")
    for name in parameters:
        if name not in known:
            raise ValueError(f"unknown threshold {name!r}; choose from {', '.join(known)}")
    if len(set(parameters)) < len(parameters):
        raise ValueError(f"parameters must be a list of different thresholds, got {parameters!r}")
    return tuple(parameters)


@kernel
def adapt(w, m, P, thresholds, cost, gated):
    """The posterior pruned, merged adaptively and pruned again by `thresholds` (D'Ortenzio, Adaptive).

    `cost` is that of merging all of it, and `gated` the number of its Gaussians that were updated. Returns w,
    m and P of the result, weights that sum to 1; its mean (d,) and covariance (d, d); the relative loss, the
    share of the cost that the result has lost; and the work: Gaussians updated plus costs of pairs evaluated.
    """
    alpha, prune, density = thresholds[0], thresholds[1], thresholds[2]
    w, m, P, entered, left = reduce_scan(
        w, m, P, prune, np.int64(MAX_HYPOTHESES), int(thresholds[COMPONENTS]), alpha, density
    )
    after, mean, covariance = total_cost(w, m, P)
    # the cost still to come on the greedy way to one Gaussian is that of the result, see `total_merge_cost`
    relative_loss = max(0.0, 1 - after / cost) if cost > 0.0 else 0.0
    return w, m, P, mean, covariance, relative_loss, gated + merge_costs(entered, left)


@kernel
def reduced(reducer, w, m, P, history, thresholds, cost, gated):
    """What `adapt` returns, and the history of the result, by the reducer of that place among `REDUCERS`.

    `history` (n, DEPTH) are the last detections of the hypotheses, which matter to "n-scan" alone. But for
    "adaptive" the limit of hypotheses is kept by pruning the lightest, which takes no work.
    """
    if reducer == ADAPTIVE:
        w, m, P, mean, covariance, relative_loss, work = adapt(w, m, P, thresholds, cost, gated)
        return w, m, P, mean, covariance, relative_loss, work, history[: len(w)]
    prune, density, most = thresholds[1], thresholds[2], np.int64(MAX_HYPOTHESES)
    if reducer == N_SCAN:
        scans = np.int64(thresholds[HISTORY])
        w, m, P, history, work = n_scan_reduce((w, m, P), history, scans, prune, most, most, density)
    else:
        w, m, P, work = cluster_scan(w, m, P, prune, most, most, thresholds[DISTANCE], density)
        history = history[: len(w)]
    if len(w) > thresholds[COMPONENTS]:
        kept = heaviest_mask(w, np.int64(thresholds[COMPONENTS]))
        w, m, P, _ = select(w, m, P, kept)
        history = history[kept]
    w = rescaled(w)
    after, mean, covariance = total_cost(w, m, P)
    relative_loss = max(0.0, 1 - after / cost) if cost > 0.0 else 0.0
    return w, m, P, mean, covariance, relative_loss, gated + work, history


def origin_in(reducer: str, full: Mixture, history: np.ndarray, thresholds: Thresholds) -> np.ndarray:
    """Where every hypothesis goes in `reduced`.

    Parameters
    ----------
    reducer : str
        One of `REDUCERS`.
    full : Mixture
        Full posterior, N hypotheses.
    history : ndarray of int, shape (N, DEPTH)
        Their last detections.
    thresholds : Thresholds

    Returns
    -------
    ndarray of int, shape (N,)
        Row of the reduced mixture that each went into, -1 where it was pruned.
    """
    prune, components = thresholds.prune, thresholds.components
    reduce: Callable[[Mixture], Reduced]
    if reducer == "adaptive":
        reduce, components = Greedy(components, thresholds.alpha), UNLIMITED
    elif reducer == "n-scan":
        _, place = entering(full, prune, MAX_HYPOTHESES)
        reduce = partial(NScan(MAX_HYPOTHESES, thresholds.history), history=history[place >= 0])
    else:
        reduce = Clustering(MAX_HYPOTHESES, thresholds.distance)
    return origin_of_reduction(full, reduce, prune, thresholds.prune_density, MAX_HYPOTHESES, components)
