"""Many targets in a square: where they cross, how they move, and what the sensor sees where."""

from dataclasses import replace

import numpy as np
import pytest

from gmr_gym.scenarios.crossing import crossing_targets
from gmr_gym.scenarios.dense import dense_targets
from gmr_gym.scenarios.manoeuvring import manoeuvring_targets
from gmr_gym.simulation.multi_target import draw
from gmr_gym.simulation.shadows import shadowed

EVERY = [crossing_targets, dense_targets, manoeuvring_targets]


def paths(scenario, seed=0):
    return scenario.truth(np.random.default_rng(seed))


@pytest.mark.parametrize(("spacing", "angle"), [(0.0, 0.35), (30.0, 0.1), (12.0, np.pi)])
def test_two_targets_pass_each_other_at_the_spacing_and_the_angle(spacing, angle):
    x = paths(crossing_targets(2, spacing, angle))
    apart = np.linalg.norm(x[:, 0, :2] - x[:, 1, :2], axis=1)
    assert apart.argmin() == 30 and apart.min() == pytest.approx(spacing, abs=1e-9)
    one, other = x[0, :, 2:] / 10.0
    assert np.arccos(np.clip(one @ other, -1, 1)) == pytest.approx(angle, abs=1e-6)
    np.testing.assert_allclose(np.diff(x[:, :, :2], axis=0), x[1:, :, 2:], atol=1e-9)


def test_without_an_angle_they_fly_in_line():
    x = paths(crossing_targets(5, 20.0, 0.0))
    gaps = np.diff(x[:, :, :2], axis=1)
    np.testing.assert_allclose(np.linalg.norm(gaps, axis=2), 20.0)
    np.testing.assert_allclose(gaps / 20.0, x[:, 1:, 2:] / 10.0, atol=1e-9)
    assert (paths(crossing_targets(5), 1) != paths(crossing_targets(5), 2)).any()


@pytest.mark.parametrize("make", [dense_targets, manoeuvring_targets])
def test_a_target_is_there_once_and_halfway_and_within_the_square(make):
    x = paths(make(200))
    there = ~np.isnan(x[:, :, 0])
    assert there[50].all() and not there.all()
    assert (np.abs(np.diff(there.astype(int), axis=0)).sum(axis=0) <= 2).all()
    assert np.nanmax(np.abs(x[:, :, :2])) <= 500.0


def test_targets_turn_at_the_rate_and_as_seldom_as_they_are_told():
    scenario = manoeuvring_targets(1000, turn_rate=0.3, stay=0.9)
    # about the scan at which all are in the square, whichever way they fly
    x = np.concatenate([paths(scenario, seed)[48:53] for seed in range(8)], axis=1)
    x = x[:, np.linalg.norm(x[2, :, 2:], axis=-1) > 6.0]  # so that the noise is no turn
    heading = np.arctan2(x[..., 3], x[..., 2])
    turn = (np.diff(heading, axis=0) + np.pi) % (2 * np.pi) - np.pi
    turn = turn[:, np.isfinite(turn).all(axis=0)]
    mode, n = np.rint(turn / 0.3), turn.shape[1]
    assert 0.005 < (turn - 0.3 * mode).std() < 0.02
    changed = (mode[1:] != mode[:-1]).mean()
    assert n > 5000 and abs(changed - 0.1) < 5 * np.sqrt(0.09 / (3 * n))
    for which in (-1, 0, 1):
        assert abs((mode[0] == which).mean() - 1 / 3) < 5 * np.sqrt(2 / 9 / n)


def test_the_sensor_sees_less_in_a_shadow_and_the_filter_model_does_not_know():
    still = np.zeros((3000, 2, 4))
    still[:, 1, 0] = 200.0
    scenario = crossing_targets(trajectory=still, shadows=[((200, 0), 50, 0.3), ((190, 0), 50, 0.6)])
    episode = draw(scenario, 0)
    for target, p in ((0, 0.9), (1, 0.3)):
        share = (episode.origin == target).sum() / 3000
        assert abs(share - p) < 5 * np.sqrt(p * (1 - p) / 3000)
    assert scenario.model.detection_probability == 0.9
    without = draw(replace(scenario, detection_probability=0.9), 0)
    np.testing.assert_array_equal(episode.x, without.x)
    false = [one.z[one.origin == -1] for one in (episode, without)]
    np.testing.assert_array_equal(np.sort(false[0], axis=0), np.sort(false[1], axis=0))


