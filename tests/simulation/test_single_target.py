"""The world: chance is drawn once, from streams of its own, with the rates it states."""

import dataclasses
from itertools import product

import numpy as np
import pytest
from scipy.stats import chisquare, kstest

from gmr_gym.scenarios.dortenzio import printed_path, turning_target
from gmr_gym.scenarios.li import airborne_radar
from gmr_gym.scenarios.planar import fixed_box, path
from gmr_gym.scenarios.recorded import recorded_flight
from gmr_gym.scenarios.zhang import jump_markov
from gmr_gym.simulation.scans import CELL, ground_into, scan_into
from gmr_gym.simulation.single_target import capacity, draw, scan, view_of

NOWHERE = np.zeros(2)
LOW, HIGH = np.array([[-3100.0, 950.0], [6900.0, 19_950.0]])  # corners of a region of 10 km by 19 km


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
    a, b = (scan(scenario, episode, 0, NOWHERE).z for episode in (first, other))
    assert not np.isin(a, b).any()


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
    less_seen = draw(turning_target(detection_probability=0.3), 3)
    np.testing.assert_array_equal(base.z, less_seen.z)
    assert (less_seen.detected <= base.detected).all()  # the same numbers under a lower bar
    for t in range(100):
        given, denser, darker = (
            clutter_of(scan(scenario, episode, t, NOWHERE))
            for scenario, episode in (
                (turning_target(), base),
                (turning_target(clutter_rate=300), more_clutter),
                (turning_target(detection_probability=0.3), less_seen),
            )
        )
        np.testing.assert_array_equal(given, darker)
        assert len(denser) > 1.3 * len(given)  # seeded: 300 a scan for 150


def test_a_scan_is_the_same_whichever_were_made_before_it():
    for scenario in (turning_target(), jump_markov(), airborne_radar()):
        episode = draw(scenario, 8)
        centre = scenario.sensor.measure(episode.x[20])
        in_turn = [scan(scenario, episode, t, centre) for t in range(40)]
        for t in (39, 3, 20):
            for a, b in zip(scan(scenario, draw(scenario, 8), t, centre), in_turn[t], strict=True):
                np.testing.assert_array_equal(a, b)


def test_a_scan_is_made_in_place_and_leaves_the_rows_behind_it_as_they_are():
    scenario = turning_target(clutter_rate=3.0)
    episode, view = draw(scenario, 2), view_of(scenario)
    for t in range(100):
        z = np.full((capacity(3.0), 2), np.nan)
        k, place = scan_into(
            z, view, episode.key, t, NOWHERE, episode.z[t], episode.detected[t], episode.slot[t]
        )
        same = scan(scenario, episode, t, NOWHERE)
        np.testing.assert_array_equal(z[:k], same.z)
        assert np.isnan(z[k:]).all() and k == len(same.z)
        assert np.flatnonzero(same.origin == 0).tolist() == ([] if place < 0 else [place])


def test_a_scan_holds_no_more_than_it_has_room_for():
    scenario = turning_target(clutter_rate=30.0, detection_probability=1.0)
    scenarios = scenario, dataclasses.replace(scenario, region=scenario.window)
    for scenario in scenarios:
        episode, z = draw(scenario, 0), np.full((6, 2), np.nan)
        args = episode.key, 0, NOWHERE, episode.z[0], True, 0.0
        assert scan_into(z[:5], view_of(scenario), *args) == (5, 0)
        assert np.isnan(z[5]).all() and not np.isnan(z[:5]).any()


def clutter_of(seen):
    """Clutter in the order of its coordinates: the point in whose place the target stands is the last."""
    z = seen.z[seen.origin < 0]
    return z[np.lexsort(z.T)]


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
        clutter = clutter_of(here)
        assert (np.abs(clutter) <= [100, 30]).all()
        assert (there.origin < 0).all()  # the target is out of the window
        np.testing.assert_allclose(clutter_of(there) - far, clutter, atol=1e-10)  # rounding at 3e4


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


def grounded(window=(1000.0, 1000.0), density=1e-4, high=HIGH, seed=0, scans=20, at=None):
    """A target that stands still at `at`, or is never seen, and clutter on the ground of a region."""
    chance = 1e-12 if at is None else 1.0
    path = np.tile(NOWHERE if at is None else at, (scans, 1)).astype(float)
    scenario = turning_target(
        clutter_density=density, window=window, trajectory=path, detection_probability=chance
    )
    scenario = dataclasses.replace(scenario, region=fixed_box(LOW, high))
    return scenario, draw(scenario, seed)


