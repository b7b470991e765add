"""Lv's section 7 run again: claims with known answers, evidence of made-up runs, figures of one episode."""

import json
from dataclasses import replace

import numpy as np
import pytest

from gmr_gym import cli
from gmr_gym.baselines.fitted_phd import fitted_phd
from gmr_gym.baselines.fmm import fmm_em
from gmr_gym.baselines.gm_phd import gm_phd
from gmr_gym.envs.lookup import scenario_of, tracker_of
from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns
from gmr_gym.experiments.evidence import Evidence, measured
from gmr_gym.experiments.figures import HEADINGS
from gmr_gym.experiments.papers import lv, lv_episode
from gmr_gym.experiments.papers.lv import (
    ACROSS,
    FITTED,
    PAPER,
    PRINTED,
    QUANTITIES,
    REDUCED,
    RIGHT,
    TABLES,
    UNIFORM,
)
from gmr_gym.filters.tracker import MultiTargetReport
from gmr_gym.scenarios.lv import unknown_clutter
from gmr_gym.simulation.multi_target import draw, scan

WORLD = unknown_clutter()
RUNS = 40


def runs_with(seed=0, **fields):
    """Runs of a hundred scans with one target in each, named, but for the fields that are given."""
    shape = RUNS, 100
    one = {name: np.ones(shape) for name in MultiTargetRuns._fields}
    one |= {"missed": np.zeros(shape), "false": np.zeros(shape)}
    return MultiTargetRuns(**one | fields)


def test_evidence_is_of_runs_with_known_scores():
    named = np.ones((RUNS, 100))
    named[:, :25] = 3  # too many for a quarter of the scans
    named[:, 25:50] = 0
    distance = np.where(named == 1, 10.0, 500.0)
    distance[:, 25:50] = np.nan
    missed = np.zeros((RUNS, 100))
    missed[:, 28:33] = 5000.0  # one is lost and found again
    missed[:20, 40:] = 10000.0  # both are lost for good
    error = np.full((RUNS, 100), np.nan)
    error[:, ::5] = 0.25
    runs = runs_with(
        named=named, wasserstein=distance, missed=missed, false=np.maximum(named - 1, 0) * 5000.0,
        density_error=error,
    )  # fmt: skip
    found = measured(QUANTITIES, WORLD, runs)
    np.testing.assert_allclose(found.off, 0.75)
    np.testing.assert_allclose(found.false, 0.5)
    np.testing.assert_allclose(found.right, 10.0)
    np.testing.assert_allclose(found.printed, 130.0)  # as eq. 41 has it, nothing named is no error
    np.testing.assert_array_equal(found.wasserstein, distance)
    np.testing.assert_allclose(found.density, 0.25)
    np.testing.assert_array_equal(found.lost, np.where(np.arange(RUNS) < 20, 3, 1))
    np.testing.assert_array_equal(found.again, 1)


def test_where_the_number_was_never_right_there_is_no_distance():
    runs = runs_with(named=np.zeros((RUNS, 100)))
    assert np.isnan(measured(QUANTITIES, WORLD, runs).right).all()


def scattered(seed, **means):
    """Evidence about these means, of a deviation of a hundredth."""
    rng = np.random.default_rng(seed)
    numbers = dict.fromkeys(QUANTITIES, 1.0) | means
    numbers = {name: value + 0.01 * rng.standard_normal(RUNS) for name, value in numbers.items()}
    distance = np.where(rng.random((RUNS, 9)) < 0.5, numbers["wasserstein"][:, None], np.nan)
    return Evidence(**numbers | {"wasserstein": distance})


def verdicts(records, table, runs):
    return {r["claim"]: r["verdict"] for r in records if (r["table"], r["runs"]) == (table, runs)}


