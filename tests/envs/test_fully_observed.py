"""The fully observed twin of an environment: the same episodes, with the truth in the observation."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from radar_files import given
from same_bits import assert_same

import gmr_gym  # noqa: F401  registers the environments
from gmr_gym.envs.registry import TRACKED

TURNING, JUMP, RADAR, CLUTTER = (
    f"gmr_gym/{name}-v0" for name in ("TurningTarget", "JumpMarkov", "AirborneRadar", "UnknownClutter")
)
MARKOV, SET = ("truth", "mode", "scans_off"), ("truth", "present")


def twin(env_id, **kwargs):
    return gym.make(env_id, observe="truth", **given(env_id), **kwargs).unwrapped


@pytest.mark.parametrize("env_id", sorted(TRACKED))
def test_the_twin_of_every_tracking_environment_passes_gymnasiums_check(env_id):
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*symmetric and normalized space")  # metres are meant
        env = twin(env_id)
        env.action_space.seed(0)
        check_env(env)


@pytest.mark.parametrize(("env_id", "more"), [(TURNING, MARKOV), (JUMP, MARKOV), (CLUTTER, SET)])
def test_the_twin_plays_the_same_episode_and_shows_what_info_has(env_id, more):
    plain, full = gym.make(env_id).unwrapped, twin(env_id)
    plain.action_space.seed(1)
    a, b = plain.reset(seed=3), full.reset(seed=3)
    for _ in range(5):
        assert_same(a[0], {key: b[0][key] for key in a[0]})
        assert_same(a[-1], b[-1])
        assert b[0].keys() - a[0].keys() == {*more}
        for key in {*more} & b[-1].keys():
            np.testing.assert_array_equal(b[0][key].ravel(), np.ravel(b[-1][key]))
        action = plain.action_space.sample()
        a, b = plain.step(action), full.step(action)
        assert a[1:4] == b[1:4]


def test_what_the_twin_shows_suffices_for_an_error_of_nothing_and_says_when_a_target_will_be_given_up():
    env = twin(JUMP)
    observation, _ = env.reset(seed=1)
    for _ in range(5):
        observation, reward, *_ = env.step(observation["truth"])
        assert reward == 0 and observation["scans_off"] == [0]
    seen, ended = [], False
    while not ended:
        observation, _, ended, *_ = env.step(observation["truth"] + [1e4, 0, 0, 0])
        seen.append(int(observation["scans_off"][0]))
    assert seen == [1, 2, 3, 4, 5, 6, 7, 8, 9, 0]  # the last of an empty observation
    assert not observation["truth"].any()


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize(
    ("env_id", "world"),
    [(TURNING, {"horizon": 7}), (JUMP, {}), (RADAR, {"horizon": 5}), (CLUTTER, {"horizon": 4})],
)
def test_twins_side_by_side_are_single_ones_bit_for_bit(env_id, world, mode):
    one = gym.make_vec(env_id, 3, autoreset_mode=mode, observe="truth", **world)
    other = SyncVectorEnv([lambda: twin(env_id, **world)] * 3, autoreset_mode=mode)
    assert one.observation_space == other.observation_space
    one.action_space.seed(2)
    (seen, _), (again, _) = one.reset(seed=4), other.reset(seed=4)
    assert one.observation_space.contains(seen)
    for step in range(25):
        assert_same(seen, again)
        actions = one.action_space.sample()
        if "prior_mean" in seen:  # some far away, until the target is given up
            actions = seen["truth"] + 1e4 * (np.arange(3)[:, None] == step % 20 // 12)
        a, b = one.step(actions), other.step(actions)
        assert_same(a[4], b[4])
        np.testing.assert_array_equal(a[1], b[1])
        seen, again = a[0], b[0]


def test_an_observation_may_be_written_to():
    envs = gym.make_vec(TURNING, 2, observe="truth")
    first, info = envs.reset(seed=0)
    first["truth"][...] = 0
    assert info["truth"].any() and envs.step(first["prior_mean"])[0]["truth"].all()


@pytest.mark.parametrize("env_id", [TURNING, CLUTTER])
def test_anything_else_to_observe_is_refused(env_id):
    for make in (gym.make, gym.make_vec):
        with pytest.raises(ValueError, match=r"^observe must be one of detections, truth, got 'all'$"):
            make(env_id, observe="all")
