"""A radar that turns: each detection at its own time, and range rate, against what is lost without them."""

import numpy as np

from gmr_gym.recorded import LiveTracker, SensorSpec, tracking_model

PERIOD, SPEED, TARGETS, TURNS = 5.0, 250.0, 8, 24
RADAR = SensorSpec(
    "radar", "polar", deviation=(50.0, np.radians(0.08)), range_rate_deviation=1.0,
    detection_probability=0.9, clutter_per_scan=10.0, rotation_period=PERIOD,
)  # fmt: skip
MODEL = tracking_model([RADAR], (-9e4, -9e4), (9e4, 9e4), max_speed=350.0)


def turns(seed=0):
    """For each turn detections (range, azimuth), range rates and times; and start and velocity of the
    targets."""
    rng = np.random.default_rng(seed)
    (course, bearing), far = rng.uniform(-np.pi, np.pi, (2, TARGETS)), rng.uniform(2e4, 6e4, TARGETS)
    x = far[:, None] * np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    v = SPEED * np.stack([np.cos(course), np.sin(course)], axis=1)
    scans = []
    for turn in range(TURNS):
        rows = []
        for i in range(TARGETS):
            at = PERIOD * (turn + 0.5)
            for _ in range(5):  # when the beam, at azimuth 0 as the turn begins, meets the target
                place = x[i] + v[i] * at
                azimuth = np.arctan2(place[1], place[0])
                at = PERIOD * (turn + azimuth % (2 * np.pi) / (2 * np.pi))
            place = x[i] + v[i] * at
            away = np.linalg.norm(place)
            rows.append([away, azimuth, v[i] @ place / away, at])
        seen = np.array(rows)[rng.random(TARGETS) < 0.9]
        seen[:, :3] += rng.normal(0, [50.0, np.radians(0.08), 1.0], (len(seen), 3))
        share = rng.random(rng.poisson(10))
        false = [9e4 * np.sqrt(rng.random(len(share))), 2 * np.pi * share, rng.uniform(-350, 350, len(share))]
        false = np.stack([*false, PERIOD * (turn + share)], axis=1)
        scan = np.concatenate([seen, false])
        scans.append(scan[np.argsort(scan[:, 3])])
    return scans, x, v


def errors(own_times, range_rate):
    """Root mean square errors of position (m) and velocity (m/s) over the later half, the number of targets
    found on average, and that of tracks confirmed."""
    scans, x, v = turns()
    tracker, off, found, confirmed = LiveTracker(MODEL), [], [], []
    for turn, scan in enumerate(scans):
        time = PERIOD * (turn + (1.0 if own_times else 0.5))
        rows = tracker.update(
            time, scan[:, :2], times=scan[:, 3] if own_times else None,
            range_rate=scan[:, 2] if range_rate else None, azimuths=(0.0, 2 * np.pi),
        )  # fmt: skip
        if turn < TURNS // 2:
            continue
        there = rows.x[(rows.status == 1) | (rows.status == 2)]
        truth = np.concatenate([x + v * time, v], axis=1)
        distance = np.linalg.norm(truth[:, None, :2] - there[None, :, :2], axis=2)
        near = distance.min(axis=1) < 2000
        found.append(near.sum())
        confirmed.append(len(there))
        off.append((there[distance.argmin(axis=1)] - truth)[near])
    off = np.concatenate(off)
    rms = [np.sqrt((off[:, part] ** 2).sum(axis=1).mean()) for part in (slice(2), slice(2, 4))]
    return *rms, np.mean(found), np.mean(confirmed)


def test_own_times_beat_one_time_for_a_turn():
    own, one = errors(True, False), errors(False, False)
    assert own[2] > 0.95 * TARGETS and own[3] < TARGETS + 1
    assert own[0] < one[0] / 3


def test_range_rate_brings_the_velocity_down():
    with_rate, without = errors(True, True), errors(True, False)
    assert with_rate[2] > 0.95 * TARGETS
    assert with_rate[1] < 0.6 * without[1]
