"""Tracks of recorded detections as a recording, to be watched as an episode is."""

from collections.abc import Sequence

import numpy as np

from gmr_gym.recorded.detections import POLAR, Detections
from gmr_gym.recorded.positions import local_positions
from gmr_gym.recorded.scans import Scan
from gmr_gym.recorded.tracks import DELETED, Tracks
from gmr_gym.replay.columns import upper
from gmr_gym.replay.recording import Recording

MOST_FRAMES = 2000  # that a page shows; of more scans, neighbours are shown together
LIKELY = 0.5  # weight from which a detection is shown as one of a track
EMPTY = np.empty((0, 2))


def recording_of(
    tracks: Tracks,
    detections: Detections,
    scans: Sequence[Scan],
    name: str = "tracks",
    title: str = "",
    truth: np.ndarray | None = None,
    most: int = MOST_FRAMES,
) -> Recording:
    """A recording of tracks.

    Parameters
    ----------
    tracks : Tracks
    detections : Detections
    scans : sequence of T Scan
        In order of time.
    name : str
        Of what tracked.
    title : str
        Of what was tracked.
    truth : ndarray (T, n, 2), optional
        True positions at the scans, m, nan where a target is absent.
    most : int
        Frames. Of more scans, so many in a row are shown as one frame that there are no more, with all their
        detections.

    Returns
    -------
    Recording
        Of many targets; a frame has a `time`, s, and of each track the last row until then, from its first to
        that of its deletion. A detection's `origin` is the track that takes it, less one, or -1.
    """
    frames, of_scan, times = _frames(scans, most)
    of_row = of_scan[np.searchsorted([scan.time for scan in scans], tracks.time)]
    frame_of, rows = _held(of_row, tracks, frames)
    points = [scan.rows for scan in scans]
    order = np.concatenate([*points, np.empty(0, int)]).astype(int)
    z_counts = np.bincount(of_scan, weights=[len(one) for one in points], minlength=frames).astype(int)
    taken = np.full(len(detections.time), -1)
    likely = (tracks.weight >= LIKELY) & (tracks.detection >= 0)
    taken[tracks.detection[likely]] = tracks.track[likely] - 1
    at = np.searchsorted(of_scan, np.arange(frames), side="right") - 1
    own = {
        "z": local_positions(detections)[order, :2],
        "z_start": _starts(z_counts),
        "origin": taken[order],
        "declared": tracks.x[rows, :2],
        "declared_P": upper(tracks.P[rows]),
        "declared_start": _starts(np.bincount(frame_of, minlength=frames)),
        "existence": tracks.existence[rows],
        "label": tracks.track[rows],
        "expected": np.bincount(frame_of, weights=tracks.existence[rows], minlength=frames),
        **_no_mixture(frames),
    }
    columns = {"truth": np.empty((frames, 0, 2)) if truth is None else truth[at], "time": times}
    columns |= {f"0/{column}": values for column, values in own.items()}
    radar = detections.kind == POLAR and not detections.origin.any()
    period = (times[-1] - times[0]) / max(frames - 1, 1)
    return Recording(title, None, "many", float(period), frames, 0, radar, (), (name,), columns)


def _frames(scans: Sequence[Scan], most: int) -> tuple[int, np.ndarray, np.ndarray]:
    """Number of frames, the frame of each scan, and the time of each frame, that of its last scan."""
    together = -(-len(scans) // most)
    of_scan = np.arange(len(scans)) // together
    ends = np.flatnonzero(np.diff(of_scan, append=len(scans)))
    return len(ends), of_scan, np.array([scan.time for scan in scans])[ends]


def _held(frame: np.ndarray, tracks: Tracks, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Frames, in order, and the last row of each track until then, from its first to that of its deletion."""
    found, rows = [np.empty(0, int)], [np.empty(0, int)]
    for track in np.unique(tracks.track):
        own = np.flatnonzero(tracks.track == track)
        end = frame[own[-1]] + 1 if tracks.status[own[-1]] == DELETED else frames
        within = np.arange(frame[own[0]], end)
        found.append(within)
        rows.append(own[np.searchsorted(frame[own], within, side="right") - 1])
    at, row = np.concatenate(found), np.concatenate(rows)
    order = np.argsort(at, kind="stable")
    return at[order], row[order]


def _starts(counts: np.ndarray) -> np.ndarray:
    return np.concatenate([[0], np.cumsum(counts)])


def _no_mixture(frames: int) -> dict[str, np.ndarray]:
    """The columns of an intensity that is not kept."""
    return {
        "kept": EMPTY, "kept_w": np.empty(0), "kept_P": np.empty((0, 3)),
        "kept_start": np.zeros(frames + 1, int), "count": np.zeros(frames, int),
    }  # fmt: skip
