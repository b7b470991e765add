"""The vector environment is as many single ones, bit for bit: Gymnasium's own SyncVectorEnv is what it has to
equal."""

import copy
import multiprocessing
import pickle
from concurrent.futures import ThreadPoolExecutor

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import gmr_gym  # noqa: F401  registers the environments
from gmr_gym.envs.registry import TRACKING, TUNING
from gmr_gym.envs.vector import TrackingVectorEnv

TURNING, FLIGHT, AGILE, JUMP, RADAR = (
    f"gmr_gym/{name}-v0"
    for name in ("TurningTarget", "RecordedFlight", "AgileFlight", "JumpMarkov", "AirborneRadar")
)
# short episodes, so that several are played
WORLDS = [
    (TURNING, {"horizon": 17}),
    (TURNING, {"horizon": 13, "clutter_rate": 0, "detection_probability": 0.5}),
    (FLIGHT, {"horizon": 15, "window": (600, 900)}),
    (AGILE, {"horizon": 14}),
    (JUMP, {}),
    (RADAR, {"horizon": 16}),
]
MODES = [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP]


def native(env_id, n, **kwargs):
    return gym.make_vec(env_id, num_envs=n, vectorization_mode="vector_entry_point", **kwargs)


def in_turn(env_id, n, mode=AutoresetMode.NEXT_STEP, **world):
    return SyncVectorEnv([lambda: gym.make(env_id, **world).unwrapped] * n, autoreset_mode=mode)


def assert_same(a, b):
    """Observations or infos, dicts inside them too, with the same keys, types and bits."""
    assert a.keys() == b.keys()
    for key in a:
        if isinstance(a[key], dict):
            assert_same(a[key], b[key])
        elif a[key].dtype == object:
            for one, other in zip(a[key], b[key], strict=True):
                assert (one is None) == (other is None)
                if one is not None:
                    assert_same(one, other)
        else:
            assert a[key].dtype == b[key].dtype, key
            np.testing.assert_array_equal(a[key], b[key], err_msg=key)


def estimates(info, step, rng):
    """About the truth, but now and then every third environment's far away, until its track is lost."""
    truth = info.get("truth", np.zeros((1, 1)))  # of none, where all episodes have just ended
    near = truth + rng.normal(size=truth.shape)
    near[::3, 0] += 1e6 * (step % 50 < 28)
    return near


def same_play(one, other, seed):
    """Steps both; how many episodes ended, lost and at the horizon."""
    lost, over, rng = 0, 0, np.random.default_rng(5)
    for a, b in ((one.reset(seed=seed), other.reset(seed=seed)), (one.reset(), other.reset())):
        assert_same(a[0], b[0])
        assert_same(a[1], b[1])
    info = a[1]
    shape = info["truth"].shape
    for step in range(120):
        given = np.broadcast_to(estimates(info, step, rng), shape)
        a, b = one.step(given), other.step(given)
        info = a[4]
        assert_same(a[0], b[0])
        for i in (1, 2, 3):
            assert a[i].dtype == b[i].dtype
            np.testing.assert_array_equal(a[i], b[i])
        assert_same(info, b[4])
        lost, over = lost + a[2].sum(), over + a[3].sum()
    return lost, over


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize(("env_id", "world"), WORLDS)
def test_a_vector_of_n_is_n_single_environments_bit_for_bit(env_id, world, mode):
    one, other = native(env_id, 5, autoreset_mode=mode, **world), in_turn(env_id, 5, mode, **world)
    lost, over = same_play(one, other, seed=[3, 1, 4, 1, 5])
    assert lost > 0 and over > 0
    assert one.observation_space == other.observation_space and one.action_space == other.action_space


@pytest.mark.parametrize("env_id", sorted(TRACKING))
def test_every_id_of_one_target_has_a_vector_environment_of_its_own(env_id):
    envs = gym.make_vec(env_id, num_envs=3)
    assert isinstance(envs, TrackingVectorEnv) and envs.spec.id == env_id
    assert envs.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
    observation, _ = envs.reset(seed=2)
    assert envs.observation_space.contains(observation)
    for i in range(3):
        alone, _ = gym.make(env_id).unwrapped.reset(seed=2 + i)
        assert_same(alone, {key: part[i] for key, part in observation.items()})
    assert envs.observation_space.contains(envs.step(observation["prior_mean"])[0])
    envs.close()


