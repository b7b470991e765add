"""Environments of many targets side by side are as many single ones, bit for bit."""

import copy
import pickle
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import gmr_gym  # noqa: F401  registers the environments
from gmr_gym.envs.multi_target_vector import MultiTargetVectorEnv
from gmr_gym.envs.registry import MULTI_TARGET
from gmr_gym.scenarios.lv import unknown_clutter

ID = "gmr_gym/UnknownClutter-v0"
PATH = np.random.default_rng(0).uniform(-900, 900, (5, 4, 4))
PATH[:2, 1] = PATH[3:, 2] = np.nan
# short episodes, so that several are played
WORLDS = [
    {"horizon": 6},
    {"horizon": 5, "clutter": "dense", "metric": "ospa"},
    {"horizon": 4, "clutter_rate": 0, "detection_probability": 0.5, "targets": 2},
    {"trajectory": PATH, "groups": [(0.7, (0, 0), (500, 300), (30, 0))], "clutter_rate": 9, "targets": 3},
]


def cubic(horizon: int = 4):
    """A scenario whose distances are not of order 1 or 2."""
    return replace(unknown_clutter(horizon=horizon), order=3.0)


OTHERS = [
    ("gmr_gym/MeetingTargets-v0", {"horizon": 6, "staggered": True}),
    ("gmr_gym/MeetingTargets-v0", {"trajectory": PATH % 300, "truth_seed": None, "metric": "ospa"}),
    ("gmr_gym/CrossingTargets-v0", {"horizon": 5, "n": 3, "shadows": [((0, 0), 400, 0.1)]}),
    ("gmr_gym/DenseTargets-v0", {"horizon": 3, "hot_spots": [(40, (100, 0), 60)]}),
    ("gmr_gym/ManoeuvringTargets-v0", {"horizon": 5}),
]


def native(n, /, env_id=ID, **kwargs):
    return gym.make_vec(env_id, num_envs=n, vectorization_mode="vector_entry_point", **kwargs)


def in_turn(n, /, mode=AutoresetMode.NEXT_STEP, env_id=ID, **world):
    return SyncVectorEnv([lambda: gym.make(env_id, **world).unwrapped] * n, autoreset_mode=mode)


def assert_same(a, b):
    """Arrays, or dicts of them, with the same keys, types and bits."""
    if isinstance(a, dict):
        assert a.keys() == b.keys()
        for key in a:
            assert_same(a[key], b[key])
    elif a is None or b is None:
        assert a is b
    elif a.dtype == object:
        for one, other in zip(a, b, strict=True):
            assert_same(one, other)
    else:
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)


def submitted(envs, info, rng):
    """Estimates near the targets, elsewhere, and some that do not count."""
    actions = rng.uniform(-300, 300, envs.action_space.shape)
    actions[:, :, 0] = rng.random(actions.shape[:2])
    if "truth" in info:  # not where all episodes have just ended
        rows = min(info["truth"].shape[1], actions.shape[1])
        off = rng.choice([0.0, 3.0, 60.0], (rows, 1)) * rng.normal(size=info["truth"][:, :rows].shape)
        actions[:, :rows, 1 : 1 + off.shape[2]] = info["truth"][:, :rows] + off
    if envs._single.labels:
        # mostly those of the scan before, some exchanged, some without
        labels = np.arange(actions.shape[1]) - 1.2
        actions[:, :, -1] = rng.permuted(np.tile(labels, (len(actions), 1)), axis=1)
        actions[::2, :, -1] = labels
    return actions


def same_play(one, other, seed, steps):
    """Steps both; how many episodes ended."""
    for a, b in ((one.reset(seed=seed), other.reset(seed=seed)), (one.reset(), other.reset())):
        assert_same(a[0], b[0])
        assert_same(a[1], b[1])
    info, rng, over = a[1], np.random.default_rng(5), 0
    for _ in range(steps):
        given = submitted(one, info, rng)
        a, b = one.step(given), other.step(given)
        for part, wanted in zip(a, b, strict=True):
            assert_same(part, wanted)
        info, over = a[4], over + a[3].sum()
        assert not a[2].any()
    return over


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("world", [*WORLDS, {"scenario": f"{__name__}:cubic"}])
def test_a_vector_of_n_is_n_single_environments_bit_for_bit(world, mode):
    one, other = native(4, autoreset_mode=mode, **world), in_turn(4, mode, **world)
    assert isinstance(one, MultiTargetVectorEnv) and one.metadata["autoreset_mode"] is mode
    assert one.observation_space == other.observation_space and one.action_space == other.action_space
    assert same_play(one, other, seed=[3, 1, 2**70, 1], steps=20) >= 8


