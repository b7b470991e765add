"""Which tracks of trackers without existence are confirmed, and which are dropped: M of N, or a score.

Blackman and Popoli 1999, chapter 6.
"""

from typing import NamedTuple

import numpy as np

from gmr_gym.checks import check_choice, check_probability, check_whole

LOGICS = ("m-of-n", "score")


class TrackLogic(NamedTuple):
    """When a track is confirmed or dropped; `track_logic` makes a checked one.

    Attributes
    ----------
    kind : {"m-of-n", "score"}
    hits, window : int
        A track is confirmed by `hits` detections in its first `window` scans, and dropped if it has not got
        them.
    misses : int
        A confirmed track is dropped after so many misses in a row.
    confirm, drop : float
        Log of the ratio of likelihoods at which a tentative track is confirmed, and of its fall at which it
        is dropped.
    """

    kind: str
    hits: int
    window: int
    misses: int
    confirm: float
    drop: float


class TrackHistory(NamedTuple):
    """What the logic knows of n tracks.

    Attributes
    ----------
    confirmed : ndarray of bool, shape (n,)
    age, hits, misses : ndarray of int, shape (n,)
        Scans, scans with a detection, and misses since the last one.
    score, best : ndarray, shape (n,)
        Log of the likelihood of the track over that of false alarms, and the greatest it has had.
    """

    confirmed: np.ndarray
    age: np.ndarray
    hits: np.ndarray
    misses: np.ndarray
    score: np.ndarray
    best: np.ndarray


def track_logic(
    kind: str = "score",
    hits: int = 3,
    window: int = 4,
    misses: int = 5,
    false_confirmation: float = 0.1,
    missed_confirmation: float = 1e-2,
) -> TrackLogic:
    """Checked TrackLogic.

    Parameters
    ----------
    kind : {"m-of-n", "score"}
    hits, window : int
        M and N: a track is confirmed by M detections in its first N scans.
    misses : int
        A confirmed track is dropped after so many misses in a row.
    false_confirmation, missed_confirmation : float
        Of "score": probabilities that a track of false alarms is confirmed, and that one of a target is
        dropped.

    Raises
    ------
    ValueError
        Naming the argument that is out of range.

    References
    ----------
    Wald 1947; Blackman and Popoli 1999.
    """
    check_choice("logic", kind, LOGICS)
    check_whole("hits", hits, 1)
    check_whole("window", window, hits)
    check_whole("misses", misses, 1)
    check_probability("false_confirmation", false_confirmation)
    check_probability("missed_confirmation", missed_confirmation)
    if not false_confirmation + missed_confirmation < 1:
        raise ValueError(
            "false_confirmation and missed_confirmation must sum to less than 1, got "
            f"{false_confirmation} and {missed_confirmation}"
        )
    confirm = np.log((1 - missed_confirmation) / false_confirmation)
    drop = np.log(missed_confirmation / (1 - false_confirmation))
    return TrackLogic(kind, int(hits), int(window), int(misses), float(confirm), float(drop))


def started(logic: TrackLogic, score: np.ndarray) -> TrackHistory:
    """History of tracks with one detection, of these scores (n,)."""
    n = len(score)
    one, none = np.ones(n, np.int64), np.zeros(n, np.int64)
    sure = np.full(n, logic.hits == 1) if logic.kind == "m-of-n" else score >= logic.confirm
    return TrackHistory(sure, one, one, none, score, score)


def advanced(
    logic: TrackLogic, history: TrackHistory, hit: np.ndarray, gain: np.ndarray
) -> tuple[TrackHistory, np.ndarray]:
    """The history after a scan, and which tracks (n,) are kept.

    Parameters
    ----------
    logic : TrackLogic
    history : TrackHistory
    hit : ndarray of bool, shape (n,)
        Whether each has a detection.
    gain : ndarray, shape (n,)
        What the scan adds to its score.

    Returns
    -------
    history : TrackHistory
        Of all n tracks.
    kept : ndarray of bool, shape (n,)
        By the score a track is dropped when it has lost `drop` since its best, a confirmed one when it has
        lost as much as lies between confirming and dropping.
    """
    age, hits = history.age + 1, history.hits + hit
    misses = np.where(hit, 0, history.misses + 1)
    score = history.score + gain
    best = np.maximum(history.best, score)
    if logic.kind == "m-of-n":
        confirmed = history.confirmed | ((hits >= logic.hits) & (age <= logic.window))
        kept = np.where(confirmed, misses < logic.misses, hits + logic.window - age >= logic.hits)
    else:
        confirmed = history.confirmed | (score >= logic.confirm)
        kept = best - score < np.where(confirmed, logic.confirm, 0.0) - logic.drop
    return TrackHistory(confirmed, age, hits, misses, score, best), kept


def take(history: TrackHistory, index: np.ndarray) -> TrackHistory:
    """The histories at `index`, integers or a boolean mask (n,)."""
    return TrackHistory(*(part[index] for part in history))


def joined(*parts: TrackHistory) -> TrackHistory:
    """The histories of all parts, one part after another."""
    return TrackHistory(*map(np.concatenate, zip(*parts, strict=True)))
