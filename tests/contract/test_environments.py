"""Every registered environment keeps Gymnasium's contract, and the tracking environment its own."""

import json
import pickle
import subprocess
import sys
import warnings
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from radar_files import given

import gmr_gym  # noqa: F401  registers the environments
from gmr_gym.baselines.learning_pmb import learning_pmb
from gmr_gym.baselines.mht import runnalls
from gmr_gym.baselines.nearest_neighbour import NearestNeighbour
from gmr_gym.envs.episodic import EXTENT
from gmr_gym.envs.policy import MultiTargetPolicy, Policy
from gmr_gym.envs.registry import ENVIRONMENTS, TRACKED, TRACKING
from gmr_gym.envs.render import Canvas, Tracked
from gmr_gym.envs.tracking import TrackingEnv
from gmr_gym.evaluation.loop import play as play_scans
from gmr_gym.evaluation.montecarlo import run_once
from gmr_gym.evaluation.multi_target_runs import run_multi_target_once
from gmr_gym.filters.registry import make_tracker
from gmr_gym.mixture import mixture, moments
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.simulation.reward import SCANS_OFF
from gmr_gym.simulation.single_target import Truth, draw

EVERY = sorted(env_id for env_id in gym.registry if env_id.startswith("gmr_gym/"))
IDS, SINGLE = sorted(TRACKED), sorted(TRACKING)
TURNING, FLIGHT, JUMP, RADAR = (
    f"gmr_gym/{name}-v0" for name in ("TurningTarget", "RecordedFlight", "JumpMarkov", "AirborneRadar")
)
FAR = np.array([1e6, 0.0, 0.0, 0.0])
# m, of a target that flies past a radar which stands still, in steps of 30 m
PASSING, STILL = [[20_000.0, 30.0 * t, 2_000.0] for t in range(8)], [[0.0, 0.0, 0.0]] * 8


def make(env_id=TURNING, **world):
    return gym.make(env_id, **given(env_id), **world).unwrapped


def plain(env, observation):
    """An action for any id: the prior's mean of one target, of many what a seed gives."""
    if "prior_mean" in observation:
        return observation["prior_mean"]
    env.action_space.seed(1)
    return env.action_space.sample()


def play(env, act, seed):
    """Observations, infos and rewards of an episode, and how it ended."""
    observation, info = env.reset(seed=seed)
    observations, infos, rewards, ended = [observation], [info], [], (False, False)
    while not any(ended):
        observation, reward, *ended, info = env.step(act(observation))
        observations.append(observation)
        infos.append(info)
        rewards.append(reward)
    return observations, infos, rewards, tuple(ended)


def assert_same(a, b):
    assert set(a) == set(b)
    for key in a:
        np.testing.assert_array_equal(a[key], b[key], err_msg=key)


def test_every_id_of_the_list_is_registered():
    assert sorted(ENVIRONMENTS) == EVERY


@pytest.mark.parametrize("env_id", EVERY)
def test_every_id_passes_gymnasiums_check(env_id):
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*symmetric and normalized space")  # metres are meant
        warnings.filterwarnings("error", message=".*obs")
        env = gym.make(env_id, **given(env_id)).unwrapped
        env.action_space.seed(0)
        check_env(env)


@pytest.mark.parametrize("env_id", EVERY)
def test_every_id_passes_stable_baselines3s_check(env_id):
    checker = pytest.importorskip("stable_baselines3.common.env_checker")
    env = gym.make(env_id, **given(env_id)).unwrapped
    env.action_space.seed(0)
    checker.check_env(env, warn=False)


@pytest.mark.parametrize("env_id", IDS)
def test_every_id_replays_from_its_seed(env_id):
    first, again = gym.make(env_id, **given(env_id)), gym.make(env_id, **given(env_id))
    for one, two in ((first, again), (first, first)):  # a second copy, and the same one over again
        space = one.action_space
        space.seed(3)
        samples = [space.sample() for _ in range(12)]
        plays = []
        for env in (one, two):
            observation, _ = env.reset(seed=11)
            # of one target within 10 m and m/s
            prior = observation.get("prior_mean")
            actions = samples if prior is None else [prior + sample / 1e6 for sample in samples]
            plays.append([(observation, 0.0)])
            for action in actions:
                observation, reward, terminated, truncated, _ = env.step(action)
                plays[-1].append((observation, reward))
                if terminated or truncated:
                    break
        for (a, reward_a), (b, reward_b) in zip(*plays, strict=True):
            assert_same(a, b)
            assert reward_a == reward_b
    assert not np.array_equal(first.reset(seed=12)[0]["scan"], again.reset(seed=13)[0]["scan"])


