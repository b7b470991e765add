"""The leaderboard: who runs where, in which order, and what is left behind."""

import csv
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from gmr_gym.cli import app
from gmr_gym.envs.lookup import scenario_of, tracker_of
from gmr_gym.evaluation import run
from gmr_gym.evaluation.summary import Estimate, summary
from gmr_gym.experiments import leaderboard

TURNING, FLIGHT = "gmr_gym/TurningTarget-v0", "gmr_gym/JumpMarkov-v0"


def test_every_installed_tracker_runs_or_has_a_reason_and_two_names_of_one_count_once():
    work, unfit = leaderboard.entries([TURNING, FLIGHT], ["runnalls-5", "pda:"])
    assert {"pda", "runnalls", "runnalls-5", "mmg"} <= work[TURNING][1].keys()
    assert "pda" not in work[FLIGHT][1] and "one motion" in unfit[FLIGHT]["pda"]
    assert "radar" in unfit[TURNING]["imm-dcm-pda"]
    assert "pda:" not in work[TURNING][1]
    assert len({"mmae", "mmae-pda"} & work[TURNING][1].keys()) == 1


def test_a_tracker_that_runs_nowhere_is_an_error_with_the_reason():
    with pytest.raises(ValueError, match=r"'pda' runs in none of gmr_gym/JumpMarkov-v0: .*one motion"):
        leaderboard.entries([FLIGHT], ["pda"])


def test_the_best_stand_first_and_who_has_no_error_last():
    scenario = scenario_of(TURNING, {"clutter_rate": 20, "horizon": 25})
    trackers = {name: tracker_of(name, scenario) for name in ("nearest-neighbour", "pda", "clairvoyant")}
    results = run(scenario, trackers, runs=3)
    rows = leaderboard.ranked(scenario, results, unit=1e-5)
    losses = [row["track_loss"].value for row in rows.values()]
    assert losses == sorted(losses)
    expected = summary(scenario, results)
    for name, row in rows.items():
        assert row["time_in_pda_scans"] == Estimate(expected[name]["time_per_scan"].value / 1e-5)
        for metric in set(leaderboard.COLUMNS) - {"time_in_pda_scans"}:
            assert np.array_equal(row[metric], expected[name][metric], equal_nan=True)


def test_the_command_leaves_record_rows_and_page(tmp_path, monkeypatch):
    def few(env_id, world):
        return scenario_of(env_id, {"clutter_rate": 20, "horizon": 5})

    monkeypatch.setattr(leaderboard, "scenario_of", few)
    monkeypatch.setattr(leaderboard, "_once", lambda group: ["pda", "nearest-neighbour", "imm-dcm-pda"])
    asked = ["leaderboard", "--env", TURNING, "--runs", "2", "--jobs", "1", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, asked, catch_exceptions=False)
    assert done.exit_code == 0 and "nearest-neighbour" in done.stdout
    record = json.loads((tmp_path / "leaderboard.json").read_text())
    assert {row["tracker"] for row in record["tables"][0]["rows"]} == {"pda", "nearest-neighbour"}
    assert list(record["unfit"][TURNING]) == ["imm-dcm-pda"]
    with (tmp_path / "leaderboard.csv").open(newline="") as stream:
        rows = [*csv.DictReader(stream)]
    cells = {(row["tracker"], row["metric"]): row["value"] for row in rows}
    for row in record["tables"][0]["rows"]:
        for metric, cell in row["metrics"].items():
            assert cells[row["tracker"], metric] == ("" if cell["value"] is None else repr(cell["value"]))
    page = (tmp_path / "leaderboard.html").read_text()
    assert "imm-dcm-pda" in page and f"gmr-gym leaderboard --env {TURNING} --runs 2 --seed 0" in page
