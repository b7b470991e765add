"""An agent's own frame: detections about its prediction, actions as offsets from it, everything scaled."""

import copy
import pickle
import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import SyncVectorEnv
from same_bits import assert_same

import gmr_gym  # noqa: F401  registers the environments
from gmr_gym.envs.registry import TRACKING
from gmr_gym.learning import RelativeTracking, RelativeTrackingVector
from gmr_gym.learning.prediction import Prediction
from gmr_gym.mixture import gaussian
from gmr_gym.models.kalman import predict
from gmr_gym.scenarios.dortenzio import turning_target

TURNING, JUMP, RADAR, CLUTTER = (
    f"gmr_gym/{name}-v0" for name in ("TurningTarget", "JumpMarkov", "AirborneRadar", "UnknownClutter")
)


def single(env_id=TURNING, nearest=8, reach=None, **world):
    return RelativeTracking(gym.make(env_id, **world).unwrapped, nearest, reach)


def several(n, env_id=TURNING, nearest=8, reach=None, **world):
    return RelativeTrackingVector(gym.make_vec(env_id, n, **world), nearest, reach)


@pytest.mark.parametrize(
    ("env_id", "world"),
    [*((env_id, {}) for env_id in TRACKING), (TURNING, {"observe": "truth"})],
)
def test_every_environment_of_one_target_passes_gymnasiums_check_in_the_agents_frame(env_id, world):
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*is different from the unwrapped version")
        warnings.filterwarnings("error", message=".*(obs|space|symmetric)")
        env = single(env_id, **world)
        env.action_space.seed(0)
        check_env(env)


@pytest.mark.parametrize("nearest", [3, 500, None])
def test_an_agent_sees_the_nearest_detections_about_its_prediction_in_units_of_reach(nearest):
    env, plain = single(nearest=nearest, reach=250.0), gym.make(TURNING)
    seen, _ = env.reset(seed=2)
    observation, _ = plain.reset(seed=2)
    mean, F = observation["prior_mean"], turning_target().model.motions[0].F
    away = (observation["scan"][observation["mask"] == 1] - (F @ mean)[:2]) / 250.0
    away = away[(np.abs(away) <= 1).all(axis=1)]
    away = away[np.argsort((away**2).sum(axis=1))][:nearest]
    assert 3 <= len(away) == seen["mask"].sum()
    np.testing.assert_allclose(seen["detections"][: len(away)], away, rtol=1e-6)
    assert not seen["detections"][len(away) :].any() and not seen["mask"][len(away) :].any()
    assert len(seen["mask"]) == (nearest or len(observation["mask"]))
    assert seen["detections"].dtype == np.float32


def test_an_action_is_an_offset_from_the_prediction_and_the_reward_a_share_of_the_cutoff():
    env = single(reach=50.0)
    env.reset(seed=1)
    F, H = turning_target().model.motions[0].F, np.eye(2, 4)
    predicted = F @ [0.0, 0.0, 10.0, -10.0]
    truth = env.unwrapped._episode.x[0]
    _, reward, *_, info = env.step([0.2, -0.1])
    assert info["error"] == pytest.approx(np.linalg.norm(H @ (predicted - truth) + [10.0, -5.0]), rel=1e-12)
    assert reward == pytest.approx(-info["error"] / 100.0, rel=1e-12)


