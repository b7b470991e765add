"""The environment that sets thresholds, and the tables its instances come from."""

import json
import pickle
import warnings
from functools import partial
from importlib.util import find_spec

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import gmr_gym  # noqa: F401  registers the environments
from agents.draw_instances import SEED, SEEN, UNSEEN, drawn, followed
from gmr_gym.baselines.mht import adaptive
from gmr_gym.envs.lookup import scenario_of
from gmr_gym.envs.registry import TUNING
from gmr_gym.envs.tuning import ReductionTuningEnv, ThresholdSchedule
from gmr_gym.evaluation.loop import play
from gmr_gym.simulation.reward import SCANS_OFF
from gmr_gym.simulation.single_target import draw
from gmr_gym.tuning.features import BOUND
from gmr_gym.tuning.instances import SCANS, TABLES, Instance, instances, trajectory, trajectory_names, world
from gmr_gym.tuning.policies import Constant, Schedule
from gmr_gym.tuning.thresholds import Thresholds, from_action, to_action

SURE = Instance("sure", "turning-target", 0, 0.5, 20.0, 0.95, 5.0, 5.0, 3.0)
LOST = SURE._replace(instance_id="lost", clutter_rate=500.0, detection_probability=0.1)
ACTION = np.zeros(2, np.float32)
COLUMNS = Instance._fields


def table(folder, *rows, header=COLUMNS):
    file = folder / "table.csv"
    lines = [",".join(map(str, row)) for row in (header, *rows)]
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return str(file)


def episode(env, act, **how):
    """Observations, rewards and infos, and whether it was terminated."""
    observation, info = env.reset(**how)
    observations, rewards, infos, over, terminated = [observation], [], [info], False, False
    while not over:
        observation, reward, terminated, truncated, info = env.step(act(observation))
        observations.append(observation)
        rewards.append(reward)
        infos.append(info)
        over = terminated or truncated
    return observations, rewards, infos, terminated


def played(instance, tracker, seed):
    """The tracker along the instance, in the harness: reports and errors."""
    scenario = world(instance)
    drawn = draw(scenario, seed)
    reports = [done.report for done in play(scenario, tracker, drawn)]
    errors = [np.linalg.norm((report.x[0] - x)[:2]) for report, x in zip(reports, drawn.x, strict=True)]
    return reports, errors


@pytest.mark.parametrize("parameters", [("alpha", "prune"), ("components", "prune_density"), ("alpha",)])
def test_both_checks_pass_without_a_warning(parameters):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("default", category=DeprecationWarning)
        check_env(gym.make(TUNING, parameters=parameters).unwrapped)
        if find_spec("stable_baselines3"):
            from stable_baselines3.common.env_checker import check_env as check_for_sb3

            check_for_sb3(gym.make(TUNING, parameters=parameters))


def test_the_picture_is_of_the_tracker_under_its_thresholds(tmp_path):
    """As the harness plays `adaptive`; pictures that nobody asked for change nothing."""
    env = ReductionTuningEnv(instances=table(tmp_path, SURE), components=40, render_mode="rgb_array")
    with pytest.raises(RuntimeError, match=r"call reset\(\) before render"):
        env.render()
    reports, _ = played(SURE, adaptive(world(SURE).model, 40, *from_action(ACTION, env.parameters)[:2]), 3)
    env.reset(seed=3)
    pictures = [env.render()]
    before, after, counts, actions = env._canvas.figure.axes
    _, full = before.collections
    assert len(full.get_offsets()) == 2  # a miss, and the one detection in the gate
    assert not after.collections  # nothing is reduced yet
    for t in range(12):
        _, _, _, _, info = env.step(ACTION)
        env.lookahead_reward(ACTION)
        if t not in (2, 7, 11):
            continue
        pictures.append(env.render())
        there, kept_by_scan = (line.get_ydata() for line in counts.lines)
        assert kept_by_scan[-1] == len(reports[t].mixture.w) == info["components"]
        assert len(kept_by_scan) == t + 1 and (there >= kept_by_scan).all()
        taken = [line.get_ydata() for line in actions.lines]
        np.testing.assert_allclose(taken, np.zeros((2, t + 1)), atol=1e-6)
        for plane in (before, after):
            estimates = next(line for line in plane.lines if line.get_label() == "estimate").get_xydata()
            np.testing.assert_array_equal(estimates, [report.x[0, :2] for report in reports[: t + 1]])
            gates, hypotheses = plane.collections
            np.testing.assert_array_equal(gates.get_offsets(), reports[t].gates.z)
            low, high = np.transpose([plane.get_xlim(), plane.get_ylim()])
            assert (low < gates.get_offsets()).all() and (gates.get_offsets() < high).all()
        np.testing.assert_array_equal(hypotheses.get_offsets(), reports[t].mixture.m[:, :2])
        full = before.collections[1].get_offsets()
        assert len(full) == there[-1]
        np.testing.assert_allclose(full.mean(axis=0), reports[t].x[0, :2], atol=100)
    assert {picture.shape for picture in pictures} == {(640, 640, 3)}
    named = [text.get_text() for text in env._canvas.figure.legends[0].get_texts()]
    assert {"gates", "truth", "estimate", "number kept", *env.parameters} < {*named}
    env.reset()
    env.render()
    env.step(ACTION)
    assert env.render().shape == (640, 640, 3)
    env.close()


