"""Files of tracks: a row for each track and scan, and the lines of the MOTChallenge."""

import csv
from collections.abc import Iterable, Sequence
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from gmr_gym.evaluation.writing import whole
from gmr_gym.recorded.detections import Detections, named
from gmr_gym.recorded.positions import geodetic
from gmr_gym.recorded.tracks import CONFIRMED, STATUS, Tracks, rows_of_each
from gmr_gym.version import __version__

DECIMALS = 4  # of metres and metres a second: a tenth of a millimetre
DEGREES = 9  # decimals of latitude and longitude, likewise
SECONDS = 9  # decimals of a time
TOGETHER = 20_000  # rows that are made into text at a time
CLASHING = "input_{}"  # name of a column of the input that has the name of one of the tracks


def write_tracks(
    path: Path | str,
    tracks: Tracks,
    detections: Detections,
    *,
    modes: Sequence[str] = (),
    command: str = "",
) -> None:
    """Write tracks as CSV, a row for each track and scan.

    Lines that start with # come first, with the version, the command, the absolute time of 0 s and the
    reference point of the coordinates.

    Parameters
    ----------
    path : Path or str
    tracks : Tracks
    detections : Detections
        What was tracked: its rows, metadata, absolute time and reference point.
    modes : sequence of r str
        Names of the motion models; "1", "2", ... unless given.
    command : str
        What made the tracks.

    Raises
    ------
    OSError
        Naming the file.
    """
    if not named(detections.identity).any():
        detections = detections._replace(identity=detections.identity[:0])
    with whole(path) as partial, partial.open("w", encoding="utf-8", newline="") as file:
        file.writelines(f"# {line}\n" for line in _head(detections, command))
        writer = csv.writer(file, lineterminator="\n")
        for first in range(0, max(len(tracks.time), 1), TOGETHER):
            part = Tracks(*(column[first : first + TOGETHER] for column in tracks))
            columns = track_columns(part, detections, modes)
            if not first:
                writer.writerow(columns)
            writer.writerows(zip(*columns.values(), strict=True))