@pytest.mark.parametrize("env_id", EVERY)
def test_every_id_has_a_spec_that_json_carries_over(env_id):
    spec = gym.make(env_id, **given(env_id)).spec.to_json()
    assert json.loads(spec)["id"] == env_id
    gym.make(gym.envs.registration.EnvSpec.from_json(spec)).reset(seed=0)


@pytest.mark.parametrize("env_id", IDS)
def test_a_pickled_copy_goes_on_as_the_episode_it_was_taken_from(env_id):
    env = make(env_id)
    observation, _ = env.reset(seed=7)
    action = plain(env, observation)
    env.step(action)
    copy = pickle.loads(pickle.dumps(env))
    a, b = env.step(action), copy.step(action)
    assert_same(a[0], b[0])
    assert a[1] == b[1]
    assert_same(env.reset()[0], copy.reset()[0])  # and so do the seeds to come


def test_plain_numbers_as_arguments_go_through_json():
    trajectory = [[0, 0], [10, 5], [20, 20], [30, 20], [40, 30]]
    env = gym.make(TURNING, clutter_rate=30, horizon=5, trajectory=trajectory)
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert_same(env.reset(seed=1)[0], again.reset(seed=1)[0])
    assert again.unwrapped.scenario.clutter_rate == 30


def test_module_and_id_make_an_environment_where_nothing_was_imported():
    code = "import gymnasium as gym; print(gym.make('gmr_gym:gmr_gym/TurningTarget-v0').unwrapped)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=100)
    assert done.returncode == 0 and "TrackingEnv" in done.stdout, done.stderr


@pytest.mark.parametrize("env_id", IDS)
def test_without_a_seed_the_episodes_of_one_seed_follow_one_another(env_id):
    a, b = make(env_id), make(env_id)
    for env in (a, b):
        env.reset(seed=4)
    second = a.reset()[0]
    assert_same(second, b.reset()[0])
    assert not np.array_equal(second["scan"], a.reset()[0]["scan"])


@pytest.mark.parametrize(
    ("env_id", "name", "world"),
    [
        (TURNING, "runnalls-10", {"horizon": 25}),
        (TURNING, "runnalls-10", {"horizon": 25, "window": (400, 400)}),
        (FLIGHT, "runnalls-10", {"horizon": 25}),
        (JUMP, "mmg-5", {}),
        (RADAR, "imm-pda", {"horizon": 25}),
    ],
)
def test_a_policy_in_the_environment_and_its_tracker_in_the_harness_do_the_same(env_id, name, world):
    env = make(env_id, **world)
    tracker = make_tracker(name, env.scenario.model)
    estimates = []
    policy = Policy(tracker)

    def act(observation):
        estimates.append(policy(observation))
        return estimates[-1]

    _, infos, rewards, ended = play(env, act, seed=1)
    runs = run_once(env.scenario, tracker, 1)
    np.testing.assert_array_equal(estimates, runs.x)
    np.testing.assert_array_equal([info["truth"] for info in infos[:-1]], runs.truth)
    error = np.linalg.norm((runs.x - runs.truth)[:, list(env.scenario.position)], axis=1)
    np.testing.assert_allclose([info["error"] for info in infos[1:]], error, rtol=1e-12)
    np.testing.assert_allclose(rewards, -np.minimum(error, env.scenario.cutoff), rtol=1e-12)
    assert ended == (False, True)


def test_policy_begins_anew_with_every_episode():
    env = make(horizon=12)
    used, fresh = Policy(runnalls(env.scenario.model, 5)), Policy(runnalls(env.scenario.model, 5))
    play(env, used, seed=1)
    observation, _ = env.reset(seed=2)
    used(observation)  # an episode left after its first scan
    for seed in (2, 3):
        assert_same(*(dict(enumerate(play(env, policy, seed)[2])) for policy in (used, fresh)))
    assert used.report.x.shape == (1, 4)