def test_pictures_change_nothing_of_what_is_played(tmp_path):
    file = table(tmp_path, SURE)
    watched = gym.make(TUNING, instances=file, render_mode="rgb_array")
    for env in (watched, gym.make(TUNING, instances=file)):
        env.reset(seed=1)
        rewards = []
        for _ in range(5):
            rewards.append(env.step(ACTION)[1])
            if env is watched:
                env.render()
        if env is watched:
            wanted = rewards
    assert rewards == wanted


def test_an_unknown_keyword_is_named_with_the_nearest_and_all_there_are():
    for make in (
        ReductionTuningEnv,
        partial(gym.make, TUNING),
        partial(gym.make_vec, TUNING, 2, vectorization_mode="vector_entry_point"),
    ):
        with pytest.raises(
            ValueError, match=r"'prise'; did you mean 'price'\? .* parameters, instances, price"
        ):
            make(prise=1.0)
    with pytest.raises(ValueError, match="render_mode must be one of"):
        ReductionTuningEnv(render_mode="ascii")


@pytest.mark.parametrize(
    "thresholds", [Thresholds(0.05, 5e-4), Thresholds(0.01, 1e-4), Thresholds(0.4, 1e-2)]
)
@pytest.mark.parametrize("name", ["train-00", "train-02", "train-05"])
def test_constant_actions_are_the_adaptive_tracker_scan_for_scan(thresholds, name):
    env = ReductionTuningEnv(components=40)
    action = to_action(thresholds, env.parameters)
    _, rewards, infos, terminated = episode(env, lambda _: action, seed=3, options={"instance_id": name})
    used = infos[1]["thresholds"]  # an action, decoded, is off by rounding
    assert list(used) == ["alpha", "prune", "prune_density", "components"]
    wanted = thresholds._replace(components=40)
    assert used == pytest.approx({key: getattr(wanted, key) for key in used}, rel=1e-12)
    instance = env.instances[name]
    tracker = adaptive(world(instance).model, 40, used["alpha"], used["prune"], used["prune_density"])
    reports, errors = played(instance, tracker, 3)
    assert [info["error"] for info in infos[1:]] == pytest.approx(errors[: len(rewards)], rel=1e-12, abs=1e-9)
    kept = [len(report.mixture.w) for report in reports]
    assert [info["components"] for info in infos[1:]] == kept[: len(rewards)]
    assert terminated or len(rewards) == len(reports)
    wanted = [-min(e / 100, 1) - env.price * i["work"] for e, i in zip(errors, infos[1:], strict=False)]
    wanted[-1] -= terminated * (len(reports) - len(rewards))
    assert rewards == pytest.approx(wanted, abs=1e-9)
    assert all(info["instance_id"] == name for info in infos)


def test_work_is_less_where_more_is_pruned(tmp_path):
    env = ReductionTuningEnv(instances=table(tmp_path, SURE))
    works = [
        sum(info.get("work", 0) for info in episode(env, lambda _, a=a: np.array([a, a]), seed=1)[2])
        for a in (-0.5, 0.0, 1.0)
    ]
    assert works[0] > 1.5 * works[1] > 2 * works[2] > 0