def test_in_a_hot_spot_there_is_more_clutter_and_trackers_spread_it():
    scenario = crossing_targets(clutter_rate=5.0, hot_spots=[(30.0, (100.0, -100.0), 20.0)])
    episode = draw(scenario, 3)
    near = np.linalg.norm(episode.z - [100.0, -100.0], axis=1) < 100.0
    assert abs((near & (episode.origin == -1)).sum() / 61 - 30.0) < 5 * np.sqrt(30.2 / 61)
    assumed = scenario.model.clutter
    assert assumed.uniform == 35.0 and not len(assumed.gaussians.w)


def test_a_tracker_that_is_told_assumes_what_is_true():
    scenario = dense_targets(shadows=[((0, 0), 50, 0.3)], hot_spots=[(30.0, (9.0, 9.0), 20.0)], told="true")
    assert scenario.model.clutter.density(np.full((1, 2), 9.0)) == scenario.clutter(0).density(
        np.full((1, 2), 9.0)
    )
    np.testing.assert_array_equal(
        scenario.model.detected(np.array([[0, 1, 0, 0], [99, 0, 0, 0]])), [0.3, 0.9]
    )


def test_the_filter_model_of_manoeuvring_targets_has_their_motions_unless_it_is_to_have_one():
    model = manoeuvring_targets(turn_rate=0.2, stay=0.8).model
    assert len(model.motions) == 3 and model.switching[0].tolist() == pytest.approx([0.8, 0.1, 0.1])
    assert len(manoeuvring_targets(modes=False).model.motions) == 1


@pytest.mark.parametrize("make", EVERY)
def test_a_trajectory_takes_the_place_of_the_drawn(make):
    x = np.full((7, 2, 4), 3.0)
    x[:3, 1] = np.nan
    scenario = make(trajectory=np.ma.masked_invalid(x), horizon=5)
    np.testing.assert_array_equal(paths(scenario), x[:5])
    assert (scenario.targets, scenario.horizon) == (2, 5)


@pytest.mark.parametrize("make", EVERY)
@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"n": 0}, "n must be at least 1, got 0"),
        ({"n": 1001}, "n must be at most 1000 targets, got 1001"),
        ({"clutter_rate": 0}, "clutter_rate must be positive"),
        ({"sensor_deviation": -1}, "sensor_deviation must be positive and finite, got -1"),
        ({"detection_probability": 1.5}, "detection_probability must lie in"),
        ({"shadows": [(0, 0, 3)]}, r"shadows must be \(\(x, y\), radius, probability\) each"),
        ({"shadows": [((0, 0), 3, 1.5)]}, "shadows must have a finite centre, a positive radius and a prob"),
        ({"hot_spots": 3}, r"hot_spots must be \(false alarms a scan, \(x, y\), deviation\) each, got 3"),
        ({"hot_spots": [(1, (0, 0), 0)]}, "hot_spots must be of positive rates at finite places"),
        ({"trajectory": [[[1, 2, 3]]]}, r"trajectory must have shape \(T, m, 4\), got \(1, 1, 3\)"),
        ({"told": "nothing"}, "told must be one of uniform, true, got 'nothing'"),
        ({"horizon": 0}, "horizon must be between 1"),
    ],
)
def test_a_wrong_setting_is_named(make, wrong, message):
    with pytest.raises(ValueError, match=message):
        make(**wrong)


@pytest.mark.parametrize(
    ("make", "wrong", "message"),
    [
        (crossing_targets, {"angle": 4.0}, "angle must lie between 0 and 3.142, got 4"),
        (crossing_targets, {"spacing": -1.0}, "spacing must lie between 0"),
        (crossing_targets, {"speed": 20.0}, "within 500 m of the middle, which they leave by 100 m"),
        (dense_targets, {"speed": 0.0}, "speed must be positive and at most 1000 m/s, got 0"),
        (manoeuvring_targets, {"turn_rate": 2.0}, "turn_rate must be positive and at most 1 rad/s, got 2"),
        (manoeuvring_targets, {"stay": -0.1}, "stay must be a probability, got -0.1"),
    ],
)
def test_so_is_a_setting_of_one_scenario(make, wrong, message):
    with pytest.raises(ValueError, match=message):
        make(**wrong)


def test_a_shadow_of_nothing_is_a_number():
    assert shadowed(1, ()) == 1.0
