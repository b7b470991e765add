"""All that a tracker keeps from scan to scan, and its form in a file."""

import json
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.filters.clutter_estimation import ClutterEstimate, initial_estimate
from gmr_gym.filters.imm_tracks import Banks
from gmr_gym.models.clutter import uniform_clutter
from gmr_gym.recorded.model import TrackingModel
from gmr_gym.recorded.track_rules import Lives, width


class Targets(NamedTuple):
    """n tracks in order of their labels.

    Attributes
    ----------
    banks : Banks
    existence : ndarray (n,)
    identity : ndarray of int (n,)
        Index into `State.identities`, -1 where it is not known.
    lives : Lives
    """

    banks: Banks
    existence: np.ndarray
    identity: np.ndarray
    lives: Lives


class State(NamedTuple):
    """All that a tracker keeps from scan to scan.

    Attributes
    ----------
    targets : Targets
    time : float
        Of the last scan, s; minus infinity before the first.
    undetected : float
        Expected number of targets in the box that have not been detected.
    next_label : int
    identities : dict of str to int
    clutter : tuple of ClutterEstimate
        One for each sensor; none where the clutter is not estimated.
    """

    targets: Targets
    time: float
    undetected: float
    next_label: int
    identities: dict[str, int]
    clutter: tuple[ClutterEstimate, ...]


def initial_state(model: TrackingModel) -> State:
    """The state before the first scan.

    Parameters
    ----------
    model : TrackingModel

    Returns
    -------
    State
    """
    modes = model.bank()
    p, r, d = model.axes, len(model.modes), modes.states(model.axes)
    banks = Banks(np.empty((0, r)), np.empty((0, r, d)), np.empty((0, r, d, d)), np.empty(0))
    none, count = np.empty(0), np.empty(0, np.int64)
    lives = Lives(
        count, count, np.empty(0, np.int8), np.empty((0, width(model)), np.int8), none, none,
        np.empty((0, len(model.sensors))), np.empty((0, p)), none, np.empty(0, bool),
    )  # fmt: skip
    clutter = tuple(
        initial_estimate(uniform_clutter(model.low, model.high, max(spec.clutter_per_scan, 1e-3)))
        for spec in model.sensors
        if model.learn_clutter
    )
    return State(Targets(banks, none, count, lives), -np.inf, model.undetected, 1, {}, clutter)


def chosen(tree: Any, rows: Any) -> Any:
    """The tracks of these rows: a record of arrays, and of such records."""
    if isinstance(tree, np.ndarray):
        return tree[rows]
    return type(tree)(*(chosen(branch, rows) for branch in tree))


def joined(first: Any, second: Any) -> Any:
    """The tracks of two records, one after the other."""
    if isinstance(first, np.ndarray):
        return np.concatenate([first, second])
    return type(first)(*map(joined, first, second))


def leaves(tree: Any) -> Iterator[np.ndarray]:
    """The arrays of a state, one after the other; the identities as text."""
    if isinstance(tree, tuple):
        for branch in tree:
            yield from leaves(branch)
    else:
        yield np.asarray(json.dumps(tree) if isinstance(tree, dict) else tree)


def rebuilt(template: Any, found: Iterator[np.ndarray]) -> Any:
    """The state whose `leaves` are `found`, of the form of the template."""
    if isinstance(template, tuple):
        branches = [rebuilt(branch, found) for branch in template]
        return type(template)(*branches) if hasattr(template, "_fields") else tuple(branches)
    leaf = next(found)
    if isinstance(template, np.ndarray):
        return leaf
    return json.loads(str(leaf)) if isinstance(template, dict) else type(template)(leaf)
