"""The world of many targets: its clutter, its targets and its scans do what they state."""

import json
import pickle
import warnings
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from scipy.stats import chisquare, poisson

import gmr_gym  # noqa: F401  registers the environments
from gmr_gym.evaluation.metrics import gospa, ospa
from gmr_gym.mixture import mixture
from gmr_gym.models.clutter import Clutter, no_components, uniform_clutter
from gmr_gym.models.motions import constant_acceleration
from gmr_gym.scenarios.lv import GROUPS, three_targets, unknown_clutter
from gmr_gym.simulation.multi_target import draw, draw_clutter, scan

ID = "gmr_gym/UnknownClutter-v0"
BOX = np.array([[-100.0, -60.0], [140.0, 100.0]])
ASLANT = np.array([[900.0, 400.0], [400.0, 600.0]])


def mixed(**parts):
    """Uniform, Gaussian and elliptic clutter in a small box, some reaching out; parts replace its own."""
    whole = Clutter(
        *BOX,
        uniform=20.0,
        gaussians=mixture([15.0, 6.0], [[0.0, 0.0], [135.0, 60.0]], [ASLANT, 100 * np.eye(2)]),
        ellipses=mixture([12.0, 5.0], [[40.0, 30.0], [-95.0, -50.0]], [3 * ASLANT, np.diag([900.0, 400.0])]),
    )
    return whole._replace(**parts)


def on_grid(clutter, low, high, cells=800):
    """Centres of a grid's cells (cells, cells, p) between two corners and their area."""
    sides = [a + (b - a) * (np.arange(cells) + 0.5) / cells for a, b in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1)
    density = clutter.density(grid.reshape(-1, 2)).reshape(cells, cells)
    return density, np.prod((np.array(high) - low) / cells)


def clutter_of(episode):
    return episode.z[episode.origin < 0]


@pytest.mark.parametrize(
    "parts",
    [
        {"gaussians": no_components(2), "ellipses": no_components(2)},
        {"uniform": 1e-9, "ellipses": no_components(2)},
        {"uniform": 1e-9, "gaussians": no_components(2)},
        {},
    ],
    ids=["uniform", "gaussians", "ellipses", "all"],
)
def test_sampled_clutter_has_the_density_that_is_stated(parts):
    clutter, rng = mixed(**parts), np.random.default_rng(0)
    scans = 4_000
    z = np.concatenate([draw_clutter(clutter, rng) for _ in range(scans)])
    density, area = on_grid(clutter, *BOX)
    cells = 16
    wanted = scans * area * density.reshape(cells, 50, cells, 50).sum(axis=(1, 3))
    counts = np.histogram2d(*z.T, bins=cells, range=BOX.T)[0]
    assert counts.sum() == len(z)  # none outside the box
    often = wanted > 5
    # Poisson cells, those of few points pooled
    got = np.append(counts[often], counts[~often].sum())
    wanted = np.append(wanted[often], wanted[~often].sum())
    got, wanted = got[wanted > 5], wanted[wanted > 5]
    assert abs(got.sum() - wanted.sum()) < 5 * np.sqrt(wanted.sum())
    assert chisquare(got, wanted * got.sum() / wanted.sum()).pvalue > 1e-4  # seeded


def test_number_of_false_detections_is_poisson():
    clutter, rng = mixed(), np.random.default_rng(1)
    within, area = on_grid(clutter, *BOX)
    expected = within.sum() * area
    counts = np.array([len(draw_clutter(clutter, rng)) for _ in range(20_000)])
    assert abs(counts.mean() - expected) < 5 * np.sqrt(expected / 20_000)
    assert abs(counts.var() - expected) < 5 * np.sqrt((expected + 2 * expected**2) / 20_000)
    assert expected < clutter.expected - 3  # what reaches out is not seen


