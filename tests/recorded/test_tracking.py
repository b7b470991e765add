"""Tracks with labels from recorded scans: the loop, the rules, labels, times, identities."""

import numpy as np
import pytest

from gmr_gym.recorded import LiveTracker, Scan, SensorSpec, from_arrays, track, tracking_model
from gmr_gym.recorded.model import as_text
from gmr_gym.recorded.tracks import COASTED, CONFIRMED, DELETED, STATUS, joined_rows

BOX = (-1e3, -1e3), (1e3, 1e3)
RADAR = SensorSpec("radar", deviation=(5.0, 5.0), detection_probability=0.9, clutter_per_scan=5.0)


def model(*, sensors=(RADAR,), box=BOX, **options):
    return tracking_model(sensors, *box, **{"max_speed": 50.0, **options})


def crossing(scans=25, seed=3):
    """Detections of two targets that cross and of clutter, scan by scan."""
    rng = np.random.default_rng(seed)
    out = []
    for t in range(scans):
        targets = np.array([[-200.0 + 16 * t, 100 - 8.0 * t], [-200.0 + 16 * t, -100 + 8.0 * t]])
        z = targets[rng.random(2) < 0.95]
        out.append(
            np.concatenate([z + rng.normal(0, 5, z.shape), rng.uniform(-1e3, 1e3, (rng.poisson(5), 2))])
        )
    return out


def same(a, b):
    for name, one, other in zip(a._fields, a, b, strict=True):
        np.testing.assert_array_equal(one, other, err_msg=name)


def recorded(scans, sensors=(RADAR,)):
    z, time = np.concatenate(scans), np.repeat(np.arange(len(scans), dtype=float), [len(z) for z in scans])
    start = np.cumsum([0, *map(len, scans)])
    cut = [
        Scan(float(t), float(t), float(t), np.arange(start[t], start[t + 1]), 0) for t in range(len(scans))
    ]
    return from_arrays(time, z, sensors=sensors), cut


def test_a_tracker_restored_goes_on_as_if_there_had_been_no_break(tmp_path):
    scans = crossing()
    for learn in (False, True):
        whole, first = LiveTracker(model(learn_clutter=learn)), LiveTracker(model(learn_clutter=learn))
        for t, z in enumerate(scans[:12]):
            whole.update(float(t), z)
            first.update(float(t), z)
        first.save(tmp_path / "break.npz")
        second = LiveTracker.load(tmp_path / "break.npz")
        assert as_text(second.model) == as_text(whole.model)
        for t, z in enumerate(scans[12:], 12):
            same(whole.update(float(t), z), second.update(float(t), z))


def test_a_file_that_holds_no_whole_tracker_is_refused(tmp_path):
    LiveTracker(model()).save(tmp_path / "whole")
    whole = (tmp_path / "whole.npz").read_bytes()
    with np.load(tmp_path / "whole.npz") as file:
        np.savez(tmp_path / "fewer.npz", **{name: file[name] for name in file.files[:-1]})
    for name, data in (("cut.npz", whole[:-99]), ("empty.npz", b""), ("text.npz", b"text")):
        (tmp_path / name).write_bytes(data)
    for name in ("cut.npz", "empty.npz", "text.npz", "fewer.npz"):
        with pytest.raises(ValueError, match=rf"{name}: no whole file of `LiveTracker.save`"):
            LiveTracker.load(tmp_path / name)


