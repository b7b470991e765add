"""All that a tracker keeps from scan to scan, and its form in a file."""

from typing import NamedTuple

import numpy as np

from gmr_gym.filters.clutter_estimation import ClutterEstimate, initial_estimate
from gmr_gym.filters.imm_tracks import Banks
from gmr_gym.models.clutter import uniform_clutter
from gmr_gym.recorded.model import TrackingModel
from gmr_gym.recorded.track_leaves import Leaves, no_leaves
from gmr_gym.recorded.track_rules import Lives, width
from gmr_gym.recorded.tracks import Tracks, no_rows


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


class LastScans(NamedTuple):
    """What smoothing some scans late keeps of the last scans: m rows, K banks in order of scans and rows.

    Attributes
    ----------
    number : int
        Of the last scan, from 1.
    rows : Tracks
    row_scan : ndarray of int (m,)
        Number of the scan of each row.
    banks : Banks
        Filtered with the own detections of their tracks alone (see `smoothing.continued`).
    label, scan : ndarray of int (K,)
        Track and number of the scan of each bank.
    of_row : ndarray of bool (K,)
        Whether the bank is at the time of its row, and not at that of its detection.
    """

    number: int
    rows: Tracks
    row_scan: np.ndarray
    banks: Banks
    label: np.ndarray
    scan: np.ndarray
    of_row: np.ndarray


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
    last : tuple of LastScans
        One; none where nothing is smoothed.
    leaves : tuple of Leaves
        One; none where tracks have no hypotheses.
    """

    targets: Targets
    time: float
    undetected: float
    next_label: int
    identities: dict[str, int]
    clutter: tuple[ClutterEstimate, ...]
    last: tuple[LastScans, ...]
    leaves: tuple[Leaves, ...]


def initial_state(model: TrackingModel, lag: int = 0) -> State:
    """The state before the first scan.

    Parameters
    ----------
    model : TrackingModel
    lag : int
        Number of scans by which rows are smoothed late; 0 for none.

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
    trees = (no_leaves(r, d),) if model.tracker == "mht" else ()
    last = LastScans(0, no_rows(p, r), count, banks, count, count, np.empty(0, bool))
    targets = Targets(banks, none, count, lives)
    return State(targets, -np.inf, model.undetected, 1, {}, clutter, (last,) if lag else (), trees)
