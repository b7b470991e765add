"""The harness: every tracker meets the same episodes, on any number of workers, in any number of sittings."""

import importlib
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from gmr_gym.baselines.clairvoyant import Clairvoyant
from gmr_gym.baselines.mht import runnalls
from gmr_gym.baselines.mmg import Mmg
from gmr_gym.baselines.nearest_neighbour import NearestNeighbour
from gmr_gym.evaluation.montecarlo import BLOCK, Runs, run, run_once
from gmr_gym.evaluation.source import code as code_of
from gmr_gym.filters.registry import make_tracker
from gmr_gym.models.gating import gates, volumes
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.scenarios.recorded import recorded_flight
from gmr_gym.scenarios.zhang import jump_markov
from gmr_gym.simulation.single_target import draw, scan

WORLD = turning_target(horizon=8, clutter_rate=20)
NEAREST = {"nearest": NearestNeighbour(WORLD.model)}
MEASURED = [field for field in Runs._fields if field != "seconds"]


def assert_same(a, b, fields=MEASURED):
    for field in fields:
        np.testing.assert_array_equal(getattr(a, field), getattr(b, field), err_msg=field)


def test_every_run_is_its_own_seeds_whatever_the_tracker_and_the_number_of_runs():
    both = NEAREST | {"clairvoyant": Clairvoyant(WORLD.model)}
    few, many = run(WORLD, both, 3, seed=5), run(WORLD, NEAREST, BLOCK + 4, seed=5)
    assert_same(few["nearest"], Runs(*(a[:3] for a in many["nearest"])))
    assert not np.array_equal(many["nearest"].x[0], many["nearest"].x[1])
    other = run(WORLD, NEAREST, 3, seed=6)["nearest"]
    assert not np.array_equal(few["nearest"].x, other.x)
    later = np.random.SeedSequence(5, spawn_key=(BLOCK + 1,))  # a run of the second block
    assert_same(run_once(WORLD, *NEAREST.values(), later), Runs(*(a[BLOCK + 1] for a in many["nearest"])))
    for i in range(3):
        sequence = np.random.SeedSequence(5, spawn_key=(i,))
        alone = run_once(WORLD, Clairvoyant(WORLD.model), sequence)
        assert_same(alone, Runs(*(a[i] for a in few["clairvoyant"])))
        np.testing.assert_array_equal(few["nearest"].truth[i], draw(WORLD, sequence).x)


def test_two_workers_give_what_one_gives_bit_for_bit():
    built = NEAREST | {"mht": runnalls(WORLD.model, 5)}
    one, two = (run(WORLD, built, 2 * BLOCK + 3, seed=2, jobs=jobs) for jobs in (1, 2))
    for name in built:
        assert len(one[name].x) == 2 * BLOCK + 3
        assert_same(one[name], two[name])


def test_two_workers_give_what_one_gives_where_the_target_switches_and_clutter_stands_on_the_ground():
    world = jump_markov()
    built = {name: make_tracker(name, world.model) for name in ("mmg-3", "imm-pda")}
    one, two = (run(world, built, 2, seed=4, jobs=jobs) for jobs in (1, 2))
    for name in built:
        assert_same(one[name], two[name])
    np.testing.assert_array_equal(one["mmg-3"].truth, one["imm-pda"].truth)
    assert not np.array_equal(one["mmg-3"].truth[0], one["mmg-3"].truth[1])


def test_a_run_is_the_loop_over_its_scans():
    world = recorded_flight(horizon=12)
    tracker = NearestNeighbour(world.model)
    runs = run_once(world, tracker, 9)
    episode, belief, centre = draw(world, 9), tracker.init(), world.centre(world.model.prior.m[0])
    for t in range(12):
        z, _ = scan(world, episode, t, centre)
        belief, report = tracker.step(belief, z)
        np.testing.assert_array_equal(runs.x[t], report.x[0])
        np.testing.assert_array_equal(runs.P[t], report.P[0])
        np.testing.assert_array_equal(runs.truth[t], episode.x[t])
        assert runs.components[t] == 1
        assert runs.gate_volume[t] == volumes(report.gates)[0]
        d2 = [(a - report.gates.z[0]) @ np.linalg.solve(report.gates.S[0], a - report.gates.z[0]) for a in z]
        assert runs.gated[t] == sum(np.array(d2) <= report.gates.threshold)
        missed = episode.x[t, :2] - report.gates.z[0]
        assert runs.off_target[t] == (
            missed @ np.linalg.solve(report.gates.S[0], missed) > report.gates.threshold
        )
        centre = world.centre(report.x[0])
    assert (runs.seconds > 0).all()