def test_seed_and_instance_alone_decide_what_there_is_to_see(tmp_path):
    env, other = (ReductionTuningEnv(instances=table(tmp_path, SURE, LOST)) for _ in range(2))
    other.reset(seed=99)  # whatever came before
    worlds, first = [], []
    for one, action in ((env, ACTION), (other, ACTION + 1)):
        observation, _ = one.reset(seed=7, options={"instance_id": "sure"})
        first.append(observation)
        for _ in range(5):
            one.step(action)
        worlds.append(one._episode)
    np.testing.assert_array_equal(*first)
    for a, b in zip(*worlds, strict=True):
        np.testing.assert_array_equal(a, b)
    plays = [episode(one, lambda _: ACTION, seed=8) for one in (env, other)]
    np.testing.assert_array_equal(plays[0][0], plays[1][0])
    assert plays[0][1:] == plays[1][1:]
    assert not np.array_equal(plays[0][0][0], env.reset(seed=9)[0])


def test_instances_come_in_an_order_that_the_seed_shuffles_each_once_before_any_again():
    env = ReductionTuningEnv(instances="valid")
    orders = []
    for seed in (1, 1, 2):
        orders.append([env.reset(seed=seed if i == 0 else None)[1]["instance_id"] for i in range(32)])
        assert sorted(orders[-1][:16]) == sorted(orders[-1][16:]) == sorted(env.instances)
    assert orders[0] == orders[1] != orders[2] and orders[0][:16] != orders[0][16:]


def test_a_lost_target_ends_the_episode_and_is_charged_for_what_is_left(tmp_path):
    env = ReductionTuningEnv(instances=table(tmp_path, LOST), price=0.0)
    observations, rewards, infos, terminated = episode(env, lambda _: ACTION, seed=0)
    assert terminated and 20 < len(rewards) < SCANS
    assert all(info["error"] > 100 for info in infos[-SCANS_OFF:])
    assert rewards[-1] == -1 - (SCANS - len(rewards)) and rewards[-2] == -1
    assert not observations[-1].any()
    with pytest.raises(RuntimeError, match=r"call reset\(\) before step\(\): no episode is running"):
        env.step(ACTION)


def test_observations_stay_in_their_space_to_the_last():
    env = ReductionTuningEnv(instances="test")
    rng = np.random.default_rng(0)
    for seed in range(6):
        observations, _, _, _ = episode(env, lambda _: rng.uniform(-0.2, 1, 2), seed=seed)
        for observation in observations:
            assert env.observation_space.contains(observation) and (np.abs(observation) <= BOUND).all()


def test_a_pickled_copy_goes_on_as_the_episode_it_was_taken_from():
    env = gym.make(TUNING).unwrapped
    env.reset(seed=7)
    env.step(ACTION)
    copy = pickle.loads(pickle.dumps(env))
    for a, b in ((env.step(ACTION), copy.step(ACTION)), (env.reset(), copy.reset())):
        np.testing.assert_array_equal(a[0], b[0])
        assert a[1:] == b[1:]


def test_a_schedule_drives_the_environment(tmp_path):
    env = ReductionTuningEnv(instances=table(tmp_path, SURE))
    inside = ThresholdSchedule(env, Schedule(np.array([[-0.5, 0.0], [0.5, 0.2]]), every=3))
    _, _, infos, _ = episode(inside, lambda _: None, seed=0)
    alphas = [info["thresholds"]["alpha"] for info in infos[1:]]
    assert len(set(alphas[:3])) == len(set(alphas[3:])) == 1 and alphas[0] < alphas[3]
    _, rewards, _, _ = episode(ThresholdSchedule(env, Constant(ACTION)), lambda _: None, seed=0)
    assert rewards == episode(env, lambda _: ACTION, seed=0)[1]


@pytest.mark.parametrize(
    ("kwargs", "message"),
    [
        ({"parameters": ("beta",)}, "unknown threshold 'beta'"),
        ({"parameters": ()}, "parameters must be a list"),
        ({"parameters": np.array(["alpha"])}, "parameters must be a list of different thresholds, got array"),
        ({"parameters": [["alpha"]]}, r"unknown threshold \['alpha'\]"),
        ({"price": -1.0}, "price must be a number, non-negative and finite, got -1.0"),
        ({"price": np.nan}, "price must be a number, non-negative"),
        ({"price": "1e-4"}, "price must be a number, non-negative and finite, got '1e-4'"),
        ({"components": "30"}, "components must be at least 1, got '30'"),
        ({"components": np.inf}, "components must be a whole number, got inf"),
        ({"components": 1}, r"components must lie in \[2, 200\]"),
        ({"components": 30.5}, "components must be a whole number, got 30.5"),
        ({"instances": "trian"}, "cannot read the instances 'trian'"),
    ],
)
def test_bad_arguments_are_refused(kwargs, message):
    with pytest.raises(ValueError, match=message):
        ReductionTuningEnv(**kwargs)