@pytest.mark.parametrize(("env_id", "world"), OTHERS)
def test_so_it_is_in_every_environment_of_many_targets(env_id, world):
    one, other = native(3, env_id, **world), in_turn(3, env_id=env_id, **world)
    assert same_play(one, other, seed=[3, 1, 1], steps=14) >= 6


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("metric", ["gospa", "trajectory-gospa"])
def test_so_it_is_with_labels(metric, mode):
    world = {"env_id": "gmr_gym/MeetingTargets-v0", "horizon": 5, "metric": metric, "labels": True}
    one, other = native(3, autoreset_mode=mode, **world), in_turn(3, mode, **world)
    assert one.action_space.shape == (3, 10, 6)
    assert same_play(one, other, seed=[3, 1, 1], steps=14) >= 6


def test_two_estimates_of_one_label_are_refused_with_their_rows():
    envs = native(2, horizon=3, labels=True)
    envs.reset(seed=0)
    actions = np.zeros(envs.action_space.shape)
    actions[..., -1] = 3.0
    envs.step(actions)  # none counts
    actions[1, 1::3, 0] = 1.0
    actions[1, 7, -1], actions[1, 4, -1] = 2.0, 2.6
    with pytest.raises(ValueError, match=r"differ among .*, got 3 in the rows 1 and 4 of environment 1$"):
        envs.step(actions)
    actions[1, :, -1] = -1.0
    envs.step(actions)


@pytest.mark.parametrize("env_id", sorted(MULTI_TARGET))
def test_every_id_of_many_targets_has_a_vector_environment_of_its_own(env_id):
    envs = gym.make_vec(env_id, num_envs=2)
    assert isinstance(envs, MultiTargetVectorEnv) and envs.spec.id == env_id
    observation, _ = envs.reset(seed=2)
    assert envs.observation_space.contains(observation)
    envs.close()


def test_threads_and_the_number_of_environments_change_nothing():
    one, two, fewer = (native(n, threads=k, horizon=5) for n, k in ((70, 1), (70, 2), (40, 3)))
    assert (one._threads, two._threads) == (1, 2)
    *_, info = (envs.reset(seed=9)[1] for envs in (two, fewer, one))
    rng = np.random.default_rng(6)
    for _ in range(8):
        given = submitted(one, info, rng)
        a, b, c = one.step(given), two.step(given), fewer.step(given[:40])
        info = a[4]
        for part, same, of_fewer in zip(a, b, c, strict=True):
            assert_same(part, same)
            short = {key: each[:40] for key, each in part.items()} if isinstance(part, dict) else part[:40]
            assert_same(short, of_fewer)


def test_without_a_copy_the_next_step_writes_over_the_last_and_says_the_same():
    kept, fresh = native(3, copy=False, horizon=4), native(3, horizon=4)
    first, again = kept.reset(seed=1)[0], fresh.reset(seed=1)[0]
    before, nobody = copy.deepcopy(again), np.zeros(fresh.action_space.shape)
    for _ in range(9):
        a, b = kept.step(nobody), fresh.step(nobody)
        assert a[0]["scan"] is first["scan"] and b[0]["scan"] is not again["scan"]
        assert_same(a[0], b[0])
        assert_same(a[4], b[4])
    assert_same(before, again)


def test_what_was_handed_out_may_be_written_to():
    spoilt, untouched = native(2, horizon=5), native(2, horizon=5)
    spoilt.reset(seed=0), untouched.reset(seed=0)
    for _ in range(8):
        given = np.full(spoilt.action_space.shape, 0.7)
        a, b = spoilt.step(given), untouched.step(given.copy())
        for part, wanted in zip(a, b, strict=True):
            assert_same(part, wanted)
        for part in (given, *a[0].values(), *a[1:4], *a[4].values()):
            part[...] = 0


def test_a_mask_begins_anew_what_it_names_and_leaves_the_rest():
    envs, other = (
        native(3, autoreset_mode="Disabled", horizon=6),
        in_turn(3, AutoresetMode.DISABLED, horizon=6),
    )
    envs.reset(seed=6), other.reset(seed=6)
    nobody, mask = np.zeros(envs.action_space.shape), np.array([False, True, False])
    for step in range(12):
        a, b = envs.step(nobody), other.step(nobody)
        for part, wanted in zip(a, b, strict=True):
            assert_same(part, wanted)
        mask = np.array([False, True, False]) if step == 2 else a[3]
        if mask.any():
            again = [one.reset(options={"reset_mask": mask.copy()}) for one in (envs, other)]
            for part, wanted in zip(*again, strict=True):
                assert_same(part, wanted)