def test_density_of_the_groups_integrates_to_what_is_expected_of_them():
    clutter = mixed()._replace(uniform=0.0)
    density, area = on_grid(clutter, [-300, -300], [300, 300], 1500)
    assert density.sum() * area == pytest.approx(clutter.expected, rel=1e-3)  # edges of ellipses on a grid
    assert clutter.expected == pytest.approx(38)


@pytest.mark.parametrize("control", ["groups", "uniform", "dense"])
def test_density_of_the_scenarios_clutter_integrates_to_what_is_expected_in_the_box(control):
    clutter = unknown_clutter(clutter=control).clutter(0)
    density, area = on_grid(clutter, clutter.low, clutter.high, 1000)
    assert density.sum() * area == pytest.approx(clutter.expected, rel=1e-3)
    assert clutter.expected == pytest.approx(155 if control == "dense" else 50)


def test_groups_of_the_scenario_are_table_1():
    clutter = unknown_clutter().clutter(0)
    assert clutter.uniform == pytest.approx(15)
    np.testing.assert_allclose(clutter.gaussians.w, [7.5, 5, 5])
    np.testing.assert_allclose(clutter.ellipses.w, [7.5, 5, 5])
    np.testing.assert_array_equal(clutter.ellipses.m, [[400, 200], [-200, 400], [200, -200]])
    rng = np.random.default_rng(0)
    for (_, centre, axes), m, P in zip(GROUPS, clutter.gaussians.m, clutter.gaussians.P, strict=True):
        z = rng.multivariate_normal(m, P, 20_000)
        share = ((((z - centre) / axes) ** 2).sum(axis=1) <= 1).mean()
        assert abs(share - 0.95) < 5 * np.sqrt(0.95 * 0.05 / 20_000)
    denser = unknown_clutter(clutter="dense").clutter(0)
    assert denser.uniform == clutter.uniform
    np.testing.assert_allclose(denser.gaussians.w, 4 * clutter.gaussians.w)
    np.testing.assert_allclose(unknown_clutter(group_density=4).clutter(0).ellipses.w, denser.ellipses.w)


def test_clutter_seen_in_the_scenario_lies_in_its_groups():
    z = np.concatenate([clutter_of(draw(unknown_clutter(), seed)) for seed in range(30)])
    assert abs(len(z) - 150_000) < 5 * np.sqrt(150_000)
    for share, centre, axes in GROUPS:
        within = ((((z - centre) / axes) ** 2).sum(axis=1) <= 1).mean()
        # a half and 95 % of the other, and of the uniform clutter what lies there
        wanted = share * 0.975 + 0.3 * np.pi * np.prod(axes) / 4e6
        # the neighbours' tails reach in by a little
        assert -5 * np.sqrt(wanted / len(z)) < within - wanted < 0.003


def test_control_without_groups_is_uniform():
    z = clutter_of(draw(unknown_clutter(clutter="uniform", horizon=100), 0))
    assert abs(len(z) - 5000) < 5 * np.sqrt(5000)
    cells = np.histogram2d(*z.T, bins=8, range=[(-1000, 1000)] * 2)[0]
    assert chisquare(cells.ravel()).pvalue > 1e-4


def test_drifting_groups_are_where_they_are_said_to_be():
    drifting = ((0.7, (-500.0, 0.0), (50.0, 80.0), (10.0, -3.0)),)
    scenario = unknown_clutter(groups=drifting, clutter_rate=400, detection_probability=1e-12)
    episode = draw(scenario, 0)
    for t in (0, 40, 99):
        centre = np.array([-500.0 + 10 * t, -3.0 * t])
        clutter = scenario.clutter(t)
        for part in (clutter.gaussians, clutter.ellipses):
            np.testing.assert_allclose(part.m, [centre])
        z = scan(episode, t).z
        near = z[(((z - centre) / [50, 80]) ** 2).sum(axis=1) < 2]
        assert len(near) > 200
        np.testing.assert_allclose(near.mean(axis=0), centre, atol=5 * 45 / np.sqrt(200))


