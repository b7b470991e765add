"""Labels of estimates: rewards by trajectories, and labels that two estimates share."""

import gymnasium as gym
import numpy as np
import pytest

import gmr_gym
from gmr_gym.evaluation.multi_target_runs import run_multi_target_once
from gmr_gym.evaluation.trajectory_metrics import trajectory_gospa

ID, HALF = "gmr_gym/CrossingTargets-v0", 6
WORLD = {"n": 2, "horizon": 2 * HALF, "metric": "trajectory-gospa", "labels": True, "targets": 3}


def rewards(act, **settings):
    """Of an episode in which act(t, states) gives the rows; and the true positions (T, m, 2)."""
    env, found, paths = gym.make(ID, **WORLD | settings).unwrapped, [], []
    _, info = env.reset(seed=4)
    for t in range(env.scenario.horizon):
        paths.append(info["truth"][:, :2])
        rows = np.zeros(env.action_space.shape)
        rows[:2] = act(t, info["truth"])
        _, reward, _, _, info = env.step(rows)
        found.append(reward)
    return np.array(found), np.array(paths)


def labelled(x, labels):
    return np.column_stack([np.ones(len(x)), x, labels])


def exchanged(t, x):
    return labelled(x + 1.0, [5, 9] if t < HALF else [9, 5])


def test_rewards_sum_to_minus_the_trajectory_gospa_of_the_episode():
    found, paths = rewards(exchanged)
    tracks = paths + 1.0
    tracks[HALF:] = tracks[HALF:, ::-1]
    whole = trajectory_gospa(tracks, paths, 25.0, 2.0, 2.5)
    assert whole.switches == pytest.approx(2 * 2.5**2)
    assert -found.sum() == pytest.approx(whole.total) and (found < 0).all()
    assert found[HALF] < found[HALF - 1] - 1.0  # the scan at which they are exchanged


def test_a_switch_costs_what_is_asked_for_and_sets_do_not_see_it():
    kept = rewards(lambda t, x: labelled(x + 1.0, [5, 9]))[0].sum()
    for switching in (1.0, 4.0):
        found = rewards(exchanged, switching=switching)[0].sum()
        assert found**2 - kept**2 == pytest.approx(2 * switching**2)
    np.testing.assert_allclose(rewards(exchanged, metric="gospa")[0], -2.0)


def test_an_estimate_without_a_label_is_a_trajectory_of_one_scan():
    found, paths = rewards(lambda t, x: labelled(x, [-1, -0.7]))
    apart = np.full((2 * HALF, 4 * HALF, 2), np.nan)
    for t in range(2 * HALF):
        apart[t, 2 * t : 2 * t + 2] = paths[t]
    assert -found.sum() == pytest.approx(trajectory_gospa(apart, paths, 25.0, 2.0, 2.5).total)


def test_the_label_is_the_whole_number_next_to_it():
    near, _ = rewards(lambda t, x: labelled(x, [0.4 * (-1) ** t, 1.3]))
    assert near.sum() == pytest.approx(0.0, abs=1e-6)


def test_a_policy_of_a_trackers_labels_is_rewarded_by_its_trajectories_as_a_run_has_them():
    env = gym.make("gmr_gym/MeetingTargets-v0", horizon=20, metric="trajectory-gospa", labels=True).unwrapped
    tracker = gmr_gym.make_tracker("pmb", env.scenario.model)
    policy, total, over = gmr_gym.MultiTargetPolicy(tracker, labels=True), 0.0, False
    observation, _ = env.reset(seed=3)
    while not over:
        observation, reward, _, over, _ = env.step(policy(observation))
        total -= reward
    runs = run_multi_target_once(env.scenario, tracker, 3)
    parts = (field for name, field in runs._asdict().items() if name.startswith("trajectory_"))
    assert total == pytest.approx(np.sqrt(np.sum([*parts])), rel=1e-9)


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match=r"metric trajectory-gospa compares .*: it needs labels=True"):
        gym.make(ID, metric="trajectory-gospa")
    with pytest.raises(ValueError, match="switching must be positive and finite, got 0"):
        gym.make(ID, switching=0.0)
    with pytest.raises(ValueError, match="labels must be True or False, got 2"):
        gym.make(ID, labels=2)
    message = r"differ among the estimates of a scan, got 4 in the rows 0 and 1$"
    with pytest.raises(ValueError, match=message):
        rewards(lambda t, x: labelled(x, [4, 4.2]), metric="gospa")
