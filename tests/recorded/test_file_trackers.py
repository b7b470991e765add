"""Tracks of files by rules of association, by hypotheses, and by installed trackers of many targets."""

from itertools import pairwise

import numpy as np
import pytest

from gmr_gym.filters import registry
from gmr_gym.filters.tracker import MultiTargetReport
from gmr_gym.mixture import Mixture
from gmr_gym.models.clutter import uniform_clutter
from gmr_gym.recorded import LiveTracker, Scan, SensorSpec, from_arrays, track, tracking_model
from gmr_gym.recorded.declared_tracks import Declared
from gmr_gym.recorded.model import TRACKERS
from gmr_gym.recorded.plugged_trackers import plugged, track_plugged
from gmr_gym.recorded.tracks import COASTED, CONFIRMED, DELETED

BOX = (-1e3, -1e3), (1e3, 1e3)
RADAR = SensorSpec("radar", deviation=(5.0, 5.0), detection_probability=0.9, clutter_per_scan=5.0)
OTHERS = TRACKERS[1:]


def model(tracker="pmb", *, sensors=(RADAR,), **options):
    return tracking_model(sensors, *BOX, **{"max_speed": 50.0, "tracker": tracker, **options})


def crossing(scans=25, seed=3):
    """Detections of two targets that cross and of clutter, scan by scan."""
    rng = np.random.default_rng(seed)
    for t in range(scans):
        targets = np.array([[-200.0 + 16 * t, 100 - 8.0 * t], [-200.0 + 16 * t, -100 + 8.0 * t]])
        z = targets[rng.random(2) < 0.95]
        yield np.concatenate([z + rng.normal(0, 5, z.shape), rng.uniform(-1e3, 1e3, (rng.poisson(5), 2))])


def recorded(scans, sensors=(RADAR,)):
    scans = [*scans]
    time = np.repeat(np.arange(len(scans), dtype=float), [len(z) for z in scans])
    cut = np.split(np.arange(len(time)), np.cumsum([len(z) for z in scans])[:-1])
    return from_arrays(time, np.concatenate(scans), sensors=sensors), [
        Scan(float(t), float(t), float(t), rows, 0) for t, rows in enumerate(cut)
    ]


def check_crossed(rows):
    """Two confirmed tracks at the end, on the targets, and labels without gaps and never used twice."""
    last = (rows.time == rows.time[-1]) & ((rows.status == CONFIRMED) | (rows.status == COASTED))
    places = rows.x[last]
    assert len(places) == 2
    for sign in (-1, 1):
        off = places - [184.0, sign * -92.0, 16.0, sign * -8.0]
        assert np.linalg.norm(off[:, :2], axis=1).min() < 15 and np.linalg.norm(off[:, 2:], axis=1).min() < 4
    assert np.unique(rows.track).tolist() == [*range(1, rows.track.max() + 1)]
    for label in np.unique(rows.track):
        assert (rows.status[rows.track == label][:-1] != DELETED).all()
        assert (np.diff(rows.time[rows.track == label]) == 1.0).all()


@pytest.mark.parametrize("tracker", OTHERS)
def test_crossing_targets_are_followed_and_a_break_changes_nothing(tracker, tmp_path):
    scans = [*crossing()]
    whole = track(*recorded(scans), model(tracker))
    check_crossed(whole)
    live = LiveTracker(model(tracker))
    for t, z in enumerate(scans):
        rows = live.update(float(t), z)
        np.testing.assert_array_equal(rows.x, whole.x[whole.time == t])
        if t == 12:
            live.save(tmp_path / "break.npz")
            live = LiveTracker.load(tmp_path / "break.npz")


