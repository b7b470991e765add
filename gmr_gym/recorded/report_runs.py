"""Reports of targets that name themselves, many in a row in one call of compiled code."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from gmr_gym.filters.bernoulli_tracks import Origins
from gmr_gym.kernels import kernel
from gmr_gym.models.positions import Look
from gmr_gym.recorded.array_records import chosen
from gmr_gym.recorded.detections import Detections, numbered
from gmr_gym.recorded.model import TrackingModel, polar
from gmr_gym.recorded.scans import Scan
from gmr_gym.recorded.track_rules import follow
from gmr_gym.recorded.track_state import State
from gmr_gym.recorded.track_update import NO_OTHER, Assumed
from gmr_gym.recorded.tracks import DELETED, Tracks, no_rows

SHORTEST, LONGEST = 16, 4096  # what a run may have at most; four times what the last one had


class Reports(NamedTuple):
    """Scans of a file as reports, S of them in order."""

    detection: np.ndarray  # (S,) int, index into the detections
    code: np.ndarray  # (S,) int, number of the identity; -1 for a scan that is no sound single report
    names: list[str]  # identities by number
    sensor: np.ndarray  # (S,) int


def reports_of(detections: Detections, scans: Sequence[Scan], model: TrackingModel) -> Reports:
    """The scans of one detection with an identity, as reports.

    Parameters
    ----------
    detections : Detections
    scans : sequence of S Scan
    model : TrackingModel

    Returns
    -------
    Reports
    """
    at = np.array([scan.rows[0] if len(scan.rows) == 1 else -1 for scan in scans], int)
    time, sensor = (np.array([scan[i] for scan in scans]) for i in (0, Scan._fields.index("sensor")))
    code = np.append(numbered(detections.identity), -1)[at]
    names = [name for name in dict.fromkeys(detections.identity.tolist()) if name is not None]
    with_rate = np.array([spec.range_rate_deviation > 0 for spec in model.sensors], bool)
    sound = (at >= 0) & (time == detections.time[at]) & (np.diff(time, prepend=-np.inf) >= 0)
    sound &= np.isfinite(detections.z[at, : model.axes]).all(axis=1)
    sound &= with_rate[sensor] | np.isnan(detections.range_rate[at])
    return Reports(at, np.where(sound, code, -1), names, sensor)


def run(
    state: State, of: Assumed, detections: Detections, reports: Reports, first: int, most: int
) -> tuple[State, Tracks]:
    """State and rows after at most so many reports from `first` on whose targets all have tracks, one row for
    each: up to a scan that must be taken by itself."""
    known, sensor = _known(state, reports, first, most), int(reports.sensor[first])
    if not len(known):
        return state, no_rows(of.model.axes, len(of.model.modes))
    rows = reports.detection[first : first + len(known)]
    spec, axes = of.model.sensors[sensor], of.model.axes
    time = detections.time[rows]
    look = Look(
        0.0,
        time,
        np.ascontiguousarray(detections.z[rows, :axes]),
        detections.range_rate[rows],
        detections.origin[rows],
        np.array([*spec.deviation, spec.range_rate_deviation]),
        polar(spec),
    )
    done, found = followed(state.targets, of.kernels, look, known, (NO_OTHER, of.gates), sensor)
    label, status, x, P, existence, w, gated, best, weight, nis, age = (part[:done] for part in found)
    detection = np.where(best == 0, rows[:done], -1)
    tracks = Tracks(time[:done], label, status, x, P, existence, w, gated, detection, weight, nis, age)
    if not done:
        return state, tracks
    targets = state.targets
    if status[-1] == DELETED:
        targets = chosen(targets, targets.lives.status != DELETED)
    return state._replace(targets=targets, time=float(time[done - 1])), tracks


def _known(state: State, reports: Reports, first: int, most: int) -> np.ndarray:
    """Numbers of the identities of the reports from `first` on, up to a new one or another sensor's."""
    found: list[int] = []
    part = slice(first, first + most)
    for code, sensor in zip(reports.code[part].tolist(), reports.sensor[part].tolist(), strict=True):
        number = state.identities.get(reports.names[code]) if code >= 0 else None
        if number is None or sensor != reports.sensor[first]:
            break
        found.append(number)
    return np.array(found, np.int64)


@kernel
def followed(targets, assumed, look, known, other, sensor):
    """Update the tracks of reports, in place, one report after the other: up to one whose target has no
    track, to one at whose time another track has been silent for too long, or past one that ends its track.

    look has the k reports as its detections, and known (k,) are the identities; other is (log density of what
    else they may be, gates). Returns the number of reports taken, and columns of rows of tracks.
    """
    k, p, r = len(known), look.z.shape[1], targets.banks.w.shape[1]
    label, status, age = np.empty(k, np.int64), np.empty(k, np.int8), np.empty(k, np.int64)
    x, P, w = np.empty((k, 2 * p)), np.empty((k, 2 * p, 2 * p)), np.empty((k, r))
    gated, best = np.empty(k, np.int64), np.empty(k, np.int64)
    existence, weight, nis = np.empty(k), np.empty(k), np.empty(k)
    lives, max_coast = targets.lives, assumed[1].max_coast
    own, unlooked = np.ones(1, np.bool_), np.zeros(1, np.bool_)
    done = 0
    for j in range(k):
        i = -1
        for n in range(len(targets.identity)):
            if targets.identity[n] == known[j]:
                i = n
                break
        silent = i < 0
        for n in range(len(lives.hit_time)):
            silent |= n != i and look.at[j] - lives.hit_time[n] > max_coast
        if silent:
            break
        at = look.at[j : j + 1]
        one = Look(
            at[0],
            at,
            look.z[j : j + 1],
            look.range_rate[j : j + 1],
            look.origin[j : j + 1],
            look.deviation,
            look.polar,
        )
        origins = Origins(1.0, other[0], known[j : j + 1], own, other[1])
        place, covariance, found = follow(targets, (i, i + 1), assumed, one, origins, (at, unlooked), sensor)
        x[j], P[j], w[j] = place[0], covariance[0], targets.banks.w[i]
        label[j], status[j], age[j] = lives.label[i], lives.status[i], lives.age[i]
        existence[j] = targets.existence[i]
        gated[j], best[j], weight[j], nis[j] = found[2][0], found[3][0], found[4][0], found[5][0]
        done = j + 1
        if lives.status[i] == DELETED:
            break
    return done, (label, status, x, P, existence, w, gated, best, weight, nis, age)