def test_targets_come_and_go_at_the_scans_that_are_stated():
    x = three_targets(np.random.default_rng(0))
    there = ~np.isnan(x).any(axis=2)
    np.testing.assert_array_equal(there, ~np.isnan(x).all(axis=2))
    scans = np.arange(1, 101)
    for i, (born, last) in enumerate(((1, 70), (20, 90), (45, 100))):
        np.testing.assert_array_equal(there[:, i], (scans >= born) & (scans <= last))


def test_targets_start_where_they_are_expected_and_move_as_is_stated():
    runs = np.array([three_targets(np.random.default_rng(seed)) for seed in range(400)])
    off = np.stack([
        runs[:, 0, 0, :2] - (200, 800),
        runs[:, 19, 1, :2] - (800, -800),
        runs[:, 44, 2, :2] - runs[:, 44, 1, :2],  # its parent
    ])  # fmt: skip
    np.testing.assert_allclose(off.mean(axis=1), 0, atol=5 * 10 / np.sqrt(400))
    np.testing.assert_allclose(off.std(axis=1), 10, rtol=5 / np.sqrt(800))
    F = constant_acceleration(1.0, 0.01).F
    for i, born, last in ((0, 1, 70), (1, 20, 90), (2, 45, 100)):
        x = runs[:, born - 1 : last, i]
        noise = (x[:, 1:] - x[:, :-1] @ F.T).reshape(-1, 3, 2)  # (N, rate, axis)
        G = np.array([0.5, 1.0, 0.0 if i == 2 else 1.0])
        wanted = 1e-4 * np.outer(G, G)  # the corrected Q
        for one in (noise[:, :, 0], noise[:, :, 1]):
            np.testing.assert_allclose(one.T @ one / len(one), wanted, atol=5e-6)
    assert not runs[:, 44:, 2, 4:].any()  # constant velocity


def test_two_targets_or_three_cross_a_group():
    clutter = unknown_clutter().clutter(0)
    for seed in range(20):
        x = three_targets(np.random.default_rng(seed))[:, :, :2]
        within = np.zeros(3, int)
        for m, P in zip(clutter.ellipses.m, clutter.ellipses.P, strict=True):
            within += (np.einsum("tmi,ij,tmj->tm", x - m, np.linalg.inv(P), x - m) <= 1).sum(axis=0)
        assert (within >= 10).sum() >= 2
        assert np.nanmax(np.abs(x)) < 1000  # and all stay in the region


def test_detections_come_from_whom_they_are_said_to_with_the_sensors_noise():
    scenario = unknown_clutter(detection_probability=0.8)
    noise, seen, there = [], 0, 0
    for seed in range(60):
        episode = draw(scenario, seed)
        there += (~np.isnan(episode.x[:, :, 0])).sum()
        for t in range(100):
            z, origin = scan(episode, t)
            mine = origin >= 0
            assert len(set(origin[mine])) == mine.sum()  # one each at most
            noise.append(z[mine] - episode.x[t, origin[mine], :2])
            seen += mine.sum()
    noise = np.concatenate(noise)
    assert np.isfinite(noise).all()
    np.testing.assert_allclose(noise.mean(axis=0), 0, atol=5 * 12.5 / np.sqrt(len(noise)))
    np.testing.assert_allclose(np.cov(noise.T), 156.25 * np.eye(2), atol=5 * 156.25 * np.sqrt(2 / len(noise)))
    assert there == 60 * (70 + 71 + 56) and abs(seen / there - 0.8) < 5 * np.sqrt(0.16 / there)


def test_a_target_outside_the_region_is_not_seen():
    path = np.zeros((40, 2, 4))
    path[:, 0, 0] = np.linspace(-2000, 2000, 40)
    episode = draw(unknown_clutter(trajectory=path, detection_probability=1.0, clutter_rate=0), 0)
    assert (np.abs(episode.z) <= 1000).all()
    seen = np.array([[i in scan(episode, t).origin for i in range(2)] for t in range(40)])
    assert seen[:, 1].all()
    clear = np.abs(np.abs(path[:, 0, 0]) - 1000) > 60
    np.testing.assert_array_equal(seen[clear, 0], np.abs(path[clear, 0, 0]) < 1000)