def track_columns(tracks: Tracks, detections: Detections, modes: Sequence[str] = ()) -> dict[str, list]:
    """The columns of a file of tracks, by name: numbers, text, and "" for what is absent.

    Parameters
    ----------
    tracks, detections, modes
        As for `write_tracks`.
    """
    axes, names = "xyz"[: tracks.x.shape[1] // 2], _state_names(tracks)
    states = [f"{name}_m" for name in names[: len(axes)]] + [f"{name}_mps" for name in names[len(axes) :]]
    modes = modes or [str(i + 1) for i in range(tracks.modes.shape[1])]
    mode = [_known(column) for column in tracks.modes.round(DECIMALS + 2).T]
    columns: dict[str, list] = {"time": tracks.time.round(SECONDS).tolist()}
    if detections.start:
        columns["time_utc"] = [utc(detections.start, time) for time in tracks.time.tolist()]
    columns |= {"track_id": tracks.track.tolist(), "status": [STATUS[each] for each in tracks.status]}
    columns |= dict(zip(states, _without_zero(tracks.x.round(DECIMALS)).T.tolist(), strict=True))
    columns |= _covariances(tracks.P, names)
    columns["existence"] = tracks.existence.round(DECIMALS + 2).tolist()
    columns |= {f"mode_{name}": column for name, column in zip(modes, mode, strict=True)}
    columns["detections"] = tracks.detections.tolist()
    columns["detection_row"] = _of_detection(tracks, detections.row)
    columns |= {"weight": tracks.weight.round(DECIMALS + 2).tolist(), "nis": _short(tracks.nis)}
    columns["age"] = tracks.age.tolist()
    if detections.reference:
        columns |= _places(tracks, detections.reference)
    east, north = tracks.x[:, len(axes)], tracks.x[:, len(axes) + 1]
    columns["speed_mps"] = np.linalg.norm(tracks.x[:, len(axes) :], axis=1).round(DECIMALS).tolist()
    columns["course_deg"] = (np.degrees(np.arctan2(east, north)) % 360).round(2).tolist()
    return columns | _copied(tracks, detections, columns)


def confirmed_only(tracks: Tracks) -> Tracks:
    """The rows of confirmed tracks, each from its first confirmation to its end."""
    keep = np.zeros(len(tracks.time), bool)
    for rows in rows_of_each(tracks).values():
        keep[rows[np.logical_or.accumulate(tracks.status[rows] == CONFIRMED)]] = True
    return Tracks(*(column[keep] for column in tracks))


def write_mot(path: Path | str, tracks: Tracks, times: np.ndarray) -> None:
    """Write tracks as the ten columns of the MOTChallenge.

    The columns are frame and track, from 1, a box of four numbers, the probability of existence, and x, y and
    z, m. There is no picture: the box is -1,-1,-1,-1, and z is 0 of tracks in the plane.

    Parameters
    ----------
    path : Path or str
    tracks : Tracks
    times : array_like (T,)
        Times of all scans, s, increasing, those without a track too: frame f is at times[f - 1].

    Raises
    ------
    ValueError
        For a track at a time that is no scan's.
    OSError
        Naming the file.
    """
    frames = np.searchsorted(times, tracks.time)
    known = frames < len(times)
    known[known] = np.asarray(times)[frames[known]] == tracks.time[known]
    for time in tracks.time[~known][:1]:
        raise ValueError(f"times must have that of every row of tracks, but {time} is none")
    axes = tracks.x.shape[1] // 2
    points = np.zeros((len(tracks.time), 3))
    points[:, :axes] = tracks.x[:, :axes]
    each = zip((frames + 1).tolist(), tracks.track.tolist(), tracks.existence, points, strict=True)
    with whole(path) as partial, partial.open("w", encoding="utf-8") as file:
        for frame, track, existence, (x, y, z) in each:
            file.write(f"{frame},{track},-1,-1,-1,-1,{existence:.6g},{x:.4f},{y:.4f},{z:.4f}\n")


def utc(start: datetime, seconds: float) -> str:
    """A time as ISO 8601 with microseconds and Z.

    Parameters
    ----------
    start : datetime
        UTC, of second 0.
    seconds : float
    """
    time = start.replace(tzinfo=None) + timedelta(seconds=seconds)
    return f"{time.isoformat(timespec='microseconds')}Z"


def _head(detections: Detections, command: str) -> Iterable[str]:
    yield f"gmr-gym {__version__}"
    if command:
        yield f"command: {command}"
    if detections.start:
        yield f"time 0 s: {utc(detections.start, 0.0)}"
    if detections.reference:
        place = ", ".join(map(str, detections.reference))
        yield f"reference: {place} (latitude deg, longitude deg, altitude m; x east, y north, z up)"


def _state_names(tracks: Tracks) -> list[str]:
    axes = "xyz"[: tracks.x.shape[1] // 2]
    return [*axes, *(f"v{axis}" for axis in axes)]


def _covariances(P: np.ndarray, names: Sequence[str]) -> dict[str, list]:
    """The upper triangle, row by row."""
    pairs = [(i, j) for i in range(len(names)) for j in range(i, len(names))]
    return {
        f"var_{names[i]}" if i == j else f"cov_{names[i]}_{names[j]}": _short(P[:, i, j]) for i, j in pairs
    }


def _known(values: np.ndarray) -> list:
    """The numbers, "" for nan."""
    return ["" if value != value else value for value in values.tolist()]


def _short(values: np.ndarray) -> list[str]:
    """Six digits of each, none of nan."""
    return ["" if np.isnan(value) else f"{value:.6g}" for value in values.tolist()]


def _without_zero(values: np.ndarray) -> np.ndarray:
    """The values with 0 for -0."""
    return values + 0.0


def _of_detection(tracks: Tracks, values: Any) -> list:
    """What an array or a list has of the detection of each row, "" where there is none."""
    at = tracks.detection.tolist()
    if isinstance(values, np.ndarray):
        there = [i for i in at if i >= 0]
        values = dict(zip(there, values[there].tolist(), strict=True))
    return ["" if i < 0 or values[i] is None else values[i] for i in at]


def _places(tracks: Tracks, reference: tuple[float, float, float]) -> dict[str, list]:
    axes = tracks.x.shape[1] // 2
    latitude, longitude, height = geodetic(tracks.x[:, :axes], reference).T
    found = {"lat": latitude.round(DEGREES).tolist(), "lon": longitude.round(DEGREES).tolist()}
    return found | ({"alt": height.round(DECIMALS).tolist()} if axes == 3 else {})


def _copied(tracks: Tracks, detections: Detections, taken: Iterable[str]) -> dict[str, list[Any]]:
    """Identity and metadata of the detection of each row."""
    columns: dict[str, Any] = {}
    if any(each is not None for each in detections.identity):
        columns["identity"] = detections.identity
    columns |= {CLASHING.format(n) if n in taken else n: column for n, column in detections.metadata.items()}
    return {name: _of_detection(tracks, column) for name, column in columns.items()}
