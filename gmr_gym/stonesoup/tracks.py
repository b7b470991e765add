"""Ground truth and tracks, as Stone Soup has them and as arrays."""

from collections.abc import Collection, Sequence
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
from stonesoup.types.array import CovarianceMatrix
from stonesoup.types.groundtruth import GroundTruthPath, GroundTruthState
from stonesoup.types.prediction import Prediction
from stonesoup.types.state import StateMutableSequence, TaggedWeightedGaussianState
from stonesoup.types.track import Track

from gmr_gym.evaluation import recordings
from gmr_gym.mixture import mean_and_covariance
from gmr_gym.recorded.tracks import COASTED, CONFIRMED, Tracks, rows_of_each
from gmr_gym.stonesoup.mixtures import mixture_of, rows_of, vector


def truth_of(paths: Collection[StateMutableSequence], times: Sequence[datetime]) -> np.ndarray:
    """States of ground truth at the times of scans.

    Parameters
    ----------
    paths : collection of m GroundTruthPath
        A set is taken in order of time and place of the first states.
    times : sequence of T datetime

    Returns
    -------
    ndarray (T, m, d)
        NaN where a path has no state at the time.

    Raises
    ------
    ValueError
        For no path, and states of different size.
    """
    if not len(paths):
        raise ValueError("paths must be at least one")
    each = paths if isinstance(paths, Sequence) else sorted(paths, key=_first)
    d, row = each[0][0].ndim, {time: t for t, time in enumerate(times)}
    x = np.full((len(times), len(each), d), np.nan)
    for j, path in enumerate(each):
        there = [state for state in path if state.timestamp in row]
        if there:
            states = rows_of("states of paths", [state.state_vector for state in there])
            if states.shape[1] != d:
                raise ValueError(f"states of paths must have one size, got {d} and {states.shape[1]}")
            x[[row[state.timestamp] for state in there], j] = states
    return x


def paths_of(x: np.ndarray, times: Sequence[datetime]) -> list[GroundTruthPath]:
    """Ground truth as Stone Soup has it.

    Parameters
    ----------
    x : ndarray (T, m, d) or (T, d)
        States; NaN where a target is absent.
    times : sequence of T datetime

    Returns
    -------
    list of m GroundTruthPath
    """
    x = np.asarray(x, float)
    columns = x[:, None] if x.ndim == 2 else x
    return [
        GroundTruthPath(
            [
                GroundTruthState(vector(state), timestamp=time)
                for state, time in zip(columns[:, j], times, strict=True)
                if np.isfinite(state).all()
            ]
        )
        for j in range(columns.shape[1])
    ]


def tracks_of(rows: Tracks | recordings.Track, start: datetime) -> list[Track]:
    """Tracks as Stone Soup has them.

    Parameters
    ----------
    rows : gmr_gym.recorded.Tracks, or Track of `gmr_gym.evaluation.recordings`
    start : datetime
        Of time 0.

    Returns
    -------
    list of Track
        In order of their labels, which are their ids. States are weighted by existence, 1 for one target.
    """
    if isinstance(rows, recordings.Track):
        return [_track(rows.times, rows.x, rows.P, np.ones(len(rows.times)), "1", start)]
    return [
        _track(rows.time[at], rows.x[at], rows.P[at], rows.existence[at], str(label), start)
        for label, at in rows_of_each(rows).items()
    ]


def track_rows_of(
    tracks: Collection[Track], start: datetime | None = None, order: Sequence[int] | None = None
) -> Tracks:
    """Tracks of Stone Soup as rows.

    Parameters
    ----------
    tracks : collection of Track
        A set is taken in order of time and place of the first states. At least one.
    start : datetime, optional
        Of time 0; that of the first state unless given.
    order : sequence of d int, optional
        Which state of theirs each is: positions first, then velocities, as [0, 2, 1, 3] of [x, vx, y, vy].

    Returns
    -------
    gmr_gym.recorded.Tracks
        Labels count from 1. A state that is a prediction is coasted, any other confirmed. What Stone Soup
        does not say is NaN, or -1 for `detection`.

    Raises
    ------
    ValueError
        For no track, a state without a time, and as `mixture_of`.
    """
    if not len(tracks):
        raise ValueError("tracks must be at least one")
    each = tracks if isinstance(tracks, Sequence) else sorted(tracks, key=_first)
    states = [(label, age, state) for label, track in enumerate(each, 1) for age, state in enumerate(track)]
    for label, _, state in states:
        if state.timestamp is None:
            raise ValueError(f"states of tracks must have a timestamp, got one of track {label} without")
    states.sort(key=lambda each: (each[2].timestamp, each[0]))
    zero = states[0][2].timestamp if start is None else start
    labels, ages, found = zip(*states, strict=True)
    x, P = (np.array(a) for a in zip(*(mean_and_covariance(mixture_of(one)) for one in found), strict=True))
    at = np.arange(x.shape[1]) if order is None else np.array(order)
    none = np.full(len(found), np.nan)
    return Tracks(
        time=np.array([(one.timestamp - zero).total_seconds() for one in found]),
        track=np.array(labels),
        status=np.array([COASTED if isinstance(one, Prediction) else CONFIRMED for one in found], np.int8),
        x=x[:, at],
        P=P[:, at[:, None], at],
        existence=np.array([float(getattr(one, "weight", 1.0)) for one in found]),
        modes=np.ones((len(found), 1)),
        detections=np.full(len(found), -1),
        detection=np.full(len(found), -1),
        weight=none,
        nis=none,
        age=np.array(ages),
    )


def utc(time: datetime) -> datetime:
    """The time with its zone, UTC where it has none."""
    return time if time.tzinfo else time.replace(tzinfo=UTC)


def _track(
    times: np.ndarray, x: np.ndarray, P: np.ndarray, w: np.ndarray, label: str, start: datetime
) -> Track:
    return Track(
        [
            TaggedWeightedGaussianState(
                vector(x[i]), P[i].view(CovarianceMatrix), start + timedelta(seconds=float(times[i])),
                weight=float(w[i]), tag=label,
            )
            for i in range(len(times))
        ],
        id=label,
    )  # fmt: skip


def _first(path: Any) -> tuple:
    return path[0].timestamp, path[0].state_vector.ravel().tolist()