def test_a_targets_detection_stands_anywhere_among_the_clutter():
    path = np.zeros((4000, 1, 4))
    world = {"detection_probability": 1.0, "clutter": "uniform", "clutter_rate": 9}
    episode = draw(unknown_clutter(trajectory=path, **world), 0)
    ranks = []
    for t in range(4000):
        origin = scan(episode, t).origin
        if len(origin) == 10:
            ranks.append(int(np.flatnonzero(origin == 0)[0]))
    assert len(ranks) > 400 and chisquare(np.bincount(ranks, minlength=10)).pvalue > 1e-4
    # clutter is in random order too: uniform parts are not ahead of groups
    clutter = uniform_clutter(*BOX, 1.0)._replace(ellipses=mixture([9.0], [[0.0, 0.0]], [np.eye(2)]))
    world = replace(unknown_clutter(trajectory=path, detection_probability=1e-12), clutter=lambda t: clutter)
    episode = draw(world, 0)
    lead = np.array([np.abs(scan(episode, t).z[0]).max() > 1 for t in range(4000) if len(scan(episode, t).z)])
    assert abs(lead.mean() - 0.1) < 5 * np.sqrt(0.09 / 4000)


def test_same_seed_same_world_and_another_seed_another():
    scenario = unknown_clutter()
    first, again, other = (draw(scenario, seed) for seed in (1, np.random.SeedSequence(1), 2))
    for a, b in zip(first, again, strict=True):
        np.testing.assert_array_equal(a, b)
    assert not np.array_equal(first.z[:40], other.z[:40])
    sequence = np.random.SeedSequence(5, spawn_key=(3,))
    np.testing.assert_array_equal(draw(scenario, sequence).z, draw(scenario, sequence).z)


def test_truth_detection_and_clutter_have_streams_of_their_own():
    base = draw(unknown_clutter(), 3)
    more = draw(unknown_clutter(clutter_rate=200), 3)
    np.testing.assert_array_equal(base.x, more.x)
    np.testing.assert_array_equal(base.z[base.origin == 1], more.z[more.origin == 1])
    less = draw(unknown_clutter(detection_probability=0.3), 3)
    np.testing.assert_array_equal(base.x, less.x)
    np.testing.assert_array_equal(clutter_of(base), clutter_of(less))  # in the same order
    assert (less.origin >= 0).sum() < 0.4 * (base.origin >= 0).sum()
    moved = draw(unknown_clutter(trajectory=np.nan_to_num(base.x[:, :, :4])[::-1]), 3)
    np.testing.assert_array_equal(clutter_of(base), clutter_of(moved))


def test_truth_of_another_size_than_the_scenarios_is_refused():
    scenario = replace(unknown_clutter(horizon=5), targets=2)
    with pytest.raises(ValueError, match=r"truth must be 5 scans of 2 targets, got shape \(5, 3, 6\)"):
        draw(scenario, 0)


def test_trackers_are_told_of_uniform_clutter_unless_they_are_told_the_truth():
    scenario = unknown_clutter()
    told = scenario.model
    assert len(told.clutter.gaussians.w) == len(told.clutter.ellipses.w) == 0
    assert told.clutter.expected == told.clutter.uniform == 50
    assert (told.detection_probability, told.survival_probability) == (0.98, 0.99)
    np.testing.assert_array_equal(told.births.m[:, :2], [[200, 800], [800, -800]])
    np.testing.assert_array_equal(told.births.P[0, :2, :2], 100 * np.eye(2))
    assert not told.births.m[:, 2:].any()
    for velocity in ((12, 16), (15, 9)):  # within three deviations, or no tracker could start
        assert (np.array(velocity) < 3 * np.sqrt(np.diag(told.births.P[0])[2:4])).all()
    np.testing.assert_array_equal(told.sensor.R, 12.5**2 * np.eye(2))
    z = np.random.default_rng(0).uniform(-1000, 1000, (50, 2))
    knowing = unknown_clutter(told="true", clutter="dense")
    np.testing.assert_array_equal(knowing.model.clutter.density(z), knowing.clutter(7).density(z))
    # as much of it, spread evenly
    assert unknown_clutter(clutter="dense").model.clutter.uniform == pytest.approx(155)
    assert unknown_clutter(clutter_rate=0).model.clutter.uniform > 0


