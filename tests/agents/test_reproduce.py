"""All of training and comparison by one command: its stages, in their order."""

import sys
from pathlib import Path

import pytest

pytest.importorskip("torch")
pytest.importorskip("stable_baselines3")
pytest.importorskip("optuna")
sys.path.insert(0, str(Path(__file__).parents[2] / "agents"))

import reproduce

VALID = {0: "1,100,-20.0\n2,200,-18.0\n", 1: "1,100,-19.0\n2,200,-19.5\n"}


@pytest.fixture
def stages(monkeypatch, tmp_path):
    """Every stage writes its name instead, and the file that it leaves."""
    done = []

    def trained(algorithm, *, seed, out, **rest):
        done.append(f"train {out.name}")
        out.mkdir(exist_ok=True)
        (out / "valid.csv").write_text("chapter,steps,reward\n" + VALID[seed])

    def exported(run, out, chapter, runs):
        done.append(f"export {run.name} {chapter}")
        out.with_suffix(".csv").write_text("price,work\n")

    def compared(static, policies, **rest):
        done.append(f"compare {static.relative_to(tmp_path)} {len(policies)}")

    monkeypatch.setattr(reproduce.train, "main", trained)
    monkeypatch.setattr(reproduce.export, "main", exported)
    monkeypatch.setattr(reproduce.tune_rivals, "main", lambda *counts, out, **rest: done.append("tune"))
    monkeypatch.setattr(reproduce.evaluate_fronts, "main", compared)
    return done


def test_the_best_chapter_of_all_seeds_is_exported_once(stages, tmp_path):
    every = [
        stage
        for reducer in reproduce.TRAINED
        for stage in (f"train {reducer}-0", f"train {reducer}-1", f"export {reducer}-0 2")
    ]
    every += ["tune", "compare rivals/static.json 4"]
    for expected in (every, [stage for stage in every if "export" not in stage]):
        stages.clear()
        reproduce.main(seeds=2, out=tmp_path)
        assert stages == expected


def test_results_of_the_docs_are_those_that_the_comparison_of_fronts_makes(tmp_path):
    for name, command in (("fronts", "python agents/evaluate_fronts.py"), ("other", "gmr-gym evaluate")):
        (tmp_path / f"{name}.md").write_text(f"<!--\ncommand: {command} x\nneeds: y\n-->\n")
    assert reproduce.results(tmp_path) == ["fronts"]