@pytest.mark.parametrize(("better", "wanted"), [(True, "holds"), (False, "fails")])
def test_the_papers_claims_hold_where_its_numbers_are_better_and_fail_where_they_are_worse(better, wanted):
    good = {"off": 0.2, "false": 0.1, "printed": 50.0, "wasserstein": 60.0, "ospa": 30.0, "density": 0.4}
    bad = {"off": 1.2, "false": 2.1, "printed": 350.0, "wasserstein": 360.0, "ospa": 60.0, "density": 1.4}
    own = good | {"right": RIGHT - 4, "again": 0.9} if better else bad | {"right": RIGHT + 4, "again": 0.1}
    found = {"fmm-em": scattered(0, **own), UNIFORM: scattered(1, **bad if better else good)}
    records = PAPER.claim_records({"groups": found})
    assert list(verdicts(records, "groups", "fmm-em").items()) == [(c.sentence, wanted) for c in PRINTED]
    assert {record["runs"] for record in records} == {"fmm-em"}


def test_claims_across_tables_need_them_all_and_compare_the_right_ones():
    tables = {
        "uniform": {UNIFORM: scattered(0, false=0.1, ospa=25.0), "learning-phd": scattered(1, ospa=25.1)},
        "groups": {
            UNIFORM: scattered(2, false=2.0), "learning-phd": scattered(3, ospa=30.0),
        },
        "groups-told": {UNIFORM: scattered(5, ospa=29.0)},
        "dense": {UNIFORM: scattered(6, false=1.0), "learning-phd": scattered(7, ospa=45.0)},
        "dense-told": {UNIFORM: scattered(8, ospa=42.0)},
    }  # fmt: skip
    records = PAPER.claim_records(tables)
    wanted = ["holds", "fails", "holds", "fails", "holds"]
    assert [(r["table"], r["runs"], r["verdict"]) for r in records] == [
        (asked.table or "uniform", asked.runs, verdict) for asked, verdict in zip(ACROSS, wanted, strict=True)
    ]
    some = PAPER.claim_records({"uniform": tables["uniform"], "groups-told": tables["groups-told"]})
    assert [(r["table"], r["runs"]) for r in some] == [("uniform", "learning-phd")]


def test_a_number_that_was_the_same_in_every_run_is_not_certain():
    own = Evidence(**vars(scattered(0)) | {"again": np.ones(RUNS), "lost": np.ones(RUNS)})
    (record,) = [
        r
        for r in PAPER.claim_records({"dense": {"fmm-em": own, UNIFORM: own}})
        if "provisionally" in r["claim"]
    ]
    assert record["value"] == 0.5 and 0.3 < record["low"] < 0.5 and record["verdict"] == "holds"


def test_a_claim_about_scans_that_there_were_not_is_unknown():
    own = Evidence(**vars(scattered(0)) | {"right": np.full(RUNS, np.nan)})
    records = PAPER.claim_records({"groups": {"fmm-em": own, UNIFORM: own}})
    assert [r["verdict"] for r in records if "about 10 m" in r["claim"]] == ["unknown"]


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.name)
def test_every_tracker_of_a_table_is_made_and_every_column_has_a_heading(table):
    world = scenario_of(table.env_id, table.settings)
    for spec in table.trackers:
        tracker = tracker_of(spec, world)
        tracker.step(tracker.init(), np.empty((0, 2)))
    assert set(table.columns) <= set(HEADINGS)
    assert set(FITTED) <= set(table.trackers) or UNIFORM in table.trackers or table.name == "reductions"


def test_the_reductions_are_of_one_filter_told_the_true_clutter():
    (table,) = [table for table in TABLES if table.name == "reductions"]
    assert table.settings == {"told": "true"} and len(set(REDUCED)) == len(REDUCED)
    assert {spec.partition(":")[0] for spec in REDUCED} == {"gm-phd"}


def test_curves_have_a_gap_where_nothing_is_named_and_no_0():
    distance = np.full((RUNS, 100), 7.0)
    distance[:, 40:60] = np.nan  # in no run
    distance[1:, :20] = np.nan  # but in one
    runs = runs_with(wasserstein=distance)
    drawing = lv._by_scan({"one": runs})
    *_, shown, undefined = (panel.lines[0].get_ydata() for panel in drawing.axes)
    assert np.isnan(shown[40:60]).all() and np.all(np.delete(shown, np.s_[40:60]) == 7.0)
    np.testing.assert_allclose(undefined[[0, 30, 50]], [100 * (1 - 1 / RUNS), 0.0, 100.0])
    said = [MultiTargetReport(np.empty((0, 6)), *[np.zeros(0)] * 2, 0.0, None, None)] * 100
    panel = lv_episode._episode("one", WORLD, draw(WORLD, 0), said, runs).axes[-1]
    own, several, none = (line.get_ydata() for line in panel.lines)
    assert np.isnan(own).all() and len(none) == 100 and np.isnan(several[40:60]).all()
    assert panel.lines[-1].get_label() == "none at 100 scans"


