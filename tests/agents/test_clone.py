"""A policy cloned from a data set: it does what the one it was cloned from does, from its file."""

import csv
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
pytest.importorskip("torch")
pytest.importorskip("h5py")
pytest.importorskip("minari")
sys.path.insert(0, str(ROOT / "agents"))

import clone  # noqa: E402

from gmr_gym.offline import load, players_of, write  # noqa: E402
from gmr_gym.tuning import network  # noqa: E402
from gmr_gym.tuning.instances import Instance, instances  # noqa: E402


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """The shipped policy and another, on two instances."""
    folder = tmp_path_factory.mktemp("cloned")
    with (folder / "few.csv").open("w", newline="") as file:
        csv.writer(file).writerows([Instance._fields, *[*instances("train").values()][:2]])
    env = gym.make(gym.spec("gmr_gym/ReductionTuning-v0"), instances=str(folder / "few.csv"))
    players = players_of(["learned", "random"], env.unwrapped)
    return write(folder / "few-v0", env, players, episodes=6)


@pytest.fixture(autouse=True)
def fewer_resamples(monkeypatch):
    monkeypatch.setattr("scores.RESAMPLES", 20)


def test_a_clone_is_judged_beside_the_policy_that_it_was_cloned_from(data, capsys):
    file = data.parent / "clone.npz"
    clone.main(data, file, "learned", 32, 150, 0, 2, str(data.parent / "few.csv"))
    said = capsys.readouterr().out
    assert "| learned |" in said and "| clone |" in said and "clone minus learned" in said
    env = load(data).recover_environment().unwrapped
    (original,) = players_of(["learned"], env)
    features, actions = clone.pairs(load(data), "learned")
    mine, theirs = network.load(file, env.features, env.parameters)(features), original.begin(0)
    np.testing.assert_allclose([theirs(row, 0) for row in features[:50]], actions[:50], atol=1e-6)
    unexplained = ((mine - actions) ** 2).mean() / actions.var(axis=0).mean()
    assert unexplained < 0.3


def test_another_player_is_not_cloned(data):
    with pytest.raises(ValueError, match="'rule' is not among the players of few-v0: learned, random"):
        clone.pairs(load(data), "rule")


@pytest.mark.parametrize(("own", "word"), [(-1.0, "within"), (-9.0, "outside")])
def test_a_clone_within_the_interval_is_told_from_one_outside(own, word, capsys):
    rng = np.random.default_rng(0)
    shape = 1, 2, 50
    fields = {name: rng.random(shape) for name in clone.Episodes._fields}
    theirs = clone.Episodes(**fields | {"lost": np.zeros(shape), "reward": rng.normal(-1, 1, shape)})
    clone.shown(theirs, theirs._replace(reward=np.full(shape, own)), "learned")
    assert f"the clone's reward, {own:.2f}, is {word} " in capsys.readouterr().out
