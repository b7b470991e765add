"""The world: chance is drawn once, from streams of its own, with the rates it states."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import chisquare

from gmr_gym.scenarios.dortenzio import printed_path, turning_target
from gmr_gym.scenarios.planar import path
from gmr_gym.scenarios.recorded import recorded_flight
from gmr_gym.simulate import draw, scan

NOWHERE = np.zeros(2)


def long_episode(seed=0, scans=20_000, **kwargs):
    """Twenty thousand scans of a target that stands still in a box."""
    scenario = turning_target(trajectory=np.zeros((scans, 2)), **{"box": ((-90, -90), (110, 110))} | kwargs)
    return scenario, draw(scenario, seed)


def test_same_seed_same_episode_and_another_seed_another():
    scenario = turning_target()
    first, again, other = (draw(scenario, seed) for seed in (1, 1, 2))
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(first.z, other.z) and not np.array_equal(first.detected, other.detected)
    assert not np.array_equal(first.clutter[:50], other.clutter[:50])


def test_a_seed_sequence_drawn_from_twice_gives_the_same_episode_and_its_children_others():
    scenario, sequence = turning_target(), np.random.SeedSequence(5)
    first, again, plain = draw(scenario, sequence), draw(scenario, sequence), draw(scenario, 5)
    child = draw(scenario, np.random.SeedSequence(5, spawn_key=(0,)))
    for a, b, c in zip(first, again, plain, strict=True):
        np.testing.assert_array_equal(a, b)
        np.testing.assert_array_equal(a, c)
    assert not np.array_equal(first.z, child.z)


def test_truth_detection_and_clutter_have_streams_of_their_own():
    base = draw(turning_target(), 3)
    more_clutter = draw(turning_target(clutter_rate=300), 3)
    np.testing.assert_array_equal(base.z, more_clutter.z)
    np.testing.assert_array_equal(base.detected, more_clutter.detected)
    np.testing.assert_array_equal(base.slot, more_clutter.slot)
    assert len(more_clutter.clutter) > 1.5 * len(base.clutter)
    less_seen = draw(turning_target(detection_probability=0.3), 3)
    np.testing.assert_array_equal(base.z, less_seen.z)
    np.testing.assert_array_equal(base.clutter, less_seen.clutter)
    assert (less_seen.detected <= base.detected).all()  # the same numbers under a lower bar


def test_detections_come_at_their_rate_with_the_worlds_own_noise():
    scenario, episode = long_episode(sensor_deviation=5.0, told_sensor_deviation=50.0)
    T = scenario.horizon
    assert abs(episode.detected.mean() - 0.9) < 5 * np.sqrt(0.9 * 0.1 / T)  # standard errors of a share
    noise = episode.z - episode.x[:, :2]
    np.testing.assert_allclose(noise.mean(axis=0), 0, atol=5 * 5 / np.sqrt(T))
    # 25 m^2 with five standard errors of a variance, 25 sqrt(2 / T)
    np.testing.assert_allclose(np.cov(noise.T), 25 * np.eye(2), atol=5 * 25 * np.sqrt(2 / T))


def test_clutter_is_poisson_and_uniform_in_the_box():
    scenario, episode = long_episode(clutter_rate=4.0)
    T = scenario.horizon
    scans = [scan(scenario, episode, t, NOWHERE) for t in range(T)]
    counts = np.array([(s.origin < 0).sum() for s in scans])
    assert abs(counts.mean() - 4) < 5 * np.sqrt(4 / T)
    # the variance of a Poisson count's variance is (4 + 2 * 16) / T
    assert abs(counts.var() - 4) < 5 * np.sqrt(36 / T)
    points = np.concatenate([s.z[s.origin < 0] for s in scans])
    assert (points >= -90).all() and (points <= 110).all()
    cells = np.histogram2d(*points.T, bins=8, range=[(-90, 110)] * 2)[0]
    assert chisquare(cells.ravel()).pvalue > 1e-4  # seeded: it fails for good or not at all


def test_density_times_area_is_the_rate():
    box = ((0, 0), (40, 50))
    by_density = turning_target(clutter_density=0.01, box=box)
    by_rate = turning_target(clutter_rate=20, box=box)
    assert by_density.clutter_rate == 20
    assert by_rate.model.clutter_density == 0.01


def test_targets_detection_stands_anywhere_in_the_scan():
    scenario, episode = long_episode(clutter_rate=4.0)
    places, hits = [], 0
    for t in range(scenario.horizon):
        z, origin = scan(scenario, episode, t, NOWHERE)
        assert (origin == 0).sum() == episode.detected[t] and set(origin) <= {0, -1}
        if episode.detected[t]:
            hits += 1
            (place,) = np.flatnonzero(origin == 0)
            np.testing.assert_array_equal(z[place], episode.z[t])
            if len(z) == 5:
                places.append(place)
    assert hits > 0.8 * scenario.horizon
    assert chisquare(np.bincount(places, minlength=5)).pvalue > 1e-4


def test_window_that_follows_carries_the_same_points_to_any_centre():
    scenario, episode = long_episode(scans=500, box=None, window=(200.0, 60.0), clutter_rate=10.0)
    far = np.array([1e4, -3e4])
    for t in range(500):
        here, there = scan(scenario, episode, t, NOWHERE), scan(scenario, episode, t, far)
        clutter = here.z[here.origin < 0]
        assert (np.abs(clutter) <= [100, 30]).all()
        assert (there.origin < 0).all()  # the target is out of the window
        np.testing.assert_allclose(there.z - far, clutter, atol=1e-10)  # rounding at 3e4


def test_detection_outside_a_window_is_not_seen_and_outside_the_papers_own_box_it_is():
    scenario, episode = long_episode(scans=500, box=None, window=(20.0, 20.0), detection_probability=1.0)
    for t in range(500):
        inside = (np.abs(episode.z[t]) <= 10).all()
        assert (scan(scenario, episode, t, NOWHERE).origin == 0).any() == inside
    assert 0 < sum((np.abs(z) <= 10).all() for z in episode.z) < 500
    beside, episode = long_episode(scans=500, box=((0, -100), (100, 100)), detection_probability=1.0)
    seen = [(scan(beside, episode, t, NOWHERE).origin == 0).any() for t in range(500)]
    assert seen == [z[0] >= 0 for z in episode.z]
    paper = turning_target(detection_probability=1.0)
    episode = draw(paper, 0)
    assert all((scan(paper, episode, t, NOWHERE).origin == 0).any() for t in range(100))
    assert ((episode.z < paper.window.low) | (episode.z > paper.window.high)).any()


def test_following_window_is_centred_on_the_estimate_carried_forward_one_period():
    scenario = recorded_flight()
    np.testing.assert_array_equal(scenario.centre(np.array([10.0, 20, 3, -4])), [13, 16])
    offset = scenario.model.motions[0]._replace(offset=np.array([100.0, 0, 0, 0]))
    pushed = dataclasses.replace(scenario, model=scenario.model._replace(motions=(offset,)))
    np.testing.assert_array_equal(pushed.centre(np.zeros(4)), [100, 0])


def test_turning_target_flies_the_papers_path():
    position, velocity, states = np.array([0.0, 0.0]), np.array([10.0, -10.0]), []
    for t in range(100):
        u = np.array((0.2, 0.6) if t < 50 else (0.0, -2.0) if t < 75 else (-3.0, 1.0))
        position, velocity = position + velocity + u / 2, velocity + u
        states.append(np.concatenate((position, velocity)))
    np.testing.assert_allclose(printed_path(), states, rtol=1e-12, atol=1e-9)
    scenario = turning_target()
    assert scenario.horizon == 100 and scenario.clutter_rate == 150
    np.testing.assert_allclose(scenario.window.high - scenario.window.low, [1316.5, 662.5], atol=1e-9)
    # what the filter is told: deviations 3 m/s^2 and sqrt(70) m, where the world has sqrt(60) m
    told = scenario.model
    assert told.sensor.R[0, 0] == pytest.approx(70) and scenario.sensor.R[0, 0] == pytest.approx(60)
    assert told.motions[0].Q[2, 2] == pytest.approx(9)
    np.testing.assert_array_equal(told.prior.m, [[0, 0, 10, -10]])
    np.testing.assert_array_equal(told.prior.P, [np.eye(4)])
    assert told.detection_probability == 0.9 == scenario.detection_probability


def test_path_takes_velocities_from_central_differences_and_starts_one_period_before():
    t = np.arange(0, 20, 0.5)
    parabola = np.stack([t**2, 3 * t], axis=1)
    x, start = path(parabola, 0.5)
    np.testing.assert_allclose(x[1:-1, 2:], np.stack([2 * t, np.full(40, 3.0)], 1)[1:-1], atol=1e-9)
    np.testing.assert_array_equal(x[:, :2], parabola)
    np.testing.assert_allclose(start[:2], x[0, :2] - 0.5 * x[0, 2:])
    given, _ = path(np.hstack([parabola, parabola]), 0.5)
    np.testing.assert_array_equal(given, np.hstack([parabola, parabola]))


def test_a_straight_path_along_an_axis_is_a_trajectory_too():
    east = np.stack([10.0 * np.arange(30), np.zeros(30)], axis=1)
    scenario = turning_target(trajectory=east)
    assert scenario.horizon == 30 and scenario.window.volume > 0
