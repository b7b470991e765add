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
    modes, d = model.bank(), 2 * model.axes
    order = np.argsort(tracks.track, kind="stable")
    starts = np.flatnonzero(np.diff(tracks.track[order], prepend=0))
    for rows in np.split(order, starts[1:]) if len(order) else []:
        banks: list[Banks] = []
        at = []
        for row in rows:
            j = own_detection(tracks, row, first=not banks)
            look = None if j < 0 else _look(detections, model, j)
            banks += continued(banks[-1] if banks else None, tracks.time[row], look, model, modes)
            at.append(len(banks) - 1)
        mode, mean, covariance = imm_smoothing.smoothed(one_after_another(banks), modes, model.axes)
        w[rows], x[rows], P[rows] = mode[at], mean[at, :d], covariance[at, :d, :d]
    return tracks._replace(x=x, P=P, modes=w, nis=np.full(len(x), np.nan))


def own_detection(tracks: Tracks, row: int, first: bool) -> int:
    """The detection that is taken for the track's own in a row, -1 for none; with the first it began."""
    own = first or tracks.weight[row] >= OWN * tracks.existence[row]
    return int(tracks.detection[row]) if own else -1


def continued(
    bank: Banks | None, time: float, look: Look | None, model: TrackingModel, modes: Modes
) -> list[Banks]:
    """The filtered banks of one track that follow `bank`: after its detection, the one of `look`, and at
    `time`. A track without a bank begins with the detection."""
    banks = []
    if bank is None:
        assert look is not None
        d = modes.states(model.axes)
        bank = Banks(*engine.started(modes, look, np.zeros(1, int), model.max_speed, d))
        banks.append(bank)
    elif look is not None:
        seen = min(max(look.at[0], bank.time[0]), time)
        bank = _advanced(bank, modes, look._replace(time=float(seen), at=np.array([seen])))
        banks.append(bank)
    if time > bank.time[0] or not banks:
        banks.append(_advanced(bank, modes, _nothing(time, model)))
    return banks


def one_after_another(banks: list[Banks]) -> Banks:
    """Banks of one track as one record, in order of time."""
    return Banks(*(np.concatenate(column) for column in zip(*banks, strict=True)))


def detection_of(look: Look, j: int) -> Look:
    """The detection j of a look as a look of its own, at its own time."""
    one = slice(j, j + 1)
    at, z, rate, origin = (part[one].copy() for part in (look.at, look.z, look.range_rate, look.origin))
    return look._replace(time=float(at[0]), at=at, z=z, range_rate=rate, origin=origin)


def _advanced(bank: Banks, modes: Modes, look: Look) -> Banks:
    """The bank after the look, whose detection, if there is one, is certain."""
    k = len(look.at)
    bank = Banks(*(column.copy() for column in bank))
    sure = Origins(1.0, np.repeat(NO_OTHER, k), np.full(k, -1), np.zeros(k, bool), np.full(2, np.inf))
    engine.update(Bernoullis(bank, np.ones(1), np.full(1, -1), np.zeros(1)), modes, look, sure)
    return bank


def _look(detections: Detections, model: TrackingModel, j: int) -> Look:
    """A look of one detection, at its own time."""
    spec, one = model.sensors[detections.sensor[j]], slice(j, j + 1)
    at, z, rate, origin = (
        part[one].copy() for part in (detections.time, detections.z, detections.range_rate, detections.origin)
    )
    deviation = np.array([*spec.deviation, spec.range_rate_deviation])
    return Look(float(at[0]), at, z[:, : model.axes].copy(), rate, origin, deviation, polar(spec))


def _nothing(time: float, model: TrackingModel) -> Look:
    """A look without detections."""
    none, p = np.empty(0), model.axes
    return Look(float(time), none, np.empty((0, p)), none, np.empty((0, 3)), np.ones(p + 1), False)
