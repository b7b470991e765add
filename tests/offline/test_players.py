"""Who plays the episodes of a data set: by what a user types."""

from importlib.resources import files

import gymnasium as gym
import numpy as np
import pytest

from gmr_gym.offline.players import SHIPPED, players_of
from gmr_gym.tuning.policies import ByNetwork
from gmr_gym.tuning.thresholds import REDUCERS, from_action

TUNING = "gmr_gym/ReductionTuning-v1"


@pytest.fixture(scope="module")
def env():
    return gym.make(TUNING).unwrapped


def test_the_shipped_policy_is_that_of_the_reducer(env):
    (learned,) = players_of(["learned"], env)
    policy = learned.begin(0)
    assert isinstance(policy, ByNetwork)
    assert (policy.network.features, policy.network.parameters) == (env.features, env.parameters)


def test_a_constant_sets_what_it_is_given_and_the_paper_s_values_else(env):
    (constant,) = players_of(["constant:history=1,process_noise=2"], env)
    thresholds = from_action(constant.begin(0)(np.zeros(38), 0), env.parameters)
    assert thresholds.history == 1 and thresholds.process_noise == pytest.approx(2)
    assert thresholds.prune == pytest.approx(5e-4) and thresholds.components == 100


def test_random_actions_are_those_of_the_episode_s_seed(env):
    (random,) = players_of(["random:every=2"], env)
    first, again, other = (
        np.array([policy(np.zeros(38), t) for t in range(4)]) for policy in map(random.begin, (1, 1, 2))
    )
    assert (first == again).all() and (first[0] == first[1]).all()
    assert (first != other).all() and (first[1] != first[2]).all()


@pytest.mark.parametrize(
    ("spec", "said"),
    [
        ("learnt", "unknown policy 'learnt'; did you mean 'learned'?"),
        ("pda", "'pda'; ReductionTuning is played by learned, constant, random, and not by trackers"),
        ("constant:alpha=0.1", "policy constant has no parameter 'alpha'; it takes history, prune"),
        ("constant:prune=0.1", r"prune must lie in \[1e-06, 0.01\] to be an action, got 0.1"),
        ("constant:prune=little", "prune must be a number, got 'little'"),
        ("random:every=0", "every must be"),
        ("learned:policy=none.npz", "none.npz is not a readable policy"),
    ],
)
def test_a_wrong_policy_is_refused(spec, said, env):
    with pytest.raises(ValueError, match=said):
        players_of([spec], env)


def test_an_environment_that_no_tracker_plays_is_refused():
    with pytest.raises(ValueError, match="must be an environment of this package, which trackers play; got"):
        players_of(["pda"], gym.make("CartPole-v1").unwrapped)


@pytest.mark.parametrize("reducer", REDUCERS)
def test_every_reducer_has_a_shipped_policy(reducer):
    shipped = np.load(str(files("gmr_gym.data") / "policies" / SHIPPED[reducer]))
    features, parameters = (shipped[name].tolist() for name in ("features", "parameters"))
    env = gym.make(TUNING, reducer=reducer, parameters=parameters, features=features).unwrapped
    (learned,) = players_of(["learned"], env)
    assert learned.begin(0).network.parameters == env.parameters
