"""Training scripts: the adapter, a run that goes on as if it had not been stopped, its policy in a file."""

import json
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
torch = pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")
yaml = pytest.importorskip("yaml")
sys.path.insert(0, str(ROOT / "agents"))

from export import network_of  # noqa: E402
from from_vector import WORK, FromVector  # noqa: E402
from gymnasium.vector import AutoresetMode, SyncVectorEnv  # noqa: E402
from judge import Episodes, played  # noqa: E402
from learner import ENV_ID, START, Run, environments, recorded, restored, settings  # noqa: E402
from recurrent import remembering  # noqa: E402

from gmr_gym.tuning.hindsight import HINDSIGHT  # noqa: E402
from gmr_gym.tuning.network import load, save  # noqa: E402
from gmr_gym.tuning.recent import ALL_FEATURES  # noqa: E402
from gmr_gym.tuning.thresholds import Thresholds, to_action  # noqa: E402

CONTRIB = find_spec("sb3_contrib")
FEW = {"ppo": {"n_steps": 32, "batch_size": 64, "n_envs": 4}, "sac": {"learning_starts": 50, "n_envs": 4}}


class Counting(gym.Env):
    """Counts to a length of its own; ends by itself where `dies`."""

    observation_space = gym.spaces.Box(-1000, 1000, (1,), np.float32)
    action_space = gym.spaces.Box(-1, 1, (1,), np.float32)

    def __init__(self, length, dies):
        self.length, self.dies = length, dies

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.t = 0
        return np.zeros(1, np.float32), {}

    def step(self, action):
        self.t += 1
        over = self.t == self.length
        return np.full(1, self.t, np.float32), float(self.t), over and self.dies, over and not self.dies, {}


def vector(mode=AutoresetMode.SAME_STEP):
    make = [lambda: Counting(2, False), lambda: Counting(3, True)]
    return SyncVectorEnv(make, autoreset_mode=mode)


def test_the_adapter_tells_the_last_observation_and_who_ended_by_time_alone():
    venv = FromVector(vector())
    np.testing.assert_array_equal(venv.reset(), [[0], [0]])
    seen = [venv.step(np.zeros((2, 1))) for _ in range(3)]
    np.testing.assert_array_equal([obs.ravel() for obs, *_ in seen], [[1, 1], [0, 2], [1, 0]])
    np.testing.assert_array_equal([over for _, _, over, _ in seen], [[0, 0], [1, 0], [0, 1]])
    assert seen[1][3][0] == {"TimeLimit.truncated": True, "terminal_observation": np.array([2.0])}
    assert seen[2][3][1] == {"TimeLimit.truncated": False, "terminal_observation": np.array([3.0])}
    assert "terminal_observation" not in seen[1][3][1]
    np.testing.assert_array_equal(seen[2][1], [1, 3])


def test_where_the_horizon_ends_a_problem_nobody_is_told_of_an_end_by_time():
    venv = FromVector(vector(), horizon_ends=True)
    venv.reset()
    _, _, over, infos = [venv.step(np.zeros((2, 1))) for _ in range(2)][1]
    assert over.tolist() == [True, False] and not any(info["TimeLimit.truncated"] for info in infos)
    run = environments(settings("ppo", 0, None, 100, {"components": 20}, None))
    assert run.venv.horizon_ends


def test_prices_weigh_alike_and_each_episode_by_its_own():
    venv = FromVector(gym.make_vec(
        ENV_ID, 2, vectorization_mode="vector_entry_point", autoreset_mode="SameStep", price=(1e-4, 1e-2)
    ))  # fmt: skip
    plain = gym.make_vec(
        ENV_ID, 2, vectorization_mode="vector_entry_point", autoreset_mode="SameStep", price=(1e-4, 1e-2)
    )
    venv.seed(1)
    venv.reset()
    _, infos = plain.reset(seed=1)
    ends = 0
    while ends < 3:
        price = infos["price"]
        _, rewards, over, _ = venv.step(np.full((2, 6), 0.9))
        _, wanted, _, _, infos = plain.step(np.full((2, 6), 0.9))
        np.testing.assert_allclose(rewards, wanted / (1 + WORK * price), rtol=1e-6)
        ends += over.sum()
    assert (infos["price"] != price).any()


def test_the_adapter_refuses_environments_that_reset_a_step_late():
    with pytest.raises(ValueError, match="SAME_STEP"):
        FromVector(vector(AutoresetMode.NEXT_STEP))