def test_an_ended_episode_has_to_be_begun_anew_by_hand_where_nothing_else_does_it():
    envs = native(2, autoreset_mode="Disabled", horizon=1)
    nobody = np.zeros(envs.action_space.shape)
    envs.reset(seed=0)
    envs.step(nobody)
    with pytest.raises(RuntimeError, match=r"call reset\(\) before step"):
        envs.step(nobody)


def test_what_is_given_for_an_episode_that_is_over_does_not_count():
    envs = native(2, horizon=2)
    envs.reset(seed=0)
    for step in range(6):
        given = np.zeros(envs.action_space.shape)
        given[...] = np.nan if step % 3 == 2 else 0.0
        _, reward, _, truncated, info = envs.step(given)
        assert truncated.all() == (step % 3 == 1)
        assert ("error" in info) == bool(reward.any()) == (step % 3 != 2)


def test_a_masked_row_is_no_estimate():
    envs, other = native(2, horizon=3), native(2, horizon=3)
    envs.reset(seed=0), other.reset(seed=0)
    actions = np.ones(envs.action_space.shape)
    masked = np.ma.array(actions, mask=np.zeros(actions.shape, bool))
    masked[0, 2, 3], masked[1, :, 0] = np.ma.masked, np.ma.masked
    masked.data[0, 2, 3] = np.nan
    actions[0, 2], actions[1] = 0.0, 0.0
    wanted = other.step(actions)
    for part, same in zip(envs.step(masked), wanted, strict=True):
        assert_same(part, same)
    assert wanted[4]["false"][0] > 0 == wanted[4]["false"][1]
    np.testing.assert_array_equal(envs.step(list(masked))[1], other.step(actions)[1])


def test_a_pickled_copy_goes_on_as_the_original():
    envs = native(2, horizon=3)
    envs.reset(seed=0)
    nobody = np.zeros(envs.action_space.shape)
    envs.step(nobody)
    twin = pickle.loads(pickle.dumps(envs))
    for _ in range(6):
        for part, wanted in zip(twin.step(nobody), envs.step(nobody), strict=True):
            assert_same(part, wanted)


def test_what_cannot_be_is_refused_by_name():
    for wrong, message in (
        ({"num_envs": 0}, "num_envs must be at least 1"),
        ({"threads": 0}, "threads must be at least 1"),
        ({"targets": 0}, "targets must be a whole number of rows between 1 and 1000, got 0"),
        ({"metric": "nees"}, "metric must be one of gospa, ospa, trajectory-gospa, got 'nees'"),
        (
            {"autoreset_mode": "never"},
            "autoreset_mode must be one of NextStep, SameStep, Disabled, got 'never'",
        ),
        ({"cluter": 3}, "unknown argument 'cluter'; did you mean 'clutter'"),
        ({"render_mode": "human"}, "make a single one to render: render_mode"),
    ):
        with pytest.raises(ValueError, match=message):
            MultiTargetVectorEnv(MULTI_TARGET[ID], **{"num_envs": 2} | wrong)
    envs, nobody = native(2), np.zeros((2, 10, 7))
    with pytest.raises(RuntimeError, match=r"call reset\(\) before step"):
        envs.step(nobody)
    with pytest.raises(NotImplementedError, match="vector environments are not rendered"):
        envs.render()
    envs.reset(seed=0)
    unsure, far, unknown = nobody.copy(), nobody.copy(), nobody.copy()
    unsure[1, 3, 0], far[1, 3, 2], unknown[0, 9, 6] = 1.5, 1.1e7, np.nan
    for actions, message in (
        (nobody[0], r"actions must have shape \(2, 10, 7\), got \(10, 7\)"),
        ([[["a"] * 7] * 10] * 2, "actions must be numbers of shape"),
        (
            unsure,
            r"existence, the first column, must lie in \[0, 1\], got \[0.0, .*1.5, .*\] in environment 1",
        ),
        (far, "actions must be finite and within .* and are not in environment 1"),
        (unknown, "actions must be finite and within .* and are not in environment 0"),
    ):
        with pytest.raises(ValueError, match=message):
            envs.step(actions)
    envs.step(nobody)  # a refused action has changed nothing