def test_section_seven_is_run_drawn_and_written_by_the_command(tmp_path, monkeypatch):
    tables = tuple(
        replace(table, settings=table.settings | {"horizon": 12}, trackers={name: {} for name in names})
        for table, names in zip(
            TABLES[:3],
            (
                (UNIFORM, *FITTED[:2], "learning-phd", "learning-pmb"),
                (UNIFORM, "pmb"),
                (UNIFORM, "learning-phd"),
            ),
            strict=True,
        )
    )
    monkeypatch.setattr(lv, "PAPER", replace(PAPER, tables=tables))
    arguments = ["reproduce", "lv", "--runs", "2", "--jobs", "1", "--out", str(tmp_path)]
    cli.app(arguments, standalone_mode=False)
    record = json.loads((tmp_path / "lv.json").read_text())
    assert {claim["table"] for claim in record["claims"]} == {"groups", "uniform"}
    drawn = {file.stem for file in tmp_path.glob("*.png")}
    assert drawn == {
        "figure-1", "figure-2", "figure-3", "figures-4-6-8", "figures-5-7-9", "figures-5-7-9-repaired",
        "learning-pmb", "clutter", *(f"by-scan-{table.name}" for table in tables),
    }  # fmt: skip
    header = (tmp_path / "runs-groups.csv").read_text().splitlines()[0]
    assert header.startswith("tracker,run,ospa,") and "seconds" not in header


def test_as_many_runs_as_the_paper_unless_told_otherwise(tmp_path, monkeypatch):
    table = replace(TABLES[1], settings={"horizon": 2}, trackers={UNIFORM: {}, "pmb": {}}, runs=3)
    monkeypatch.setattr(lv, "PAPER", replace(PAPER, tables=(table,)))
    cli.app(["reproduce", "lv", "--jobs", "1", "--out", str(tmp_path)], standalone_mode=False)
    assert json.loads((tmp_path / "lv.json").read_text())["runs"] == 3
    assert len((tmp_path / "runs-groups-told.csv").read_text().splitlines()) == 7


@pytest.mark.parametrize("repaired", [False, True])
def test_the_fitted_phd_is_a_phd_told_scan_by_scan_what_the_finite_mixture_fits(repaired):
    told, crowd = WORLD.model, draw(WORLD, 3)
    fed, fit = fitted_phd(told, repaired=repaired), fmm_em(told, repaired)
    belief, mixture, targets = fed.init(), fit.init(), gm_phd(told).init()
    for t in range(30):
        z = scan(crowd, t).z if t % 10 else np.empty((0, 2))
        belief, said = fed.step(belief, z)
        mixture, fitted = fit.step(mixture, z)
        targets, wanted = gm_phd(told._replace(clutter=fitted.clutter)).step(targets, z)
        np.testing.assert_array_equal(said.intensity.w, wanted.intensity.w)
        np.testing.assert_array_equal(said.x, wanted.x)
        np.testing.assert_array_equal(said.clutter.density(crowd.z), wanted.clutter.density(crowd.z))


@pytest.mark.parametrize("by", ["gm-phd", "fitted-phd"])
def test_the_fitted_phd_is_fed_by_a_finite_mixture_alone(by):
    with pytest.raises(ValueError, match="by must be fmm-em or fmm-gibbs"):
        fitted_phd(WORLD.model, by=by)


def test_the_fitted_phd_refuses_a_limit_that_is_none():
    with pytest.raises(ValueError, match="prune_weight must be non-negative"):
        fitted_phd(WORLD.model, prune_weight=-1.0)