def test_a_saved_tracker_stays_until_the_next_is_written_whole(tmp_path, monkeypatch):
    tracker = LiveTracker(model())
    tracker.save(tmp_path / "tracker.npz")
    before = (tmp_path / "tracker.npz").read_bytes()

    def interrupted(path, **arrays):
        path.write_bytes(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez", interrupted)
    with pytest.raises(KeyboardInterrupt):
        tracker.save(tmp_path / "tracker.npz")
    assert (tmp_path / "tracker.npz").read_bytes() == before and len([*tmp_path.iterdir()]) == 1


def test_a_file_gives_the_rows_of_the_live_loop():
    scans = crossing()
    tracker, live = LiveTracker(model()), []
    for t, z in enumerate(scans):
        live.append(tracker.update(float(t), z))
    whole = track(*recorded(scans), model())
    start, at = np.cumsum([0, *map(len, scans)]), 0
    for t, rows in enumerate(live):
        part = type(whole)(*(column[at : at + len(rows.time)] for column in whole))
        at += len(rows.time)
        same(rows, part._replace(detection=np.where(part.detection < 0, -1, part.detection - start[t])))
    assert at == len(whole.time)


def test_two_crossing_targets_keep_their_labels_and_no_label_is_used_twice():
    rows = track(*recorded(crossing()), model())
    last = rows.time == rows.time[-1]
    confirmed = rows.track[last & (rows.status == CONFIRMED)]
    assert len(confirmed) == 2
    assert (np.diff(np.unique(rows.track)) == 1).all() and rows.track.min() == 1
    for label in np.unique(rows.track):
        times, status = (column[rows.track == label] for column in (rows.time, rows.status))
        assert (np.diff(times) == 1.0).all()
        assert (status[:-1] != DELETED).all()
    for label, sign in zip(confirmed, (-1, 1), strict=True):
        mine = rows.x[last & (rows.track == label)][0]
        assert abs(abs(mine[3]) - 8) < 2 and abs(mine[2] - 16) < 2, sign


def test_the_order_of_detections_does_not_matter_but_for_rounding():
    rng, tracker, other = np.random.default_rng(0), LiveTracker(model()), LiveTracker(model())
    for t, z in enumerate(crossing(15)):
        order = rng.permutation(len(z))
        a, b = tracker.update(float(t), z), other.update(float(t), z[order])
        a, b = tracker.update(float(t), z), other.update(float(t), z[order])
        np.testing.assert_array_equal(a.track, b.track)
        np.testing.assert_allclose(a.x, b.x, rtol=1e-9, atol=1e-6)
        np.testing.assert_allclose(a.existence, b.existence, rtol=1e-9)
        found = b.detection >= 0
        np.testing.assert_array_equal(a.detection[found], order[b.detection[found]])


def test_a_target_that_goes_is_coasted_and_deleted_after_its_misses():
    tracker = LiveTracker(model(delete=(3, 3), sensors=[RADAR._replace(clutter_per_scan=0.1)]))
    status = []
    for t in range(12):
        rows = tracker.update(float(t), [[10.0 * t, 0.0]] if t < 7 else [])
        status += [STATUS[s] for s in rows.status[rows.track == 1]]
    assert status[6:] == ["confirmed", "coasted", "coasted", "deleted"]
    assert len(tracker.state.targets.existence) == 0


def test_confirmation_by_m_of_n_takes_m_detections():
    tracker = LiveTracker(model(confirm=(3, 5)))
    status = [tracker.update(float(t), z).status[0] for t, z in enumerate([[[0, 0]], [[0, 0]], [], [[0, 0]]])]
    assert [STATUS[s] for s in status] == ["tentative", "tentative", "tentative", "confirmed"]


def test_a_miss_counts_only_where_the_beam_has_passed_and_once_a_turn():
    turning = RADAR._replace(rotation_period=4.0, clutter_per_scan=0.1)
    tracker = LiveTracker(model(sensors=[turning], survival_probability=1.0))
    for t in range(4):
        rows = tracker.update(4.0 * t, [[100.0, 100.0]])
    before = rows.existence[0]
    rows = tracker.update(13.0, [], azimuths=(np.pi / 2, np.pi))  # not where the track is
    assert rows.existence[0] == pytest.approx(before, rel=1e-9) and rows.status[0] == CONFIRMED
    rows = tracker.update(13.5, [], azimuths=(0.0, np.pi / 2))  # so soon after the detection: no second look
    assert rows.existence[0] == pytest.approx(before, rel=1e-9)
    rows = tracker.update(16.0, [], azimuths=(np.pi / 2, 0.0))  # clockwise
    assert rows.existence[0] < before and rows.status[0] == COASTED


def test_a_detection_joins_no_track_of_another_identity():
    tracker = LiveTracker(model())
    for t in range(4):
        rows = tracker.update(float(t), [[0.0, 0.0], [3.0, 0.0]], identity=["A", "B"])
    assert len(rows.track) == 2
    assert sorted(rows.detection.tolist()) == [0, 1] and (rows.detections == 1).all()


def test_a_report_by_itself_touches_only_its_own_track_until_others_are_silent_too_long():
    tracker = LiveTracker(model(max_coast=50.0, confirm=(2, 2)))
    for t in range(6):
        a = tracker.update(2.0 * t, [[10.0 * t, 0.0]], identity="A")
        b = tracker.update(2.0 * t + 1, [[10.0 * t, 5.0]], identity="B")
        assert a.track.tolist() == [1] and b.track.tolist() == [2]
    assert a.status[0] == b.status[0] == CONFIRMED and a.existence[0] == 1.0
    assert a.x[0, 2] == pytest.approx(5.0, abs=0.5)
    rows = tracker.update(61.0, [[300.0, 5.0]], identity="B")
    assert rows.track.tolist() == [1, 2] and rows.status.tolist() == [DELETED, CONFIRMED]
    assert tracker.update(62.0, [[0.0, 0.0]], identity="A").track.tolist() == [3]


def test_reports_of_a_file_give_the_rows_of_the_live_loop():
    """Runs of reports end at a new ship, at one that was silent for too long, at another sensor and at scans
    that are none."""
    rng, n = np.random.default_rng(8), 120
    names = [f"{i}" for i in rng.integers(0, 5, n)]
    names[40:80] = [name if name != "3" else "4" for name in names[40:80]]  # one is silent
    names[60] = None
    time, z = np.arange(n, dtype=float), rng.normal(0, 5, (n, 2)) + [[200.0 * int(i or 9), 0] for i in names]
    sensors = (RADAR, RADAR._replace(name="shore", deviation=(9.0, 9.0)))
    which = (np.arange(n) % 30 > 20).astype(int)
    seen = from_arrays(time, z, identity=names, sensors=sensors, sensor=which)
    scans = [Scan(t, t, t, np.array([i]), int(which[i])) for i, t in enumerate(time.tolist())]
    scans.insert(90, Scan(89.5, 89.5, 89.5, np.empty(0, int), 0))
    assumed = model(sensors=sensors, max_coast=25.0)
    live, parts = LiveTracker(assumed), []
    for scan in scans:
        one = scan.rows
        named = [names[i] for i in one]
        alone = named[0] if named and named[0] is not None else named
        rows = live.update(scan.time, z[one], sensor=scan.sensor, identity=alone)
        parts.append(rows._replace(detection=np.append(one, -1)[rows.detection]))
    found = track(seen, scans, assumed, reports=True)
    same(found, joined_rows(parts))
    assert DELETED in found.status and len(np.unique(found.track)) > 5


def test_a_static_object_is_not_confirmed_where_a_least_speed_is_asked_for():
    tracker = LiveTracker(model(min_speed=2.0))
    for t in range(12):
        rows = tracker.update(float(t), [[0.0, 0.0], [10.0 * t, 300.0]])
    assert {STATUS[s] for s in rows.status[rows.x[:, 1] < 100]} == {"tentative"}
    assert {STATUS[s] for s in rows.status[rows.x[:, 1] > 100]} == {"confirmed"}


def test_many_detections_stay_within_the_most_tracks():
    rng = np.random.default_rng(0)
    tracker = LiveTracker(model(max_tracks=300, max_speed=20.0))
    for t in range(3):
        rows = tracker.update(float(t), rng.uniform(-1e3, 1e3, (2000, 2)))
        assert len(tracker.state.targets.existence) <= 300
    assert np.isfinite(rows.x).all()


@pytest.mark.parametrize(("arguments", "message"), [
    ({"time": 0.5, "z": [[0, 0]]}, "time must be finite and not go back: got 0.5 after 1.0"),
    ({"time": 2.0, "z": [[0, 0, 0]]}, r"z must be finite with shape \(k, 2\), got shape \(1, 3\)"),
    ({"time": 2.0, "z": [[0, 0]], "times": [1, 2]}, r"times must have shape \(1,\), one for each detection"),
    ({"time": 2.0, "z": [[0, 0]], "identity": ["a", "b"]}, "identity must have 1 entries"),
    ({"time": 2.0, "z": [[0, 0]], "range_rate": [1.0]}, "needs a range_rate_deviation"),
    ({"time": 2.0, "z": [[0, 0]], "sensor": -1}, r"sensor must be an index in 0\.\.0, got -1"),
    ({"time": 2.0, "z": [[0, 0]], "origin": [0, np.nan, 0]}, r"origin must be finite with shape \(3,\) or"),
])  # fmt: skip
def test_what_is_wrong_with_a_scan_is_named(arguments, message):
    tracker = LiveTracker(model())
    tracker.update(1.0, [])
    with pytest.raises(ValueError, match=message):
        tracker.update(**arguments)


def test_sensors_of_two_kinds_follow_one_track():
    polar = SensorSpec(
        "polar", "polar", (300.0, -500.0, 0.0), (5.0, 0.01), detection_probability=0.9, clutter_per_scan=1.0
    )
    tracker, rng = LiveTracker(model(sensors=[RADAR, polar])), np.random.default_rng(0)
    for t in range(10):
        place = np.array([-100.0 + 20 * t, 5.0 * t])
        away = place - [300.0, -500.0]
        if t % 2:
            z = np.array([np.hypot(*away), np.arctan2(away[1], away[0])]) + rng.normal(0, [5.0, 0.01])
        else:
            z = place + rng.normal(0, 5, 2)
        rows = tracker.update(float(t), [z], sensor=t % 2)
        assert rows.track.tolist() == [1] and rows.detection.tolist() == [0]
    assert rows.status[0] == CONFIRMED
    assert np.linalg.norm(rows.x[0, :2] - place) < 10 and np.linalg.norm(rows.x[0, 2:] - [20, 5]) < 4


def test_a_radar_with_elevation_tracks_in_space():
    radar = SensorSpec(
        "radar",
        "polar",
        (0.0, 0.0, 50.0),
        (10.0, 0.002, 0.002),
        detection_probability=0.9,
        clutter_per_scan=1.0,
    )
    space = (-2e4, -2e4, 0.0), (2e4, 2e4, 1e4)
    tracker, rng = LiveTracker(model(sensors=[radar], box=space, max_speed=200.0)), np.random.default_rng(0)
    for t in range(12):
        place = np.array([5000.0 + 100 * t, -3000.0 + 80 * t, 2000.0 - 10 * t])
        away = place - [0.0, 0.0, 50.0]
        level = np.hypot(*away[:2])
        z = [np.hypot(level, away[2]), np.arctan2(away[1], away[0]), np.arctan2(away[2], level)]
        rows = tracker.update(float(t), [z + rng.normal(0, [10.0, 0.002, 0.002])])
    assert rows.track.tolist() == [1] and rows.status[0] == CONFIRMED
    assert rows.x.shape == (1, 6) and rows.P.shape == (1, 6, 6)
    off = rows.x[0] - [*place, 100, 80, -10]
    assert off @ np.linalg.solve(rows.P[0], off) < 22.5  # 99.9 % of six degrees of freedom