def test_a_target_whose_state_is_masked_is_absent():
    path = np.random.default_rng(0).uniform(-500, 500, (12, 4, 4))
    masked = np.ma.array(path, mask=np.zeros(path.shape, bool))
    masked[:3, 1, 0] = masked[8:, 2] = np.ma.masked
    absent = path.copy()
    absent[:3, 1] = absent[8:, 2] = np.nan
    wanted = draw(unknown_clutter(trajectory=absent), 0).x
    np.testing.assert_array_equal(draw(unknown_clutter(trajectory=masked), 0).x, wanted)
    np.testing.assert_array_equal(draw(unknown_clutter(trajectory=list(masked)), 0).x, wanted)


@pytest.mark.parametrize("columns", [4, 6])
def test_a_given_trajectory_is_flown_and_told_of_where_it_starts(columns):
    path = np.random.default_rng(columns).uniform(-500, 500, (12, 4, columns))
    path[:3, 1] = path[8:, 2] = path[4:6, 3] = np.nan  # one comes, one goes, one is away for a while
    scenario = unknown_clutter(trajectory=path, horizon=11)
    x = draw(scenario, 0).x
    np.testing.assert_array_equal(x[:, :, :columns], path[:11])
    assert (np.isnan(x[:, :, 4:]) == np.isnan(x[:, :, :2])).all()
    starts = [path[0, 0, :2], path[3, 1, :2], path[0, 2, :2], path[0, 3, :2]]
    np.testing.assert_array_equal(scenario.model.births.m[:, :2], starts)
    told = unknown_clutter(trajectory=path, births=[(0.5, (1, 2))]).model.births
    assert told.w == [0.5] and told.m[0].tolist() == [1, 2, 0, 0, 0, 0]