@pytest.mark.parametrize("tracker", TRACKERS)
def test_identities_own_times_and_range_rates_count_for_every_tracker(tracker):
    """Two targets side by side, seen by a polar sensor at times within the scan, each with its identity but
    for the order that places alone suggest."""
    rng = np.random.default_rng(0)
    polar = SensorSpec(
        "radar", "polar", deviation=(5.0, 0.005), range_rate_deviation=0.5, detection_probability=0.9,
        clutter_per_scan=0.1,
    )  # fmt: skip
    live, named = LiveTracker(model(tracker, sensors=(polar,), confirm=(3, 5))), {}
    for t in range(12):
        at = np.array([t + 0.3, t + 0.8])
        place = np.column_stack([500.0 + 20 * at, [0.0, 12.0]])
        far, v = np.linalg.norm(place, axis=1), np.array([20.0, 0.0])
        z = np.column_stack([far, np.arctan2(place[:, 1], place[:, 0])])
        rate = (place @ v) / far + rng.normal(0, 0.5, 2)
        z += rng.normal(0, 1, (2, 2)) * [5.0, 0.005]
        rows = live.update(t + 1.0, z, times=at, range_rate=rate, identity=["a", "b"])
        for label, j in zip(
            rows.track[rows.detection >= 0], rows.detection[rows.detection >= 0], strict=True
        ):
            named.setdefault(int(label), set()).add(int(j))
    assert all(len(own) == 1 for own in named.values())  # of one identity alone
    alive = rows.status == CONFIRMED
    assert alive.sum() == 2
    np.testing.assert_allclose(rows.x[alive][:, 0], 500 + 20 * 12.0, atol=12)
    np.testing.assert_allclose(rows.x[alive][:, 2], 20, atol=1)


def test_a_hard_association_does_not_draw_two_tracks_together():
    """Where two targets go side by side for long, all detections in both gates, a mean over associations is
    between them; the best assignment is not."""
    rng, apart = np.random.default_rng(4), {}
    scans = [np.array([[8.0 * t, 0.0], [8.0 * t, 14.0]]) + rng.normal(0, 4, (2, 2)) for t in range(40)]
    radar = RADAR._replace(deviation=(4.0, 4.0), detection_probability=0.99, clutter_per_scan=0.01)
    for tracker in ("pda", "gnn"):
        assumed = model(tracker, sensors=(radar,), motion="constant-velocity", acceleration_deviation=2.0)
        rows = track(*recorded(scans, (radar,)), assumed)
        longest = np.argsort(np.bincount(rows.track))[-2:]
        y = [rows.x[(rows.track == label) & (rows.time >= 10), 1].mean() for label in longest]
        apart[tracker] = abs(y[0] - y[1])
    assert apart["gnn"] > 10 and apart["pda"] < apart["gnn"]


@pytest.mark.parametrize("tracker", TRACKERS)
def test_certain_detections_that_come_twice_or_not_at_all_break_nothing(tracker):
    """A detection probability of one, no clutter, a target certain to exist, its detection repeated; and a
    crowd that no look tells apart."""
    sure = RADAR._replace(detection_probability=1.0, clutter_per_scan=0.0)
    live = LiveTracker(model(tracker, sensors=(sure,), survival_probability=1.0))
    for t in range(8):
        rows = live.update(float(t), [[10.0 * t, 0.0]] * 2 if t != 4 else [])
        assert np.isfinite(rows.x).all() and (rows.existence <= 1).all()
    assert rows.status.tolist() == [CONFIRMED] and rows.track.tolist() == [1]
    live, rng = LiveTracker(model(tracker)), np.random.default_rng(1)
    for t in range(5):
        rows = live.update(float(t), rng.normal(0, 6, (10, 2)))
        assert np.isfinite(rows.P).all() and len(np.unique(rows.track)) == len(rows.track)


def test_a_history_without_a_target_gets_no_detection():
    """Of a track that is detected for certain, the history of a miss has no target. Where two tracks may have
    a detection, an integer program then chooses among histories, and needs finite weights."""
    sure = RADAR._replace(detection_probability=1.0, clutter_per_scan=0.0)
    live = LiveTracker(model("mht", sensors=(sure,)))
    for t, z in enumerate(crossing()):
        rows = live.update(float(t), z)
        assert np.isfinite(rows.x).all() and np.isfinite(live.state.leaves[0].log_weight).all()


def test_unknown_trackers_are_refused():
    with pytest.raises(ValueError, match="tracker must be one of pmb, pda, gnn, mht, phd, got 'gm-phd'"):
        model("gm-phd")


