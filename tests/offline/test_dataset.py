"""Data sets: what Minari reads is what the environment did, and what is no such data set is refused."""

import json
import shutil
from itertools import product

import gymnasium as gym
import numpy as np
import pytest

from gmr_gym.offline import load, players_of, write
from gmr_gym.offline.episodes import seed_of, stacked

minari = pytest.importorskip("minari")
pytest.importorskip("h5py")

TURNING, TUNING, MANY = (
    f"gmr_gym/{name}-v0" for name in ("TurningTarget", "ReductionTuning", "UnknownClutter")
)
CASES = {
    TURNING: ({"horizon": 5, "clutter_rate": 5}, ["pda", "nearest-neighbour"]),
    MANY: ({"horizon": 4, "clutter_rate": 5}, ["gm-phd"]),
    TUNING: ({}, ["learned", "constant:alpha=0.1"]),
}  # fmt: skip


def written(folder, env_id, seed=3, episodes=2, **options):
    settings, specs = CASES[env_id]
    env = gym.make(gym.spec(env_id), **settings)
    name = env_id.rpartition("/")[2].lower()
    return write(folder / name, env, players_of(specs, env.unwrapped), episodes, seed, **options)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    root = tmp_path_factory.mktemp("datasets")
    for env_id in CASES:
        written(root, env_id)
    return root


@pytest.mark.parametrize("env_id", CASES)
def test_what_minari_reads_is_the_environment_replayed(env_id, folder, monkeypatch):
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(folder))
    dataset = minari.load_dataset(env_id.rpartition("/")[2].lower())
    env, specs = dataset.recover_environment().unwrapped, CASES[env_id][1]
    known = [*dataset.storage.get_episode_metadata(range(len(dataset)))]
    assert [one["player"] for one in known] == [spec for _, spec in product(range(2), specs)]
    assert [one["seed"] for one in known] == [seed_of(3, i) for i, _ in product(range(2), specs)]
    for episode, metadata in zip(dataset, known, strict=True):
        observation, info = env.reset(seed=metadata["seed"], options=metadata.get("options"))
        rewards = []
        for t, action in enumerate(episode.actions):
            assert_at(episode.observations, t, observation)
            assert_at(episode.infos, t, {key: info[key] for key in info if key != "instance_id"})
            observation, reward, terminated, truncated, info = env.step(action)
            rewards.append(reward)
            assert (episode.terminations[t], episode.truncations[t]) == (terminated, truncated)
        assert terminated or truncated
        assert_at(episode.observations, len(rewards), observation)
        assert episode.rewards.tolist() == rewards
        assert metadata["rewards_sum"] == pytest.approx(sum(rewards))
        assert specs[episode.infos["player"][0]] == metadata["player"]


def assert_at(arrays, t, wanted):
    """That entry t of the arrays is what is wanted, bit by bit."""
    if isinstance(wanted, dict):
        for key in wanted:
            assert_at(arrays[key], t, wanted[key])
    else:
        np.testing.assert_array_equal(arrays[t], wanted)


def test_the_actions_are_those_of_the_player(folder):
    dataset = load(folder / "turningtarget-v0", TURNING)
    env = dataset.recover_environment().unwrapped
    policy = players_of(["pda"], env)[0].begin(0)
    first = dataset[0]
    for t, action in enumerate(first.actions):
        seen = {key: rows[t] for key, rows in first.observations.items()}
        np.testing.assert_array_equal(policy(seen, t), action)


def test_the_same_seed_gives_the_same_data_and_another_seed_other_data(folder, tmp_path):
    again = load(written(tmp_path / "a", TURNING))
    other = load(written(tmp_path / "b", TURNING, seed=4))
    for one, same, different in zip(load(folder / "turningtarget-v0"), again, other, strict=True):
        for name in ("actions", "rewards"):
            np.testing.assert_array_equal(getattr(one, name), getattr(same, name))
        np.testing.assert_array_equal(one.observations["scan"], same.observations["scan"])
        assert not np.array_equal(one.observations["scan"], different.observations["scan"])


