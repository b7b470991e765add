"""ReductionTuning inside DACBench: its runner, its wrappers, its instances."""

import gymnasium as gym
import numpy as np
import pytest

from gmr_gym.tuning.instances import instances

with pytest.MonkeyPatch.context() as patch:
    patch.setattr("warnings.warn", lambda *said, **more: None)  # of benchmarks whose packages are not there
    dacbench = pytest.importorskip("dacbench", exc_type=ImportError)

from dacbench.agents import StaticAgent
from dacbench.runner import run_benchmark
from dacbench.wrappers import PerformanceTrackingWrapper

from gmr_gym.envs.dacbench import ReductionTuningBenchmark

V0, V1 = "gmr_gym/ReductionTuning-v0", "gmr_gym/ReductionTuning-v1"


def config(**given):
    return dacbench.abstract_benchmark.objdict(given)


def made(**given):
    return ReductionTuningBenchmark(config=config(**given))


def test_an_episode_is_that_of_the_environment_itself():
    env, own = made().get_environment(), gym.make(V1).unwrapped
    observation, info = env.reset(seed=5)
    wanted, said = own.reset(seed=5, options={"instance_id": env.get_instance().instance_id})
    assert info == said
    np.testing.assert_array_equal(observation, wanted)
    rng = np.random.default_rng(0)
    for _ in range(5):
        action = rng.uniform(-0.5, 0.5, 5)
        got, theirs = env.step(action), own.step(action)
        np.testing.assert_array_equal(got[0], theirs[0])
        assert got[1:] == theirs[1:]
    assert env.observation_space == own.observation_space and env.action_space == own.action_space


def test_instances_come_in_turn_and_those_held_out_when_asked():
    env = made(environment=V0, instance_set_path="train", test_set_path="test").get_environment()
    names = [*instances("train")]
    seen = [env.reset()[1]["instance_id"] for _ in range(2)]
    assert seen == names[1:3]  # DACBench begins by taking the next
    env.use_test_set()
    assert env.reset(options={"instance_id": 0})[1]["instance_id"] == next(iter(instances("test")))


def test_episodes_without_a_seed_are_drawn_by_that_of_the_benchmark():
    def first(seed):
        return made(environment=V0, instance_set_path="train", seed=seed).get_environment().reset()[0]

    np.testing.assert_array_equal(first(1), first(1))
    assert not np.array_equal(first(1), first(2))


def test_its_runner_and_a_wrapper_of_its_own_run_to_the_cutoff():
    benchmark = made(environment=V0, instance_set_path="train", test_set_path="test", cutoff=3)
    benchmark.register_wrapper(PerformanceTrackingWrapper)
    env = benchmark.get_environment()
    mean = run_benchmark(env, StaticAgent(env, np.zeros(2)), 2)
    assert -1.5 < mean < 0
    assert len(env.get_performance()[0]) == 2


def test_a_configuration_is_written_and_read_again(tmp_path):
    benchmark = made(environment=V0, instance_set_path="train", test_set_path="test", cutoff=7)
    benchmark.get_environment()
    assert [*benchmark.config.config_space] == ["0_alpha", "1_prune"]
    benchmark.save_config(tmp_path / "config.json")
    for again in (
        ReductionTuningBenchmark(config_path=tmp_path / "config.json"),
        ReductionTuningBenchmark.from_json(benchmark.to_json()),
    ):
        env = again.get_environment()
        assert (env.n_steps, env.action_space.shape) == (7, (2,))
        assert len(env.instance_set) == len(instances("train"))


def test_the_benchmark_as_compared_on_has_every_default():
    env = made(environment=V0, instance_set_path="train").get_benchmark(seed=4)
    assert (len(env.instance_set), len(env.test_set), env.initial_seed) == (96, 48, 4)
    assert env.action_space.shape == (5,)


def test_another_environment_is_refused():
    with pytest.raises(ValueError, match=r"must be one of .*ReductionTuning-v0, .* got 'Luby-v0'"):
        made(environment="Luby-v0")
