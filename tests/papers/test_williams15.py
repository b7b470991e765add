"""Targets that meet: figures by phase, claims that follow the errors, and what the command leaves."""

import json
from dataclasses import replace

import numpy as np
import pytest

from gmr_gym import cli
from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns
from gmr_gym.experiments.papers import williams15
from gmr_gym.experiments.papers.williams15 import (
    CLAIMS,
    PAPER,
    PHASES,
    PMB,
    PMBM,
    REDUCED,
    REDUCTION_CLAIMS,
    TABLES,
    TRACKERS,
)
from gmr_gym.scenarios.williams import FIRST, MIDDLE, SCANS, meeting_targets

WORLD = meeting_targets(truth_seed=0)


def runs_with(gospa):
    """Thirty runs whose GOSPA is this (81,) scan by scan, and whose other scores are ones."""
    one = {name: np.ones((30, SCANS)) for name in MultiTargetRuns._fields}
    return MultiTargetRuns(**one)._replace(gospa=np.tile(gospa, (30, 1)))


def test_the_phases_are_scans_about_the_meeting_and_do_not_overlap():
    scans = [np.arange(SCANS)[phase] for phase in PHASES.values()]
    assert MIDDLE - 1 in scans[1] and len(np.unique(np.concatenate(scans))) == sum(map(len, scans))
    assert min(FIRST) <= scans[0][0] and max(FIRST) < scans[1][0] and scans[2][-1] == SCANS - 1


def test_rows_have_the_root_mean_square_of_every_phase():
    gospa = np.arange(SCANS, dtype=float)
    (row,) = williams15._rows(WORLD, {"one": runs_with(gospa)}).values()
    assert row["gospa_rms"].value == pytest.approx(np.sqrt((gospa**2).mean()))
    assert row["gospa_after"].value == pytest.approx(np.sqrt((gospa[46:] ** 2).mean()))


def test_a_claim_of_a_phase_holds_where_its_tracker_is_better_there_and_fails_where_it_is_worse():
    own, rival = np.ones(SCANS), np.ones(SCANS)
    own[PHASES["meeting"]], own[PHASES["after"]] = 0.5, 2.0
    results = {PMBM: runs_with(own), PMB: runs_with(rival)}
    table = TABLES[0]
    records = PAPER.claim_records({table.name: PAPER.evidence(table, WORLD, results)})
    verdicts = {record["claim"]: record["verdict"] for record in records}
    assert verdicts["pmbm is better than pmb where they meet"] == "holds"
    assert verdicts["pmbm is better than pmb after they have met"] == "fails"
    assert verdicts["pmbm is better than pmb"] == "fails"
    assert len(verdicts) == sum({claim.of, claim.against} == {PMBM, PMB} for claim in CLAIMS)


def test_every_claim_is_about_trackers_of_the_tables():
    for claims, trackers in ((CLAIMS, TRACKERS), (REDUCTION_CLAIMS, REDUCED)):
        assert all({claim.of, claim.against} <= set(trackers) for claim in claims)


def test_labels_are_kept_by_the_share_of_targets_there_in_the_last_ten_scans():
    scans, four = np.arange(SCANS), np.where(np.arange(SCANS) < MIDDLE - 1, 4.0, 3.0)
    runs = runs_with(np.ones(SCANS))._replace(
        kept=np.tile(np.where(scans < 75, 2.0, 1.0), (30, 1)), targets=np.tile(four, (30, 1))
    )
    (row,) = williams15._rows(WORLD, {"one": runs}).values()
    assert row["labels_kept_before"].value == pytest.approx(0.5)
    assert row["labels_kept_after"].value == pytest.approx((4 * 2 + 6) / 30)


def test_tables_are_run_drawn_and_written_by_the_command(tmp_path, monkeypatch):
    some = {name: TRACKERS[name] for name in ("gm-phd", PMB)}
    tables = tuple(replace(table, trackers=some) for table in TABLES[1:2])
    monkeypatch.setattr(williams15, "PAPER", replace(PAPER, tables=tables))
    arguments = ["reproduce", "williams15", "--runs", "2", "--jobs", "1", "--out", str(tmp_path)]
    cli.app(arguments, standalone_mode=False)
    record = json.loads((tmp_path / "williams15.json").read_text())
    assert [row["tracker"] for row in record["tables"][0]["rows"]] == ["gm-phd", PMB]
    assert all((tmp_path / f"{name}-staggered.png").exists() for name in ("by-scan", "existence"))
    header = (tmp_path / "runs-staggered.csv").read_text().splitlines()[0].split(",")
    assert {"gospa", "trajectory_gospa", "switches", "anees"} <= set(header)