def shortened(tmp_path, algorithm, steps, seed=3, hindsight=True):
    """Settings of a run of a few steps."""
    entry = yaml.safe_load((ROOT / f"agents/hyperparams/{algorithm}.yml").read_text())
    entry[ENV_ID] |= FEW[algorithm.removesuffix("_lstm")]
    file = tmp_path / "few.yml"
    file.write_text(yaml.safe_dump(entry))
    return settings(algorithm, seed, steps, 256, {"components": 20}, file, hindsight)


@pytest.mark.parametrize("algorithm", [*FEW, *["ppo_lstm"] * bool(CONTRIB)])
def test_a_stopped_run_goes_on_as_if_it_had_not_been(tmp_path, algorithm):
    whole = Run(tmp_path / "whole", shortened(tmp_path, algorithm, 512))
    while not whole.over:
        whole.learn()
    assert whole.chapter == 2 and whole.model.num_timesteps == 512
    begun = Run(tmp_path / "parts", shortened(tmp_path, algorithm, 512))
    begun.learn()
    taken_up = Run(tmp_path / "parts", shortened(tmp_path, algorithm, 512))
    assert taken_up.chapter == 1
    taken_up.learn()
    assert taken_up.over
    one, other = (run.model.policy.state_dict() for run in (whole, taken_up))
    for name in one:
        assert torch.equal(one[name], other[name]), name
    np.testing.assert_array_equal(whole.venv.obs_rms.mean, taken_up.venv.obs_rms.mean)
    assert recorded(tmp_path / "parts") == (whole.settings, 2)
    with pytest.raises(ValueError, match="holds a run of other seed"):
        Run(tmp_path / "parts", shortened(tmp_path, algorithm, 512, seed=4))


@pytest.mark.parametrize("hindsight", [True, False])
@pytest.mark.parametrize("algorithm", FEW)
def test_the_exported_policy_says_what_the_model_predicts_whatever_the_critic_knows(
    tmp_path, algorithm, hindsight
):
    said = shortened(tmp_path, algorithm, 256, hindsight=hindsight)
    run = Run(tmp_path / "run", said)
    run.learn()
    venv = environments(said)
    network = network_of(restored(tmp_path / "run", 1, said, venv), venv)
    save(tmp_path / "policy.npz", network)
    read = load(tmp_path / "policy.npz", ALL_FEATURES, Thresholds._fields)
    assert read.parameters == ("history", "prune", "components", "process_noise", "coasting_noise", "fading")
    shape = run.venv.observation_space.shape
    assert shape == (len(ALL_FEATURES) + hindsight * len(HINDSIGHT),)
    observations = np.random.default_rng(0).uniform(-2, 2, (50, *shape)).astype(np.float32)
    wanted, _ = run.model.predict(venv.normalize_obs(observations), deterministic=True)
    said = [read(row[: len(ALL_FEATURES)]) for row in observations]
    np.testing.assert_allclose(said, wanted, atol=2e-6)  # single precision


@pytest.mark.parametrize("algorithm", FEW)
def test_an_untrained_policy_is_about_where_it_is_to_begin(tmp_path, algorithm):
    run = Run(tmp_path / "run", shortened(tmp_path, algorithm, 256))
    action, _ = run.model.predict(run.venv.reset(), deterministic=True)
    wanted = np.tile(to_action(START, run.venv.get_attr("parameters")[0]), (len(action), 1))
    np.testing.assert_allclose(action, wanted, atol=0.1)


