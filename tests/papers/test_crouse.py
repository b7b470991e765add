"""Crouse's tables on a few mixtures and scans: run, judged, drawn and written by the command."""

import json
from dataclasses import replace

import numpy as np
import pytest
from reference import runs_of

from gmr_gym import cli
from gmr_gym.evaluation.mixture_problems import MixtureProblem
from gmr_gym.evaluation.reduction_runs import ReductionRuns
from gmr_gym.experiments.evidence import Evidence
from gmr_gym.experiments.figures import HEADINGS
from gmr_gym.experiments.papers import crouse
from gmr_gym.experiments.papers.crouse import GMRC, MAPS, PAPER, REFINED, RUNNALLS, TABLES, of_mixtures
from gmr_gym.experiments.tables import MixtureTable
from gmr_gym.scenarios.salmond import second_order

MIXTURES = [table for table in TABLES if isinstance(table, MixtureTable)]


def runs(*errors):
    """Runs of a reduction with these errors, and twice as much divergence."""
    ise = np.array(errors, float)[:, None]
    return ReductionRuns(ise, ise, 2 * ise, ise, np.full(ise.shape, 5), np.full(ise.shape, 1e-3))


@pytest.mark.parametrize("table", MIXTURES, ids=lambda table: table.name)
def test_every_reduction_of_a_table_can_be_made_and_every_figure_shown_has_a_heading(table):
    ((problem, reductions),) = table.work()
    assert problem is table.problem and [*reductions] == [*table.trackers]
    assert all(reduce.keywords["components"] == table.components for reduce in reductions.values())
    rows = table.summarise(problem, {"runnalls": runs(1.0, 2.0)})
    assert {*table.columns} <= rows["runnalls"].keys() and {*table.columns} <= {*HEADINGS}
    assert {*table.published} <= {*table.trackers}
    assert (table.runs_of(40), table.exact) == ((40, False) if table.name == "random" else (1, True))
    assert table.with_rows(["pda"]) is table


def test_a_row_has_means_and_medians_over_the_mixtures():
    row = of_mixtures(MixtureProblem(), {"west": runs(1.0, 2.0, 6.0)})["west"]
    assert (row["ise"].value, row["ise_median"].value, row["divergence"].value) == (3.0, 2.0, 6.0)
    assert row["ise"].low < 3.0 < row["ise"].high and row["time_per_reduction"].value == 1e-3


def test_differences_are_of_the_same_mixtures():
    results = {"runnalls": runs(1.0, 2.0, 3.0), "west": runs(2.0, 3.0, 4.0)}
    row = crouse.from_first(MixtureProblem(), results)["west - runnalls"]
    assert tuple(row["ise"]) == (1.0, 1.0, 1.0) and tuple(row["divergence"]) == (2.0, 2.0, 2.0)


def test_sentences_are_judged_on_mixtures_and_on_tracks():
    many = 40
    level = {"runnalls": 0.08, "gmrc": 0.05, "cowa": 0.11, REFINED: 0.04}
    spread = np.random.default_rng(0).normal(0, 0.001, many)
    results = {name: runs(*(error + spread)) for name, error in level.items()}
    told = {"random": PAPER.evidence(TABLES[0], MixtureProblem(), results)}
    judged = {record["claim"]: record["verdict"] for record in PAPER.claim_records(told)}
    assert [*judged.values()] == ["holds", "holds", "holds", "fails"]  # less ISE, and here less divergence
    scenario = second_order()
    lost = {name: np.arange(many) < count for name, count in ((RUNNALLS, 1), (GMRC, 30), (crouse.COWA, 35))}
    tracked = {
        name: runs_of(np.zeros((many, 3, 4)), np.repeat(off[:, None], 3, axis=1))
        for name, off in lost.items()
    }
    told = {"tracker": PAPER.evidence(next(t for t in TABLES if t.name == "tracker"), scenario, tracked)}
    assert [record["verdict"] for record in PAPER.claim_records(told)] == ["holds", "holds"]
    assert isinstance(told["tracker"][GMRC], Evidence) and told["tracker"][GMRC].ise is None


def test_the_command_runs_draws_and_writes_tables_of_mixtures_trackers_and_the_sweep(tmp_path, monkeypatch):
    few = [replace(TABLES[0], trackers={"runnalls": {}, "cowa": {}}, problem=MixtureProblem(samples=50))]
    short = {name: {} for name in (RUNNALLS, GMRC)}
    few += [replace(table, trackers=short) for table in TABLES if table.name == "tracker"]
    few += [table for table in TABLES if table.name == "1d-5"]
    grid = replace(MAPS[0], axes={"acceleration": (0.1,), "clutter": (0.005, 0.01)})
    monkeypatch.setattr(crouse, "PAPER", replace(PAPER, tables=tuple(few), maps=(grid,)))
    cli.app(
        ["reproduce", "crouse", "--runs", "2", "--jobs", "1", "--out", str(tmp_path)], standalone_mode=False
    )
    record = json.loads((tmp_path / "crouse.json").read_text())
    tables = {table["name"]: table for table in record["tables"]}
    assert [*tables] == ["random", "random, paired differences", "tracker", "1d-5", "sweep"]
    exact = {row["tracker"]: row["metrics"]["ise"]["value"] for row in tables["1d-5"]["rows"]}
    assert exact["runnalls"] == pytest.approx(0.0266345318, abs=5e-11)
    assert exact["greedy-isd"] == exact["brute-force"] == pytest.approx(0.0029520974, abs=5e-11)
    assert exact["gmrc"] == pytest.approx(1.70321e-4, rel=1e-4)
    assert tables["1d-5"]["notes"] == [] and "too few" in tables["random"]["notes"][0]
    assert tables["random"]["rows"][0]["metrics"]["ise"]["paper"] == 0.0834
    drawn = {file.stem for file in tmp_path.glob("*.png")}
    assert drawn == {"figure-random", "figure-tracker", "figure-1d-5", "sweep"}
    header, first, *_ = (tmp_path / "runs-random.csv").read_text().splitlines()
    assert header == "reduction,run,ise,nise,divergence,reverse_divergence,components"
    assert first.startswith("runnalls,0,")