@pytest.mark.parametrize(
    ("world", "message"),
    [
        ({"clutter": "thick"}, "clutter must be groups, uniform or dense, got 'thick'"),
        ({"told": "nothing"}, "told must be uniform or true, got 'nothing'"),
        ({"clutter_rate": -1}, "clutter_rate must lie between 0 and 1e4 per scan, got -1"),
        ({"clutter_rate": np.nan}, "clutter_rate must lie"),
        ({"clutter_rate": "many"}, "^clutter_rate must be a number, got 'many'$"),
        ({"detection_probability": 1.2}, "detection_probability must lie in"),
        ({"group_density": 0}, "group_density must be positive and at most 100, got 0"),
        ({"uniform_share": 0.4}, "uniform_share must be positive and make 1 .* got 0.4 and 1.1 in all"),
        ({"uniform_share": 0.0, "groups": [(0.9999999, (0, 0), (1, 1))]}, "uniform_share must be positive"),
        ({"groups": [(0.7, (0, 0))]}, r"groups\[0\] must be \(share, "),
        ({"groups": [(0.7, (0, 0), 5)]}, r"groups\[0\] must be \(share, "),
        ({"groups": [(0.7, (0, 0), (5, 5), (1, 1), 3)]}, r"groups\[0\] must be \(share, "),
        ({"groups": 3}, "groups"),
        ({"groups": [(0.2, (0, 0), (5, 5)), "x"]}, r"groups\[1\] must be \(share, "),
        ({"groups": [(0.7, (0, np.inf), (5, 5))]}, r"groups\[0\] must be finite"),
        ({"groups": [(0.7, (0, 0), (5, 5), (np.nan, 0))]}, r"groups\[0\] must be finite"),
        ({"groups": [(0.7, (0, 0), (5, 0))]}, r"groups\[0\] must have positive semi-axes"),
        ({"groups": [(-0.7, (0, 0), (5, 5))]}, r"groups\[0\] must have a share between 0 and 1"),
        ({"groups": [(0.7, (0, 0), (5, 5), (1, 0))], "told": "true"}, "told must be uniform where groups"),
        ({"births": []}, "births must be"),
        ({"births": [(200, 800)]}, "births must be"),
        ({"births": [(-1, (200, 800))]}, "births must be of positive numbers"),
        ({"births": [(1, (200, np.nan))]}, "births must be of positive numbers at finite positions"),
        ({"trajectory": np.zeros((5, 4))}, r"trajectory must have shape \(T, m, 4\) or .*got \(5, 4\)"),
        ({"trajectory": np.zeros((5, 2, 5))}, "trajectory must have shape"),
        ({"trajectory": np.zeros((5, 0, 4))}, "trajectory must have shape"),
        ({"trajectory": "circle"}, "trajectory must be numbers of shape"),
        ({"trajectory": [[[0, 0, np.nan, 0]]]}, "or nan in a whole state"),
        ({"trajectory": [[[0, 0, np.inf, 0]]]}, "trajectory must be finite"),
        ({"trajectory": np.full((4, 1, 4), np.nan)}, "trajectory must show every target"),
        ({"horizon": 101}, "horizon must be between 1 and the 100 scans"),
        ({"horizon": 0}, "horizon must be between 1"),
        ({"trajectory": np.zeros((5, 1, 4)), "horizon": 6}, "horizon must be between 1 and the 5 scans"),
        ({"clutter_density": 1e-4}, "unknown argument 'clutter_density'; .*takes clutter, clutter_rate, "),
        ({"metric": "rmse"}, "metric must be one of gospa, ospa, trajectory-gospa, got 'rmse'"),
        ({"targets": 0}, "targets must be a whole number of rows between 1 and 1000, got 0"),
        ({"targets": 2.5}, "targets must be a whole number"),
        ({"targets": True}, "targets must be a whole number"),
        ({"render_mode": "ascii"}, "render_mode must be one of"),
    ],
)
def test_bad_argument_is_refused_by_name(world, message):
    with pytest.raises(ValueError, match=message), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        make(**world)


def make(**world):
    return gym.make(ID, **world).unwrapped


def nobody(env):
    return np.zeros(env.action_space.shape)


def knowing(env, info, off=0.0):
    """The truth, or `off` metres beside it, in rows from the last."""
    action = nobody(env)
    for row, x in zip(action[::-1], info["truth"][info["present"]], strict=False):
        row[:] = [0.5, *x]
        row[1] += off
    return action


def put(action, column, value):
    """The action with one number of its third row replaced."""
    action[2, column] = value
    return action


def episode_of(env, act, seed):
    observation, info = env.reset(seed=seed)
    rewards, infos, observations, ended = [], [info], [observation], False
    while not ended:
        observation, reward, terminated, ended, info = env.step(act(env, info))
        assert not terminated
        rewards.append(reward)
        infos.append(info)
        observations.append(observation)
    return observations, infos, rewards


def test_the_truth_submitted_costs_nothing_and_nobody_costs_the_missed():
    env = make()
    assert max(np.abs(episode_of(env, knowing, 0)[2])) == 0
    observations, infos, rewards = episode_of(env, lambda env, info: nobody(env), 0)
    counts = np.array([info["present"].sum() for info in infos[:-1]])
    assert set(counts) == {1, 2, 3} and len(rewards) == 100
    np.testing.assert_allclose(rewards, -np.sqrt(5000 * counts))
    np.testing.assert_allclose([info["missed"] for info in infos[1:]], 5000 * counts)
    assert observations[-1]["mask"].sum() == 0 and not observations[-1]["scan"].any()
    assert "truth" not in infos[-1] and infos[-1]["false"] == infos[-1]["localisation"] == 0


