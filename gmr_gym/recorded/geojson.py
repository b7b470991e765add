"""Tracks as GeoJSON (RFC 7946), a feature for each."""

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from gmr_gym.evaluation.writing import whole
from gmr_gym.recorded.detections import Detections
from gmr_gym.recorded.output import utc
from gmr_gym.recorded.positions import geodetic
from gmr_gym.recorded.tracks import STATUS, Tracks

DEGREES = 7  # decimals: a centimetre


def write_geojson(path: Path | str, tracks: Tracks, detections: Detections) -> None:
    """Write tracks as GeoJSON.

    Parameters
    ----------
    path : Path or str
    tracks : Tracks
    detections : Detections
        What was tracked: its absolute time and reference point.

    Raises
    ------
    ValueError
        For detections without a reference point.
    OSError
        Naming the file.
    """
    text = json.dumps(geojson(tracks, detections), separators=(",", ":"), allow_nan=False)
    with whole(path) as partial:
        partial.write_text(text + "\n", encoding="utf-8")


def geojson(tracks: Tracks, detections: Detections) -> dict[str, Any]:
    """A FeatureCollection of tracks.

    Each track is a LineString from its first detection to its last, without the scans after that at which it
    only coasted; a Point if that is one scan, and a MultiLineString, cut at 180 degrees, if it crosses the
    antimeridian. Positions are longitude, latitude, and the altitude of tracks in space. Properties are
    track_id, start and end, times, one for each position, and the status at the end.

    Parameters
    ----------
    tracks : Tracks
    detections : Detections
        What was tracked.

    Returns
    -------
    dict

    Raises
    ------
    ValueError
        For detections without a reference point.
    """
    reference = check_georeferenced(detections)
    axes = tracks.x.shape[1] // 2
    latitude, longitude, height = geodetic(tracks.x[:, :axes], reference).T
    points = np.stack([longitude.round(DEGREES), latitude.round(DEGREES), height.round(2)], axis=1)
    features = []
    for track in np.unique(tracks.track):
        rows = np.flatnonzero(tracks.track == track)
        seen = np.flatnonzero(tracks.detection[rows] >= 0)
        rows = rows[: seen[-1] + 1] if len(seen) else rows[:1]
        features.append(_feature(tracks, rows, points[rows, : max(axes, 2)], detections))
    return {"type": "FeatureCollection", "features": features}


def check_georeferenced(detections: Detections) -> tuple[float, float, float]:
    """The reference point of detections.

    Parameters
    ----------
    detections : Detections

    Raises
    ------
    ValueError
        If there is none.
    """
    if detections.reference is None:
        raise ValueError(
            "GeoJSON has latitudes and longitudes, but nothing says where on Earth x and y are 0: give --lat "
            "and --lon, --sensor-position or --reference"
        )
    return detections.reference


def _feature(tracks: Tracks, rows: np.ndarray, points: np.ndarray, detections: Detections) -> dict[str, Any]:
    times = [_time(time, detections) for time in tracks.time[rows].tolist()]
    lines = _cut(points)
    if len(rows) == 1:
        geometry = {"type": "Point", "coordinates": points[0].tolist()}
    elif len(lines) == 1:
        geometry = {"type": "LineString", "coordinates": lines[0]}
    else:
        geometry = {"type": "MultiLineString", "coordinates": lines}
    properties = {
        "track_id": int(tracks.track[rows[0]]),
        "start": times[0],
        "end": times[-1],
        "status": STATUS[tracks.status[rows[-1]]],
        "times": times,
    }
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _time(seconds: float, detections: Detections) -> str | float:
    return utc(detections.start, seconds) if detections.start else round(seconds, 6)


def _cut(points: np.ndarray) -> list[list[list[float]]]:
    """The lines that a line of points is cut into where it crosses the antimeridian; each ends on it."""
    lines, line = [], [points[0].tolist()]
    for before, after in pairwise(points):
        if abs(after[0] - before[0]) > 180:
            edge = np.copysign(180.0, before[0])
            share = (edge - before[0]) / (after[0] + 2 * edge - before[0] or 1.0)
            there = before + share * (after - before)
            there[0] = edge
            there = there.round(DEGREES)
            lines.append([*line, there.tolist()])
            there[0] = -edge
            line = [there.tolist()]
        line.append(after.tolist())
    return [*lines, line]
