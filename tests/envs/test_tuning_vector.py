"""Tuning environments side by side against as many single ones."""

from functools import partial

import gymnasium as gym
import numba
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import gmr_gym  # noqa: F401  registers the environments
from gmr_gym.envs.registry import TUNING
from gmr_gym.tuning.instances import Instance

SURE = Instance("sure", "turning-target", 70, 0.5, 20.0, 0.95, 5.0, 5.0, 3.0)
LOST = SURE._replace(instance_id="lost", clutter_rate=500.0, detection_probability=0.1)
HALF = SURE._replace(instance_id="half", clutter_rate=60.0, detection_probability=0.5, first_scan=90)


@pytest.fixture
def table(tmp_path):
    file = tmp_path / "table.csv"
    rows = (Instance._fields, SURE, LOST, HALF)
    file.write_text("\n".join(",".join(map(str, row)) for row in rows) + "\n", encoding="utf-8")
    return str(file)


def vector(n, **kwargs):
    return gym.make_vec(TUNING, n, vectorization_mode="vector_entry_point", **kwargs)


def assert_same(one, other, where=""):
    """The same types and the same values to the last bit, at any depth."""
    assert type(one) is type(other), where
    if isinstance(one, dict):
        assert one.keys() == other.keys(), where
        for key in one:
            assert_same(one[key], other[key], f"{where}/{key}")
    elif one.dtype == object:
        assert [type(value) for value in one] == [type(value) for value in other], where
        assert all(np.array_equal(a, b) for a, b in zip(one, other, strict=True)), where
    else:
        assert one.dtype == other.dtype, where
        np.testing.assert_array_equal(one, other, err_msg=where)


@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
@pytest.mark.parametrize("seed", [7, [3, 1, 3, 9]])
def test_they_are_single_ones_to_the_last_bit_through_several_episodes(table, mode, seed):
    told = {"instances": table, "parameters": ("alpha", "prune", "components")}
    single = SyncVectorEnv([partial(gym.make, TUNING, **told)] * 4, autoreset_mode=mode)
    many = vector(4, autoreset_mode=mode.value, **told)
    assert many.metadata["autoreset_mode"] is mode
    assert many.observation_space == single.observation_space and many.action_space == single.action_space
    for one, other in zip(single.reset(seed=seed), many.reset(seed=seed), strict=True):
        assert_same(one, other, "reset")
    rng, ends = np.random.default_rng(0), np.zeros(2, int)
    for t in range(120):
        actions = rng.uniform(0.1, 1, (4, 3)).astype(np.float32)
        results = single.step(actions), many.step(actions)
        for part, (one, other) in enumerate(zip(*results, strict=True)):
            assert_same(one, other, f"{t}, {part}")
        ends += results[0][2].sum(), results[0][3].sum()
    assert (ends > 2).all()  # losses, and ends by time
    for one, other in zip(single.reset(), many.reset(), strict=True):
        assert_same(one, other, "reset without a seed")


def test_neither_the_number_of_threads_nor_of_neighbours_changes_anything(table, monkeypatch):
    actions, found = np.full((6, 2), 0.3, np.float32), []
    for threads, n in ((1, 6), (3, 6), (3, 4)):
        monkeypatch.setattr(numba.config, "NUMBA_NUM_THREADS", threads)
        envs = vector(n, instances=table)
        rows = [envs.reset(seed=2)[0]]
        for _ in range(20):
            observation, reward, *_ = envs.step(actions[:n])
            rows.append(np.column_stack([observation, reward]))
        found.append(rows)
    for one, other, fewer in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)
        np.testing.assert_array_equal(one[:4], fewer)


def test_observations_are_overwritten_only_where_that_is_asked_for(table):
    for copy in (True, False):
        envs = vector(2, instances=table, copy=copy)
        first, _ = envs.reset(seed=0)
        kept = first.copy()
        second, *_ = envs.step(np.zeros((2, 2)))
        assert (second is first) is not copy
        assert np.array_equal(first, kept) is copy


def test_without_a_reset_of_their_own_episodes_that_are_over_stand_still(table):
    envs, again = (vector(3, instances=table, autoreset_mode=mode) for mode in ("Disabled", "NextStep"))
    running = np.ones(3, bool)
    envs.reset(seed=1), again.reset(seed=1)
    for _ in range(35):
        results = [one.step(np.full((3, 2), 0.5)) for one in (envs, again)]
        for part, other in zip(*(result[:4] for result in results), strict=True):
            np.testing.assert_array_equal(part[running], other[running])
            assert not part[~running].any()
        running &= ~(results[0][2] | results[0][3])
    assert not running.all()
    assert envs.reset(seed=1)[0].any(axis=1).all()


def test_an_instance_may_be_asked_for(table):
    envs = vector(3, instances=table)
    _, infos = envs.reset(seed=[4, 5, 6], options={"instance_id": "lost"})
    assert infos["instance_id"].tolist() == ["lost"] * 3
    with pytest.raises(ValueError, match="unknown instance 'last'; did you mean 'lost'"):
        envs.reset(options={"instance_id": "last"})


def test_what_cannot_be_is_refused(table):
    for kwargs, message in (
        (
            {"autoreset_mode": "Never"},
            "autoreset_mode must be one of NextStep, SameStep, Disabled, got 'Never'",
        ),
        ({"price": -1.0}, "price must be a number, non-negative and finite, got -1.0"),
        ({"components": 1}, r"components must lie in \[2, 200\]"),
        ({"parameters": ("beta",)}, "unknown threshold 'beta'"),
    ):
        with pytest.raises(ValueError, match=message):
            vector(2, instances=table, **kwargs)
    for count, message in ((0, "at least 1, got 0"), (2.5, "a whole number, got 2.5"), ("2", "1, got '2'")):
        with pytest.raises(ValueError, match=f"num_envs must be .*{message}"):
            vector(count, instances=table)
    envs = vector(2, instances=table)
    with pytest.raises(RuntimeError, match=r"call reset\(\) before step\(\)"):
        envs.step(np.zeros((2, 2)))
    with pytest.raises(ValueError, match="seed must be a whole number or 2 of them"):
        envs.reset(seed=[1, 2, 3])
    envs.reset(seed=0)
    for actions, message in (
        (np.zeros(2), r"actions must have shape \(2, 2\), one number each for alpha, prune, got \(2,\)"),
        (np.array([[0.0, 0.0], [0.0, np.nan]]), r"finite and within \[-1, 1\], got \[0.0, nan\] for .* 1"),
        (np.zeros((2, 2), complex), r"actions must be numbers of shape \(2, 2\)"),
        ([["a", "b"]] * 2, "actions must be numbers"),
        (np.array([[1.5, 0.0], [0.0, 0.0]]), r"got \[1.5, 0.0\] for environment 0"),
    ):
        with pytest.raises(ValueError, match=message):
            envs.step(actions)
    with pytest.raises(ValueError, match="actions must be given in full"):
        envs.step(np.ma.masked_all((2, 2)))
    envs.step(np.zeros((2, 2)))  # a refused action has changed nothing


def test_an_error_in_one_of_them_is_raised(table):
    envs = vector(2, instances=table)
    envs.reset(seed=0)
    envs._state["P"][1] = np.diag([-1.0, 1.0, 1.0, 1.0])
    with pytest.raises(ValueError, match="not positive definite"):
        envs.step(np.zeros((2, 2)))