def test_observation_is_in_its_space_and_its_mask_counts_the_detections():
    env = make(clutter_rate=3, horizon=60)
    observations, infos, _, _ = play(env, Policy(NearestNeighbour(env.scenario.model)), seed=0)
    for t, (observation, info) in enumerate(zip(observations, infos, strict=True)):
        assert env.observation_space.contains(observation)
        assert observation["time"] == t + 1
        k = observation["mask"].sum()
        assert (observation["mask"][:k] == 1).all() and (observation["scan"][k:] == 0).all()
        if t < 60:
            assert set(info["origin"][:k]) <= {0, -1} and set(info["origin"][k:]) <= {-2}
        else:
            assert k == 0
    assert 0 < np.mean([(info["origin"] == 0).any() for info in infos[:-1]]) < 1


@pytest.mark.parametrize("env_id", IDS)
def test_observation_stays_in_its_space_whatever_action_the_space_allows(env_id):
    env = make(env_id)
    env.reset(seed=0)
    for action in (env.action_space.high, env.action_space.low):
        assert env.observation_space.contains(env.step(action)[0])


@pytest.mark.parametrize("env_id", SINGLE)
def test_nothing_but_the_targets_own_detection_tells_of_the_truth(env_id):
    base, moved = (make(env_id, detection_probability=1e-12) for _ in range(2))
    # as many scans as the truth has; an early end would tell of it too, rightly, and is put off
    base.scenario = replace(base.scenario, cutoff=1e9)
    x, mode = base.scenario.truth(np.random.default_rng(6))
    moved.scenario = replace(base.scenario, truth=lambda rng: Truth(x[::-1] + 37.0, mode[::-1]))
    plays = [play(env, lambda observation: observation["prior_mean"], seed=6) for env in (base, moved)]
    for a, b in zip(*(observations for observations, _, _, _ in plays), strict=True):
        assert_same(a, b)
    assert len(plays[0][0]) == len(x) + 1 and all(o["mask"].any() for o in plays[0][0][:-1])
    truths = [[info["truth"] for info in infos[:-1]] for _, infos, _, _ in plays]
    assert (np.array(truths[0]) != np.array(truths[1])).any(axis=1).all()
    # and detected, it changes the scan alone
    for env in (base, moved):
        env.scenario = replace(env.scenario, detection_probability=1.0)
    a, b = (env.reset(seed=6)[0] for env in (base, moved))
    assert not np.array_equal(a["scan"], b["scan"])
    for key in set(a) - {"scan", "mask"}:
        np.testing.assert_array_equal(a[key], b[key])


@pytest.mark.parametrize("env_id", SINGLE)
def test_the_mode_in_info_is_a_motion_of_the_model_or_minus_one(env_id):
    env = make(env_id)
    truth = env.scenario.truth(np.random.default_rng(0))
    assert truth.mode.shape == truth.x.shape[:1]
    _, infos, _, _ = play(env, lambda observation: observation["prior_mean"], seed=0)
    modes = [info["mode"] for info in infos[:-1]]
    assert {type(mode) for mode in modes} == {int}
    # a scripted target follows none of the motions that a tracker is told
    motions = 0 if env_id in (TURNING, FLIGHT, RADAR) else len(env.scenario.model.motions)
    assert set(modes) <= set(range(-1, motions))
    assert "mode" not in infos[-1]


def test_observation_of_a_radar_that_looks_seldom_stays_in_its_space():
    env = make(RADAR, trajectory=PASSING, platform=STILL, period=10)
    env.reset(seed=0)
    for action in (env.action_space.high, env.action_space.low):
        observation = env.step(action)[0]
        assert env.observation_space.contains(observation) and observation["mask"].any()
    assert observation["scan"].max() > 1e8  # carried one period on


def test_prior_in_the_observation_is_the_priors_mean_and_covariance():
    env = make()
    observation, _ = env.reset(seed=0)
    np.testing.assert_array_equal(observation["prior_mean"], [0, 0, 10, -10])
    np.testing.assert_array_equal(observation["prior_covariance"], np.eye(4).ravel())