def test_the_looked_ahead_reward_is_the_one_that_comes_and_changes_nothing(tmp_path):
    env, rng = ReductionTuningEnv(instances=table(tmp_path, SURE, LOST)), np.random.default_rng(0)
    for name in ("sure", "lost"):
        env.reset(seed=3, options={"instance_id": name})
        over = False
        while not over:
            action = rng.uniform(0, 1, 2)
            near, far = env.lookahead_reward(action), env.lookahead_reward(action, 2)
            assert near == env.lookahead_reward(action)
            _, reward, terminated, truncated, _ = env.step(action)
            over = terminated or truncated
            assert near == reward
            assert far == pytest.approx(reward + (0 if over else env.lookahead_reward(action)), abs=1e-12)
    with pytest.raises(RuntimeError, match="call reset"):
        env.lookahead_reward(action)


def test_the_former_name_of_the_looked_ahead_reward_warns_and_gives_the_same(tmp_path):
    env = ReductionTuningEnv(instances=table(tmp_path, SURE))
    env.reset(seed=3)
    with pytest.warns(DeprecationWarning, match="foreseen is now lookahead_reward"):
        assert env.foreseen(ACTION, 2) == env.lookahead_reward(ACTION, 2)


def test_bad_options_and_actions_are_refused():
    env = ReductionTuningEnv()
    with pytest.raises(RuntimeError, match="call reset"):
        env.step(ACTION)
    with pytest.raises(ValueError, match="unknown instance 'train-0'; did you mean 'train-"):
        env.reset(options={"instance_id": "train-0"})
    with pytest.raises(ValueError, match="unknown option 'instance'; reset takes 'instance_id'"):
        env.reset(options={"instance": "train-00"})
    env.reset(seed=0)
    for action, message in (
        (np.zeros(3), r"action must have shape \(2,\)"),
        (np.full(2, np.nan), "action must be finite"),
        (np.full(2, 1.5), r"within \[-1, 1\], got \[1.5, 1.5\]"),
    ):
        with pytest.raises(ValueError, match=message):
            env.step(action)
    env.step(ACTION)  # a refused action has changed nothing


def test_commands_that_run_trackers_refuse_it():
    with pytest.raises(
        ValueError, match=r"ReductionTuning-v0 is not a tracking environment: no tracker runs in it"
    ):
        scenario_of(TUNING, {})


def test_its_spec_goes_through_json_with_its_arguments():
    env = gym.make(TUNING, parameters=["alpha", "components"], instances="valid", price=1e-4)
    spec = env.spec.to_json()
    assert json.loads(spec)["kwargs"]["instances"] == "valid"
    again = gym.make(gym.envs.registration.EnvSpec.from_json(spec)).unwrapped
    assert again.parameters == ("alpha", "components") and again.price == 1e-4


def test_the_tables_are_apart_and_extrapolation_lies_outside():
    rows = {name: instances(name) for name in TABLES}
    assert [len(found) for found in rows.values()] == [56, 16, 24, 12]
    ids = [i for found in rows.values() for i in found]
    assert len(set(ids)) == len(ids)
    inside = [row for name in TABLES[:3] for row in rows[name].values()]
    for row in inside:
        assert 50 <= row.clutter_rate <= 400 and 0.7 <= row.detection_probability <= 0.98
    flown = {row.trajectory for row in inside}
    for row in rows["extrapolation"].values():
        assert row.trajectory not in flown
        assert row.clutter_rate >= 450 or row.detection_probability <= 0.7
    drawn = [
        {row.trajectory for row in found.values() if "jump" in row.trajectory} for found in rows.values()
    ]
    assert all(a.isdisjoint(b) for i, a in enumerate(drawn) for b in drawn[:i])
    assert set(trajectory_names()) <= flown | {row.trajectory for row in rows["extrapolation"].values()}


@pytest.mark.parametrize("number", range(4))
def test_the_committed_tables_are_what_the_script_draws(number):
    table, rng = TABLES[number], np.random.default_rng((SEED, number))
    kinds = UNSEEN if table == "extrapolation" else SEEN
    rows = list(instances(table).values())
    shares = (rng.permutation(len(rows)) + rng.random(len(rows))) / len(rows)
    for i, row in enumerate(rows):
        kind = kinds[i % len(kinds)]
        candidates = (drawn(rng, f"{table}-{i:02}", kind, number, shares[i]) for _ in range(100))
        assert any(candidate == row for candidate in candidates)  # the ones before it nobody could follow


