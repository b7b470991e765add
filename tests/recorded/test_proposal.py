"""What a file says of its sensors and targets, beside what it was made of."""

import re
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from gmr_gym import cli
from gmr_gym.experiments.detection_options import TARGET, TRACKS
from gmr_gym.experiments.tracks import many_targets_model
from gmr_gym.recorded import (
    STATUS,
    Configuration,
    SensorSpec,
    cut,
    from_arrays,
    read_configuration,
    track,
)
from gmr_gym.recorded.noise import deviation_of, differences, likelihoods
from gmr_gym.recorded.proposal import completed, propose

PROBABILITY, CLUTTER, NOISE = 0.9, 3.0, 0.3


def simulated(seed, *, scans=50, targets=5, deviation=(5.0, 5.0), polar=False, speed=10.0, half=1500.0):
    """Detections every 2 s of targets at nearly constant velocity and of clutter."""
    rng, dt = np.random.default_rng(seed), 2.0
    place = rng.uniform(-0.6 * half, 0.6 * half, (targets, 2))
    velocity = speed * rng.normal(size=(targets, 2))
    times, z = [], []
    for k in range(scans):
        w = rng.normal(size=(2, targets, 2)) if speed else np.zeros((2, targets, 2))
        place = place + dt * velocity + NOISE * dt**1.5 * (w[0] / 2 + w[1] / np.sqrt(12))
        velocity = velocity + NOISE * np.sqrt(dt) * w[0]
        seen = place[rng.random(targets) < PROBABILITY]
        clutter = rng.uniform(-half, half, (rng.poisson(CLUTTER), 2))
        if polar:
            seen, clutter = (
                np.stack([np.hypot(*p.T), np.arctan2(p[:, 1], p[:, 0])], 1) for p in (seen, clutter)
            )
        z.append(np.vstack([seen + rng.normal(0, deviation, seen.shape), clutter]))
        times += [dt * k] * len(z[-1])
    return from_arrays(times, np.vstack(z), sensors=[SensorSpec("", "polar" if polar else "cartesian")])


def interval(lines, name):
    line = next(line for line in lines if line.startswith(name))
    return [float(end) for end in re.search(r"\(([\d.e-]+) to ([\d.e-]+)", line).groups()]


@pytest.mark.parametrize(
    "polar, deviation", [(False, (5.0, 5.0)), (False, (1.0, 2.0)), (True, (5.0, np.radians(0.3)))]
)
def test_what_the_file_was_made_of_lies_in_the_intervals(polar, deviation):
    found = simulated(1, polar=polar, deviation=deviation)
    proposal = propose(found, cut(found))
    first, second = ("range", "azimuth") if polar else ("x", "y")
    true = {
        f"deviation in {first}": deviation[0],
        f"deviation in {second}": np.degrees(deviation[1]) if polar else deviation[1],
        "detection probability": PROBABILITY,
        "clutter a scan": CLUTTER,
        "acceleration deviation": NOISE,
    }
    for name, value in true.items():
        low, high = interval(proposal.lines, name)
        assert low <= value <= high, name
        assert high < 2 * low or name == "clutter a scan"
    assert proposal.target["motion"] == "constant-velocity" and not proposal.learn_clutter
    assert "min_speed" not in proposal.target  # nothing stands still
    (spec,) = proposal.sensors
    np.testing.assert_allclose(spec.deviation, deviation, rtol=0.3)
    assert proposal.lines[-1].startswith("rests on 5 tracks that move")
    nis = next(one for one in proposal.after if one.name == "NIS / degrees of freedom")
    assert 0.7 < nis.value < 1.3  # with rough numbers it is far below


def test_two_long_tracks_are_enough_and_their_number_is_said():
    found = simulated(0, targets=2, scans=60)
    lines = propose(found, cut(found)).lines
    assert lines[-1].startswith("rests on 2 tracks that move") and "fewer than 5" in lines[-1]


@pytest.mark.parametrize(
    "kind, message",
    [
        ({"scans": 12, "targets": 1}, r"to propose from: .*needed are 50 measured coordinates"),
        ({"speed": 0.0}, r"nothing to propose from: of \d+ confirmed tracks none moves"),
    ],
)
def test_too_little_and_what_stands_still_are_refused(kind, message):
    found = simulated(3, **kind)
    with pytest.raises(ValueError, match=message):
        propose(found, cut(found))