def two_peaks():
    """A scenario whose prior is a mixture: its spread is in the distance of the means."""
    scenario = turning_target()
    prior = mixture([0.5, 0.5], [[-50.0, 0, 0, 0], [50.0, 0, 0, 0]], [np.eye(4)] * 2)
    return replace(scenario, model=scenario.model._replace(prior=prior))


def test_covariance_of_a_prior_with_two_peaks_has_their_distance_in_it(monkeypatch):
    monkeypatch.setattr("gmr_gym.scenarios.dortenzio.two_peaks", two_peaks, raising=False)
    observation, _ = TrackingEnv("gmr_gym.scenarios.dortenzio:two_peaks").reset(seed=0)
    mean, covariance = moments(two_peaks().model.prior)
    np.testing.assert_allclose(observation["prior_mean"], mean)
    np.testing.assert_allclose(observation["prior_covariance"], covariance.ravel())


def test_ten_scans_beyond_the_cutoff_end_the_episode_and_charge_what_is_left():
    env = make(horizon=40)
    truth = env.scenario.truth(None).x
    step = iter(range(40))

    def act(observation):
        t = next(step)
        return truth[t] + (FAR if t != 5 and t < 30 else 0)  # one good estimate begins the count anew

    _, infos, rewards, ended = play(env, act, seed=0)
    assert ended == (True, False) and len(rewards) == 6 + SCANS_OFF
    assert rewards[5] == 0 and infos[6]["error"] == 0
    assert rewards[:5] == [-100] * 5 and rewards[-1] == -100 * (1 + 40 - len(rewards))
    assert sum(rewards) == -100 * 39  # as if it had gone on to the end
    with pytest.raises(RuntimeError, match=r"call reset\(\) before step"):
        env.step(FAR)


def test_a_new_episode_counts_from_nothing():
    env = make(horizon=40)
    env.reset(seed=0)
    for _ in range(SCANS_OFF - 1):
        assert not env.step(FAR)[2]
    assert len(play(env, lambda observation: FAR, seed=1)[2]) == SCANS_OFF


def test_an_error_of_the_cutoff_itself_is_not_beyond_it():
    env = make(horizon=30)
    truth = iter(env.scenario.truth(None).x)
    _, _, rewards, ended = play(env, lambda _: next(truth) + np.array([100, 0, 0, 0]), seed=0)
    assert ended == (False, True) and rewards == pytest.approx([-100] * 30, rel=1e-9)


def test_last_observation_is_empty_in_either_ending():
    for action, ending in ((lambda o: o["prior_mean"], (False, True)), (lambda o: FAR, (True, False))):
        env = make(horizon=12)
        observations, infos, _, ended = play(env, action, seed=0)
        assert ended == ending
        assert observations[-1]["mask"].sum() == 0 and not observations[-1]["scan"].any()
        assert env.observation_space.contains(observations[-1])
        assert "truth" not in infos[-1] and infos[-1]["error"] > 0


def arrays(info):
    """What an info holds that can be written to."""
    found = [value for value in info.values() if isinstance(value, np.ndarray)]
    assert len(found) >= 2
    return found


@pytest.mark.parametrize("env_id", IDS)
def test_changing_what_was_handed_out_changes_nothing_inside(env_id):
    env, untouched = make(env_id), make(env_id)
    observation, info = env.reset(seed=0)
    prior = plain(env, observation).copy()
    for array in (*observation.values(), *arrays(info)):
        array[...] = 0
    untouched.reset(seed=0)
    for _ in range(4):
        a, b = (e.step(prior) for e in (env, untouched))
        assert_same(a[0], b[0])
        assert_same(a[4], b[4])
        assert a[1] == b[1]
        for array in (*a[0].values(), *arrays(a[4])):
            array[...] = 0


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (np.zeros(3), r"action must have shape \(4,\), got \(3,\)"),
        (np.zeros((1, 4)), r"action must have shape \(4,\), got \(1, 4\)"),
        (np.full(4, np.nan), "action must be finite and within"),
        ([0, 0, 0, np.inf], "action must be finite and within"),
        ([1.1 * EXTENT, 0, 0, 0], "action must be finite and within"),
        (
            np.ma.array(np.zeros(4), mask=[0, 0, 1, 0]),
            "action must be given in full, but some of it is masked",
        ),
    ],
)
def test_bad_action_is_refused_and_costs_nothing(action, message):
    env = make(horizon=3)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        env.step(action)
    assert sum(1 for _ in range(3) if env.step(np.zeros(4))[0]["time"] > 0) == 3


