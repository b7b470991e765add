"""How good tracks are beside a truth."""

from collections import Counter
from collections.abc import Iterator

import numpy as np

from gmr_gym.evaluation.metrics import gospa
from gmr_gym.evaluation.trajectory_metrics import trajectory_gospa
from gmr_gym.recorded.detections import Detections
from gmr_gym.recorded.figures import Figure
from gmr_gym.recorded.quality import LIKELY
from gmr_gym.recorded.tracks import COASTED, CONFIRMED, Tracks
from gmr_gym.recorded.truth import Truth, at_times

CUTOFF = 50.0  # m
ORDER = 2.0
SWITCHING = 0.2  # of the cutoff
OVER_TIME = ("gospa", "localisation", "missed", "false")


def accuracy(
    tracks: Tracks, truth: Truth, times: np.ndarray, cutoff: float = CUTOFF
) -> tuple[list[Figure], dict[str, list[float]]]:
    """Figures of confirmed tracks beside a truth of positions in the plane.

    Parameters
    ----------
    tracks : Tracks
    truth : Truth
    times : ndarray (T,)
        Times of scans, s, at which the two are compared; those outside the truth are left out.
    cutoff : float
        Distance beyond which a track is none of the target, m. A switch costs a fifth of it.

    Returns
    -------
    figures : list of Figure
        GOSPA and T-GOSPA with their parts, then of each target its coverage, the number of tracks that
        covered it in turn, and the median error of these.
    over_time : dict of str to list
        "time", s, and by scan "gospa", m, its "localisation", m^2, and how many targets are "missed" and how
        many tracks "false".

    Raises
    ------
    ValueError
        If no scan is within the time of the truth.
    """
    times = np.unique(times)
    if len(truth.time):
        times = times[(times >= truth.time.min()) & (times <= truth.time.max())]
    if not len(times) or not len(truth.time):
        raise ValueError("no scan is within the time of the truth; do both count time from the same moment?")
    declared = (tracks.status == CONFIRMED) | (tracks.status == COASTED)
    x, _ = at_times(tracks.time[declared], tracks.track[declared], tracks.x[declared, :2], times)
    y, names = at_times(truth.time, truth.target, truth.position[:, :2], times)
    over_time = {"time": times.tolist()} | _gospa_by_scan(x, y, cutoff)
    figures = [*_sets(over_time), *_trajectories(x, y, cutoff)]
    for j, name in enumerate(names):
        figures += _of_target(x, y[:, j], f"{name}", cutoff)
    return figures, over_time


def _gospa_by_scan(x: np.ndarray, y: np.ndarray, cutoff: float) -> dict[str, list[float]]:
    alone = cutoff**ORDER / 2
    parts = []
    for estimates, targets in zip(x, y, strict=True):
        found, true = (points[np.isfinite(points[:, 0])] for points in (estimates, targets))
        one = gospa(found, true, cutoff, ORDER)
        parts.append((one.total, one.localisation, one.missed / alone, one.false / alone))
    return {name: list(column) for name, column in zip(OVER_TIME, zip(*parts, strict=True), strict=True)}


def _sets(over_time: dict[str, list[float]]) -> Iterator[Figure]:
    T = len(over_time["time"])
    yield Figure("mean GOSPA", float(np.mean(over_time["gospa"])), "m", T)
    yield Figure("targets missed a scan", float(np.mean(over_time["missed"])), "", T)
    yield Figure("false tracks a scan", float(np.mean(over_time["false"])), "", T)


def _trajectories(x: np.ndarray, y: np.ndarray, cutoff: float) -> Iterator[Figure]:
    """T-GOSPA as a root mean square over scans, and its parts."""
    T, change, alone = len(x), SWITCHING * cutoff, cutoff**ORDER / 2
    parts = trajectory_gospa(x, y, cutoff, ORDER, change)
    held = np.isfinite(y[..., 0]).sum() - parts.missed / alone
    yield Figure("T-GOSPA a scan", parts.total / T ** (1 / ORDER), "m", T)
    if held > 0:
        error = float((parts.localisation / held) ** (1 / ORDER))
        yield Figure("T-GOSPA, root mean square error", error, "m", T)
    yield Figure("T-GOSPA, targets missed a scan", parts.missed / alone / T, "", T)
    yield Figure("T-GOSPA, false tracks a scan", parts.false / alone / T, "", T)
    yield Figure("T-GOSPA, switches", parts.switches / change**ORDER, "", T)


def _of_target(x: np.ndarray, y: np.ndarray, name: str, cutoff: float) -> Iterator[Figure]:
    """Coverage of a target (T, 2) by the nearest track of each scan."""
    there = np.isfinite(y[:, 0])
    if not there.any():
        return
    away = np.full((int(there.sum()), x.shape[1] + 1), np.inf)
    distance = np.linalg.norm(x[there] - y[there, None], axis=2)
    away[:, :-1] = np.where(np.isfinite(distance), distance, np.inf)
    nearest, least = away.argmin(axis=1), away.min(axis=1)
    covered = least <= cutoff
    n = len(covered)
    yield Figure(f"coverage of target {name}", float(covered.mean()), "", n)
    yield Figure(f"labels of target {name}", len(np.unique(nearest[covered])), "", n)
    if covered.any():
        error = float(np.median(least[covered]))
        yield Figure(f"median error of target {name}", error, "m", int(covered.sum()))


def label_accuracy(tracks: Tracks, detections: Detections) -> list[Figure]:
    """Figures of confirmed tracks beside the targets that a column of the input names.

    Parameters
    ----------
    tracks : Tracks
    detections : Detections

    Returns
    -------
    list of Figure
        Of each target the share of its detections that confirmed tracks took, and how many tracks did; of all
        tracks the share of detections that are of the target they have most of.
    """
    declared = (tracks.status == CONFIRMED) & (tracks.weight >= LIKELY) & (tracks.detection >= 0)
    track, target = tracks.track[declared], detections.truth[tracks.detection[declared]]
    named = np.array([one is not None for one in detections.truth], bool)
    figures = []
    for name in sorted(set(detections.truth[named].tolist())):
        n, own = int((detections.truth == name).sum()), track[target == name]
        figures.append(Figure(f"detections of target {name} in tracks", len(own) / n, "", n))
        figures.append(Figure(f"labels of target {name}", len(np.unique(own)), "", n))
    if len(track):
        most = dict(Counter(zip(track.tolist(), target.tolist(), strict=True)).most_common()[::-1])
        largest = {t: count for (t, _), count in most.items()}  # the largest of each comes last
        share = sum(largest.values()) / len(track)
        figures.append(Figure("detections of a track's own target", share, "", len(track)))
    return figures
