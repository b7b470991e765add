"""Shards and merges: blocks of runs from machines that share nothing make up the whole, each once."""

import errno
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from gmr_gym.baselines.gm_phd import gm_phd
from gmr_gym.baselines.mht import runnalls
from gmr_gym.baselines.nearest_neighbour import NearestNeighbour
from gmr_gym.evaluation import archive
from gmr_gym.evaluation.blocks import load, merge, save
from gmr_gym.evaluation.montecarlo import BLOCK, Runs, run, run_shard
from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns
from gmr_gym.experiments.sweeps import shard_of
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.scenarios.lv import unknown_clutter

WORLD = turning_target(horizon=4, clutter_rate=5)
NEAREST = {"nearest": NearestNeighbour(WORLD.model)}
BUILT = NEAREST | {"mht": runnalls(WORLD.model, 3)}
RUNS = 4 * BLOCK + 1  # five blocks
KINDS = Runs, MultiTargetRuns


def names(folder):
    return {file.name for file in folder.iterdir()}


def sharded(folder, n):
    """A folder for each of n shards."""
    folders = [folder / str(i) for i in range(1, n + 1)]
    for i, one in enumerate(folders, 1):
        one.mkdir()
        run_shard(WORLD, BUILT, RUNS, seed=7, shard=(i, n), folder=one)
    return folders


@pytest.fixture(scope="module")
def shards(tmp_path_factory):
    return sharded(tmp_path_factory.mktemp("shards"), 3)


def test_every_block_is_in_one_shard_and_every_third_of_each_tracker_in_each(shards):
    found = [names(folder) for folder in shards]
    assert sum(map(len, found)) == len(set.union(*found)) == 2 * 5
    for digest in {name[:32] for name in set.union(*found)}:
        places = {
            int(name.split("-")[1]) // BLOCK: i
            for i, some in enumerate(found) for name in some if name.startswith(digest)
        }  # fmt: skip
        start = places[0]
        assert places == {block: (start + block) % 3 for block in range(5)}


def test_merged_shards_are_the_whole_sweep_and_nothing_is_run_again(shards, tmp_path):
    merged = merge(shards, tmp_path, *KINDS)
    assert len(merged.copied) == 10 and not any(merged[1:])
    seen = []
    found = run(WORLD, BUILT, RUNS, seed=7, folder=tmp_path, progress=lambda *at: seen.append(at))
    assert seen == [(2 * RUNS, 2 * RUNS)]
    whole = run(WORLD, BUILT, RUNS, seed=7)
    for name in BUILT:
        assert len(found[name].x) == RUNS
        for field in set(Runs._fields) - {"seconds"}:
            np.testing.assert_array_equal(getattr(found[name], field), getattr(whole[name], field), field)


def test_a_shard_goes_on_where_it_stopped_and_says_how_much_there_is(shards, tmp_path):
    seen = []
    size = len(names(shards[0]))
    for _ in range(2):
        told = run_shard(
            WORLD, BUILT, RUNS, seed=7, shard=(1, 3), folder=tmp_path, progress=lambda *at: seen.append(at)
        )
        assert told == (size, 10)
    assert names(tmp_path) == names(shards[0])
    total = seen[0][1]
    assert seen[0] == (0, total) and seen[-2:] == [(total, total)] * 2 and len(seen) == size + 2
    next(tmp_path.iterdir()).write_bytes(b"")
    with pytest.raises(ValueError, match="is not a block of runs"):
        run_shard(WORLD, BUILT, RUNS, seed=7, shard=(1, 3), folder=tmp_path)


def test_a_shard_with_nothing_to_do_leaves_a_folder_that_can_be_merged(tmp_path):
    left, seen = [tmp_path / str(i) for i in (1, 2)], []
    for i, folder in enumerate(left, 1):
        run_shard(WORLD, NEAREST, 1, shard=(i, 2), folder=folder, progress=lambda *at: seen.append(at))
    assert sorted(len(names(folder)) for folder in left) == [0, 1] and seen == [(0, 1), (1, 1)]
    assert len(merge(left, tmp_path / "into", *KINDS).copied) == 1


def test_a_part_of_a_block_is_not_taken_for_the_block(tmp_path):
    run(WORLD, NEAREST, BLOCK, folder=tmp_path)
    run(WORLD, NEAREST, 5, folder=tmp_path)
    assert len(run(WORLD, NEAREST, BLOCK, folder=tmp_path)["nearest"].x) == BLOCK
    assert len(names(tmp_path)) == 2


