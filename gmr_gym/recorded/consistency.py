"""Whether innovations are as large, as unrelated and as centred as the filter believes."""

from collections.abc import Iterator, Sequence

import numpy as np
from scipy.special import gammaincinv

from gmr_gym.recorded.detections import POLAR, Detections
from gmr_gym.recorded.figures import Figure
from gmr_gym.recorded.innovations import Innovations, innovations
from gmr_gym.recorded.tracks import Tracks

FOLLOWS = 1.5  # usual intervals of a sensor within which an innovation follows another


def consistency(tracks: Tracks, detections: Detections, rows: np.ndarray) -> Iterator[Figure]:
    """The figures of innovations, by sensor.

    Parameters
    ----------
    tracks : Tracks
    detections : Detections
    rows : ndarray of int
        Those of `tracks` that count.

    Yields
    ------
    Figure
    """
    for i, spec in enumerate(detections.sensors):
        if not np.isfinite(spec.deviation).all():
            continue
        found = innovations(tracks, detections, i)
        found = Innovations(*(column[np.isin(found.row, rows)] for column in found))
        of = f", {spec.name}" if len(detections.sensors) > 1 else ""
        yield from _nis(tracks, detections, found.row, spec.p, of)
        names = ("range", "azimuth", "elevation") if spec.kind == POLAR else ("x", "y", "z")
        if n := len(found.row):
            half = 2 * np.sqrt(2 / n)
            share = (found.v**2 / found.S.diagonal(axis1=1, axis2=2)).mean(axis=0)
            for name, value in zip(names, share.tolist(), strict=False):
                yield Figure(f"NIS in {name}{of}", value, "", n, 1 - half, 1 + half)
            yield from _correlation(tracks, found, of)
            yield from _means(tracks, found, names if spec.kind == POLAR else (), of)


def _nis(tracks: Tracks, detections: Detections, rows: np.ndarray, p: int, of: str) -> Iterator[Figure]:
    """Mean of the NIS over its degrees of freedom, and how often it is beyond 95 %."""
    nis = tracks.nis[rows]
    dof = p + np.isfinite(detections.range_rate[tracks.detection[rows]])
    nis, dof = nis[np.isfinite(nis)], dof[np.isfinite(nis)]
    if n := len(nis):
        half = 2 * np.sqrt(2 * dof.sum()) / dof.sum()
        yield Figure(f"NIS / degrees of freedom{of}", float(nis.sum() / dof.sum()), "", n, 1 - half, 1 + half)
        beyond, half = (nis > 2 * gammaincinv(dof / 2, 0.95)).mean(), 2 * np.sqrt(0.05 * 0.95 / n)
        yield Figure(f"NIS beyond 95 %{of}", float(beyond), "", n, max(0.05 - half, 0.0), 0.05 + half)


def _correlation(tracks: Tracks, found: Innovations, of: str) -> Iterator[Figure]:
    """Correlation of the normalised innovations with those that the sensor gave before."""
    white = np.linalg.solve(np.linalg.cholesky(found.S), found.v[..., None])[..., 0]
    order = np.lexsort((found.row, tracks.track[found.row]))
    row, white = found.row[order], white[order]
    same, gap = np.diff(tracks.track[row]) == 0, np.diff(tracks.time[row])
    follows = same & (gap <= FOLLOWS * np.median(gap[same])) if same.any() else same
    before, after = white[:-1][follows], white[1:][follows]
    if scale := np.sqrt((before**2).sum() * (after**2).sum()):
        bound = 2 / np.sqrt(before.size)
        value = float((before * after).sum() / scale)
        yield Figure(f"correlation of successive innovations{of}", value, "", before.size, -bound, bound)


def _means(tracks: Tracks, found: Innovations, names: Sequence[str], of: str) -> Iterator[Figure]:
    """Mean innovations along and across the track, where it has a course, and in the coordinates of these
    names."""
    axes = tracks.x.shape[1] // 2
    velocity = tracks.x[found.row, axes : axes + 2]
    course = velocity[velocity.any(axis=1)]
    course = course / np.linalg.norm(course, axis=1, keepdims=True)
    cartesian = found.cartesian[velocity.any(axis=1)]
    along = (cartesian * course).sum(axis=1)
    across = cartesian[:, 1] * course[:, 0] - cartesian[:, 0] * course[:, 1]
    columns = [("along track", along, "m"), ("to the left of the track", across, "m")]
    columns += [
        (f"in {name}", column if name == "range" else np.degrees(column), "m" if name == "range" else "deg")
        for name, column in zip(names, found.v.T, strict=False)
    ]
    for name, column, unit in (each for each in columns if len(each[1])):
        half = 2 * float(column.std()) / np.sqrt(len(column))
        yield Figure(f"mean innovation {name}{of}", float(column.mean()), unit, len(column), -half, half)
