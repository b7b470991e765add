"""Scripts that train agents to track by themselves, each with a budget of seconds."""

import csv
import sys
from pathlib import Path

import numpy as np
import pytest

FOLDER = Path(__file__).parents[2] / "agents" / "estimating"
torch = pytest.importorskip("torch")
torch.set_num_threads(1)  # small networks run no faster on more
sys.path.insert(0, str(FOLDER))

import learning_curve  # noqa: E402
from ppo import Settings, train  # noqa: E402
from quiet import errors, tracker_errors, vector  # noqa: E402

from gmr_gym.evaluation.montecarlo import run_once  # noqa: E402
from gmr_gym.filters.registry import make_tracker  # noqa: E402

FEW = Settings(steps=256, envs=4, rollout=16, batches=2)


def test_every_script_can_be_read_in_one_go():
    scripts = list(FOLDER.glob("*.py"))
    assert len(scripts) >= 5
    for script in scripts:
        assert len(script.read_text(encoding="utf-8").splitlines()) <= 150, script


def test_ppo_changes_what_an_agent_does_and_the_same_seed_the_same():
    found = [[(steps, agent.act(SEEN)) for steps, agent in train(FEW, horizon=9)] for _ in range(2)]
    assert [steps for steps, _ in found[0]] == [0, 64, 128, 192, 256]
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one[1], other[1])
    first, last = found[0][0][1], found[0][-1][1]
    assert first.shape == (3, 2) and np.abs(last - first).max() > 1e-3


SEEN = vector(3, horizon=9).reset(seed=0)[0]


def test_errors_are_what_rewards_charge_and_a_tracker_in_the_agents_place_has_those_of_its_runs():
    seeds, scenario = [5, 6], vector(1, horizon=12).unwrapped.scenario
    wanted = []
    for seed in seeds:
        runs = run_once(scenario, make_tracker("pda", scenario.model), seed)
        wanted.append(np.linalg.norm((runs.x - runs.truth)[:, :2], axis=1).mean())
    np.testing.assert_allclose(tracker_errors("pda", seeds, horizon=12), wanted, rtol=1e-9)
    lost = errors(lambda seen: np.ones((2, 2)), seeds, horizon=30)
    ahead = errors(lambda seen: np.zeros((2, 2)), seeds, horizon=30)
    assert (lost > 80).all() and (lost <= 100).all() and (ahead < lost).all()


def test_the_learning_curve_is_written_and_drawn_again_from_what_is_written(tmp_path, monkeypatch):
    table, picture = tmp_path / "curve.csv", tmp_path / "curve.png"
    learning_curve.main(table, picture, seeds=1, steps=2 * 64 * 64, every=1, episodes=2)
    rows = list(csv.DictReader(table.open()))
    assert [row["agent"] for row in rows] == ["pda", "nearest-neighbour", "ppo", "ppo", "ppo"]
    assert [row["steps"] for row in rows[2:]] == ["0", "4096", "8192"]
    assert float(rows[0]["error_m"]) < float(rows[2]["error_m"])
    picture.unlink()
    monkeypatch.setattr(learning_curve, "found", None)
    learning_curve.main(table, picture)
    assert picture.stat().st_size > 10_000


@pytest.mark.parametrize("pool", ["mean", "maximum", "attention"])
def test_stable_baselines3_learns_with_features_of_sets(pool):
    pytest.importorskip("stable_baselines3")
    from ppo_stable_baselines3 import train

    agent = train(64, envs=2, rollout=32, pool=pool, horizon=9)
    actions, _ = agent.predict(SEEN, deterministic=True)
    assert agent.num_timesteps == 64 and actions.shape == (3, 2) and np.abs(actions).max() > 0


def test_torchrl_learns_over_the_same_vector_environments():
    pytest.importorskip("torchrl")
    from ppo_torchrl import acting, train

    first, last = (acting(train(steps, envs=4, frames=64, horizon=9))(SEEN) for steps in (64, 192))
    assert first.shape == (3, 2) and (np.abs(last) <= 1).all() and np.abs(last - first).max() > 1e-4
