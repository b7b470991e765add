"""What critics are told of the truth, against its definitions written out."""

from functools import partial

import gymnasium as gym
import numpy as np
import pytest

import gmr_gym  # noqa: F401  registers the environments
from gmr_gym.filters.mht import predict_and_update
from gmr_gym.mixture import Mixture, moments
from gmr_gym.reduction.runnalls import total_merge_cost
from gmr_gym.simulation.single_target import scan
from gmr_gym.tuning.features import FEATURES
from gmr_gym.tuning.hindsight import AHEAD, HINDSIGHT
from gmr_gym.tuning.thresholds import DORTENZIO, adapt, to_action

ACTION = to_action(DORTENZIO, ("alpha", "prune"))


def pair(**options):
    make = partial(gym.make, "gmr_gym/ReductionTuning-v0", **options)
    return [make(hindsight=told).unwrapped for told in (False, True)]


def test_hindsight_stands_behind_the_features_and_changes_nothing_else():
    plain, told = pair(instances="valid")
    seen, more = plain.reset(seed=3)[0], told.reset(seed=3)[0]
    for _ in range(200):
        assert more.shape == told.observation_space.shape == (len(FEATURES) + len(HINDSIGHT),)
        np.testing.assert_array_equal(more[: len(FEATURES)], seen)
        assert told.observation_space.contains(more)
        (seen, *rest), (more, *others) = plain.step(ACTION), told.step(ACTION)
        assert rest == others
        if rest[1] or rest[2]:
            seen, more = plain.reset()[0], told.reset()[0]


@pytest.mark.parametrize("wrong", [-1, 2, "yes", None])
def test_hindsight_is_there_or_it_is_not(wrong):
    with pytest.raises(ValueError, match="hindsight must be True or False"):
        gym.make("gmr_gym/ReductionTuning-v0", hindsight=wrong)


@pytest.mark.parametrize("seed", range(3))
def test_hindsight_is_what_it_is_called(seed):
    _, env = pair(instances="train")
    observation, _ = env.reset(seed=seed)
    scenario, episode = env._scenario, env._episode
    H, R, x = scenario.model.sensor.H, scenario.model.sensor.R, episode.x
    strayed, belief = 0, scenario.model.prior
    for t in range(60):
        z = scan(scenario, episode, t, scenario.centre(moments(belief)[0])).z
        full = predict_and_update(belief, scenario.model, z)
        w, m, P = full.posterior.mixture
        belief = Mixture(
            *adapt(w, m, P, np.array(DORTENZIO, float), total_merge_cost(Mixture(w, m, P)), 0)[:3]
        )
        found = dict(zip(HINDSIGHT, observation[len(FEATURES) :].tolist(), strict=True))
        target = H @ x[t]
        distances = np.array([
            (target - H @ a) @ np.linalg.solve(H @ C @ H.T, target - H @ a) for a, C in zip(m, P, strict=True)
        ])  # fmt: skip
        holds = distances <= full.gates.threshold
        later = min(t + AHEAD, len(x) - 1)
        turned = H @ (x[later] - x[t]) - (later - t) * scenario.period * x[t, list(scenario.velocity)]
        wanted = {
            "left": 2 * (len(x) - t) / 100 - 1,
            "strayed": strayed / 5 - 1,
            "error": np.log10(1 + np.linalg.norm(target - H @ (w @ m))) / 1.5 - 1,
            "nearest": np.log10(0.1 + distances.min()) / 2,
            "holding": 2 * w[holds].sum() - 1,
            "hope": np.log10(max(w[holds].max(initial=0.0), 1e-8)) / 4 + 1,
            "turning": np.log10(0.1 + np.linalg.norm(turned) / np.sqrt(R[0, 0])) - 0.5,
            "showing": 2 * episode.detected[t : later + 1].mean() - 1,
            "noise": 5 * np.log(np.sqrt(scenario.sensor.R[0, 0] / R[0, 0])),
        }
        for name in HINDSIGHT:
            assert found[name] == pytest.approx(np.clip(wanted[name], -2, 2), abs=1e-5), (name, t)
        observation, _, terminated, truncated, info = env.step(ACTION)
        strayed = strayed + 1 if info["error"] > scenario.cutoff else 0
        if terminated or truncated:
            break