def test_clairvoyant_is_handed_the_targets_detection_and_no_other():
    handed = []

    class Listening(Clairvoyant):
        def step(self, belief, z):
            handed.append(z)
            return super().step(belief, z)

    run_once(WORLD, Listening(WORLD.model), 3)
    episode = draw(WORLD, 3)
    for t, z in enumerate(handed):
        np.testing.assert_array_equal(z, episode.z[t : t + 1][episode.detected[t : t + 1]])
    assert {len(z) for z in handed} == {0, 1}


def test_loss_rule_is_told_the_targets_own_detection():
    told = []

    def listening(looked, x, z):
        told.append((x, z))
        return False

    world = replace(WORLD, loss_rule=listening)
    run_once(world, NearestNeighbour(world.model), 3)
    episode = draw(world, 3)
    for t, (x, z) in enumerate(told):
        np.testing.assert_array_equal(x, episode.x[t])
        np.testing.assert_array_equal(z, episode.z[t] if episode.detected[t] else [np.nan, np.nan])


@pytest.mark.parametrize("missed", [False, True])
def test_a_track_given_up_is_off_target_whatever_the_loss_rule_says(missed):
    times = iter(range(8))

    class GivingUp(NearestNeighbour):
        def step(self, belief, z):
            belief, report = super().step(belief, z)
            return belief, report._replace(alive=next(times) not in (2, 3, 7))

    world = replace(WORLD, loss_rule=lambda gates, x, z: missed)
    runs = run_once(world, GivingUp(WORLD.model), 3)
    assert np.flatnonzero(runs.off_target).tolist() == (list(range(8)) if missed else [2, 3, 7])
    assert runs.off_target.dtype == bool


class Stopped(Exception):
    pass


def test_a_stopped_run_goes_on_where_it_stopped_and_ends_the_same(tmp_path):
    def stop_after_a_block(done, total):
        if done >= BLOCK:
            raise Stopped

    runs = 2 * BLOCK + 5
    with pytest.raises(Stopped):
        run(WORLD, NEAREST, runs, folder=tmp_path, progress=stop_after_a_block)
    assert len(list(tmp_path.iterdir())) == 1
    seen = []
    resumed = run(WORLD, NEAREST, runs, folder=tmp_path, progress=lambda *at: seen.append(at))["nearest"]
    assert seen == [(BLOCK, runs), (2 * BLOCK, runs), (runs, runs)]
    assert_same(resumed, run(WORLD, NEAREST, runs)["nearest"])
    # times are never equal twice: nothing was run again
    assert_same(resumed, run(WORLD, NEAREST, runs, folder=tmp_path)["nearest"], Runs._fields)


def test_more_runs_go_on_from_the_blocks_of_fewer(tmp_path):
    fewer = run(WORLD, NEAREST, BLOCK, folder=tmp_path)["nearest"]
    more = run(WORLD, NEAREST, 2 * BLOCK, folder=tmp_path)["nearest"]
    assert_same(fewer, Runs(*(a[:BLOCK] for a in more)), Runs._fields)
    assert len(more.x) == 2 * BLOCK


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 1},
        {"scenario": turning_target(horizon=8, clutter_rate=21)},
        {"scenario": replace(WORLD, truth=turning_target(horizon=8, trajectory=np.eye(8, 4)).truth)},
        {"trackers": {"nearest": runnalls(WORLD.model, 5)}},
    ],
    ids=["seed", "clutter", "truth", "tracker"],
)
def test_blocks_of_another_world_tracker_or_seed_are_not_taken_for_these(tmp_path, change):
    run(WORLD, NEAREST, 2, folder=tmp_path)
    asked = {"scenario": WORLD, "trackers": NEAREST, "runs": 2, "seed": 0} | change
    stored = run(**asked, folder=tmp_path)["nearest"]
    assert_same(stored, run(**asked)["nearest"])
    assert len(list(tmp_path.iterdir())) == 2