@pytest.mark.parametrize("metric", ["gospa", "ospa"])
def test_reward_is_minus_the_distance_of_the_rows_that_exist(metric):
    env = make(metric=metric, targets=6, horizon=60)
    rng = np.random.default_rng(0)
    _, info = env.reset(seed=4)
    for _ in range(60):
        action = knowing(env, info, off=rng.uniform(0, 130))
        action[:2] = [[rng.random(), *rng.uniform(-100, 100, 6)] for _ in range(2)]
        estimates = [row[1:3] for row in action if row[0] >= 0.5]
        truth = info["truth"][info["present"], :2]
        _, reward, _, _, info = env.step(action)
        estimates = np.reshape(estimates, (-1, 2))
        parts = gospa(estimates, truth, 100, 2)
        wanted = parts.total if metric == "gospa" else ospa(estimates, truth, 100, 2)
        assert info["error"] == pytest.approx(wanted, rel=1e-12) and reward == -info["error"]
        assert (info["localisation"], info["missed"], info["false"]) == parts[1:]
    with pytest.raises(RuntimeError, match=r"call reset\(\) before step"):
        env.step(action)


def test_an_existence_of_a_half_counts_and_less_does_not():
    env = make(detection_probability=0.5)
    _, info = env.reset(seed=0)
    action = knowing(env, info)
    env.step(action)
    action[-1, 0] = np.nextafter(0.5, 0)
    assert env.step(action)[4]["missed"] == 5000
    action[:, 0] = 1.0  # nine rows of zeros: nine false estimates
    assert env.step(action)[4]["false"] == pytest.approx(9 * 5000)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda a: a[:3], r"action must have shape \(10, 7\), got \(3, 7\)"),
        (lambda a: a.ravel(), r"action must have shape \(10, 7\), got \(70,\)"),
        (
            lambda a: put(a, 0, 1.1),
            r"existence, the first column, must lie in \[0, 1\], got \[0.0, 0.0, 1.1,",
        ),
        (lambda a: put(a, 0, -0.1), "existence, the first column"),
        (lambda a: put(a, 0, np.nan), "existence, the first column"),
        (lambda a: put(a, 2, np.nan), "action must be finite and within"),
        (lambda a: put(a, 4, np.inf), "action must be finite and within"),
        (lambda a: put(a, 1, 1.1e7), "action must be finite and within"),
    ],
)
def test_bad_action_is_refused_and_costs_nothing(change, message):
    env = make(horizon=3)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        env.step(change(nobody(env)))
    assert [env.step(nobody(env))[3] for _ in range(3)] == [False, False, True]


def test_a_masked_row_of_an_action_is_no_estimate():
    env, other = make(horizon=2), make(horizon=2)
    _, info = env.reset(seed=0)
    other.reset(seed=0)
    action = nobody(env)
    action[: len(info["truth"]), 0], action[: len(info["truth"]), 1:] = 1.0, info["truth"]
    action[9] = 1.0
    masked = np.ma.array(action, mask=np.zeros(action.shape, bool))
    masked[9, 3] = np.ma.masked
    masked.data[9, 3] = np.nan
    action[9] = 0.0
    assert env.step(masked)[1] == other.step(action)[1]
    assert env.step(list(np.ma.masked_all(action.shape)))[1] == other.step(nobody(other))[1]


def test_observation_and_info_are_those_of_the_world():
    env = make(horizon=70, clutter_rate=3)
    world = draw(env.scenario, 9)
    observations, infos, _ = episode_of(env, lambda env, info: env.action_space.sample(), 9)
    for t, (observation, info) in enumerate(zip(observations, infos, strict=True)):
        assert env.observation_space.contains(observation) and observation["time"] == t + 1
        k = observation["mask"].sum()
        assert (observation["mask"][:k] == 1).all() and not observation["scan"][k:].any()
        if t < 70:
            z, origin = scan(world, t)
            np.testing.assert_array_equal(observation["scan"][:k], z)
            np.testing.assert_array_equal(info["origin"][:k], origin)
            assert (info["origin"][k:] == -2).all()
            np.testing.assert_array_equal(info["present"], ~np.isnan(world.x[t, :, 0]))
            np.testing.assert_array_equal(info["truth"], np.nan_to_num(world.x[t]))