def points(world, t, centre, low=(-np.inf, -np.inf), high=(np.inf, np.inf)):
    """The clutter of scan t between low and high, in the order of its coordinates."""
    z = scan(*world, t, np.asarray(centre, float)).z
    z = z[((low <= z) & (z <= high)).all(axis=1)]
    return z[np.lexsort(z.T)]


def test_clutter_on_the_ground_is_the_same_for_all_who_look_there():
    rng = np.random.default_rng(1)
    for t in range(20):
        a, b = rng.uniform(LOW + 2000, LOW + 5000, (2, 2))
        sides = np.array([1000.0, 1000.0]), rng.uniform(100, 3000, 2)
        b = b if t % 2 else a + rng.uniform(-500, 500, 2)  # half of the pairs are sure to overlap
        low = np.maximum(a - sides[0] / 2, b - sides[1] / 2)
        high = np.minimum(a + sides[0] / 2, b + sides[1] / 2)
        seen = [points(grounded(window=s), t, c, low, high) for s, c in zip(sides, (a, b), strict=True)]
        np.testing.assert_array_equal(*seen)
        assert t % 2 or len(seen[0]) > 0


def test_a_larger_region_about_the_same_corner_has_the_same_clutter():
    small, large, centre = grounded(high=LOW + 1500), grounded(), LOW + np.array([800, 400])
    for t in range(5):
        a, b = (points(world, t, centre) for world in (small, large))
        np.testing.assert_array_equal(a, b)
        assert len(a) > 50


def test_clutter_on_the_ground_differs_between_scans_seeds_and_squares():
    worlds = (grounded(window=HIGH - LOW, density=8e-6, seed=seed) for seed in (0, 1))
    z = np.concatenate([points(world, t, (LOW + HIGH) / 2) for world in worlds for t in range(4)])
    assert len(z) > 10_000
    # a square that took the stream of another would have its points in the same places
    places = np.round((z - LOW) % CELL, 6)  # 1e-6 m is far above rounding; two alike by chance: 3e-10
    assert len(np.unique(places, axis=0)) == len(z)


def test_clutter_on_the_ground_is_a_poisson_process():
    world = grounded(window=HIGH - LOW, density=8e-6, scans=30)  # 2 points a square
    z = [points(world, t, (LOW + HIGH) / 2) for t in range(30)]
    edges = [np.arange(low, high + CELL, CELL) for low, high in zip(LOW, HIGH, strict=True)]
    counts = np.array([np.histogram2d(*scanned.T, bins=edges)[0] for scanned in z])
    n = counts.size
    assert n == 30 * 20 * 38 and counts.sum() == sum(map(len, z))
    # five standard errors: a Poisson count of mean 2 has variance 2, its variance (2 + 2 * 4) / n
    assert abs(counts.mean() - 2) < 5 * np.sqrt(2 / n)
    assert abs(counts.var() - 2) < 5 * np.sqrt(10 / n)
    off = counts - 2
    # and knows nothing of the same square a scan ago, nor of the squares beside it
    for pair in (off[1:] * off[:-1], off[:, 1:] * off[:, :-1], off[:, :, 1:] * off[:, :, :-1]):
        assert abs(pair.mean()) < 5 * 2 / np.sqrt(pair.size)
    places = np.concatenate(z) - LOW
    for at, sides in ((places, HIGH - LOW), (places % CELL, (CELL, CELL))):
        for bins in (6, (10, 1), (1, 10)):
            cells = np.histogram2d(*at.T, bins=bins, range=[(0, side) for side in sides])[0]
            assert chisquare(cells.ravel()).pvalue > 1e-4  # seeded: it fails for good or not at all


