"""The papers by name, and a paper in a file of one's own: what adding one takes."""

import json
import subprocess
import sys

import pytest

from gmr_gym import cli
from gmr_gym.experiments.papers import registry
from gmr_gym.experiments.papers.registry import PAPERS, paper_named, register_paper
from gmr_gym.experiments.tables import Paper

TEMPLATE = '''
"""Whether PDA does better than a hypothesis tracker that keeps a single Gaussian."""

import numpy as np

from gmr_gym.evaluation.summary import not_lost
from gmr_gym.experiments.claims import Asked, Claim
from gmr_gym.experiments.evidence import squared_position
from gmr_gym.experiments.tables import Paper, Table


def smaller(weight, pda, other):
    return float(weight @ (other.square - pda.square).mean(axis=1) / weight.sum())


def figures(table, scenario, results, rows, out):
    (out / f"figure-{table.name}.txt").write_text("drawn")


TURN = Table("1", "four scans", "gmr_gym/TurningTarget-v0", {"horizon": 4}, {"pda": {}, "runnalls-1": {}})
PAPER = Paper(
    (TURN,),
    figures,
    quantities={"square": squared_position, "kept": not_lost},
    claims=(Asked((Claim("PDA errs less", "m^2", 0.0, smaller, "pda", "runnalls-1"),), ("1",)),),
)
'''


@pytest.fixture
def template(tmp_path, monkeypatch):
    """A paper in a file of its own, and known for as long as a test takes."""
    (tmp_path / "a_template_paper.py").write_text(TEMPLATE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(registry, "_PLACES", dict(registry._PLACES))
    known = dict(PAPERS)
    register_paper("template", "PDA against a single Gaussian", "a_template_paper:PAPER")
    yield tmp_path
    PAPERS.clear()
    PAPERS.update(known)
    sys.modules.pop("a_template_paper", None)


def test_a_paper_is_one_file_that_is_listed_run_drawn_and_judged(template, capsys):
    cli.app(["list"], standalone_mode=False)
    assert "PDA against a single Gaussian" in capsys.readouterr().out
    assert "a_template_paper" not in sys.modules  # a list imports no paper
    out = template / "out"
    cli.app(["reproduce", "template", "--runs", "3", "--jobs", "1", "--out", str(out)], standalone_mode=False)
    record = json.loads((out / "template.json").read_text())
    (table,), (claim,) = record["tables"], record["claims"]
    assert [row["tracker"] for row in table["rows"]] == ["pda", "runnalls-1"]
    assert (claim["claim"], claim["table"], claim["runs"]) == ("PDA errs less", "1", "all 3")
    assert claim["verdict"] == "too few runs"
    assert (out / "figure-1.txt").read_text() == "drawn"


def test_a_name_is_given_once_and_a_place_is_a_module_and_a_name():
    with pytest.raises(ValueError, match="there is a paper 'li' already"):
        register_paper("li", "another", "another:PAPER")
    with pytest.raises(ValueError, match="place must be MODULE:NAME, got 'another'"):
        register_paper("another", "another", "another")
    assert "another" not in PAPERS


@pytest.mark.parametrize("name", PAPERS)
def test_a_paper_is_found_by_its_name(name):
    paper = paper_named(name)
    assert isinstance(paper, Paper) and paper_named(name) is paper
    entries = paper.entries()
    assert list(entries) == [entry.name for entry in (*paper.tables, *paper.maps)]
    assert {table for asked in paper.claims for table in asked.tables} <= set(entries)


def test_an_unknown_paper_is_named_beside_those_there_are():
    with pytest.raises(ValueError, match="unknown paper 'kalman'; choose one of dortenzio, li"):
        paper_named("kalman")


def test_to_list_papers_imports_none():
    code = (
        "import sys; from gmr_gym.experiments.papers.registry import PAPERS;"
        "loaded = [m for m in sys.modules if m.startswith('gmr_gym.experiments.papers.')];"
        "assert loaded == ['gmr_gym.experiments.papers.registry'], loaded; assert len(PAPERS) == 6"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)