def test_range_rates_need_their_deviation():
    found = simulated(3, polar=True, deviation=(5.0, 0.005))
    found = found._replace(range_rate=np.ones(len(found.time)))
    with pytest.raises(ValueError, match="give --sensor-deviation range_rate=1"):
        propose(found, cut(found))


def straight(rng, targets=5):
    """Positions (targets, 2) at a time, of targets that keep their velocity."""
    place, velocity = rng.uniform(-900, 900, (targets, 2)), 10.0 * rng.normal(size=(targets, 2))
    return lambda time: place + np.multiply.outer(time, velocity)


def test_each_of_several_sensors_has_its_own_deviation_detection_probability_and_clutter():
    rng = np.random.default_rng(2)
    at, sensors = straight(rng), [SensorSpec("near"), SensorSpec("far", "polar")]
    true = [((2.0, 3.0), 0.95, 1.0), ((20.0, np.radians(0.4)), 0.7, 4.0)]
    times, z, sensor = [], [], []
    for k in range(120):
        deviation, probability, clutter = true[k % 2]
        points = np.vstack(
            [at(k)[rng.random(5) < probability], rng.uniform(-1500, 1500, (rng.poisson(clutter), 2))]
        )
        if k % 2:
            points = np.stack([np.hypot(*points.T), np.arctan2(points[:, 1], points[:, 0])], 1)
        z.append(points + rng.normal(0, deviation, points.shape))
        times += [float(k)] * len(points)
        sensor += [k % 2] * len(points)
    found = from_arrays(times, np.vstack(z), sensor=sensor, sensors=sensors)
    proposal = propose(found, cut(found))
    for spec, (deviation, probability, clutter) in zip(proposal.sensors, true, strict=True):
        first = "x" if spec.name == "near" else "range"
        expected = {
            f"deviation in {first} of {spec.name}": deviation[0],
            f"detection probability of {spec.name}": probability,
            f"clutter a scan of {spec.name}": clutter,
        }
        for name, value in expected.items():
            low, high = interval(proposal.lines, name)
            assert low <= value <= high, name
        np.testing.assert_allclose(spec.deviation, deviation, rtol=0.3)


def test_of_reports_by_the_targets_themselves_none_is_missed_or_clutter():
    rng = np.random.default_rng(4)
    at, targets = straight(rng), 5
    time = np.sort(rng.uniform(0, 600, (targets, 50)), axis=1)  # 12 s apart on average, each at its own times
    own = np.stack([at(time[i])[:, i] for i in range(targets)])
    order = np.argsort(time.ravel())
    names = np.repeat([f"ship {i}" for i in range(targets)], 50)[order].tolist()
    z = own.reshape(-1, 2)[order] + rng.normal(0, (6.0, 12.0), (targets * 50, 2))
    found = from_arrays(time.ravel()[order], z, identity=names)
    proposal = propose(found, cut(found), reports=True)
    for axis, deviation in zip("xy", (6.0, 12.0), strict=True):
        low, high = interval(proposal.lines, f"deviation in {axis}")
        assert low <= deviation <= high
    assert not [line for line in proposal.lines if line.startswith(("detection probability", "clutter"))]
    assert not proposal.learn_clutter and proposal.lines[-1].startswith("rests on 5 tracks that move")


def test_two_motion_models_are_on_both_sides_of_the_one_likeliest_alone():
    rng = np.random.default_rng(6)
    place, velocity = rng.uniform(-900, 900, (5, 2)), 8.0 * rng.normal(size=(5, 2))
    z = []
    for k in range(60):
        z.append(place + rng.normal(0, 2.0, (5, 2)))
        if k % 12 == 6:  # a turn at once
            velocity = velocity + rng.normal(0, 6.0, (5, 2))
        place = place + 2.0 * velocity
    found = from_arrays(np.repeat(2.0 * np.arange(60), 5), np.vstack(z))
    proposal = propose(found, cut(found))
    alone = next(line for line in proposal.lines if line.startswith("acceleration deviation"))
    quiet, swift = proposal.target["acceleration_deviation"]
    assert proposal.target["motion"] == "imm"
    assert quiet < float(alone.split()[2]) < swift