def test_step_needs_a_running_episode():
    env = make(horizon=1)
    with pytest.raises(RuntimeError, match=r"call reset\(\) before step"):
        env.step(np.zeros(4))
    env.reset(seed=0)
    assert env.step(np.zeros(4))[3]
    with pytest.raises(RuntimeError, match=r"call reset\(\) before step"):
        env.step(np.zeros(4))


@pytest.mark.parametrize("columns", [2, 4])
def test_a_trajectory_of_positions_or_of_states_is_flown(columns):
    rows = np.cumsum(np.random.default_rng(columns).standard_normal((9, columns)), axis=0)
    for trajectory in (rows, rows.tolist()):
        env = make(trajectory=trajectory)
        _, infos, _, _ = play(env, lambda observation: observation["prior_mean"], seed=0)
        np.testing.assert_array_equal([info["truth"][:columns] for info in infos[:-1]], rows)


@pytest.mark.parametrize("columns", [3, 6])
def test_a_radar_sees_a_given_trajectory_relative_to_a_given_platform(columns):
    target, platform = np.cumsum(np.random.default_rng(columns).standard_normal((2, 9, columns)), axis=1)
    target[:, 0] += 9_000.0
    env = make(RADAR, trajectory=target.tolist(), platform=platform.tolist())
    _, infos, _, _ = play(env, lambda observation: observation["prior_mean"], seed=0)
    truth = np.array([info["truth"] for info in infos[:-1]])
    np.testing.assert_allclose(truth[:, :columns], target - platform, rtol=1e-9, atol=1e-9)


def test_a_drawn_target_is_another_in_every_episode_and_told_of_one_motion():
    env = make(RADAR, trajectory="drawn", horizon=3)
    truths = [env.reset(seed=seed)[1]["truth"] for seed in (0, 0, 1)]
    np.testing.assert_array_equal(truths[0], truths[1])
    assert not np.array_equal(truths[1], truths[2]) and len(env.scenario.model.motions) == 1


def above(z):
    """Where detections (k, 3) of a radar lie, seen from above (k, 2)."""
    ground = z[:, 0] * np.cos(z[:, 2])
    return np.stack([ground * np.cos(z[:, 1]), ground * np.sin(z[:, 1])], axis=1)


def seen_truly(path):
    """All detections of a radar that stands still, its window following the truth, and the target's own."""
    env = make(RADAR, trajectory=path, platform=STILL, detection_probability=1.0)
    truths = iter(env.scenario.truth(None).x)
    observations, infos, _, _ = play(env, lambda _: next(truths), seed=0)
    z = np.concatenate([o["scan"] for o in observations[:-1]])
    origin = np.concatenate([info["origin"] for info in infos[:-1]])
    return z[origin > -2], z[origin == 0]


def test_a_radar_sees_a_target_whose_azimuth_passes_half_a_turn():
    path = [[-20_000.0, 200.0 - 50.0 * t, 2_000.0] for t in range(8)]
    z, mine = seen_truly(path)
    assert len(mine) == 8 and mine[:, 1].max() > 3 and mine[:, 1].min() < -3
    assert (np.abs(z[:, 1]) <= np.pi).all()
    assert np.linalg.norm(above(mine) - np.array(path)[:, :2], axis=1).max() < 4 * 0.025 * 2e4


def test_a_radar_sees_nothing_beyond_the_zenith():
    z, _ = seen_truly([[100.0, 30.0 * t, 5_000.0] for t in range(8)])
    assert (np.abs(z[:, 2]) <= np.pi / 2).all() and z[:, 2].max() > 1.5
    # about half of the window lies there
    assert 0.3 * 25 * 8 < len(z) < 0.8 * 25 * 8