@pytest.mark.parametrize("env_id", [TURNING, AGILE])
def test_seeds_drawn_ahead_are_those_of_the_stream_and_a_new_one_discards_them(env_id):
    one, other = native(env_id, 3, horizon=1), in_turn(env_id, 3, horizon=1)
    prior = one.reset(seed=[4, 2**70, 5])[0]["prior_mean"]
    other.reset(seed=[4, 2**70, 5])
    for step in range(80):
        assert_same(one.step(prior)[0], other.step(prior)[0])
        if step == 50:
            for a, b in zip(one.reset(seed=[None, 8, 5]), other.reset(seed=[None, 8, 5]), strict=True):
                assert_same(a, b)


def test_threads_and_the_number_of_environments_change_nothing():
    one, two, three = (native(FLIGHT, n, threads=threads) for n, threads in ((150, 1), (150, 2), (70, 3)))
    *_, info = (envs.reset(seed=9)[1] for envs in (three, two, one))
    rng = np.random.default_rng(6)
    for step in range(40):
        given = estimates(info, step, rng)
        a, b, c = one.step(given), two.step(given), three.step(given[:70])
        info = a[4]
        for i in (0, 4):
            assert_same(a[i], b[i])
            assert_same({key: part[:70] for key, part in a[i].items()}, c[i])
        np.testing.assert_array_equal(a[1][:70], c[1])


def test_threads_of_the_callers_own_may_step_at_once():
    def played(seed):
        envs = native(TURNING, 100, threads=2, horizon=10)
        prior = envs.reset(seed=seed)[0]["prior_mean"]
        return np.array([envs.step(prior)[0]["scan"].sum() for _ in range(30)])

    with ThreadPoolExecutor(3) as pool:
        together = list(pool.map(played, range(3)))
    np.testing.assert_array_equal(together, [played(seed) for seed in range(3)])


@pytest.mark.skipif("fork" not in multiprocessing.get_all_start_methods(), reason="no fork on this system")
@pytest.mark.filterwarnings("ignore:.*fork")
def test_a_forked_process_makes_its_scans_too():
    envs = native(TURNING, 100, threads=2)
    prior = envs.reset(seed=1)[0]["prior_mean"]
    with multiprocessing.get_context("fork").Pool(1) as pool:
        there = pool.apply_async(envs.step, (prior,)).get(timeout=60)
    assert_same(there[0], envs.step(prior)[0])


def test_without_a_copy_the_next_step_writes_over_the_last_and_says_the_same():
    kept, fresh = native(TURNING, 40, copy=False, horizon=9), native(TURNING, 40, horizon=9)
    first, again = kept.reset(seed=1)[0], fresh.reset(seed=1)[0]
    assert_same(first, again)
    before = copy.deepcopy(again)
    for _ in range(30):
        a, b = kept.step(before["prior_mean"]), fresh.step(before["prior_mean"])
        assert a[0]["scan"] is first["scan"] and b[0]["scan"] is not again["scan"]
        assert_same(a[0], b[0])
        assert_same(a[4], b[4])
    assert_same(before, again)


def test_what_was_handed_out_may_be_written_to():
    spoilt, untouched = native(JUMP, 4), native(JUMP, 4)
    prior = untouched.reset(seed=0)[0]["prior_mean"].copy()
    for part in spoilt.reset(seed=0)[0].values():
        part[...] = 0
    for _ in range(60):
        estimates = prior.copy()
        a, b = spoilt.step(estimates), untouched.step(prior)
        assert_same(a[0], b[0])
        assert_same(a[4], b[4])
        for part in (estimates, *a[0].values(), a[1], a[2], a[3], *a[4].values()):
            part[...] = 0


@pytest.mark.parametrize("env_id", [TURNING, RADAR])
def test_a_mask_begins_anew_what_it_names_and_leaves_the_rest(env_id):
    envs, other = (
        native(env_id, 4, autoreset_mode="Disabled", horizon=12),
        in_turn(env_id, 4, AutoresetMode.DISABLED, horizon=12),
    )
    prior = envs.reset(seed=6)[0]["prior_mean"]
    other.reset(seed=6)
    mask = np.array([False, True, False, True])
    for step in range(20):
        a, b = envs.step(prior), other.step(prior)
        assert_same(a[0], b[0])
        ended = a[2] | a[3]
        if step == 4:
            again = [
                e.reset(seed=[1, 2, 3, None], options={"reset_mask": mask.copy()}) for e in (envs, other)
            ]
        elif ended.any():
            again = [e.reset(options={"reset_mask": ended.copy()}) for e in (envs, other)]
        else:
            continue
        for a, b in zip(*again, strict=True):
            assert_same(a, b)