def test_train_scores_every_chapter_on_valid_and_keeps_the_best(tmp_path):
    shortened(tmp_path, "ppo", 512)
    command = [
        sys.executable, str(ROOT / "agents/train.py"), "ppo", "--steps", "512", "--chapter", "256",
        "--valid-runs", "1", "--set", "components=20", "--hyperparameters", str(tmp_path / "few.yml"),
        "--out", str(tmp_path / "run"),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    rows = [json.loads(line) for line in done.stdout.splitlines() if line.startswith("{")]
    assert [row["steps"] for row in rows] == [256, 512]
    assert all(0 <= row["lost"] <= 1 and row["work"] > 0 for row in rows)
    best = load(tmp_path / "run/best.npz", ALL_FEATURES, Thresholds._fields)
    last = load(tmp_path / "run/last.npz", ALL_FEATURES, Thresholds._fields)
    same = all(np.array_equal(a, b) for a, b in zip(best.weights, last.weights, strict=True))
    assert same == (rows[1]["reward"] > rows[0]["reward"])


@pytest.mark.skipif(not CONTRIB, reason="needs sb3_contrib")
def test_a_policy_that_remembers_is_judged_by_what_its_model_predicts(tmp_path):
    said = shortened(tmp_path, "ppo_lstm", 256)
    run = Run(tmp_path / "run", said)
    run.learn()
    act = remembering(run.model, run.venv).watching(None)
    seen = np.random.default_rng(0).uniform(-2, 2, (2, 12, len(ALL_FEATURES))).astype(np.float32)
    for episode in seen:  # the second begins as if there had been no first
        state, first = None, np.ones(1, bool)
        for t, row in enumerate(episode):
            wanted, state = run.model.predict(
                run.venv.normalize_obs(row[None]), state, episode_start=first, deterministic=True
            )
            np.testing.assert_allclose(act(row, t), wanted[0], atol=1e-5)  # single precision
            first[:] = False
    row = played({"one": remembering(run.model, run.venv)}, "wide-valid", 1, jobs=1)["one"]
    assert np.isfinite(row.reward).all() and row.scans.min() > 0
    with pytest.raises(ValueError, match="cannot be exported"):
        network_of(run.model, run.venv)


def test_episodes_side_by_side_are_judged_as_one_by_one():
    def rule(features, t):
        return np.clip([0.4 + 0.1 * features[0], 0.2 + 0.01 * t], -1, 1)

    class Alone:
        def watching(self, env):
            return rule

    class Together:
        def __call__(self, features, t):  # for the clock alone
            return rule(features, t)

        def many(self, features, t):
            return np.array([rule(row, t) for row in features])

    policies = {"plain": rule, "alone": Alone(), "together": Together()}
    found = played(
        policies, "extrapolation", 3, env={"parameters": ["history", "prune"]}, jobs=1,
        only=("extrapolation-00", "extrapolation-03"),
    )  # fmt: skip
    for field in Episodes._fields:
        if field != "seconds":
            one, *others = (getattr(found[name], field) for name in policies)
            assert one.shape == (2, 3)
            for other in others:
                np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    ("algorithm", "asked", "wanted"),
    [("ppo", 2000, 8192), ("ppo", 8192, 8192), ("sac", 100, 128), ("sac", 64, 64)],
)
def test_steps_are_rounded_up_to_what_is_collected_at_a_time(algorithm, asked, wanted):
    said = settings(algorithm, 0, asked, asked, {}, None)
    assert (said.steps, said.chapter) == (wanted, wanted)


def test_train_makes_the_steps_that_it_says_before_it_begins(tmp_path):
    shortened(tmp_path, "ppo", 512)
    command = [
        sys.executable, str(ROOT / "agents/train.py"), "ppo", "--steps", "100", "--chapter", "70",
        "--valid-runs", "1", "--set", "components=20", "--hyperparameters", str(tmp_path / "few.yml"),
        "--out", str(tmp_path / "run"),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=True)
    lines = done.stdout.splitlines()
    assert lines[:2] == [
        f"{name} {n} rounded up to 128: ppo collects 128 at a time"
        for name, n in (("steps", 100), ("chapter", 70))
    ]
    assert [json.loads(line)["steps"] for line in lines[2:]] == [128]


def test_an_unknown_algorithm_and_a_file_without_the_environment_are_refused(tmp_path):
    with pytest.raises(ValueError, match="unknown algorithm 'dqn'; choose from ppo, sac"):
        settings("dqn", 0, None, 100, {}, None)
    (tmp_path / "other.yml").write_text("CartPole-v1:\n  n_envs: 1\n")
    with pytest.raises(ValueError, match="must have an entry gmr_gym/ReductionTuning-v1"):
        settings("ppo", 0, None, 100, {}, tmp_path / "other.yml")
    with pytest.raises(ValueError, match="cannot read the hyperparameters"):
        settings("ppo", 0, None, 100, {}, tmp_path / "none.yml")
    with pytest.raises(ValueError, match="hindsight is a matter of the critic"):
        settings("ppo", 0, None, 100, {"hindsight": True}, None)
    with pytest.raises(ValueError, match="holds no run"):
        recorded(tmp_path)