def test_of_static_echoes_a_least_speed_is_proposed_that_hides_them_and_no_slow_ship():
    rng, period, scans = np.random.default_rng(8), 2.0, 60
    moored = rng.uniform(-400, 400, (6, 2))
    ships, velocity = rng.uniform(-200, 200, (3, 2)), np.array([[4.0, 0.0], [0.0, -3.0], [0.4, 0.3]])
    times, z, slow = [], [], ships[2] + period * np.multiply.outer(np.arange(scans), velocity[2])
    for k in range(scans):
        echoes = np.vstack([ships + k * period * velocity, moored[rng.random(6) < 0.6]])
        z.append(np.vstack([echoes + rng.normal(0, 1.0, echoes.shape), rng.uniform(-500, 500, (1, 2))]))
        times += [k * period] * len(z[-1])
    found = from_arrays(times, np.vstack(z))
    proposal = propose(found, cut(found))
    least = proposal.target["min_speed"]
    assert 0.0 < least < 0.25
    assert any(line.startswith(f"least speed: {least:g} m/s") for line in proposal.lines)
    assert next(one for one in proposal.after if one.name == "static tracks").value <= 1
    settings = completed(Configuration(), proposal)
    assert settings.tracks == {"min_speed": least} and "min_speed" not in settings.target
    assert completed(Configuration(tracks={"min_speed": 0.0}), proposal).tracks == {"min_speed": 0.0}
    typed = {name: option.default for name, option in (TARGET | TRACKS).items()} | {"min_speed": 0.0}
    assert many_targets_model(found._replace(sensors=proposal.sensors), settings, typed).min_speed == 0.0
    model = many_targets_model(
        found._replace(sensors=proposal.sensors), settings, typed | {"min_speed": None}
    )
    assert model.min_speed == least
    tracks = track(found._replace(sensors=model.sensors), cut(found), model)
    shown = np.flatnonzero(tracks.status == STATUS.index("confirmed"))
    away = np.linalg.norm(
        tracks.x[shown, :2] - slow[(tracks.time[shown] / period).round().astype(int)], axis=1
    )
    assert len(np.unique(tracks.time[shown[away < 10.0]])) > 0.7 * scans


def test_differences_have_the_deviation_of_a_detection_whatever_the_intervals():
    rng = np.random.default_rng(5)
    time = np.cumsum(rng.uniform(1, 2, 3000))
    z = np.stack([3 * time, -2 * time], 1) + rng.normal(0, (4.0, 0.5), (3000, 2))
    z[::50] += 300.0  # of others
    found = from_arrays(time, z)
    away = differences([np.arange(3000)], found, z, 0)
    deviation, factor = deviation_of(away)
    assert len(away) == 2998
    np.testing.assert_allclose(deviation, (4.0, 0.5), rtol=0.12)
    assert 1.0 < factor < 1.1


def test_a_track_exactly_on_a_line_has_innovations_of_zero():
    time = np.arange(12.0)
    z = np.stack([4 * time, -2 * time], 1)
    found = from_arrays(time, z, sensors=[SensorSpec("", deviation=(1.0, 1.0))])
    with np.errstate(all="raise"):
        nis = likelihoods([np.arange(12)], found, z, np.array([[1.0, 0.5]])).nis
    assert (nis == 0).all() and nis.size == 10


def test_settings_are_written_as_track_reads_them_and_what_is_given_is_kept(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = simulated(1)
    rows = [f"{t},{x},{y}" for t, (x, y) in zip(found.time, found.z, strict=True)]
    Path("z.csv").write_text("\n".join(["t_s,east_m,north_m", *rows]))
    columns = ["--time", "t_s", "--x", "east_m", "--y", "north_m", "--detection-probability", "0.8"]
    done = CliRunner().invoke(cli.app, ["inspect", "z.csv", *columns, "--write", "my radar.toml"])
    assert done.exit_code == 0 and "proposed: rests on 5 tracks" in done.output
    assert "track with gmr-gym track z.csv --config 'my radar.toml'" in done.output
    settings = read_configuration("my radar.toml")
    (sensor,) = settings.sensors
    assert settings.columns == {"time": ["t_s"], "x": ["east_m"], "y": ["north_m"]}
    assert sensor.detection_probability == 0.8 and 3.5 < sensor.deviation["x"] < 6.5
    assert settings.target["acceleration_deviation"] == [NOISE]
    done = CliRunner().invoke(cli.app, ["track", "z.csv", "--targets", "many", "--config", "my radar.toml"])
    assert done.exit_code == 0 and Path("tracks.csv").is_file()
    few = "\n".join(Path("z.csv").read_text().splitlines()[:60])
    Path("few.csv").write_text(few)
    words = ["track", "few.csv", "--targets", "many", *columns, "--sensor-deviation", "auto"]
    with pytest.raises(ValueError, match="to propose from"):
        CliRunner().invoke(cli.app, [*words, "--overwrite"], catch_exceptions=False)