def test_nothing_but_the_targets_own_detections_tells_of_the_truth():
    base, moved = make(detection_probability=1e-12), make(detection_probability=1e-12)
    x = three_targets(np.random.default_rng(0))
    moved.scenario = replace(base.scenario, truth=lambda rng: x[::-1] + 37.0)
    plays = [episode_of(env, lambda env, info: nobody(env), 6)[0] for env in (base, moved)]
    for a, b in zip(*plays, strict=True):
        for key in a:
            np.testing.assert_array_equal(a[key], b[key])


def test_capacity_holds_the_busiest_scan_and_every_target():
    drifting = [(0.7, (0, 0), (50, 50), (5, 0))]
    worlds = ({}, {"clutter": "dense"}, {"groups": drifting}, {"clutter_rate": 0})
    for world, rate in zip(worlds, (50, 155, 50, 0), strict=True):
        env = make(**world)
        assert env.observation_space["scan"].shape[0] == poisson.ppf(1 - 1e-12, rate) + 3
    assert make(trajectory=np.zeros((4, 7, 4)), clutter_rate=0).observation_space["scan"].shape == (7, 2)


def test_plain_numbers_as_arguments_go_through_json():
    path = [[[0, 0, 1, 1], [None] * 4], [[1, 1, 1, 1], [5, 5, 0, 0]]]
    env = gym.make(ID, trajectory=path, groups=[[0.7, [0, 0], [50, 60], [1, 2]]], births=[[0.1, [0, 0]]])
    spec = env.spec.to_json()
    json.loads(spec)
    again = gym.make(gym.envs.registration.EnvSpec.from_json(spec))
    np.testing.assert_array_equal(env.reset(seed=1)[0]["scan"], again.reset(seed=1)[0]["scan"])
    assert again.unwrapped.scenario.horizon == 2


def test_a_scenario_can_be_pickled():
    scenario = pickle.loads(pickle.dumps(unknown_clutter(groups=((0.7, (0, 0), (5, 5), (1, 1)),))))
    np.testing.assert_array_equal(draw(scenario, 1).z, draw(pickle.loads(pickle.dumps(scenario)), 1).z)


@pytest.mark.parametrize(
    "world",
    [{}, {"clutter": "uniform"}, {"clutter": "uniform", "clutter_rate": 0, "detection_probability": 1e-12}],
)
def test_picture_shows_detections_truth_estimates_and_groups(world):
    env = make(render_mode="rgb_array", **world)
    with pytest.raises(RuntimeError, match=r"call reset\(\) before render"):
        env.render()
    _, info = env.reset(seed=0)
    env.render()
    for _ in range(50):
        _, _, _, _, info = env.step(knowing(env, info))
    picture = env.render()
    assert picture.shape == (640, 640, 3) and picture.dtype == np.uint8
    axes = env._canvas.figure.axes[0]
    detections, path, mine, estimates, latest = (line.get_xydata() for line in axes.lines)
    tracks = np.split(path, np.arange(1, 3) * 52)  # a gap after each
    z, origin = scan(draw(env.scenario, 0), 50)
    np.testing.assert_array_equal(detections, z)
    np.testing.assert_array_equal(mine, z[origin >= 0])
    assert len(path) == 3 * 52 and np.isfinite(tracks[0]).all(axis=1).sum() == 51
    assert len(estimates) == 50 + 31 + 6 and len(latest) == 3
    np.testing.assert_array_equal(latest[-1], tracks[0][49])
    assert len(axes.collections) == (0 if "clutter" in world else 1)
    if not world:
        np.testing.assert_array_equal(axes.collections[0].get_offsets()[3:], [g[1] for g in GROUPS])
    env.close()