def test_an_installed_tracker_follows_the_targets_with_the_rules_of_tracks():
    found, scans = recorded(crossing())
    by = plugged("pmb", {"association": "exact"}, found, scans, model())
    rows = track_plugged(by, found, scans, model())
    check_crossed(rows)
    assert np.isnan(rows.modes).all() and rows.modes.shape[1] == 2
    near = rows.detection >= 0
    off = found.z[rows.detection[near]] - rows.x[near, :2]
    assert (np.linalg.norm(off, axis=1) < 40).all() and (
        found.time[rows.detection[near]] == rows.time[near]
    ).all()


def test_an_installed_tracker_is_looked_up_once_for_all_intervals(monkeypatch):
    found, scans = recorded(crossing(3))
    by = plugged("pmb", {}, found, scans, model())
    monkeypatch.setattr(registry, "tracker_entry_points", lambda group: {})
    periods = [by.make(interval, 0).model.motions[0].F[0, 2] for interval in (1.0, 1.5)]
    assert periods == [1.0, 1.5]


def test_what_an_installed_tracker_does_not_use_is_said_and_polar_detections_become_positions():
    polar = SensorSpec("radar", "polar", (100.0, 50.0, 0.0), (5.0, 0.01), 1.0, 0.9, 1.0)
    place = np.array([[300.0 + 10 * t, 50.0] for t in range(8)])
    off = place - [100.0, 50.0]
    z = np.column_stack([np.hypot(*off.T), np.arctan2(off[:, 1], off[:, 0])])
    found = from_arrays(
        np.arange(8.0), z, sensors=[polar], range_rate=np.full(8, 10.0), identity=["a"] * 8,
        origin=np.tile([100.0, 50.0, 0.0], (8, 1)),
    )  # fmt: skip
    scans = [Scan(t + 0.5, float(t), float(t), np.array([t]), 0, (0.0, 3.0)) for t in range(8)]
    by = plugged("pmb", {}, found, scans, model(sensors=(polar,)))
    said = "; ".join(by.unused)
    for part in ("times within a scan", "directions", "range rates", "identities", "the noise of each"):
        assert part in said
    rows = track_plugged(by, found, scans, model(sensors=(polar,)))
    np.testing.assert_allclose(rows.x[rows.time == 7.5][0, :2], [370, 50], atol=8)


def test_a_declared_track_is_coasted_ended_and_never_comes_back_under_its_number():
    """A tracker declares a label for two scans, then not, and much later again."""
    declared = Declared(model(motion="constant-velocity", acceleration_deviation=1.0, delete=(3, 3)))
    R, seen = np.diag([25.0, 25.0]), []
    for t in range(10):
        there = t < 2 or t > 6
        x = np.array([[10.0 * t, 0.0, 10.0, 0.0]])[: int(there)]
        report = MultiTargetReport(
            x, np.full(len(x), 0.99), np.full(len(x), 7), float(len(x)),
            Mixture(np.ones(len(x)), x, np.tile(np.diag([9.0, 9.0, 1.0, 1.0]), (len(x), 1, 1))),
            uniform_clutter(*BOX, 1.0),
        )  # fmt: skip
        rows = declared.update(float(t), x[:, :2].copy(), report, R, 0)
        seen += [(t, int(label), int(status)) for label, status in zip(rows.track, rows.status, strict=True)]
    assert [(label, status) for _, label, status in seen if label == 1] == [
        (1, 0), (1, CONFIRMED), (1, COASTED), (1, COASTED), (1, DELETED),
    ]  # fmt: skip
    assert [t for t, label, _ in seen if label == 2] == [7, 8, 9]
    assert all(b >= a for (_, a, _), (_, b, _) in pairwise(seen))


def test_a_label_without_a_detection_starts_no_track():
    declared = Declared(model())
    x = np.array([[0.0, 0.0, 0.0, 0.0]])
    mixture = Mixture(np.ones(1), x, np.eye(4)[None])
    report = MultiTargetReport(x, np.ones(1), np.array([3]), 1.0, mixture, uniform_clutter(*BOX, 1.0))
    assert len(declared.update(0.0, np.array([[500.0, 0.0]]), report, np.eye(2), 0).time) == 0