def test_clutter_of_a_radar_goes_no_further_than_once_round():
    env = make(RADAR, trajectory=PASSING, platform=STILL, angle_deviation=0.5)
    low, high = env.scenario.window.low, env.scenario.window.high
    assert high[1] - low[1] == pytest.approx(2 * np.pi) and high[2] - low[2] == pytest.approx(8.0)


def inside(axes, points):
    low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
    return (points >= low).all(axis=1) & (points <= high).all(axis=1)


@pytest.mark.parametrize(
    ("bearing", "angle"), [(0.0, 0.025), (0.8, 0.025), (1.7, 0.025), (3.14, 0.025), (0.0, 0.1)]
)
def test_a_radars_picture_is_a_view_from_above_of_all_that_it_sees(bearing, angle):
    c, s = np.cos(bearing), np.sin(bearing)
    path = PASSING @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]])
    env = make(
        RADAR, trajectory=path, platform=STILL, angle_deviation=angle, clutter_rate=300,
        detection_probability=1.0, render_mode="rgb_array",
    )  # fmt: skip
    observation, info = env.reset(seed=1)
    picture = env.render()
    assert picture.shape == (640, 640, 3) and picture.dtype == np.uint8
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 10
    (axes,) = env._canvas.figure.axes
    k = observation["mask"].sum()
    shown, path, mine, _ = (line.get_xydata() for line in axes.lines)
    np.testing.assert_allclose(shown, above(observation["scan"][:k]), rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(mine, above(observation["scan"][info["origin"] == 0]), rtol=1e-9, atol=1e-6)
    np.testing.assert_array_equal(path, info["truth"][None, :2])
    assert inside(axes, shown).all() and inside(axes, path).all() and k > 200
    # and hardly more: a window of eight deviations to either side, 20 km off
    sides, across = np.ptp([axes.get_xlim(), axes.get_ylim()], axis=1), 2 * 20_000 * np.sin(8 * angle)
    assert 0.8 * across < sides.max() < 1.3 * across and sides.min() > 0.3 * sides.max()
    assert axes.get_aspect() == 1 and (axes.get_xlabel(), axes.get_ylabel()) == ("x, m", "y, m")


def test_a_radars_picture_follows_the_estimate_and_stands_an_empty_scan():
    env = make(
        RADAR, trajectory=PASSING, platform=STILL, clutter_rate=0, detection_probability=1e-12,
        render_mode="rgb_array",
    )  # fmt: skip
    _, info = env.reset(seed=1)
    away = info["truth"] + np.repeat([30_000.0, 0.0], [3, 6])
    env.step(away)
    env.render()
    (axes,) = env._canvas.figure.axes
    assert inside(axes, away[None, :2]).all() and not inside(axes, info["truth"][None, :2]).any()


def test_a_radars_gates_and_hypotheses_are_drawn_as_their_shadows_on_the_plane():
    aslant = [[15_000.0, 12_000.0 + 30.0 * t, 8_000.0] for t in range(8)]
    scenario = make(RADAR, trajectory=aslant, platform=STILL).scenario
    tracker = make_tracker("mmg-5", scenario.model)
    episode, canvas = draw(scenario, 0), Canvas(scenario, tracked=True)
    _, seen, report, _ = next(iter(play_scans(scenario, tracker, episode)))
    canvas.draw(episode, 0, [Tracked(seen, [report.x[0]], report)])
    gates, p = report.gates, report.mixture
    drawn = (gates.z, gates.S * gates.threshold), (p.m, 5.99 * p.P)
    axes = next(axes for axes in canvas.figure.axes if axes.collections)
    for shapes, (centres, S) in zip(axes.collections, drawn, strict=True):
        np.testing.assert_array_equal(shapes.get_offsets(), centres[:, :2])
        stretch = shapes.get_transforms()[:, :2, :2]  # of the unit circle
        np.testing.assert_allclose(stretch @ stretch.transpose(0, 2, 1), S[:, :2, :2], rtol=1e-6)


def test_without_clutter_the_scan_is_the_targets_detection_or_nothing():
    env = make(clutter_rate=0, horizon=50)
    observations, infos, _, _ = play(env, Policy(runnalls(env.scenario.model)), seed=0)
    assert {int(o["mask"].sum()) for o in observations} == {0, 1}
    assert all(-1 not in info["origin"] for info in infos[:-1])


@pytest.mark.parametrize(
    ("env_id", "world", "error", "message"),
    [
        (
            TURNING,
            {"cluter_rate": 3},
            ValueError,
            "unknown argument 'cluter_rate'; did you mean 'clutter_r",
        ),
        (FLIGHT, {"trajectory": [[0, 0]] * 3}, ValueError, "unknown argument 'trajectory'"),
        (TURNING, {"horizon": 101}, ValueError, "horizon must be between 1 and the 100 scans"),
        (TURNING, {"horizon": 0}, ValueError, "horizon must be between 1"),
        (TURNING, {"trajectory": [[0, 0, 0]] * 5}, ValueError, r"shape \(T, 2\) or \(T, 4\).*got \(5, 3\)"),
        (TURNING, {"trajectory": [[0, 0]] * 2}, ValueError, "T >= 3"),
        (TURNING, {"trajectory": [[0, 0], [1, np.nan], [2, 2]]}, ValueError, "trajectory must be finite"),
        (TURNING, {"clutter_rate": 1, "clutter_density": 1e-4}, ValueError, "either clutter_rate"),
        (TURNING, {"clutter_rate": -1}, ValueError, "clutter must be between 0"),
        (TURNING, {"clutter_rate": 1e7}, ValueError, "clutter must be between 0"),
        (TURNING, {"clutter_density": np.nan}, ValueError, "clutter must be between 0"),
        (TURNING, {"detection_probability": 1.5}, ValueError, "detection_probability must lie in"),
        (TURNING, {"sensor_deviation": 0}, ValueError, "sensor_deviation must be positive"),
        (TURNING, {"told_acceleration_deviation": -3}, ValueError, "told_acceleration_deviation must be pos"),
        (TURNING, {"box": ((1, 1), (0, 0))}, ValueError, "lower corner first"),
        (TURNING, {"box": (0, 1)}, ValueError, "two finite corners"),
        (TURNING, {"window": (100, -1)}, ValueError, "two positive lengths"),
        (TURNING, {"window": (9, 9), "box": ((0, 0), (1, 1))}, ValueError, "either box .* or window"),
        (FLIGHT, {"segment": "nowhere"}, ValueError, "nowhere"),
        (
            JUMP,
            {"horizon": 5},
            ValueError,
            "unknown argument 'horizon'; .*takes case, .*, render_mode, observe$",
        ),
        (JUMP, {"case": "3"}, ValueError, "case must be one of 1, 2, stress, clear, got '3'"),
        (JUMP, {"process_variance": "one"}, ValueError, "^process_variance must be a number, got 'one'$"),
        (RADAR, {"regime": "close"}, ValueError, "regime must be one of near, far, extreme, got 'close'"),
        (RADAR, {"range_deviation": 0}, ValueError, "range_deviation must be positive and finite, got 0"),
        (RADAR, {"angle_deviation": 0.6}, ValueError, "angle_deviation must be positive and at most 0.5 rad"),
        (RADAR, {"angle_deviation": -0.1}, ValueError, "angle_deviation must be positive"),
        (RADAR, {"update": "biased"}, ValueError, "update must be one of raw, debiased, .*, got 'biased'"),
        (RADAR, {"trajectory": PASSING, "platform": PASSING}, ValueError, "keep 10 sigma of the range apart"),
        (RADAR, {"trajectory": PASSING, "platform": STILL[1:]}, ValueError, "platform must have as many"),
        (RADAR, {"trajectory": [[0, 0]] * 5}, ValueError, r"trajectory must have shape \(T, 3\) or \(T, 6\)"),
        (RADAR, {"trajectory": "circle"}, ValueError, "trajectory must be numbers"),
        (RADAR, {"trajectory": PASSING, "platform": [[0, 0, np.inf]] * 8}, ValueError, "platform must be fi"),
        (RADAR, {"detection_probability": 0}, ValueError, "detection_probability must lie in"),
        (RADAR, {"clutter_rate": -1}, ValueError, "clutter_rate must lie between 0 and"),
        (RADAR, {"period": 0}, ValueError, "period must lie between 0.01 and 10 s, got 0"),
        (RADAR, {"trajectory": "drawn", "horizon": 0}, ValueError, "horizon must be between 1"),
        (RADAR, {"trajectory": PASSING, "horizon": 9}, ValueError, "horizon must be between 1 and the 8 sc"),
        (TURNING, {"render_mode": "ascii"}, ValueError, "render_mode must be one of"),
    ],
)
def test_bad_argument_is_refused_by_name(env_id, world, error, message):
    with pytest.raises(error, match=message), warnings.catch_warnings():
        warnings.simplefilter("ignore")  # Gymnasium warns of the render mode first
        make(env_id, **world)


@pytest.mark.parametrize("env_id", IDS)
def test_two_copies_in_a_vector_environment_are_two_single_ones(env_id):
    vector = gym.make_vec(env_id, num_envs=2, **given(env_id))
    assert not isinstance(vector, gym.vector.SyncVectorEnv)  # but one of its own
    observations, _ = vector.reset(seed=5)
    actions = observations.get("prior_mean")
    if actions is None:
        actions = vector.action_space.sample()
    observations, rewards, *_ = vector.step(actions)
    for i in range(2):
        single = gym.make(env_id, **given(env_id))
        single.reset(seed=5 + i)
        observation, reward, *_ = single.step(actions[i])
        assert observation["mask"].any()
        np.testing.assert_array_equal(observations["scan"][i], observation["scan"])
        assert rewards[i] == reward


def test_a_policy_of_many_targets_scores_in_the_environment_as_its_tracker_does_in_a_run():
    env = gym.make("gmr_gym/UnknownClutter-v0", metric="ospa", horizon=30).unwrapped
    policy = MultiTargetPolicy(learning_pmb(env.scenario.model))
    _, infos, _, _ = play(env, policy, seed=3)
    wanted = run_multi_target_once(env.scenario, learning_pmb(env.scenario.model), 3)
    np.testing.assert_allclose([info["error"] for info in infos[1:]], wanted.ospa, rtol=1e-12)


def test_a_policy_of_many_targets_names_the_surest_where_there_is_no_room_for_all():
    env = gym.make("gmr_gym/UnknownClutter-v0", clutter="dense").unwrapped
    policy = MultiTargetPolicy(make_tracker("gm-phd", env.scenario.model), targets=2)
    observation, _ = env.reset(seed=0)
    for _ in range(30):
        rows = policy(observation)
        observation, *_ = env.step(np.vstack([rows, np.zeros((8, 7))]))
    assert len(policy.report.x) > 2 and rows.shape == (2, 7)
    surest = np.sort(policy.report.existence)[-2:]
    named = [np.abs(policy.report.x - row[1:]).sum(axis=1).argmin() for row in rows]
    np.testing.assert_allclose(np.sort(policy.report.existence[named]), surest)


@pytest.mark.parametrize(
    ("env_id", "states"),
    [("gmr_gym/TurningTarget-v0", 4), ("gmr_gym/AgileFlight-v0", 6), ("gmr_gym/AirborneRadar-v0", 6)],
)
def test_a_path_of_one_target_with_anything_masked_is_refused(env_id, states):
    path = np.ma.array(np.ones((5, states)), mask=np.zeros((5, states), bool))
    path[2, 1] = np.ma.masked
    with pytest.raises(ValueError, match="trajectory must be given in full, but some of it is masked"):
        gym.make(env_id, trajectory=path)


def test_a_policy_takes_a_masked_row_of_a_scan_for_absent():
    env = make()
    policies = [Policy(runnalls(env.scenario.model, 5)) for _ in range(2)]
    observation, _ = env.reset(seed=0)
    masked, without = dict(observation), dict(observation)
    masked["scan"] = np.ma.array(observation["scan"], mask=np.zeros(observation["scan"].shape, bool))
    masked["scan"][2, 1] = np.ma.masked
    without["mask"] = observation["mask"].copy()
    without["mask"][2] = 0
    np.testing.assert_array_equal(policies[0](masked), policies[1](without))
