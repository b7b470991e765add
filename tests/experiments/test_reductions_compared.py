"""Reductions compared: paired runs, rows on fronts, and a command that goes on where it stopped."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from gmr_gym.cli import app
from gmr_gym.envs import lookup
from gmr_gym.evaluation import run
from gmr_gym.evaluation.mixture_problems import random_mixture
from gmr_gym.evaluation.reduction_costs import Costs
from gmr_gym.evaluation.summary import Estimate, differences
from gmr_gym.experiments import reductions_compared
from gmr_gym.experiments.reduction_quality import RANDOM, Problem, median, of_environment, tracker_with
from gmr_gym.experiments.reduction_tracking import fit, outcome, row
from gmr_gym.experiments.reductions_compared import at_equal_time, named_front

TURNING = "gmr_gym/TurningTarget-v0"
SCENARIO = lookup.scenario_of(TURNING, {"clutter_rate": 60, "horizon": 25})


def costed(seconds, ise=0.1):
    columns = [np.full((3, 1), ise)] * 4
    return Costs(np.full((3, 1), 5), *columns, np.full((3, 1), seconds))


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
    costs = {"runnalls": costed(1.0), "a": costed(9.0), "b": costed(11.0), "c": costed(2.0, np.nan)}
    kept, unfit = fit(costs, slowest=10)
    assert kept == ["runnalls", "a"] and unfit.keys() == {"b", "c"}
    assert unfit["b"] == "11 times as long as runnalls for a posterior"


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
    mixtures = [random_mixture(i) for i in range(3)]
    few = {name: Problem(mixtures, 5, 100) for name in (RANDOM, of_environment(TURNING))}
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
    assert "2 of 2 blocks of runs" in said
    kept = {file: file.stat().st_mtime_ns for file in (tmp_path / "blocks").iterdir()}
    said = call(tmp_path)
    assert "runnalls, 2" in said and "on the front" in said
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
