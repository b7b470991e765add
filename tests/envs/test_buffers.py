"""Memory is handed out again once nobody can read it, and no sooner."""

import ctypes
import gc
import weakref

import gymnasium as gym
import numpy as np
import pytest

import gmr_gym  # noqa: F401  registers the environments
from gmr_gym.envs.buffers import KEPT, Buffers

SHAPE = 6, 5, 2


def tensor(a):
    return pytest.importorskip("torch").from_numpy(a)


# whatever may be kept of an array, and how its numbers are read
HELD = {
    "itself": lambda a: a,
    "a slice": lambda a: a[2:4],
    "a slice of a slice": lambda a: a[1:][:3][::-1],
    "a transposed reshape": lambda a: a.reshape(-1, 2).T,
    "other numbers": lambda a: a.view(np.int64),
    "its owner": lambda a: a.base,
    "a subclass": lambda a: a.view(np.recarray)[1:],
    "strides": lambda a: np.lib.stride_tricks.sliding_window_view(a, 2, axis=0),
    "a memoryview": lambda a: memoryview(a)[1:],
    "a buffer": lambda a: np.frombuffer(a.data, float),
    "a capsule": lambda a: np.from_dlpack(a)[1:],
    "an iterator": lambda a: a.flat,
    "a ctypes array": lambda a: (ctypes.c_double * a.size).from_buffer(a),
    "the array of a pointer": lambda a: a.ctypes.data_as(ctypes.POINTER(ctypes.c_double))._arr,
    "an object array's item": lambda a: np.array([None, a[0]], dtype=object)[1],
    "a tensor": tensor,
    "a slice of a tensor": lambda a: tensor(a)[2:].reshape(-1)[1:],
    "numpy's of a tensor's": lambda a: tensor(a[1:])[1:].numpy(),
}


@pytest.fixture(autouse=True, scope="module")
def older_objects_are_not_searched():
    """A search for garbage takes .3 s where other tests have left a million objects."""
    gc.collect()
    gc.freeze()
    yield
    gc.unfreeze()


def read(held):
    return np.array(held.numpy() if hasattr(held, "numpy") else held)


@pytest.mark.parametrize("kind", HELD)
def test_what_is_held_in_any_way_is_left_alone_and_given_again_after(kind):
    buffers = Buffers(np.empty(SHAPE))
    a = buffers.take()
    a[:] = np.arange(a.size).reshape(SHAPE)
    start, held = a.ctypes.data, HELD[kind](a)
    before = read(held)
    del a
    for _ in range(3 * KEPT):
        other = buffers.take()
        assert other.ctypes.data != start
        other[:] = -1.0
    np.testing.assert_array_equal(read(held), before)
    del held, other
    gc.collect()
    buffers = Buffers(np.empty(SHAPE))
    addresses = set()
    for _ in range(20):
        a = buffers.take()
        held = HELD[kind](a)
        addresses.add(a.ctypes.data)
        del a, held
        gc.collect()
    assert len(addresses) == 1


def test_one_who_keeps_the_last_takes_turns_between_two():
    buffers, last, addresses = Buffers(np.empty(SHAPE)), None, []
    for _ in range(10):
        last = buffers.take()
        addresses.append(last.ctypes.data)
    assert len(set(addresses)) == 2 and addresses[2:] == addresses[:-2]


def test_who_keeps_all_gets_new_ones_and_a_few_are_kept_for_later():
    buffers = Buffers(np.empty(SHAPE))
    kept = [buffers.take() for _ in range(5 * KEPT)]
    for i, a in enumerate(kept):
        a[:] = i
    assert all((a == i).all() for i, a in enumerate(kept))
    owners = [weakref.ref(a.base) for a in kept]
    del kept, a
    assert sum(owner() is not None for owner in owners) == KEPT


def test_a_weak_reference_ends_with_what_was_handed_out():
    buffers = Buffers(np.empty(SHAPE))
    a = buffers.take()
    weak = weakref.ref(a)
    del a
    assert weak() is None


@pytest.mark.parametrize(
    ("env_id", "world"),
    [
        ("gmr_gym/TurningTarget-v0", {"horizon": 6, "clutter_rate": 20}),
        ("gmr_gym/AirborneRadar-v0", {"horizon": 6}),
    ],
)
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_nothing_of_an_observation_that_somebody_keeps_ever_changes(env_id, world, mode):
    envs = gym.make_vec(env_id, 70, autoreset_mode=mode, threads=2, **world)
    rng, kept = np.random.default_rng(1), []
    parts = envs.reset(seed=0)[0]
    prior = parts["prior_mean"].copy()
    for _ in range(150):
        observation, *scored, info = envs.step(prior)
        parts = {**observation, **{k: v for k, v in info.items() if k in ("truth", "origin", "error")}}
        for part in (*parts.values(), *scored):
            if rng.random() < 0.3:
                rows = np.sort(rng.integers(0, 71, 2))
                view = part[slice(*rows)].reshape(-1)[rng.integers(4) :]
                kept.append((view, view.copy()))
            if rng.random() < 0.1:  # or writes to it
                kept = [(view, copy) for view, copy in kept if not np.shares_memory(view, part)]
                part[...] = 1
        kept = [pair for pair in kept if rng.random() < 0.9]
        for view, copy in kept:
            np.testing.assert_array_equal(view, copy)