def test_an_agent_that_gives_what_a_kalman_filter_would_is_a_kalman_filter():
    model = turning_target().model
    (x,), (P,) = model.prior.m, model.prior.P
    H, R, rng = model.sensor.H, model.sensor.R, np.random.default_rng(0)
    prediction = Prediction(model, x, P, 1)
    for _ in range(20):
        ahead = predict(gaussian(x, P), model.motion)
        np.testing.assert_allclose(prediction.m, ahead.m, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(prediction.P, ahead.P, rtol=1e-9, atol=1e-9)
        (x,), (P,) = ahead.m, ahead.P
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        nu = rng.normal(size=2) * 20
        x, P = x + K @ nu, (np.eye(4) - K @ H) @ P
        estimate = prediction.estimates((H @ K @ nu)[None])
        np.testing.assert_allclose(estimate[0], x, rtol=1e-9, atol=1e-9)
        prediction.move_on(estimate)


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
@pytest.mark.parametrize(
    ("env_id", "world"),
    [(TURNING, {"horizon": 17, "observe": "truth"}), (JUMP, {}), (RADAR, {"horizon": 15})],
)
def test_a_vector_in_the_agents_frame_is_single_ones_bit_for_bit(env_id, world, mode):
    one = several(4, env_id, autoreset_mode=mode, **world)
    other = SyncVectorEnv(
        [lambda: single(env_id, **world)] * 4, autoreset_mode=one.metadata["autoreset_mode"]
    )
    assert one.observation_space == other.observation_space and one.action_space == other.action_space
    one.action_space.seed(3)
    a, b = one.reset(seed=5), other.reset(seed=5)
    lost = 0
    for step in range(50):
        assert_same(a[0], b[0])
        assert_same(a[-1], b[-1])
        assert one.observation_space.contains(a[0])
        actions = one.action_space.sample() * np.float32(0.1)
        actions[::2] += 0.9 * (step > 20)  # until the target is given up
        a, b = one.step(actions), other.step(actions)
        assert_same(a[1], b[1])
        lost += a[2].sum()
    assert lost > 0


def test_a_mask_begins_anew_what_it_names_and_leaves_the_rest_where_it_was():
    envs = several(3, autoreset_mode="Disabled", horizon=30)
    envs.reset(seed=0)
    for _ in range(3):
        seen, *_ = envs.step(np.full((3, 2), 0.05))
    again, _ = envs.reset(seed=[7, None, 8], options={"reset_mask": np.array([True, False, True])})
    np.testing.assert_array_equal(again["detections"][1], seen["detections"][1])
    fresh, _ = several(1, horizon=30).reset(seed=7)
    np.testing.assert_array_equal(again["detections"][0], fresh["detections"][0])


def test_in_the_twin_an_agent_that_answers_what_it_sees_errs_by_nothing():
    env = single(observe="truth")
    seen, _ = env.reset(seed=0)
    for _ in range(30):
        seen, reward, *_, info = env.step(seen["truth"])
        assert info["error"] < 1e-4 and reward > -1e-6


def test_a_frame_is_made_again_by_its_spec_and_goes_on_as_a_pickled_copy():
    env = RelativeTracking(gym.make(TURNING, horizon=9), nearest=4, reach=60.0)
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert_same(env.reset(seed=1)[0], again.reset(seed=1)[0])
    plain = single(horizon=9)
    plain.reset(seed=1)
    for twin in (pickle.loads(pickle.dumps(plain)), copy.deepcopy(plain)):
        again = copy.deepcopy(plain)
        assert_same(again.step([0.1, 0.1])[0], twin.step([0.1, 0.1])[0])


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"nearest": 0}, "^nearest must be at least 1"),
        ({"nearest": 2.5}, "^nearest must be a whole number, got 2.5"),
        ({"nearest": 10**9}, "^nearest must be at most 10000, got 1000000000"),
        ({"reach": "a"}, "^reach must be a number, at least 0, got 'a'"),
        ({"reach": 0}, "^reach must be positive and finite, got 0"),
        ({"reach": np.inf}, "^reach must be positive and finite, got inf"),
        ({"env_id": CLUTTER}, "^env must be .* of one target, got .*MultiTarget"),
    ],
)
def test_wrong_arguments_are_refused_by_name(wrong, message):
    for made in (lambda: single(**wrong), lambda: several(2, **wrong)):
        with pytest.raises(ValueError, match=message):
            made()


@pytest.mark.parametrize(
    ("action", "message"),
    [
        ([0.0], r"must have shape \(2,\), got \(1,\)"),
        ([0.0, 1.5], r"must lie in \[-1, 1\], got \[0.0, 1.5\]"),
        ([0.0, np.nan], r"must lie in \[-1, 1\]"),
        (["a", "b"], r"must be numbers of shape \(2,\)"),
        (np.ma.array([0.0, 0.0], mask=[True, False]), "must be given in full"),
    ],
)
def test_an_action_outside_the_space_is_refused(action, message):
    env = single()
    env.reset(seed=0)
    with pytest.raises(ValueError, match=f"^action {message}"):
        env.step(action)
