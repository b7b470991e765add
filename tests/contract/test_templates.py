"""The files that a user copies: each is added by its one line, and keeps the contract of its kind."""

import inspect
import json
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import test_every_tracker as contract
from gymnasium.utils.env_checker import check_env

from gmr_gym import cli
from gmr_gym.baselines.mht import Mht
from gmr_gym.catalogue import reductions
from gmr_gym.filters.registry import make_tracker, trackers
from gmr_gym.mixture import mixture, moments
from gmr_gym.reduction.protocol import check_reduced
from gmr_gym.reduction.registry import reducer
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.scenarios.zhang import jump_markov

TEMPLATES = Path(__file__).parents[2] / "docs" / "templates"
LINES = """[gmr_gym.trackers]
a-template = template_tracker:Clustering
[gmr_gym.reductions]
a-template = template_reduction:heaviest_and_rest
gone = template_reduction:nothing
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The templates under names of their own, as a package with entry points installs them."""
    folder = tmp_path_factory.mktemp("templates")
    for template in TEMPLATES.glob("*.py"):
        (folder / f"template_{template.name}").write_text(template.read_text(encoding="utf-8"))
    (folder / "templates-0.dist-info").mkdir()
    (folder / "templates-0.dist-info" / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: templates\nVersion: 0\n"
    )
    (folder / "templates-0.dist-info" / "entry_points.txt").write_text(LINES)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(folder)
        yield folder
    for name in [name for name in sys.modules if name.startswith("template_")]:
        del sys.modules[name]


CONTRACT = [
    (test, certain)
    for name, test in vars(contract).items()
    if name.startswith("test_")
    for certain in ((False, True) if "certain" in inspect.signature(test).parameters else (None,))
]


@pytest.mark.parametrize(
    "test, certain", CONTRACT, ids=[f"{test.__name__}-{certain}" for test, certain in CONTRACT]
)
def test_the_tracker_keeps_the_contract_of_every_tracker(installed, test, certain):
    test("gmr_gym/TurningTarget-v0", "a-template", *(() if certain is None else (certain,)))


def test_the_tracker_is_listed_and_evaluated_by_its_name(installed, tmp_path, capsys):
    assert trackers()["a-template"] == "MHT of one target, reduced to `components` by clustering."
    words = ["gmr_gym/TurningTarget-v0", "--tracker", "a-template-5", "--tracker", "runnalls-5"]
    few = ["--runs", "2", "--jobs", "1", "--set", "horizon=20", "--out", str(tmp_path / "out")]
    cli.app(["evaluate", *words, *few], standalone_mode=False)
    (table, _) = json.loads((tmp_path / "out" / "evaluate.json").read_text())["tables"]
    mine, theirs = (row["metrics"] for row in table["rows"])
    assert 1 <= mine["components"]["value"] <= 5 and theirs["components"]["value"] <= 5
    with pytest.raises(ValueError, match="distance must be a number, at least 0, got -1"):
        make_tracker("a-template", turning_target().model, distance=-1)
    with pytest.raises(ValueError, match="knows one motion"):
        make_tracker("a-template", jump_markov().model)


@pytest.mark.parametrize("components", [1, 2, 30])
def test_the_reduction_keeps_the_protocol_of_every_reduction(installed, components):
    rng = np.random.default_rng(0)
    p = mixture(rng.dirichlet(np.ones(6)), rng.normal(size=(6, 2)), [np.eye(2)] * 6)
    reduce = reducer("a-template", components)
    q, origin = reduce(p)
    check_reduced((q, origin), len(p.w))
    assert len(q.w) == min(components, 2)
    for one, other in zip(moments(q), moments(p), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)
    nothing = p._replace(w=np.append(p.w[:-1] / p.w[:-1].sum(), 0.0))
    assert reduce(nothing)[1][-1] == -1
    with pytest.raises(ValueError, match="components must be at least 1, got 0"):
        reducer("a-template", 0)(p)


def test_the_reduction_is_used_by_its_name_and_as_a_function(installed):
    told, scans = turning_target().model, [np.zeros((0, 2)), np.ones((3, 2)), np.full((1, 2), 5.0)]
    by_name = Mht(told, reducer("a-template", 2))
    template = import_module("template_reduction")
    as_function = Mht(told, lambda p: template.heaviest_and_rest(p, 2))
    reports = contract.played(by_name, scans)
    contract.assert_same(reports, contract.played(as_function, scans))
    assert len(reports[1].mixture.w) == 2
    jumping = jump_markov().model
    one, other = (
        make_tracker("mmg-2", jumping, reduction=name)
        for name in ("a-template", "template_reduction:heaviest_and_rest")
    )
    contract.assert_same(contract.played(one, scans), contract.played(other, scans))


def test_a_reduction_is_listed_offered_and_suggested_like_those_of_the_project(installed, capsys):
    assert reductions()[-2:] == ("a-template", "gone") and reductions()[0] == "runnalls"
    cli.app(["list"], standalone_mode=False)
    listed = capsys.readouterr().out.splitlines()
    lines = [line.split(maxsplit=1)[1] for line in listed if line.startswith("  a-template ")]
    assert "The heaviest component and the moment match of all others" in lines[-1]
    with pytest.raises(ValueError, match="unknown reduction 'a-templat'; did you mean 'a-template'"):
        reducer("a-templat", 2)
    with pytest.raises(ValueError, match=r"reduction 'gone' is no function that can be imported: .*nothing"):
        reducer("gone", 2)


def test_an_installed_package_replaces_no_reduction_of_the_project(installed, monkeypatch):
    file = installed / "templates-0.dist-info" / "entry_points.txt"
    file.write_text(LINES + "west = template_reduction:heaviest_and_rest\n")
    try:
        assert reducer("west", 2).func.__module__ == "gmr_gym.reduction.salmond_west"
        assert reductions().count("west") == 1
    finally:
        file.write_text(LINES)


@pytest.mark.filterwarnings("ignore:.*symmetric and normalized space")  # metres are meant
def test_the_scenario_is_an_environment(installed, tmp_path):
    known = dict(gym.registry)
    try:
        env = gym.make("template_scenario:crossing/Crossing-v0", swing=50.0).unwrapped
        check_env(env)
        assert env.scenario.horizon == 60
        words = ["template_scenario:crossing/Crossing-v0", "--tracker", "pda", "--set", "clutter_rate=10"]
        few = ["--runs", "2", "--jobs", "1", "--out", str(tmp_path / "out")]
        cli.app(["evaluate", *words, *few], standalone_mode=False)
        assert json.loads((tmp_path / "out" / "evaluate.json").read_text())["tables"]
    finally:
        gym.registry.clear()
        gym.registry.update(known)


def test_the_paper_is_reproduced_by_running_its_file(installed, tmp_path):
    file, out = installed / "template_paper.py", tmp_path / "out"
    words = ["reproduce", "five-or-one", "--runs", "3", "--jobs", "1", "--out", str(out)]
    done = subprocess.run([sys.executable, str(file), *words], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    record = json.loads((out / "five-or-one.json").read_text())
    (table,), (claim,) = record["tables"], record["claims"]
    assert table["rows"][0]["metrics"]["track_loss"]["paper"] == 0.032
    assert (claim["claim"], claim["verdict"]) == ("five lose less than one", "too few runs")
    assert (out / "figure-1.png").read_bytes().startswith(b"\x89PNG")
