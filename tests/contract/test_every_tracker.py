"""Every tracker on every scenario: which models it takes, and whatever may stand in a scan."""

import re
import sys
from functools import cache, partial

import gymnasium as gym
import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher

import gmr_gym  # noqa: F401, the environments
from gmr_gym.envs.registry import MULTI_TARGET, TRACKING
from gmr_gym.filters.registry import GROUP, MULTI_TARGET_GROUP, make_tracker, trackers
from gmr_gym.models.kalman import Sensor
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.points import FARTHEST
from gmr_gym.scenarios.li import airborne_radar
from gmr_gym.scenarios.lv import unknown_clutter

MODELS = {env_id: gym.make(env_id).unwrapped.scenario.model for env_id in TRACKING}
# nothing in the models of these is new to a tracker that takes the others
ALIKE = "gmr_gym/CrossingTargets-v0", "gmr_gym/DenseTargets-v0"
MODELS |= {
    env_id: gym.make(env_id).unwrapped.scenario.model for env_id in MULTI_TARGET if env_id not in ALIKE
}
MODELS["known clutter"] = unknown_clutter(told="true", clutter="dense").model
MODELS["a wide regime"] = airborne_radar("extreme", update="extended").model

EVERY = [
    (world, name)
    for world, told in MODELS.items()
    for name in trackers(MULTI_TARGET_GROUP if isinstance(told, MultiTargetModel) else GROUP)
]
each = pytest.mark.parametrize("world, name", EVERY)


@cache
def made(world, name):
    """The tracker of that name told of that world; a test of one that cannot be made has nothing to show."""
    try:
        return make_tracker(name, MODELS[world])
    except ValueError as error:
        pytest.skip(str(error))


def detections(world, tracker, seed, k=6, reach=1000.0):
    """k detections up to `reach` away along every axis, or in range; one for whom takes no more."""
    rng, sensor = np.random.default_rng(seed), MODELS[world].sensor
    k = min(k, 1) if getattr(tracker, "knows_origin", False) else k
    if isinstance(sensor, Sensor):
        return reach * rng.uniform(-1, 1, (k, len(sensor.H)))
    return np.column_stack([reach * rng.uniform(0.1, 1, k), rng.uniform(-3, 3, k), rng.uniform(-1.5, 1.5, k)])


def played(tracker, scans):
    belief, out = tracker.init(), []
    for z in scans:
        belief, said = tracker.step(belief, z)
        out.append(said)
    return out


def numbers_of(said):
    """Every array of a report, whatever records it is made of, and every number as one."""
    return [a for part in said for a in numbers_of(part)] if isinstance(said, tuple) else [np.asarray(said)]


def assert_same(reports, others):
    for one, other in zip(reports, others, strict=True):
        for a, b in zip(numbers_of(one), numbers_of(other), strict=True):
            np.testing.assert_array_equal(a, b)


def assert_finite(said):
    # gates may have no end
    parts = [part for field, part in said._asdict().items() if field != "gates"]
    assert all(np.isfinite(a).all() for a in numbers_of(tuple(parts)))


def specialisations():
    """How often each kernel of the project has been compiled."""
    modules = [module for name, module in sys.modules.items() if name.startswith("gmr_gym")]
    kernels = {id(k): k for module in modules for k in vars(module).values() if isinstance(k, Dispatcher)}
    return {key: len(kernel.signatures) for key, kernel in kernels.items()}


def frozen(z):
    z = z.copy()
    z.setflags(write=False)
    return z


KINDS = [
    *(partial(np.asarray, dtype=kind) for kind in (np.float32, np.int64, np.int16, ">f8")),
    *(np.asfortranarray, np.ndarray.tolist, frozen),
    lambda z: np.repeat(z, 2, axis=0)[::2],
    lambda z: np.repeat(z, 2, axis=1)[:, ::2],
]


@each
def test_what_a_scan_would_refuse_of_a_model_is_refused_when_the_tracker_is_made(world, name):
    try:
        tracker = make_tracker(name, MODELS[world])
    except ValueError as error:
        assert re.search(r"needs? a (radar|linear sensor)|knows one motion", str(error))
        return
    for said in played(tracker, [detections(world, tracker, seed, k=seed) for seed in range(3)]):
        assert_finite(said)


@each
@pytest.mark.parametrize("certain", [False, True])
def test_far_detections_leave_numbers(world, name, certain):
    made(world, name)
    told = MODELS[world]
    if certain:  # and gates, where there are any, hold everything
        told = told._replace(detection_probability=1.0)
        told = told if isinstance(told, MultiTargetModel) else told._replace(gate_probability=1.0)
    tracker = make_tracker(name, told)
    for reach in (1e8, 1e9, FARTHEST):
        scans = [detections(world, tracker, seed, k, reach) for seed, k in enumerate((3, 1, 0, 6))]
        for said in played(tracker, scans):
            assert_finite(said)


@each
def test_detections_beyond_all_measure_are_refused_by_row(world, name):
    tracker = made(world, name)
    z = detections(world, tracker, 0, k=3)
    for far in (2e15, 1e100, 1e160, -1e300):
        z[-1, 0] = far
        message = f"z must lie within +-1e+10; row {len(z) - 1} is [{far}, "
        with pytest.raises(ValueError, match=re.escape(message)):
            tracker.step(tracker.init(), z)


@each
def test_masked_detections_are_absent(world, name):
    tracker = made(world, name)
    there = [detections(world, tracker, seed) for seed in range(3)]
    masked, listed = [], []
    for z in there:
        hidden = np.vstack([z[:1], z, z[:1]])
        mask = np.zeros(hidden.shape, bool)
        mask[0, -1] = mask[-1] = True
        hidden[0, -1] = np.nan  # whatever stands under a mask
        masked.append(np.ma.array(hidden, mask=mask))
        listed.append(list(masked[-1]))
    assert_same(played(tracker, masked), played(tracker, there))
    assert_same(played(tracker, listed), played(tracker, there))
    nobody = [np.ma.masked_all_like(z) for z in there]
    assert_same(played(tracker, nobody), played(tracker, [z[:0] for z in there]))


@each
def test_scans_of_any_kind_of_numbers_are_tracked_alike_by_the_same_kernels(world, name):
    tracker = made(world, name)
    # whole numbers, which every kind holds
    scans = [np.ceil(detections(world, tracker, seed)) for seed in range(2)]
    if not isinstance(MODELS[world].sensor, Sensor):
        scans = [z * [1.0, 1.0, 0.0] for z in scans]
    plain, before = played(tracker, scans), specialisations()
    for kind in KINDS:
        others = [kind(z) for z in scans]
        assert_same(played(tracker, others), plain)
    assert specialisations() == before
