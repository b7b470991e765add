"""Reductions compared: paired runs, rows on fronts, and a command that goes on where it stopped."""

import json
from functools import partial

import numpy as np
import pytest
from typer.testing import CliRunner

from gmr_gym.cli import app
from gmr_gym.envs import lookup
from gmr_gym.evaluation import run
from gmr_gym.evaluation.mixture_problems import MixtureProblem, random_mixture
from gmr_gym.evaluation.reductions import divergence
from gmr_gym.evaluation.summary import Estimate, differences
from gmr_gym.experiments import reduction_quality, reductions_compared
from gmr_gym.experiments.reduction_quality import (
    RANDOM,
    Problem,
    Trial,
    median,
    of_environment,
    pooled,
    tracker_with,
    trial,
)
from gmr_gym.experiments.reduction_tracking import outcome, row, unfit
from gmr_gym.experiments.reductions_compared import at_equal_time, named_front
from gmr_gym.reduction import capping, west
from gmr_gym.reduction.distances import integral_squared_difference

TURNING = "gmr_gym/TurningTarget-v0"
MIXTURES = [random_mixture(i) for i in range(3)]
SCENARIO = lookup.scenario_of(TURNING, {"clutter_rate": 60, "horizon": 25})


def test_differences_are_those_of_runs_on_the_same_episodes():
    trackers = {
        name: tracker_with(SCENARIO, components=2, reduction=name) for name in ("runnalls", "capping")
    }
    results = run(SCENARIO, trackers, runs=6)
    reference, one = (outcome(SCENARIO, results[name]) for name in trackers)
    expected = differences(SCENARIO, results)["capping - runnalls"]["track_loss"]
    found = row(one, reference)
    assert found["track_loss_difference"] == expected
    assert found["error_difference"].value == pytest.approx(np.mean(one.error - reference.error))
    assert row(reference, reference)["error_difference"] == Estimate(0, 0, 0)
    np.testing.assert_array_equal(results["runnalls"].truth, results["capping"].truth)


def test_a_reduction_that_is_too_slow_or_left_out_does_not_track():
    trials = {
        "runnalls": Trial((1.0,)),
        "a": Trial((8.0, 10.0)),
        "b": Trial((11.0,)),
        "c": Trial((), "too large"),
    }
    assert unfit(trials, slowest=10) == {
        "b": "11 times as long as runnalls for a posterior",
        "c": "too large",
    }


def test_a_reduction_that_takes_too_long_or_refuses_a_mixture_is_left_out_with_the_reason(monkeypatch):
    def refusing(p):
        if p is MIXTURES[-1]:
            raise ValueError("too large")
        return p, np.arange(len(p.w))

    assert trial(refusing, MIXTURES[:-1]).reason == "" and trial(refusing, MIXTURES[:-1]).seconds > 0
    assert trial(refusing, MIXTURES) == Trial((), "too large")
    monkeypatch.setattr(reduction_quality, "LONGEST", 0.0)
    assert trial(refusing, MIXTURES).reason.endswith(" s for a mixture of 10 components")


def test_recorded_mixtures_are_reduced_one_a_run_and_pooled_where_a_reduction_is_left_out_of_none():
    problem = MixtureProblem(samples=100, recorded=tuple(MIXTURES))
    each = {
        name: partial(reduction, components=5) for name, reduction in (("west", west), ("capping", capping))
    }
    found = run(problem, each, runs=3)
    for i, p in enumerate(MIXTURES):
        q, _ = west(p, 5)
        assert found["west"].ise[i, 0] == integral_squared_difference(p, q)
        assert found["west"].divergence[i, 0] == divergence(p, q, 100)[0]
    tried = {"west": Trial((1.0, 2.0)), "capping": Trial((3.0,))}
    both, times = pooled({RANDOM: {}, "a": found, "b": {"west": found["west"]}}, {"a": tried, "b": tried})
    assert [*both] == [*times] == ["west"] and times["west"].seconds == 1.5
    np.testing.assert_array_equal(both["west"].ise, np.tile(found["west"].ise, (2, 1)))


