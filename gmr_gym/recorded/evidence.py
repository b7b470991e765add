"""Tracks of a file run through with assumed numbers, and what those that move say of these numbers."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.recorded.detections import POLAR, Detections
from gmr_gym.recorded.figures import Figure
from gmr_gym.recorded.model import tracking_model
from gmr_gym.recorded.positions import box_of
from gmr_gym.recorded.quality import SHORT, SLOW, Life, lives_of, quality
from gmr_gym.recorded.scans import Scan
from gmr_gym.recorded.tracking import track
from gmr_gym.recorded.tracks import Tracks

FASTEST = 350.0  # m/s, of the first run; less in a small place
CROSSED = 10  # periods in which no target crosses the place
LEAST_INNOVATIONS = 50  # coordinates of detections of tracks that move
LEAST_SPEED = 0.01  # m/s, of static tracks
ECHOES = 3  # detections, from which on a static track is of something, and not of false alarms


class Evidence(NamedTuple):
    """Tracks of one run, those that move, and what these took."""

    found: Detections  # with what the run assumed of the sensors
    tracks: Tracks
    confirmed: int
    moving: list[Life]
    hits: list[np.ndarray]  # of each of these, indices into the detections
    figures: list[Figure]


def run_with(
    found: Detections,
    scans: Sequence[Scan],
    target: dict[str, Any],
    still: np.ndarray,
    reports: bool,
    **more: Any,
) -> Evidence:
    """Tracks with these sensors and arguments of `tracking_model`; `still` (n,) marks detections at spots
    that are hit all the time."""
    low, high = box_of(found)
    model = tracking_model(found.sensors, low.tolist(), high.tolist(), **target, **more)
    found = found._replace(sensors=model.sensors)
    tracks = track(found, scans, model, reports=reports)
    lives = lives_of(tracks)
    taken = [tracks.detection[life.rows[life.hits]] for life in lives]
    moves = [
        not life.static and len(own) >= SHORT and still[own].mean() < 0.5
        for life, own in zip(lives, taken, strict=True)
    ]
    moving, hits = ([one for one, yes in zip(all_of, moves, strict=True) if yes] for all_of in (lives, taken))
    return Evidence(found, tracks, len(lives), moving, hits, quality(tracks, found, scans, reports=reports))


def wide(found: Detections, points: np.ndarray, part: float) -> Detections:
    """The detections, of sensors whose deviations are this part of the extent."""
    length = float(np.nanmax(np.ptp(points[:, :2], axis=0), initial=1e-3)) / part
    specs = []
    for i, spec in enumerate(found.sensors):
        deviation = (length,) * spec.p
        if spec.kind == POLAR:
            angle = min(length / float(np.median(found.z[found.sensor == i, 0])), 0.1)
            deviation = (length, *(angle,) * (spec.p - 1))
        specs.append(spec._replace(deviation=deviation))
    return found._replace(sensors=tuple(specs))


def first_speed(points: np.ndarray, scans: Sequence[Scan]) -> float:
    """Largest speed of which nothing is known but the place and the period of its scans, m/s."""
    times = np.unique([scan.time for scan in scans])
    period = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    extent = float(np.nanmax(np.ptp(points[:, :2], axis=0), initial=0.0))
    return float(np.clip(extent / (CROSSED * period), 1.0, FASTEST))


def usual_speed(run: Evidence) -> float:
    """Largest speed to expect: one and a half that of nearly all rows of tracks that move."""
    axes = run.tracks.x.shape[1] // 2
    rows = np.concatenate([life.rows[life.hits][1:] for life in run.moving])
    return float(f"{1.5 * np.quantile(np.linalg.norm(run.tracks.x[rows, axes:], axis=1), 0.95):.2g}")


def static_speed(run: Evidence) -> tuple[float, int]:
    """Average speed since the first detection that half of the estimates of static tracks do not exceed, and
    the number of these tracks; 0 where there is none. Those static by large errors alone are left out."""
    place, time, speeds = run.tracks.x[:, : run.tracks.x.shape[1] // 2], run.tracks.time, []
    for life in lives_of(run.tracks):
        first, later = np.split(life.rows[life.hits], [1])
        later = later[time[later] > time[first]]
        if life.static and len(later) >= ECHOES - 1:
            own = np.linalg.norm(place[later] - place[first], axis=1) / (time[later] - time[first])
            speeds += [own] if np.median(own) <= SLOW else []
    speed = float(np.median(np.concatenate(speeds))) if speeds else 0.0
    return max(float(f"{speed:.2g}"), LEAST_SPEED) if speeds else 0.0, len(speeds)


def check_enough(run: Evidence, points: np.ndarray) -> None:
    """Refuse to propose from too little."""
    count = count_innovations(run, points)
    needed = (
        f"needed are {LEAST_INNOVATIONS} measured coordinates of targets that move, in tracks of at least "
        f"{SHORT} detections each"
    )
    if not run.moving:
        raise ValueError(
            f"nothing to propose from: of {run.confirmed} confirmed tracks none moves for so long; {needed}"
        )
    if count < LEAST_INNOVATIONS:
        raise ValueError(
            f"too little to propose from: tracks that move: {len(run.moving)}, their coordinates: {count}; "
            f"{needed}"
        )


def count_innovations(run: Evidence, points: np.ndarray) -> int:
    """Coordinates of detections that a track predicts: of all but its first two."""
    return sum(len(own) - 2 for own in run.hits) * points.shape[1]


def looks_of(run: Evidence, scans: Sequence[Scan], sensor: int) -> list[np.ndarray]:
    """Of each track that moves, whether a sensor detected it between its confirmation and last detection."""
    times = [np.unique([s.time for s in scans if (s.sensor == sensor) == own]) for own in (True, False)]
    looks = []
    for life in run.moving:
        between = slice(1, int(np.flatnonzero(life.hits)[-1]))
        rows, hits = life.rows[between], life.hits[between]
        mine, others = (np.isin(run.tracks.time[rows], one) for one in times)
        by = run.found.sensor[run.tracks.detection[rows]]
        looks.append(hits[mine & np.where(hits, by == sensor, ~others)])
    return [one for one in looks if len(one)]


def independent(looks: list[np.ndarray]) -> tuple[int, int]:
    """Hits and looks, as many as would say as much if misses did not come in runs."""
    n, hits = sum(map(len, looks)), sum(int(one.sum()) for one in looks)
    off = [one - hits / n for one in looks]
    square = sum(float(one @ one) for one in off)
    together = sum(float(one[1:] @ one[:-1]) for one in off) / square if square else 0.0
    share = (1 - together) / (1 + together) if together > 0 else 1.0
    count = max(round(n * share), 1)
    return round(hits / n * count), count
