"""The papers by name, and a paper in a file of one's own: what adding one takes."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from gmr_gym import cli
from gmr_gym.experiments.papers import registry
from gmr_gym.experiments.papers.registry import PAPERS, paper_named, register_paper
from gmr_gym.experiments.tables import Paper

TEMPLATE = Path(__file__).parents[2] / "docs" / "templates" / "paper.py"


@pytest.fixture
def template(tmp_path, monkeypatch):
    """A paper in a file of its own, and known for as long as a test takes."""
    (tmp_path / "a_template_paper.py").write_text(TEMPLATE.read_text(encoding="utf-8"))
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(registry, "_PLACES", dict(registry._PLACES))
    known = dict(PAPERS)
    register_paper("template", "five hypotheses against one", "a_template_paper:PAPER")
    yield tmp_path
    PAPERS.clear()
    PAPERS.update(known)
    sys.modules.pop("a_template_paper", None)


def test_a_paper_is_one_file_that_is_listed_run_drawn_and_judged(template, capsys):
    cli.app(["list"], standalone_mode=False)
    assert "five hypotheses against one" in capsys.readouterr().out
    assert "a_template_paper" not in sys.modules  # a list imports no paper
    out = template / "out"
    cli.app(["reproduce", "template", "--runs", "3", "--jobs", "1", "--out", str(out)], standalone_mode=False)
    record = json.loads((out / "template.json").read_text())
    (table,), (claim,) = record["tables"], record["claims"]
    assert [row["tracker"] for row in table["rows"]] == ["runnalls-5", "pda"]
    assert (claim["claim"], claim["table"], claim["runs"]) == ("five lose less than one", "1", "all 3")
    assert claim["verdict"] == "too few runs"
    assert (out / "figure-1.png").read_bytes().startswith(b"\x89PNG")


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
    with pytest.raises(ValueError, match="unknown paper 'kalman'; choose one of crouse, dortenzio, li"):
        paper_named("kalman")


def test_to_list_papers_imports_none():
    code = (
        "import sys; from gmr_gym.experiments.papers.registry import PAPERS;"
        "loaded = [m for m in sys.modules if m.startswith('gmr_gym.experiments.papers.')];"
        "assert loaded == ['gmr_gym.experiments.papers.registry'], loaded; assert len(PAPERS) == 8"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=120)
