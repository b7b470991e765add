"""Recorded radar as an environment: what is read of the files, what is played of it, what is refused."""

import copy
import shutil
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from radar_files import MOST, PERIOD, SHIPS, place, two_recordings, write_recording

import gmr_gym  # noqa: F401  registers the environments
from gmr_gym.envs.lookup import scenario_of
from gmr_gym.evaluation.set_distances import set_distances
from gmr_gym.recorded.folders import recordings
from gmr_gym.recorded.radar import recorded_radar
from gmr_gym.simulation.multi_target import draw, scan

ID = "gmr_gym/RecordedRadar-v0"


@pytest.fixture
def folder(tmp_path):
    """A copy of the recordings, to be spoilt."""
    return Path(shutil.copytree(two_recordings(), tmp_path / "radar"))


def write_plots(folder, times, name=""):
    """A target that moves east at 10 m/s, in files with columns, and one false alarm a scan."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = [f"{t},{10 * t},{y}" for t in times for y in (0.0, 500.0 + t)]
    (folder / f"{name}plots.csv").write_text("\n".join(["time_s,x_m,y_m", *rows]))
    rows = [f"{t},{10 * t},0,a" for t in range(-5, 50, 5)]
    (folder / f"{name}truth.csv").write_text("\n".join(["time_s,x_m,y_m,id", *rows]))


def test_detections_are_those_of_the_radar_alone_east_and_north():
    long, short = recordings(two_recordings())
    assert (long.name, short.name) == ("long", "short")
    assert len(long.time) == 20 and long.period == pytest.approx(PERIOD)
    counts = np.diff(long.first)
    assert counts[1] == MOST and counts[2] == 0 and counts[3] == 1 and counts[-1] >= 2
    for t in (0, 1, 4, 19):
        ships = long.z[long.first[t] : long.first[t] + 2]
        np.testing.assert_allclose(np.linalg.norm(ships - place(PERIOD * t), axis=1), 3.0, rtol=1e-3)


def test_truth_is_the_ships_own_position_at_every_scan_while_it_is_known():
    scenario = recorded_radar(two_recordings(), "long")
    episode = draw(scenario, 0)
    assert episode.x.shape == (20, 2, 4) and scenario.targets == 2
    for t in range(20):
        ships = np.column_stack([place(PERIOD * t), SHIPS[:, 2:]])
        there = 2 if t <= 5 else 1
        np.testing.assert_allclose(episode.x[t, :there], ships[:there], atol=1e-3)
        assert np.isnan(episode.x[t, there:]).all()


def test_a_detection_near_a_ship_is_taken_for_its_own_and_one_of_each():
    episode = draw(recorded_radar(two_recordings(), "long", cutoff=20.0), 0)
    for t in range(20):
        z, origin = scan(episode, t)
        wanted = [] if t == 2 else [0] if t == 3 or t > 5 else [0, 1]
        assert sorted(origin[origin >= 0]) == wanted
        np.testing.assert_allclose(z[origin == 0] - place(PERIOD * t)[0], 0.0, atol=3.1)
    close = draw(recorded_radar(two_recordings(), "long", cutoff=2.0), 0)
    assert (close.origin == -1).all()


def test_the_seed_chooses_the_recording_and_the_scan_it_begins_with():
    scenario = recorded_radar(two_recordings(), horizon=6)
    begun = set()
    for seed in range(60):
        episode = draw(scenario, seed)
        assert episode.first[0] == 0 and episode.first[-1] == len(episode.z) == len(episode.origin)
        for i, whole in enumerate(scenario.recordings):
            for start in range(len(whole.x) - 5):
                scans = [scan(whole, t) for t in range(start, start + 6)]
                if np.array_equal(episode.z, np.concatenate([z for z, _ in scans])):
                    np.testing.assert_array_equal(episode.x, whole.x[start : start + 6])
                    np.testing.assert_array_equal(np.diff(episode.first), [len(z) for z, _ in scans])
                    begun.add((i, start))
    assert {i for i, _ in begun} == {0, 1} and len(begun) > 8
    assert {start for i, start in begun if i == 0} <= set(range(15)) > {start for i, start in begun if i == 1}
    np.testing.assert_array_equal(draw(scenario, 3).z, draw(scenario, 3).z)


def test_by_default_the_shortest_recording_is_played_whole():
    scenario = recorded_radar(two_recordings())
    assert scenario.horizon == 8 and scenario.period == pytest.approx(PERIOD)
    assert recorded_radar(two_recordings(), "long").horizon == 20
    assert scenario.most_in_scan == MOST and scenario.most >= len(draw(scenario, 0).z)


def test_estimates_are_scored_beside_the_ships_by_the_stated_cutoff():
    env = gym.make(ID, folder=two_recordings(), recording="long", targets=3, cutoff=30.0).unwrapped
    _, info = env.reset(seed=0)
    rows = np.zeros((3, 5))
    rows[0], rows[1] = [1.0, *place(0.0)[0] + [3.0, 4.0], 0, 0], [0.9, 5000.0, 0, 0, 0]
    assert info["present"].all()
    np.testing.assert_allclose(info["truth"][:, :2], place(0.0), atol=1e-3)
    _, reward, _, _, info = env.step(rows)
    assert reward == -info["error"] == pytest.approx(-((25 + 450 + 450) ** 0.5), rel=1e-3)
    parts = [info[part] for part in ("localisation", "missed", "false")]
    assert parts == pytest.approx([25, 450, 450], rel=1e-3)
    worst = gym.make(ID, folder=two_recordings(), recording="long", metric="ospa").unwrapped
    worst.reset(seed=0)
    nobody = np.zeros(worst.action_space.shape)
    assert worst.step(nobody)[1] == -set_distances(np.empty((0, 2)), place(0.0), 50.0, 2.0)[4] == -50


def test_many_at_once_are_as_many_single_ones_bit_for_bit():
    world = {"folder": two_recordings(), "horizon": 5}
    one = gym.make_vec(ID, num_envs=3, vectorization_mode="vector_entry_point", **world)
    other = gym.make_vec(ID, num_envs=3, vectorization_mode="sync", **world)
    one.action_space.seed(1)
    played = [[envs.reset(seed=[1, 2, 3])] for envs in (one, other)]
    for _ in range(7):
        actions = one.action_space.sample()
        for envs, seen in zip((one, other), played, strict=True):
            observation, reward, _, truncated, _ = envs.step(actions)
            seen.append(copy.deepcopy(({**observation, "reward": reward, "over": truncated}, None)))
    for (a, _), (b, _) in zip(*played, strict=True):
        for key in b:
            np.testing.assert_array_equal(a[key], b[key], err_msg=key)


def test_files_with_columns_are_played_and_missing_scans_are_empty(tmp_path):
    write_plots(tmp_path / "bay", [0, 2, 4, 10, 12, 14])
    scenario = scenario_of(ID, {"folder": str(tmp_path / "bay")})
    episode = draw(scenario, 0)
    assert scenario.period == 2 and scenario.horizon == 8 and scenario.targets == 1
    assert [each.name for each in recordings(tmp_path)] == ["bay"]
    np.testing.assert_array_equal(np.diff(episode.first), [2, 2, 2, 0, 0, 2, 2, 2])
    np.testing.assert_allclose(episode.x[:, 0], [[20 * t, 0, 10, 0] for t in range(8)], atol=1e-9)
    box = scenario.clutter(0)
    assert (box.low < 0).all() and (box.high > [140, 514]).all() and np.isnan(box.expected)
    assert scenario.model.clutter.expected == 3


def test_scans_outside_the_time_of_the_truth_are_left_out(tmp_path):
    write_plots(tmp_path, range(-10, 60, 2), "late_")
    (late,) = recordings(tmp_path)
    assert late.name == "late" and len(late.time) == 25  # from -4 to 44 s


def test_births_are_as_likely_anywhere_in_the_box():
    model = recorded_radar(two_recordings(), birth_rate=0.5).model
    low, high = model.clutter.low, model.clutter.high
    at = low + (high - low) * np.random.default_rng(0).uniform(0.2, 0.8, (50, 2))
    away = at[:, None] - model.births.m[:, :2]
    variance = np.array([P[:2, :2].diagonal() for P in model.births.P])
    density = model.births.w * np.exp(-(away**2 / variance).sum(axis=2) / 2)
    density = (density / (2 * np.pi * variance.prod(axis=1) ** 0.5)).sum(axis=1)
    assert model.births.w.sum() == pytest.approx(0.5)
    np.testing.assert_allclose(density, 0.5 / np.prod(high - low), rtol=0.1)


def test_without_files_it_is_said_what_is_wanted_and_where_that_is_had(tmp_path, folder):
    for missing in ({}, {"folder": str(tmp_path / "nowhere")}, {"folder": str(tmp_path)}):
        if missing.get("folder") == str(tmp_path):
            shutil.rmtree(folder)
        with pytest.raises(ValueError, match=r"folder must be .*_detections.json .*/Autoferry/.*") as said:
            gym.make(ID, **missing)
        assert "\n" not in str(said.value)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"recording": "lost"}, "recording must be one of long, short, got 'lost'"),
        ({"horizon": 9}, "horizon must be at most the 8 scans of short, got 9"),
        ({"horizon": 0}, "horizon must be at least 1, got 0"),
        ({"clutter_rate": 0.0}, "clutter_rate must be positive and finite, got 0"),
        ({"detection_probability": 1.5}, r"detection_probability must lie in \(0, 1\], got 1.5"),
        ({"cutoff": "far"}, "cutoff must be a number, got 'far'"),
        ({"foldr": "x"}, "unknown argument 'foldr'; did you mean 'folder'"),
    ],
)
def test_what_cannot_be_is_refused_by_name(wrong, message):
    with pytest.raises(ValueError, match=message):
        gym.make(ID, **{"folder": two_recordings()} | wrong)


def test_recordings_that_do_not_go_together_are_refused_by_their_files(folder):
    def refused(message):
        with pytest.raises(ValueError, match=message):
            recorded_radar(str(folder))

    write_recording(folder / "again", "long", 8)
    refused("recordings of different names, got long twice")
    shutil.rmtree(folder / "again")
    write_plots(folder / "slow", range(0, 50, 10))
    refused("recordings of one period, got 10 s of slow and 2 s of long; choose one with recording")
    write_plots(folder / "slow", [0, 0.01, 0.02, 0.03, 40])
    refused("plots.csv: scans must follow one another evenly, got gaps of up to 40")
    write_plots(folder / "slow", [60, 70])
    refused("plots.csv: two scans at least must be within the time of truth.csv")
    (folder / "slow" / "truth.csv").unlink()
    refused("plots.csv: where its targets were must be in truth.csv, which is not there")