def test_the_same_world_and_tracker_built_again_find_their_blocks(tmp_path):
    first = run(WORLD, {"a": runnalls(WORLD.model, 5)}, 2, folder=tmp_path)["a"]
    again = turning_target(horizon=8, clutter_rate=20)
    found = run(again, {"b": runnalls(again.model, 5)}, 2, folder=tmp_path)["b"]
    assert_same(first, found, Runs._fields)


OWN = """
from gmr_gym.reduction import capping


def own(p, components):
    return capping(p, components)
"""


def whatever_mode(posterior, mode, reduce):
    return reduce(posterior)


def whatever_mode_by_place(reduce, posterior, mode):
    return reduce(posterior)


@pytest.mark.parametrize("nested", ["keyword", "place", "name"])
def test_an_edited_reducer_deep_inside_partial_functions_is_run_again(tmp_path, monkeypatch, nested):
    monkeypatch.syspath_prepend(str(tmp_path))
    module, file = f"reducer_by_{nested}", tmp_path / f"reducer_by_{nested}.py"
    file.write_text(OWN)
    reduce = partial(importlib.import_module(module).own, components=3)
    world = jump_markov()
    tracker = {
        "keyword": Mmg(world.model, partial(whatever_mode, reduce=reduce)),
        "place": Mmg(world.model, partial(whatever_mode_by_place, reduce)),
        "name": make_tracker("mmg-3", world.model, reduction=f"{module}:own"),
    }[nested]
    other = make_tracker("mmg-3", world.model)
    code, others = code_of(tracker), code_of(other)
    for edit in ("", "", "# edited"):
        file.write_text(OWN + edit)
        run(world, {"own": tracker}, 1, folder=tmp_path / "runs")
        assert (code_of(tracker) == code) == (edit == "")
        assert code_of(other) == others  # it has nothing to do with that file
    assert len(list((tmp_path / "runs").iterdir())) == 2


@pytest.mark.parametrize("keep", [0, 100, -1000], ids=["emptied", "cut to its head", "cut by its tail"])
def test_a_damaged_block_is_named_in_the_error(tmp_path, keep):
    run(WORLD, NEAREST, 2, folder=tmp_path)
    (file,) = tmp_path.iterdir()
    file.write_bytes(file.read_bytes()[:keep])
    with pytest.raises(ValueError, match=rf"{file.name} is not a block of runs .*delete it"):
        run(WORLD, NEAREST, 2, folder=tmp_path)


@pytest.mark.parametrize("content", ["text", "other arrays", "a flipped byte"])
def test_a_file_that_is_no_block_is_named_in_the_error(tmp_path, content):
    run(WORLD, NEAREST, 2, folder=tmp_path)
    (file,) = tmp_path.iterdir()
    whole = bytearray(file.read_bytes())
    whole[len(whole) // 2] ^= 0xFF
    with file.open("wb") as stream:
        if content == "text":
            stream.write(b"not a block")
        elif content == "other arrays":
            np.savez(stream, x=np.zeros(3))
        else:
            stream.write(whole)
    with pytest.raises(ValueError, match=rf"{file.name} is not a block of runs .*delete it"):
        run(WORLD, NEAREST, 2, folder=tmp_path)


class Unplayed(NearestNeighbour):
    def step(self, belief, z):
        raise AssertionError("played")


def test_a_folder_that_cannot_be_is_told_before_anything_is_played(tmp_path):
    (tmp_path / "file").touch()
    for wrong in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(OSError, match="file"):
            run(WORLD, {"unplayed": Unplayed(WORLD.model)}, 1, folder=wrong)


def test_bad_calls_are_refused():
    with pytest.raises(ValueError, match="runs must be at least 1, got 0"):
        run(WORLD, NEAREST, 0)
    with pytest.raises(ValueError, match="at least one tracker"):
        run(WORLD, {}, 3)


def test_gates_that_a_tracker_reports_are_those_before_the_update():
    world = turning_target(horizon=1, detection_probability=1.0, clutter_rate=0)
    tracker = NearestNeighbour(world.model)
    _, report = tracker.step(tracker.init(), np.array([[30.0, 30.0]]))
    m = world.model.motions[0].F @ world.model.prior.m[0]
    wanted = gates(world.model.prior._replace(m=m[None]), world.model.sensor, 0.999)
    np.testing.assert_allclose(report.gates.z, wanted.z)
