"""Tracks smoothed while they are followed: every row some scans late, from all detections up to then."""

import numpy as np

from gmr_gym.filters import imm_smoothing
from gmr_gym.models.positions import Look
from gmr_gym.recorded.array_records import chosen, joined
from gmr_gym.recorded.model import TrackingModel
from gmr_gym.recorded.smoothing import continued, detection_of, one_after_another, own_share
from gmr_gym.recorded.track_state import LastScans
from gmr_gym.recorded.tracks import Tracks


def with_scan(last: LastScans, rows: Tracks, look: Look, model: TrackingModel) -> LastScans:
    """What is kept after one more scan, of which the tracker gave these rows."""
    modes, number = model.bank(), last.number + 1
    label, of_row, banks = last.label.tolist(), last.of_row.tolist(), [last.banks]
    latest = {one: i for i, one in enumerate(label)}
    for row, one in enumerate(rows.track.tolist()):
        before = chosen(last.banks, [latest[one]]) if one in latest else None
        share = own_share(rows, row) if before else 1.0
        seen = detection_of(look, rows.detection[row]) if share else None
        new = continued(before, rows.time[row], seen, share, model, modes)
        banks += new
        label += [one] * len(new)
        of_row += [False] * (len(new) - 1) + [True]
    scan = np.append(last.scan, np.full(len(label) - len(last.label), number))
    row_scan = np.append(last.row_scan, np.full(len(rows.time), number))
    return LastScans(
        number, joined(last.rows, rows), row_scan,
        one_after_another(banks), np.array(label, np.int64), scan, np.array(of_row, bool),
    )  # fmt: skip


def without_old(last: LastScans, lag: int, alive: np.ndarray) -> LastScans:
    """Without the rows before the last `lag` + 1 scans, and without banks that neither such rows nor the
    tracks alive, by their labels, need."""
    recent, needed = last.row_scan >= last.number - lag, last.scan >= last.number - lag
    latest = {one: i for i, one in enumerate(last.label.tolist())}
    needed[[latest[one] for one in alive.tolist()]] = True
    return LastScans(
        last.number, chosen(last.rows, recent), last.row_scan[recent],
        chosen(last.banks, needed), last.label[needed], last.scan[needed], last.of_row[needed],
    )  # fmt: skip


def smoothed_late(last: LastScans, lag: int, model: TrackingModel) -> Tracks:
    """The rows of the scan `lag` scans before the last, smoothed by all that came since."""
    modes, d, scan = model.bank(), 2 * model.axes, last.number - lag
    rows = chosen(last.rows, last.row_scan == scan)
    for i, k in enumerate(np.flatnonzero(last.of_row & (last.scan == scan)).tolist()):
        since = k + np.flatnonzero(last.label[k:] == last.label[k])
        mode, mean, covariance = imm_smoothing.smoothed(chosen(last.banks, since), modes, model.axes)
        rows.modes[i], rows.x[i], rows.P[i] = mode[0], mean[0, :d], covariance[0, :d, :d]
    return rows._replace(nis=np.full(len(rows.time), np.nan))
