"""Recordings of tracks: every row and detection in its frame, in bounds for any length."""

import numpy as np
import pytest
from made_tracks import made
from unpacked import columns_of

from gmr_gym.recorded.detections import POLAR, SensorSpec
from gmr_gym.replay.page import page
from gmr_gym.replay.tracked import recording_of

MADE = made(seed=2, scans=30)


def recorded(**options):
    return recording_of(MADE.tracks, MADE.detections, MADE.scans, **options)


def frame(columns, name, start, t):
    return columns[f"0/{name}"][columns[f"0/{start}_start"][t] : columns[f"0/{start}_start"][t + 1]]


def test_a_frame_has_the_rows_and_the_detections_of_its_scan():
    tracks, columns = MADE.tracks, recorded().columns
    assert columns["time"].tolist() == [scan.time for scan in MADE.scans]
    for t, scan in enumerate(MADE.scans):
        rows = tracks.time == scan.time
        assert frame(columns, "label", "declared", t).tolist() == tracks.track[rows].tolist()
        assert frame(columns, "declared", "declared", t) == pytest.approx(tracks.x[rows, :2])
        assert frame(columns, "declared_P", "declared", t)[:, 1] == pytest.approx(tracks.P[rows, 0, 1])
        assert frame(columns, "z", "z", t) == pytest.approx(MADE.detections.z[scan.rows])
        assert columns["0/expected"][t] == pytest.approx(tracks.existence[rows].sum())
        taken = {scan.rows[i]: one + 1 for i, one in enumerate(frame(columns, "origin", "z", t)) if one >= 0}
        rows &= tracks.detection >= 0
        assert taken == dict(zip(tracks.detection[rows], tracks.track[rows], strict=True))


def test_scans_beyond_the_most_share_frames_with_all_their_detections():
    kept = recorded(most=8)
    columns, tracks = kept.columns, MADE.tracks
    assert kept.scans == 8 and columns["time"].tolist() == [
        *(MADE.scans[i].time for i in range(3, 30, 4)),
        58.0,
    ]
    assert len(columns["0/z"]) == len(MADE.detections.time)
    for t, last in enumerate(columns["time"]):
        within = (tracks.time > last - 8.0) & (tracks.time <= last)
        want = {
            i: tracks.x[np.flatnonzero(within & (tracks.track == i))[-1], :2] for i in tracks.track[within]
        }
        labels = frame(columns, "label", "declared", t)
        assert labels.tolist() == sorted(want)
        assert frame(columns, "declared", "declared", t) == pytest.approx(np.array([want[i] for i in labels]))


def test_a_track_without_a_row_at_a_scan_stays_where_it_was():
    tracks = MADE.tracks
    gone = ~((tracks.track == 2) & np.isin(tracks.time, (20.0, 22.0)))
    kept = recording_of(type(tracks)(*(column[gone] for column in tracks)), MADE.detections, MADE.scans)
    before = tracks.x[(tracks.track == 2) & (tracks.time == 18.0), :2]
    for t in 10, 11:
        shown = frame(kept.columns, "declared", "declared", t)
        assert shown[frame(kept.columns, "label", "declared", t) == 2] == pytest.approx(before)


def test_polar_detections_are_drawn_where_they_lie():
    z = MADE.detections.z
    spec = SensorSpec("radar", POLAR, deviation=(10.0, 0.01))
    for origin, radar in ([0.0, 0.0, 0.0], True), ([100.0, -50.0, 0.0], False):
        off = z - origin[:2]
        polar = np.column_stack([np.hypot(*off.T), np.arctan2(off[:, 1], off[:, 0])])
        at = np.tile(origin, (len(z), 1))
        kept = recording_of(
            MADE.tracks, MADE.detections._replace(z=polar, sensors=(spec,), origin=at), MADE.scans
        )
        assert kept.columns["0/z"] == pytest.approx(z, abs=1e-9)
        assert kept.radar is radar


def test_without_tracks_there_is_a_page_of_detections():
    none = type(MADE.tracks)(*(column[:0] for column in MADE.tracks))
    text = page(recording_of(none, MADE.detections, MADE.scans, title="plots.csv"))
    assert len(columns_of(text)["0/z"]) == len(MADE.detections.time)
    assert "<title>tracks: plots.csv</title>" in text