def test_other_machines_name_the_blocks_alike(tmp_path):
    """Another process, with other hashes of strings, another place for the source, and a world built anew."""
    run(WORLD, BUILT, 1, folder=tmp_path / "here")
    program = """
import sys
sys.path.insert(0, "../elsewhere/tests/evaluation")
from test_blocks import *
run(turning_target(horizon=4, clutter_rate=5), {'a': BUILT['mht'], 'b': BUILT['nearest']}, 1, folder='.')
"""
    (tmp_path / "there").mkdir()
    root = Path(__file__).parents[2]
    (tmp_path / "elsewhere").symlink_to(root)
    environment = os.environ | {"PYTHONHASHSEED": "17", "PYTHONPATH": str(tmp_path / "elsewhere")}
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path / "there", env=environment, check=True)
    assert names(tmp_path / "there") == names(tmp_path / "here")


def test_a_block_twice_is_kept_once_and_one_that_disagrees_is_told(shards, tmp_path):
    again, other, into = tmp_path / "again", tmp_path / "other", tmp_path / "into"
    merge(shards[:1], into, *KINDS)
    run_shard(WORLD, BUILT, RUNS, seed=7, shard=(1, 3), folder=again)  # the clock is never the same twice
    before = {file: file.read_bytes() for file in into.iterdir()}
    merged = merge([again], into, *KINDS)
    assert names(again) == {file.name for file in merged.present} and not merged.copied + merged.differing
    other.mkdir()
    name = min(names(into))
    block = load(into / name, Runs)
    off = np.nextafter(block.x, np.inf)
    save(other / name, block._replace(x=off))
    merged = merge([other], into, *KINDS)
    assert merged.differing == [other / name] and not merged.copied + merged.present + merged.refused
    assert {file: file.read_bytes() for file in into.iterdir()} == before


def test_blocks_of_many_targets_are_merged_too(tmp_path):
    world = unknown_clutter(horizon=6)
    built = {"phd": gm_phd(world.model)}
    kept = run(world, built, 2, folder=tmp_path / "a")["phd"]
    assert len(merge([tmp_path / "a"], tmp_path / "b", *KINDS).copied) == 1
    np.testing.assert_array_equal(run(world, built, 2, folder=tmp_path / "b")["phd"].seconds, kept.seconds)


def bad(block):
    """Files that are no blocks of 20 runs, by what is wrong with them."""
    fields = block._asdict()
    return {
        "other arrays": {"x": block.x},
        "an array too many": fields | {"more": block.x},
        "a run too few": {field: array[1:] for field, array in fields.items()},
        "a scan too few": fields | {"x": block.x[:, 1:]},
        "an axis too few": fields | {"modes": block.modes[..., 0]},
        "a dimension too few": fields | {"P": block.P[..., 1:]},
        "other dimensions": fields | {"x": block.x[..., 1:], "P": block.P[..., 1:, 1:]},
        "words": fields | {"x": block.x.astype(str)},
        "half precision": fields | {"x": block.x.astype(np.float16)},
        "the other byte order": fields | {"x": block.x.astype(">f8")},
        "whole numbers": fields | {"P": block.P.astype(int)},
        "numbers for yes and no": fields | {"off_target": block.off_target.astype(float)},
    }


@pytest.mark.parametrize("wrong", [*bad(Runs(*[np.zeros((1, 1, 1, 1))] * 9)), "cut", "text", "one array"])
def test_what_is_no_block_is_refused_by_name_and_the_rest_is_merged(shards, tmp_path, wrong):
    source, into = tmp_path / "source", tmp_path / "into"
    merge(shards[:1], source, *KINDS)
    # a shard has whole blocks of either tracker, but which of them depends on the versions in the digest
    whole = sorted(file for file in source.iterdir() if not file.name.endswith(f"-{RUNS - 1}-{RUNS}.npz"))
    victim, all_names = whole[0], names(source)
    if wrong == "cut":
        victim.write_bytes(victim.read_bytes()[:-100])
    elif wrong == "text":
        victim.write_text("not a block")
    elif wrong == "one array":
        with victim.open("wb") as stream:
            np.save(stream, np.zeros(3))
    else:
        archive.save(victim, bad(load(victim, Runs))[wrong], of=victim.name)  # with a digest of what is wrong
    for foreign in ("notes.txt", "0123.npz", f"{victim.name}.part"):
        (source / foreign).write_text("")
    (refused,) = (merged := merge([source], into, *KINDS)).refused
    assert "load it unsafely" not in refused  # numpy's advice for what is no archive
    assert refused.startswith(f"{victim} is not a block of runs (")
    assert names(into) == all_names - {victim.name}
    assert {file.name for file in merged.foreign} == {"notes.txt", "0123.npz", f"{victim.name}.part"}


def test_nothing_in_a_block_is_unpickled(shards, tmp_path):
    class Trap:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "sprung"),)

    name = min(names(shards[0]))
    block = load(shards[0] / name, Runs)
    (tmp_path / "source").mkdir()
    np.savez(tmp_path / "source" / name, **block._asdict() | {"x": np.array([[[Trap()]]], dtype=object)})
    assert len(merge([tmp_path / "source"], tmp_path / "into", *KINDS).refused) == 1
    assert not (tmp_path / "sprung").exists()


