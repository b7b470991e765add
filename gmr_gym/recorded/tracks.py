"""Tracks of recorded detections: one row for each track and scan."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

STATUS = ("tentative", "confirmed", "coasted", "deleted")
TENTATIVE, CONFIRMED, COASTED, DELETED = range(4)


class Tracks(NamedTuple):
    """Rows of tracks, ordered by time and then by track.

    Attributes
    ----------
    time : ndarray (m,)
        s.
    track : ndarray of int (m,)
        Label of the track, from 1; none is used twice.
    status : ndarray of int8 (m,)
        Index into `STATUS`. The last row of a track that has ended is deleted.
    x : ndarray (m, d)
        Positions, then velocities: m, m/s.
    P : ndarray (m, d, d)
        Covariance of x.
    existence : ndarray (m,)
        Probability that there is such a target.
    modes : ndarray (m, r)
        Probabilities of the motion models.
    detections : ndarray of int (m,)
        Number of detections in the gate.
    detection : ndarray of int (m,)
        Index of the detection of most weight, -1 if there is none in the gate.
    weight : ndarray (m,)
        Probability that this one is of the track's target.
    nis : ndarray (m,)
        Its normalised innovation squared; NaN where there is none.
    age : ndarray of int (m,)
        Scans since the first detection.
    """

    time: np.ndarray
    track: np.ndarray
    status: np.ndarray
    x: np.ndarray
    P: np.ndarray
    existence: np.ndarray
    modes: np.ndarray
    detections: np.ndarray
    detection: np.ndarray
    weight: np.ndarray
    nis: np.ndarray
    age: np.ndarray


def joined_rows(parts: Sequence[Tracks]) -> Tracks:
    """Rows one after the other.

    Parameters
    ----------
    parts : sequence of Tracks
        At least one.

    Returns
    -------
    Tracks
    """
    return Tracks(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def rows_of_each(tracks: Tracks) -> dict[int, np.ndarray]:
    """Indices of the rows of each track, in order of their numbers.

    Parameters
    ----------
    tracks : Tracks

    Returns
    -------
    dict of int to ndarray
    """
    order = np.argsort(tracks.track, kind="stable")
    labels, first = np.unique(tracks.track[order], return_index=True)
    return dict(zip(labels.tolist(), np.split(order, first[1:]), strict=True)) if len(order) else {}


def no_rows(axes: int, modes: int) -> Tracks:
    """No row.

    Parameters
    ----------
    axes, modes : int
        Number of coordinates of a position, and of motion models.

    Returns
    -------
    Tracks
    """
    none, count, d = np.empty(0), np.empty(0, np.int64), 2 * axes
    return Tracks(
        none, count, np.empty(0, np.int8), np.empty((0, d)), np.empty((0, d, d)), none, np.empty((0, modes)),
        count, count, none, none, count,
    )  # fmt: skip
