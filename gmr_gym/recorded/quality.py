"""How good tracks are, told without a truth: each figure beside what it is expected to be."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from gmr_gym.recorded.consistency import consistency
from gmr_gym.recorded.detections import Detections
from gmr_gym.recorded.figures import Figure, wilson
from gmr_gym.recorded.positions import local_positions
from gmr_gym.recorded.scans import Scan
from gmr_gym.recorded.tracks import COASTED, CONFIRMED, Tracks, rows_of_each
from gmr_gym.recorded.unused_cells import unused_by_cell

LIKELY = 0.5  # weight from which a track took a detection
SHORT = 10  # detections below which a confirmed track is short
SIGMAS = 3.0  # within which a displacement is none, and an end meets a start
SLOW = 0.5  # m/s, at which what is static may seem to move
LONGEST_GAP = 10  # median intervals between scans, between an end and a start that may be one target's
FEWEST = 10  # unused detections from which their scatter is told
FAST = 0.99  # quantile of speeds that is taken for the greatest


class Life(NamedTuple):
    """The rows of a track that was confirmed, from then on."""

    rows: np.ndarray  # indices into `Tracks`
    hits: np.ndarray  # (k,) whether it took a detection
    static: bool  # it stays where it is, or is slow


def quality(
    tracks: Tracks, detections: Detections, scans: Sequence[Scan], *, reports: bool = False
) -> list[Figure]:
    """The figures of tracks that need no truth.

    Parameters
    ----------
    tracks : Tracks
        All, also those never confirmed.
    detections : Detections
    scans : sequence of Scan
        In order of time.
    reports : bool
        Whether scans are single reports of targets: none is missed, and none is clutter.

    Returns
    -------
    list of Figure

    Notes
    -----
    Innovations are of confirmed tracks that move, at scans with one detection in the gate: echoes that stand
    still fall on the same spot, and make noise look smaller than it is. They are found again from the
    estimates after the update; see `gmr_gym.recorded.innovations`. The normalised innovation squared (NIS) is
    that of the tracker. The detection probability is counted between the scan that confirmed a track and its
    last detection, as neither is there by chance; tracks that end where their target hides make it high.
    """
    lives = lives_of(tracks)
    moving = np.concatenate([np.empty(0, int), *(life.rows for life in lives if not life.static)])
    return [
        *consistency(tracks, detections, moving),
        *([] if reports else [*_detection(tracks, detections, lives), *_unused(tracks, detections, scans)]),
        *_numbers(tracks, lives),
        _fragmentation(tracks, lives),
        *_coasting(tracks),
    ]


def lives_of(tracks: Tracks) -> list[Life]:
    """The confirmed tracks, in order of their numbers.

    Parameters
    ----------
    tracks : Tracks
    """
    lives = []
    for rows in rows_of_each(tracks).values():
        rows = rows[np.logical_or.accumulate(tracks.status[rows] == CONFIRMED)]
        if not len(rows):
            continue
        hits = (tracks.detection[rows] >= 0) & (tracks.weight[rows] >= LIKELY)
        lives.append(Life(rows, hits, _static(tracks, rows[hits] if hits.any() else rows)))
    return lives


def _static(tracks: Tracks, rows: np.ndarray) -> bool:
    """Whether no row is farther from the first one than errors, or a slow target, may have brought it."""
    axes, first = tracks.x.shape[1] // 2, rows[0]
    away = np.linalg.norm(tracks.x[rows, :axes] - tracks.x[first, :axes], axis=1)
    error = np.sqrt(np.trace((tracks.P[rows] + tracks.P[first])[:, :axes, :axes], axis1=1, axis2=2))
    return bool((away <= np.maximum(SIGMAS * error, SLOW * (tracks.time[rows] - tracks.time[first]))).all())


def _detection(tracks: Tracks, detections: Detections, lives: Sequence[Life]) -> Iterator[Figure]:
    hits = opportunities = 0
    for life in lives:
        between = life.hits[1 : np.flatnonzero(life.hits)[-1]] if life.hits.any() else life.hits[:0]
        hits, opportunities = hits + int(between.sum()), opportunities + len(between)
    if not opportunities:
        return
    value, low, high = hits / opportunities, np.nan, np.nan
    assumed = {spec.detection_probability for spec in detections.sensors}
    if len(assumed) == 1 and not np.isnan(one := assumed.pop()):
        half = 2 * np.sqrt(one * (1 - one) / opportunities)
        low, high = one - half, min(one + half, 1.0)
    yield Figure("detection probability", value, "", opportunities, low, high)
    for name, end in zip(("lowest", "highest"), wilson(hits, opportunities), strict=True):
        yield Figure(f"detection probability, {name} of its 95 % interval", end, "", opportunities)


def _numbers(tracks: Tracks, lives: Sequence[Life]) -> Iterator[Figure]:
    total, n = len(np.unique(tracks.track)), len(lives)
    yield Figure("tracks", total)
    yield Figure("tracks confirmed", n, "", total)
    if n:
        seconds = [float(np.ptp(tracks.time[life.rows])) for life in lives]
        yield Figure("median length of confirmed tracks", float(np.median(seconds)), "s", n)
        short = sum(life.hits.sum() < SHORT for life in lives) / n
        yield Figure(f"confirmed tracks of fewer than {SHORT} detections", float(short), "", n)
        yield Figure("static tracks", sum(life.static for life in lives), "", n)


def _fragmentation(tracks: Tracks, lives: Sequence[Life]) -> Figure:
    """Ends of confirmed tracks with a start that the same target could have reached, an hour."""
    axes = tracks.x.shape[1] // 2
    confirmed = tracks.status == CONFIRMED
    speeds = np.linalg.norm(tracks.x[confirmed, axes:], axis=1)
    fastest = float(np.quantile(speeds, FAST)) if len(speeds) else 0.0
    times = np.unique(tracks.time)
    longest = LONGEST_GAP * float(np.median(np.diff(times))) if len(times) > 1 else 0.0
    of_each = rows_of_each(tracks)
    starts = np.array([of_each[int(tracks.track[life.rows[0]])][0] for life in lives], int)
    ends = [life.rows[np.flatnonzero(life.hits)[-1]] if life.hits.any() else life.rows[-1] for life in lives]
    free, pairs = np.ones(len(lives), bool), 0
    for i in np.argsort(tracks.time[ends], kind="stable") if lives else ():
        gaps = tracks.time[starts] - tracks.time[ends[i]]
        near = np.flatnonzero(free & (gaps > 0) & (gaps <= longest))
        for j in near[np.argsort(gaps[near], kind="stable")].tolist():
            if _reaches(tracks, ends[i], starts[j], fastest * gaps[j]):
                free[j] = False
                pairs += 1
                break
    hours = float(np.ptp(times)) / 3600 if len(times) else 0.0
    return Figure(
        "tracks broken in two, an hour", pairs / hours if hours else np.nan, "1/h", len(lives), 0.0, 0.0
    )


def _reaches(tracks: Tracks, end: int, start: int, far: float) -> bool:
    axes = tracks.x.shape[1] // 2
    away = np.linalg.norm(tracks.x[start, :axes] - tracks.x[end, :axes])
    error = np.sqrt(np.trace((tracks.P[end] + tracks.P[start])[:axes, :axes]))
    return bool(away <= far + SIGMAS * error)


def _unused(tracks: Tracks, detections: Detections, scans: Sequence[Scan]) -> Iterator[Figure]:
    """Detections of no confirmed track: a scan, an area, and how they scatter from scan to scan."""
    left = unused(tracks, len(detections.time))
    points = local_positions(detections)[:, :2]
    known = np.isfinite(points).all(axis=1)
    points, area = points[known], 0.0
    if len(np.unique(points, axis=0)) > 2:
        area = _area(points)
    for i, spec in enumerate(detections.sensors):
        counts = np.array([left[scan.rows].sum() for scan in scans if scan.sensor == i])
        if not len(counts):
            continue
        of = f", {spec.name}" if len(detections.sensors) > 1 else ""
        half = 2 * np.sqrt(max(spec.clutter_per_scan, 0.0) / len(counts))
        low, high = max(spec.clutter_per_scan - half, 0.0), spec.clutter_per_scan + half
        mean = float(counts.mean())
        yield Figure(f"unused detections a scan{of}", mean, "", len(counts), low, high)
        if area:
            yield Figure(f"unused detections a scan and km2{of}", mean / area * 1e6, "1/km2", len(counts))
        if counts.sum() >= FEWEST and len(counts) > 1:
            half = 2 * np.sqrt(2 / (len(counts) - 1))
            value = float(counts.var(ddof=1) / mean)
            yield Figure(
                f"index of dispersion of unused detections{of}",
                value,
                "",
                len(counts),
                max(1 - half, 0.0),
                1 + half,
            )
    if area and left.sum() >= FEWEST:
        yield from unused_by_cell(points, left[known], len(scans))


def unused(tracks: Tracks, n: int) -> np.ndarray:
    """Probability that each of n detections is of no track that ever was confirmed, (n,)."""
    ever = np.isin(tracks.track, tracks.track[tracks.status == CONFIRMED]) & (tracks.detection >= 0)
    left = np.ones(n)
    np.subtract.at(left, tracks.detection[ever], tracks.weight[ever])
    return np.maximum(left, 0.0)


def _area(points: np.ndarray) -> float:
    """Area of the convex hull, m^2; 0 where they lie on a line."""
    if np.linalg.matrix_rank(points - points[0]) < 2:
        return 0.0
    return float(ConvexHull(points).volume)


def _coasting(tracks: Tracks) -> Iterator[Figure]:
    axes = tracks.x.shape[1] // 2
    confirmed, coasted = (int((tracks.status == status).sum()) for status in (CONFIRMED, COASTED))
    if n := confirmed + coasted:
        yield Figure("coasted share of confirmed tracks", coasted / n, "", n)
        P = tracks.P[tracks.status == CONFIRMED][:, :axes, :axes]
        claimed = float(np.median(np.sqrt(np.linalg.eigvalsh(P)[:, -1])))
        yield Figure("median deviation claimed", claimed, "m", confirmed)