def test_a_disk_that_is_full_is_named_by_the_file_and_keeps_no_part_of_it(shards, tmp_path, monkeypatch):
    def filling(stream, **arrays):
        stream.write(b"a part")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    block = load(next(shards[0].iterdir()), Runs)
    monkeypatch.setattr(archive.np, "savez", filling)
    file = tmp_path / "block.npz"
    with pytest.raises(OSError, match=r"No space left on device: '.*block\.npz'") as caught:
        save(file, block)
    assert caught.value.errno == errno.ENOSPC and not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("field", "change"),
    [
        ("x", lambda x: x * np.nan),
        ("x", lambda x: x.astype(np.float16)),
        ("x", lambda x: np.nextafter(x, np.inf)),
        ("P", np.negative),
        ("truth", lambda x: x + 1),
        ("off_target", np.logical_not),
        ("seconds", np.zeros_like),
    ],
)
def test_arrays_that_were_written_over_are_found_out_though_their_shapes_and_checksums_fit(
    shards, tmp_path, field, change
):
    file = tmp_path / min(names(shards[0]))
    file.write_bytes((shards[0] / file.name).read_bytes())
    arrays = archive.load(file, of=file.name)
    assert archive.DIGEST in arrays and set(arrays) == {*Runs._fields, archive.DIGEST}
    np.savez(file, **arrays | {field: change(arrays[field])})
    with pytest.raises(ValueError, match=r"is not a block of runs \(its digest does not match its arrays"):
        load(file, Runs)


def test_a_block_under_the_name_of_another_is_refused(shards, tmp_path):
    """Of other runs, or of another tracker: as long, and undamaged."""
    one, *others = [name for name in sorted(set.union(*map(names, shards))) if not name.endswith("-81.npz")]
    there = {file.name: file for folder in shards for file in folder.iterdir()}
    for other in others:
        (tmp_path / other).write_bytes(there[one].read_bytes())
        with pytest.raises(ValueError, match=rf"{other} is not a block of runs \(its digest does not match"):
            load(tmp_path / other, Runs)


def test_a_pipe_in_the_place_of_a_block_is_refused_and_not_waited_for(tmp_path):
    file = tmp_path / f"{'0' * 32}-0-20.npz"
    os.mkfifo(file)
    with pytest.raises(ValueError, match="it is not a plain file"):
        load(file, Runs)


def test_a_block_without_a_digest_is_refused(shards, tmp_path):
    file = tmp_path / min(names(shards[0]))
    np.savez(file, **load(shards[0] / file.name, Runs)._asdict())
    with pytest.raises(ValueError, match=r"\(it has no digest\); delete it to have it run again"):
        load(file, Runs)


def test_all_blocks_that_are_none_are_named_before_anything_is_run(shards, tmp_path):
    merge(shards, tmp_path, *KINDS)
    victims = sorted(tmp_path.iterdir())[:3]
    for victim in victims:
        victim.write_bytes(b"")
    for call in (run, partial(run_shard, shard=(1, 1))):
        with pytest.raises(ValueError) as refused:
            call(WORLD, BUILT, RUNS, seed=7, folder=tmp_path)
        assert all(f"{victim} is not a block of runs" in str(refused.value) for victim in victims)


def test_numbers_of_a_tracker_of_ones_own_are_kept_as_the_others_are(shards, tmp_path):
    file = shards[0] / min(names(shards[0]))
    block = load(file, Runs)
    single = block._replace(x=block.x.astype(np.float32), components=block.components.astype(np.int32))
    save(tmp_path / file.name, single)
    kept = load(tmp_path / file.name, Runs)
    assert kept.x.dtype == float and kept.components.dtype == np.int64
    np.testing.assert_array_equal(kept.x, single.x)


@pytest.mark.parametrize("text", ["0/3", "4/3", "2", "2/", "/3", "a/3", "1/3/3", "-1/3", "1.5/3", ""])
def test_a_shard_that_is_none_is_refused(text):
    with pytest.raises(ValueError, match="shard must be I/N with I from 1 to N, as in 2/3, got"):
        shard_of(text, Path())


def test_shards_are_read_and_bad_ones_refused_in_python_too(tmp_path):
    assert shard_of("2/3", Path()) == (2, 3) and shard_of(None, None) is None
    with pytest.raises(ValueError, match="with --out in which folder"):
        shard_of("2/3", None)
    with pytest.raises(ValueError, match=r"1 <= i <= n, got \(0, 3\)"):
        run_shard(WORLD, BUILT, RUNS, shard=(0, 3), folder=tmp_path)
