"""The tracker whose thresholds a network sets."""

import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest

import gmr_gym  # noqa: F401  registers the environments
from gmr_gym.baselines.learned import LearnedThresholds, learned_thresholds
from gmr_gym.baselines.mht import adaptive
from gmr_gym.evaluation.loop import play
from gmr_gym.filters.registry import make_tracker
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.scenarios.li import airborne_radar
from gmr_gym.simulation.single_target import draw
from gmr_gym.tuning.features import FEATURES
from gmr_gym.tuning.network import Network, save
from gmr_gym.tuning.policies import ByNetwork
from gmr_gym.tuning.thresholds import DORTENZIO, to_action

WORLD = turning_target(horizon=30)


def network(seed=0, scale=0.3, bias=None):
    """Acts at random about `bias`, or always as it where the scale is 0."""
    rng, k = np.random.default_rng(seed), len(FEATURES)
    out = np.zeros(2) if bias is None else np.array(bias)
    return Network(
        FEATURES, ("alpha", "prune"), np.zeros(k), np.ones(k), 5.0, "tanh", False,
        (rng.normal(0, scale, (8, k)), rng.normal(0, scale, (2, 8))), (np.zeros(8), out),
    )  # fmt: skip


def test_a_network_that_says_one_thing_is_the_tracker_with_fixed_thresholds():
    fixed = DORTENZIO._replace(alpha=0.02, prune=1e-4)
    learned = LearnedThresholds(WORLD.model, network(scale=0.0, bias=to_action(fixed, ("alpha", "prune"))))
    plain = adaptive(WORLD.model, 100, 0.02, 1e-4)
    for one, other in zip(*(play(WORLD, t, draw(WORLD, 1)) for t in (learned, plain)), strict=True):
        assert len(one.report.mixture.w) == len(other.report.mixture.w)
        np.testing.assert_allclose(one.report.x, other.report.x, rtol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_it_does_without_gym_what_the_policy_does_in_the_environment(seed):
    env = gym.make("gmr_gym/ReductionTuning-v0", instances="valid").unwrapped
    observation, _ = env.reset(seed=seed)
    policy, errors, kept, over = ByNetwork(network(seed)), [], [], False
    while not over:
        observation, _, lost, late, info = env.step(policy(observation, len(errors)))
        errors.append(info["error"])
        kept.append(info["components"])
        over = lost or late
    scenario, episode = env._scenario, env._episode
    tracker = LearnedThresholds(scenario.model, network(seed))
    for played, error, components in zip(play(scenario, tracker, episode), errors, kept, strict=False):
        off = (played.report.x[0] - episode.x[played.t])[list(scenario.position)]
        assert np.linalg.norm(off) == pytest.approx(error, rel=1e-12)
        assert len(played.report.mixture.w) == components


def test_a_policy_file_and_its_limits_are_checked_when_the_tracker_is_made(tmp_path):
    save(tmp_path / "p.npz", network())
    tracker = learned_thresholds(WORLD.model, tmp_path / "p.npz", 50)
    assert tracker.rest.components == 50
    with pytest.raises(ValueError, match="components must lie in"):
        learned_thresholds(WORLD.model, tmp_path / "p.npz", 1)
    save(tmp_path / "noise.npz", network()._replace(parameters=("alpha", "process_noise")))
    with pytest.raises(ValueError, match=r"parameters must be different ones of \('alpha', 'prune', .*noise"):
        learned_thresholds(WORLD.model, tmp_path / "noise.npz")  # which it would not heed
    with pytest.raises(ValueError, match="not a readable policy"):
        learned_thresholds(WORLD.model, tmp_path / "none.npz")


def test_a_radar_is_refused():
    with pytest.raises(ValueError, match="learned thresholds need a linear sensor"):
        make_tracker("learned-thresholds", airborne_radar("near", 10.0, trajectory="drawn").model)


def test_torch_is_not_imported(tmp_path):
    save(tmp_path / "p.npz", network())
    code = (
        "import sys, gmr_gym\n"
        "from gmr_gym.scenarios.dortenzio import turning_target\n"
        "from gmr_gym.baselines.learned import learned_thresholds\n"
        f"tracker = learned_thresholds(turning_target().model, policy={str(tmp_path / 'p.npz')!r})\n"
        "tracker.step(tracker.init(), [[0.0, 0.0]])\n"
        "assert not {'torch', 'stable_baselines3'} & set(sys.modules)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