def test_an_ended_episode_has_to_be_begun_anew_by_hand_where_nothing_else_does_it():
    envs = native(TURNING, 2, autoreset_mode=AutoresetMode.DISABLED, horizon=3)
    prior = envs.reset(seed=0)[0]["prior_mean"]
    for _ in range(3):
        envs.step(prior)
    with pytest.raises(RuntimeError, match=r"call reset\(\) before step"):
        envs.step(prior)


def test_what_is_given_for_an_episode_that_is_over_does_not_count():
    envs, other = native(FLIGHT, 2, horizon=3), native(FLIGHT, 2, horizon=3)
    prior = envs.reset(seed=0)[0]["prior_mean"]
    other.reset(seed=0)
    for step in range(9):
        over = step % 4 == 3
        a, b = (
            envs.step(prior),
            other.step(np.full_like(prior, np.nan if step == 3 else 1e300) if over else prior),
        )
        assert_same(a[0], b[0])
        assert_same(a[4], b[4])
        assert not over or ("error" not in a[4] and not a[1].any())


def test_a_pickled_copy_goes_on_as_the_original():
    envs = native(FLIGHT, 3, horizon=8)
    prior = envs.reset(seed=0)[0]["prior_mean"]
    envs.step(prior)
    twin = pickle.loads(pickle.dumps(envs))
    for _ in range(12):
        assert_same(envs.step(prior)[0], twin.step(prior)[0])


def test_unseeded_environments_differ_from_one_another():
    scans = native(TURNING, 3).reset()[0]["scan"]
    assert not np.isin(scans[0][:50], scans[1:]).any()


@pytest.mark.parametrize("env_id", [TURNING, TUNING])
def test_environments_side_by_side_say_that_they_are_not_drawn(env_id):
    with pytest.raises(ValueError, match="make a single one to render: render_mode"):
        gym.make_vec(env_id, 2, vectorization_mode="vector_entry_point", render_mode="rgb_array")
    envs = gym.make_vec(env_id, 2, vectorization_mode="vector_entry_point")
    assert envs.metadata["render_modes"] == []
    with pytest.raises(NotImplementedError, match="vector environments are not rendered; make a single one"):
        envs.render()


def test_wrong_arguments_are_refused_by_name():
    for wrong, message in (
        ({"num_envs": 0}, "num_envs must be at least 1"),
        ({"num_envs": 2.5}, "num_envs must be a whole number, got 2.5"),
        ({"threads": 0}, "threads must be at least 1"),
        (
            {"autoreset_mode": "never"},
            "autoreset_mode must be one of NextStep, SameStep, Disabled, got 'never'",
        ),
        ({"clutter": 3}, "unknown argument 'clutter'"),
    ):
        with pytest.raises(ValueError, match=message):
            TrackingVectorEnv(TRACKING[TURNING], **{"num_envs": 2} | wrong)
    envs = native(TURNING, 2)
    with pytest.raises(RuntimeError, match=r"call reset\(\) before step"):
        envs.step(np.zeros((2, 4)))
    for seed in ([1, 2, 3], "ab", True, [0.5, 1]):
        with pytest.raises(ValueError, match="seed must be a whole number or 2 of them"):
            envs.reset(seed=seed)
    for mask in (np.zeros(2, bool), np.ones(3, bool), np.ones(2)):
        with pytest.raises(ValueError, match="must be 2 booleans, at least one of them true"):
            envs.reset(options={"reset_mask": mask})
    envs.reset(seed=np.array([1, 2]))
    for action, message in (
        (np.zeros(4), r"actions must have shape \(2, 4\), got \(4,\)"),
        ([["a"] * 4] * 2, "actions must be numbers"),
        (np.full((2, 4), np.nan), "actions must be finite and within"),
        (np.ma.array(np.zeros((2, 4)), mask=np.eye(2, 4)), "actions must be given in full"),
        (np.array([[0.0] * 4, [2e7, 0, 0, 0]]), r"got \[20000000.0, 0.0, 0.0, 0.0\] in row 1"),
    ):
        with pytest.raises(ValueError, match=message):
            envs.step(action)