def test_a_window_off_the_grid_sees_as_much_clutter_as_its_area_holds():
    world = grounded(window=(700.0, 300.0), scans=2000)
    rng = np.random.default_rng(2)
    centres = rng.uniform(LOW + 400, HIGH - 400, (2000, 2))
    z = [points(world, t, centre) for t, centre in enumerate(centres)]
    counts = np.array([len(scanned) for scanned in z])
    assert abs(counts.mean() - 21) < 5 * np.sqrt(21 / 2000)  # standard errors, as above
    assert abs(counts.var() - 21) < 5 * np.sqrt((21 + 2 * 21**2) / 2000)
    at = np.concatenate([scanned - centre for scanned, centre in zip(z, centres, strict=True)])
    assert (np.abs(at) <= [350, 150]).all()
    cells = np.histogram2d(*at.T, bins=6, range=[(-350, 350), (-150, 150)])[0]
    assert chisquare(cells.ravel()).pvalue > 1e-4


def test_there_is_clutter_up_to_the_edge_of_the_region_and_none_beyond():
    corners = LOW, HIGH, np.array([LOW[0], HIGH[1]])
    for t, (corner, inward) in enumerate(product(corners, (0, 200, -200))):
        z = points(grounded(density=1e-3), t, corner + inward)
        low, high = np.maximum(LOW, corner + inward - 500), np.minimum(HIGH, corner + inward + 500)
        assert ((low <= z) & (z <= high)).all()
        expected = 1e-3 * np.prod(high - low)
        assert abs(len(z) - expected) < 5 * np.sqrt(expected)
        # it is what a window sees that lies inside
        inside = np.clip(corner, LOW + 1500, HIGH - 1500)
        np.testing.assert_array_equal(z, points(grounded((3000.0, 3000.0), 1e-3), t, inside, low, high))


def test_the_order_of_a_scan_says_nothing_of_the_target():
    # were the points in the order of the squares they are drawn by, the target's would stand out
    scenario = jump_markov()
    ranks, sorted_but_one = [], 0
    for seed in range(10):
        episode = draw(scenario, seed)
        for t in range(len(episode.x)):
            seen = scan(scenario, episode, t, episode.x[t, :2] + 150.0)
            at = int(np.flatnonzero(seen.origin == 0)[0])
            ranks.append(at / (len(seen.z) - 1))
            square = (np.delete(seen.z, at, axis=0) - scenario.region.low) // CELL
            order = square[:, 0] * 1000 + square[:, 1]
            sorted_but_one += (np.diff(order) >= 0).all()
    assert sorted_but_one == 0
    # 450 places, uniform: Kolmogorov and Smirnov's test at one in a thousand
    assert kstest(ranks, "uniform").pvalue > 1e-3


@pytest.mark.parametrize(
    "centre", [(-3700, 5000), (7500, 5000), (2000, 400), (2000, 20_500), (-3700, 400), (4e7, -4e7)]
)
def test_a_window_outside_the_region_sees_nothing(centre):
    z, origin = scan(*grounded(at=np.clip(centre, -1e5, 1e5)), 0, np.array(centre, float))
    assert z.shape == (0, 2) and origin.shape == (0,)


def test_the_target_is_seen_inside_window_and_region_only():
    # 60 m to the nearest edge is nearly eight deviations of the detection
    for offset, sees in ((300, True), ([440, 60], True), ([560, 60], False), ([300, -60], False)):
        world = grounded(at=LOW + offset)
        for t in range(20):
            z, origin = scan(*world, t, LOW)
            assert (origin == 0).sum() == sees
            if sees:
                np.testing.assert_array_equal(z[origin == 0], world[1].z[t : t + 1])


def test_only_the_squares_under_the_window_are_drawn(monkeypatch):
    squares = []

    def counting(rate, key, stream, at):
        squares.append(at[1:])
        return 0

    monkeypatch.setattr("gmr_gym.simulation.scans.poisson", counting)
    plain = getattr(ground_into, "py_func", ground_into)  # as it reads, not as it was compiled
    for kilometres in (10, 1000):
        scenario, episode = grounded(high=LOW + 1000 * kilometres)
        for t, centre in enumerate(LOW + 2000 + np.random.default_rng(3).uniform(0, 500, (20, 2))):
            squares.clear()
            plain(np.empty((500, 2)), view_of(scenario), episode.key, t, centre, 0.5)
            assert 4 <= len(set(squares)) == len(squares) <= 9  # a side of 1000 m meets two squares, or three
    squares.clear()
    plain(np.empty((500, 2)), view_of(scenario), episode.key, 0, LOW - 5000, 0.5)
    assert not squares


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