@pytest.mark.parametrize("table", TABLES[:3])
def test_clutter_is_spread_evenly_over_its_range_in_every_table(table):
    """No table of a few rows may leave out what another is judged by."""
    rates = np.array([row.clutter_rate for row in instances(table).values()])
    shares = np.sort(np.log(rates / 50) / np.log(400 / 50))
    n = len(shares)
    # of the rows only what nobody could follow at first was drawn anew, and that with its own clutter
    np.testing.assert_allclose(shares, (np.arange(n) + 0.5) / n, atol=0.51 / n)


def test_the_script_keeps_what_can_be_followed():
    assert followed(SURE)
    assert not followed(SURE._replace(manoeuvre=6.0, told_acceleration_deviation=0.05))


@pytest.mark.parametrize("name", [*trajectory_names(), "jump-markov-7"])
def test_manoeuvre_scales_the_accelerations_of_a_path_and_nothing_else(name):
    paths = [world(SURE._replace(trajectory=name, manoeuvre=m)) for m in (1.0, 0.5, 0.0)]
    x = [scenario.truth(None).x[:, :2] for scenario in paths]
    bent = [np.diff(path, 2, axis=0) for path in x]
    np.testing.assert_allclose(bent[1], bent[0] / 2, atol=1e-6)  # m/s^2, of paths that are 1e5 m away
    np.testing.assert_allclose(bent[2], 0, atol=1e-6)
    np.testing.assert_array_equal(paths[0].model.prior.m[0, :2], trajectory(name)[0, :2])
    assert len(x[0]) == min(SCANS, len(trajectory(name)) - 1)


@pytest.mark.parametrize(
    ("change", "column", "message"),
    [
        ({"clutter_rate": -1}, "clutter_rate", "'-1' is invalid"),
        ({"clutter_rate": "nan"}, "clutter_rate", "'nan' is invalid"),
        ({"detection_probability": 1.2}, "detection_probability", "'1.2' is invalid"),
        ({"sensor_deviation": "wide"}, "sensor_deviation", "'wide' is not a number"),
        ({"first_scan": 2.5}, "first_scan", "'2.5' is not a whole number"),
        ({"first_scan": 99}, "first_scan", "turning-target has 2 scans from scan 99, wanted at least 4"),
        ({"trajectory": "turning"}, "trajectory", "unknown 'turning'; choose from turning-target, "),
        ({"instance_id": ""}, "instance_id", "'' is invalid"),
        ({"instance_id": "sure"}, "instance_id", "'sure' is used twice"),
    ],
)
def test_an_impossible_value_is_refused_by_file_row_and_column(tmp_path, change, column, message):
    bad = SURE._replace(**{"instance_id": "bad", **change})
    file = table(tmp_path, SURE, bad)
    with pytest.raises(ValueError, match=f"^{file}, row 3, column {column}: {message}"):
        instances(file)


@pytest.mark.parametrize(
    ("header", "rows", "message"),
    [
        ((*COLUMNS, "clutter_rat"), [(*SURE, 1)], "unknown column 'clutter_rat'; did you mean"),
        (COLUMNS[:-1], [SURE[:-1]], "column 'told_acceleration_deviation' must appear once, not 0"),
        ((*COLUMNS, "manoeuvre"), [(*SURE, 1)], "column 'manoeuvre' must appear once, not 2 times"),
        (COLUMNS, [SURE[:-1]], "row 2: 8 cells for 9 columns"),
        (COLUMNS, [], "no instances below the header"),
    ],
)  # fmt: skip
def test_a_table_of_another_form_is_refused(tmp_path, header, rows, message):
    with pytest.raises(ValueError, match=message):
        instances(table(tmp_path, *rows, header=header))


def test_columns_may_stand_in_any_order_and_files_may_be_missing(tmp_path):
    assert instances(table(tmp_path, SURE[::-1], header=COLUMNS[::-1])) == {"sure": SURE}
    with pytest.raises(ValueError, match="cannot read the instances"):
        instances(str(tmp_path / "nowhere.csv"))
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ValueError, match="cannot read the instances"):
        instances(str(tmp_path / "binary.csv"))