def test_instances_of_reduction_tuning_are_taken_in_turn(folder):
    dataset = load(folder / "reductiontuning-v0", TUNING)
    known = [one["options"]["instance_id"] for one in dataset.storage.get_episode_metadata(range(4))]
    first, second, *_ = dataset.recover_environment().unwrapped.instances
    assert known == [first, first, second, second]


def test_the_metadata_say_how_the_data_were_made(folder):
    metadata = load(folder / "turningtarget-v0").storage.metadata
    assert metadata["dataset_id"] == "turningtarget-v0" and not {"author", "author_email"} & set(metadata)
    assert metadata["requirements"] == [f"gmr-gym=={metadata['gmr_gym']['versions']['gmr_gym']}"]
    assert "mask" in metadata["description"]
    known = metadata["gmr_gym"]
    assert known["players"] == ["pda", "nearest-neighbour"]
    assert (known["environment"], known["episodes"], known["seed"]) == (TURNING, 2, 3)


def test_infos_that_a_scan_lacks_are_marked():
    found = stacked([{"a": 1.5, "c": {"d": 2}}, {"a": 2.5, "b": np.ones(2, bool)}])
    assert found["a"].tolist() == [1.5, 2.5] and found["b"].tolist() == [[False, False], [True, True]]
    assert found["c"]["d"].tolist() == [2, -2]
    assert np.isnan(stacked([{}, {"e": 1.0}])["e"][0])


def test_nothing_half_written_is_left_and_what_was_there_stays(tmp_path):
    out = written(tmp_path, TURNING)
    before = (out / "data" / "main_data.hdf5").read_bytes()

    def stop(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        written(tmp_path, TURNING, seed=5, overwrite=True, progress=stop)
    assert [*tmp_path.iterdir()] == [out]
    assert (out / "data" / "main_data.hdf5").read_bytes() == before
    written(tmp_path, TURNING, seed=5, overwrite=True)
    assert [*tmp_path.iterdir()] == [out]
    assert load(out).storage.metadata["gmr_gym"]["seed"] == 5


def test_a_data_set_is_replaced_only_if_asked_and_another_folder_never(folder, tmp_path):
    with pytest.raises(ValueError, match="turningtarget-v0 is there already; give --overwrite"):
        written(folder, TURNING)
    (tmp_path / "turningtarget-v0").mkdir()
    with pytest.raises(ValueError, match="is there and is no data set; give another name"):
        written(tmp_path, TURNING, overwrite=True)


def changed(folder, tmp_path, change):
    """A copy of a data set, its metadata changed."""
    copy = shutil.copytree(folder / "reductiontuning-v0", tmp_path / "copy-v0")
    file = copy / "data" / "metadata.json"
    metadata = json.loads(file.read_text())
    change(metadata)
    file.write_text(json.dumps(metadata))
    return copy


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda m: m.pop("gmr_gym"), "was not written by `gmr-gym episodes`"),
        (lambda m: m["gmr_gym"].update(environment="gmr_gym/Gone-v0"), "which this version does not have"),
        (lambda m: m["gmr_gym"]["features"].reverse(), "in another version of .*, of which the features"),
        (lambda m: m.update(action_space=m["observation_space"]), "of which the action space was Box"),
    ],
)  # fmt: skip
def test_a_data_set_of_another_version_is_refused(change, said, folder, tmp_path):
    with pytest.raises(ValueError, match=said):
        load(changed(folder, tmp_path, change))


def test_a_data_set_of_another_release_is_warned_of(folder, tmp_path):
    older = changed(folder, tmp_path, lambda m: m["gmr_gym"]["versions"].update(gmr_gym="0.1.0"))
    with pytest.warns(UserWarning, match="was recorded by gmr_gym 0.1.0, and this is"):
        load(older)


def test_a_data_set_of_another_environment_and_a_folder_without_one_are_refused(folder, tmp_path):
    with pytest.raises(ValueError, match=r"is of .*Tuning-v0, and gmr_gym/ReductionTuning-v1 is asked"):
        load(folder / "reductiontuning-v0", "gmr_gym/ReductionTuning-v1")
    with pytest.raises(ValueError, match="is no data set: it has no data/metadata"):
        load(tmp_path)