def test_rows_on_a_front_and_at_equal_time_are_named():
    rows = {
        name: {"time_per_scan": Estimate(time), "track_loss": Estimate(lost), "error_capped": Estimate(1.0)}
        for name, time, lost in (
            ("a, 2", 1.0, 0.5), ("a, 10", 3.0, 0.1), ("b, 2", 2.0, 0.6), ("b, 10", 4.0, 0.2),
            ("c, 2", 9.0, 0.05),
        )
    }  # fmt: skip
    assert named_front(rows, "time_per_scan", "track_loss") == ["a, 2", "a, 10", "c, 2"]
    assert [*at_equal_time(rows)] == ["a, 10", "b, 2"]


def test_an_interval_of_a_median_contains_it_as_often_as_it_says():
    rng = np.random.default_rng(0)
    found = [median(rng.exponential(size=25)) for _ in range(1000)]
    held = np.mean([one.low <= np.log(2) <= one.high for one in found])
    assert 0.94 < held < 0.99
    assert median(np.arange(5.0))[0] == 2 and np.isnan(median(np.arange(5.0)).low)


@pytest.fixture
def small(monkeypatch):
    """The command with small problems and a short scenario."""
    three = Problem(MixtureProblem(samples=100, recorded=tuple(MIXTURES)), 3, 5)
    few = {name: three for name in (RANDOM, of_environment(TURNING))}
    monkeypatch.setattr(reductions_compared, "problems", lambda count, seed: few)
    monkeypatch.setattr(lookup, "scenario_of", lambda env_id, settings: SCENARIO)


def call(out, *more):
    asked = [
        "compare-reductions",
        "--reduction",
        "capping",
        "--env",
        TURNING,
        "--components",
        "2",
        "--runs",
        "3",
    ]
    done = CliRunner().invoke(app, [*asked, "--jobs", "1", "--out", str(out), *more], catch_exceptions=False)
    assert done.exit_code == 0
    return done.stdout


def figures(out):
    record = json.loads((out / "compare-reductions.json").read_text())
    return {
        (table["name"], row["tracker"], metric): cell
        for table in record["tables"]
        for row in table["rows"]
        for metric, cell in row["metrics"].items()
        if "equal time" not in table["name"] and "time" not in metric
    }, record


def test_shards_leave_all_blocks_and_the_whole_goes_on_from_those_that_are_there(
    small, tmp_path, monkeypatch
):
    for shard in ("1/2", "2/2"):
        said = call(tmp_path, "--shard", shard)
    assert "6 of 6 blocks of runs" in said
    kept = {file: file.stat().st_mtime_ns for file in (tmp_path / "blocks").iterdir()}
    said = call(tmp_path)
    # which of the two is on a front depends on the clock
    assert "runnalls" in said and "capping" in said and "on the front" in said
    found, record = figures(tmp_path)
    assert {table["name"] for table in record["tables"]} >= {RANDOM, f"{TURNING}, 2 components"}
    assert record["fronts"][TURNING]["track_loss"]
    files = {file.name for file in tmp_path.iterdir()}
    assert files >= {"mixtures.png", "tracking.svg", "fronts.md", "posteriors.md", "compare-reductions.csv"}
    assert {file: file.stat().st_mtime_ns for file in (tmp_path / "blocks").iterdir()} == kept
    again = sorted(kept)[::2]
    for file in again:
        file.unlink()
    monkeypatch.setattr(reductions_compared, "save", lambda drawing, file: None)  # takes seconds
    call(tmp_path)
    assert figures(tmp_path)[0] == found
    there = {file: file.stat().st_mtime_ns for file in (tmp_path / "blocks").iterdir()}
    assert there.keys() == kept.keys()
    assert {file for file in there if there[file] != kept[file]} == {*again}


def test_what_is_asked_twice_or_unknown_is_one_line(tmp_path):
    for more, message in (
        (["--reduction", "capping"], "--reduction capping is given twice"),
        (["--reduction", "runnals"], "unknown reduction 'runnals'; did you mean 'runnalls'"),
        (["--components", "2"], "--components 2 is given twice"),
    ):
        with pytest.raises(ValueError, match=message):
            call(tmp_path, *more)
