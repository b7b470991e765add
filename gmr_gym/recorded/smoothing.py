"""Tracks smoothed: every row from all detections of its track, earlier and later ones."""

import numpy as np

from gmr_gym.filters import bernoulli_tracks as engine
from gmr_gym.filters import imm_smoothing
from gmr_gym.filters.bernoulli_tracks import Bernoullis, Origins
from gmr_gym.filters.imm_tracks import Banks
from gmr_gym.models.intervals import Modes
from gmr_gym.models.positions import Look
from gmr_gym.recorded.detections import Detections
from gmr_gym.recorded.model import TrackingModel, polar
from gmr_gym.recorded.track_update import NO_OTHER
from gmr_gym.recorded.tracks import Tracks

OWN = 0.5  # share of the weight from which a detection is taken for the track's own


def smooth(tracks: Tracks, detections: Detections, model: TrackingModel) -> Tracks:
    """Smooth every track over its whole life.

    Parameters
    ----------
    tracks : Tracks
        Of `track`, with the same detections and model.
    detections : Detections
    model : TrackingModel

    Returns
    -------
    Tracks
        The same rows; x, P and modes are smoothed, and the NIS is NaN.

    Notes
    -----
    Each track is filtered once more with the detection of most weight of each row, where the track exists
    and it is this one's with probability of at least a half, taken as certain; then the backward pass of
    `imm_smoothing` follows. A detection before the row of the last one counts as of that row's time.
    """
    x, P, w = (np.array(column) for column in (tracks.x, tracks.P, tracks.modes))
    modes = model.bank()
    order = np.argsort(tracks.track, kind="stable")
    starts = np.flatnonzero(np.diff(tracks.track[order], prepend=0))
    for rows in np.split(order, starts[1:]) if len(order) else []:
        own = tracks.weight[rows] >= OWN * tracks.existence[rows]
        own[0] = True  # by which the track began
        found = np.where(own, tracks.detection[rows], -1)
        banks, at = _filtered(tracks.time[rows], found, detections, model, modes)
        d = 2 * model.axes
        mode, mean, covariance = imm_smoothing.smoothed(banks, modes, model.axes)
        w[rows], x[rows], P[rows] = mode[at], mean[at, :d], covariance[at, :d, :d]
    return tracks._replace(x=x, P=P, modes=w, nis=np.full(len(x), np.nan))


def _filtered(
    times: np.ndarray, found: np.ndarray, detections: Detections, model: TrackingModel, modes: Modes
) -> tuple[Banks, np.ndarray]:
    """Filtered banks at the times of the detections and of the rows, and where the rows are among them."""
    first = _look(detections, model, found[0], detections.time[found[0]])
    d = modes.states(model.axes)
    bank = Banks(*engine.started(modes, first, np.zeros(1, int), model.max_speed, d))
    tracks = Bernoullis(bank, np.ones(1), np.full(1, -1), np.zeros(1))
    parts, at = [_copied(bank)], []
    for row, (time, j) in enumerate(zip(times, found, strict=True)):
        if row and j >= 0:
            seen = min(max(detections.time[j], bank.time[0]), time)
            parts.append(_advanced(tracks, modes, _look(detections, model, j, seen)))
        if time > bank.time[0]:
            parts.append(_advanced(tracks, modes, _nothing(first, time)))
        at.append(len(parts) - 1)
    return Banks(*(np.concatenate(column) for column in zip(*parts, strict=True))), np.array(at)


def _advanced(tracks: Bernoullis, modes: Modes, look: Look) -> Banks:
    """The bank after the look, whose detection, if there is one, is certain."""
    k = len(look.at)
    sure = Origins(1.0, np.repeat(NO_OTHER, k), np.full(k, -1), np.zeros(k, bool), np.full(2, np.inf))
    engine.update(tracks, modes, look, sure)
    return _copied(tracks.banks)


def _copied(bank: Banks) -> Banks:
    return Banks(*(column.copy() for column in bank))


def _look(detections: Detections, model: TrackingModel, j: int, time: float) -> Look:
    """A look of one detection, made at `time`."""
    spec, one = model.sensors[detections.sensor[j]], slice(j, j + 1)
    z, rate, origin = (part[one].copy() for part in (detections.z, detections.range_rate, detections.origin))
    deviation = np.array([*spec.deviation, spec.range_rate_deviation])
    at = np.array([time], float)
    return Look(float(time), at, z[:, : model.axes].copy(), rate, origin, deviation, polar(spec))


def _nothing(look: Look, time: float) -> Look:
    """A look without detections."""
    at, z, rate, origin = (part[:0] for part in (look.at, look.z, look.range_rate, look.origin))
    return look._replace(time=float(time), at=at, z=z, range_rate=rate, origin=origin)
