"""Tracks smoothed: every row from all detections of its track, earlier and later ones."""

import numpy as np

from gmr_gym.filters import bernoulli_tracks as engine
from gmr_gym.filters import imm_smoothing
from gmr_gym.filters.imm_tracks import Banks
from gmr_gym.models.intervals import Modes
from gmr_gym.models.positions import Look
from gmr_gym.recorded.detections import Detections
from gmr_gym.recorded.model import TrackingModel, polar
from gmr_gym.recorded.tracks import Tracks

UNSURE = 1e-3  # least probability that a detection is, and that it is not, the track's own


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
    Each track, taken to exist, is filtered once more with the detection of most weight of each row alone, at
    its own time, by probabilistic data association (see `mht.pda_update`) with the probability that the
    tracker gave it; then the backward pass of `imm_smoothing` follows. A detection before the row of the last
    one counts as of that row's time.
    """
    x, P, w = (np.array(column) for column in (tracks.x, tracks.P, tracks.modes))
    modes, d = model.bank(), 2 * model.axes
    order = np.argsort(tracks.track, kind="stable")
    starts = np.flatnonzero(np.diff(tracks.track[order], prepend=0))
    for rows in np.split(order, starts[1:]) if len(order) else []:
        banks: list[Banks] = []
        at = []
        for row in rows:
            share = own_share(tracks, row) if banks else 1.0
            look = _look(detections, model, tracks.detection[row]) if share else None
            banks += continued(banks[-1] if banks else None, tracks.time[row], look, share, model, modes)
            at.append(len(banks) - 1)
        mode, mean, covariance = imm_smoothing.smoothed(one_after_another(banks), modes, model.axes)
        w[rows], x[rows], P[rows] = mode[at], mean[at, :d], covariance[at, :d, :d]
    return tracks._replace(x=x, P=P, modes=w, nis=np.full(len(x), np.nan))


def own_share(tracks: Tracks, row: int) -> float:
    """The probability that the detection of a row is the track's own, if it exists."""
    if tracks.detection[row] < 0 or tracks.weight[row] < UNSURE * tracks.existence[row]:
        return 0.0
    share = float(tracks.weight[row] / tracks.existence[row])
    return share if share <= 1.0 - UNSURE else 1.0


def continued(
    bank: Banks | None, time: float, look: Look | None, share: float, model: TrackingModel, modes: Modes
) -> list[Banks]:
    """The filtered banks of one track that follow `bank`: after the detection of `look`, which is its own
    with probability `share`, and at `time`. A track without a bank begins with the detection."""
    banks = []
    if bank is None:
        assert look is not None
        d = modes.states(model.axes)
        bank = Banks(*engine.started(modes, look, np.zeros(1, int), model.max_speed, d))
        banks.append(bank)
    elif look is not None:
        seen = min(max(look.at[0], bank.time[0]), time)
        hit = _advanced(bank, modes, look._replace(time=float(seen), at=np.array([seen])))
        bank = hit if share == 1.0 else _either(share, hit, _advanced(bank, modes, _nothing(seen, model)))
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
    return Banks(*imm_smoothing.advanced(Banks(*(column.copy() for column in bank)), modes, look))


def _either(share: float, hit: Banks, missed: Banks) -> Banks:
    """The moment match of every mode of two banks, of which the first is the true one with probability
    `share`."""
    w = np.stack([share * hit.w, (1.0 - share) * missed.w])
    part = w / np.maximum(w.sum(axis=0), 1e-300)
    m = (part[..., None] * [hit.m, missed.m]).sum(axis=0)
    off = np.stack([hit.m, missed.m]) - m
    P = np.stack([hit.P, missed.P]) + off[..., :, None] * off[..., None, :]
    return Banks(w.sum(axis=0), m, (part[..., None, None] * P).sum(axis=0), hit.time)


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
