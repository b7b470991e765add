"""The command line as a user meets it: what it prints, the files it leaves, and how it refuses."""

import contextlib
import csv
import json
import os
import re
import signal
import subprocess
import sys
import warnings
from importlib.metadata import entry_points, version
from inspect import getdoc, signature
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from PIL import Image

import gmr_gym
from gmr_gym.catalogue import BACKENDS, HYPOTHESIS_REDUCTIONS, REDUCTIONS
from gmr_gym.cli import main
from gmr_gym.data.loader import flight_names
from gmr_gym.envs.episodic import settings
from gmr_gym.envs.lookup import scenario_of, tracker_of
from gmr_gym.envs.registry import ABOUT, ENVIRONMENTS, TRACKED
from gmr_gym.evaluation import recordings as detections
from gmr_gym.evaluation import workers
from gmr_gym.evaluation.curves import CURVES
from gmr_gym.evaluation.loop import play
from gmr_gym.evaluation.montecarlo import run
from gmr_gym.evaluation.summary import FEWEST, summary
from gmr_gym.experiments.mixtures import crouse, read_mixture
from gmr_gym.experiments.output import RUN_COLUMNS, write_runs
from gmr_gym.experiments.papers.registry import PAPERS
from gmr_gym.filters.registry import GROUP, MULTI_TARGET_GROUP, make_tracker, trackers
from gmr_gym.literals import key_value
from gmr_gym.reduction.registry import REDUCERS, hypothesis_reducer, reducer
from gmr_gym.replay import lineup, reduction_page
from gmr_gym.scenarios.dortenzio import turning_target
from gmr_gym.scenarios.li import airborne_radar
from gmr_gym.scenarios.zhang import SCANS, jump_markov
from gmr_gym.simulation.single_target import draw, scan

CROUSE = "reduce", "--example", "crouse"
JUMP, TURNING, RADAR = (f"gmr_gym/{name}-v0" for name in ("JumpMarkov", "TurningTarget", "AirborneRadar"))


@pytest.fixture
def call(monkeypatch, capsys, tmp_path):
    """The command line in a folder of its own: (exit code, what it printed, its errors)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("COLUMNS", raising=False)
    monkeypatch.setattr("gmr_gym.evaluation.curves.RESAMPLES", 20)  # of the intervals nothing is asked here

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["gmr-gym", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, *capsys.readouterr()

    return call


def rows_of(file):
    return list(csv.DictReader(Path(file).read_text().splitlines()))


def test_list_shows_every_environment_segment_tracker_reduction_and_paper(call):
    code, printed, _ = call("list")
    shown, title = {}, ""
    for line in printed.splitlines():
        name, _, text = line.strip().partition(" ")
        if line.startswith(" "):
            shown[title][name] = text.strip()
        else:
            title = line
            shown[title] = {}
    segments = dict.fromkeys(flight_names(), "")
    wanted = [
        ABOUT,
        segments,
        trackers(),
        trackers(MULTI_TARGET_GROUP),
        REDUCTIONS | HYPOTHESIS_REDUCTIONS,
        PAPERS,
    ]
    assert code == 0 and list(shown.values()) == wanted
    assert {"environments", "trackers", "papers"} <= set(shown)
    assert tuple(ABOUT) == ENVIRONMENTS
    for group in (GROUP, MULTI_TARGET_GROUP):
        for point in entry_points(group=group):
            paragraph = getdoc(point.load()).split("\n\n")[0]
            assert trackers(group)[point.name] == " ".join(paragraph.split()) != ""


def answer(program):
    """What a new Python prints of a program, beside the heavy modules that it had imported at its end."""
    heavy = "'numba', 'scipy', 'matplotlib', 'joblib', 'gmr_gym.baselines'"
    program += f"\nimport sys; print(sorted({{{heavy}}} & set(sys.modules)), file=sys.stderr)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    return done.stdout, done.stderr


def completed(words):
    """What zsh is offered after the words."""
    asked = {"_GMR_GYM_COMPLETE": "complete_zsh", "_TYPER_COMPLETE_ARGS": f"gmr-gym {words}"}
    program = (
        f"import os, sys; os.environ |= {asked}; sys.argv = ['gmr-gym']\n"
        "from gmr_gym.cli import main\ntry: main()\nexcept SystemExit: pass"
    )
    printed, heavy = answer(program)
    offered = re.findall(r'^(?:_arguments .*\(\()?"([^"]+)"', printed.replace("\\\\:", ":"), re.M)
    return offered, heavy


def test_trackers_of_other_packages_are_described_without_being_imported(tmp_path, monkeypatch):
    other = tmp_path / "other"
    other.mkdir()
    (other / "__init__.py").write_text("raise AssertionError('imported')")
    (other / "mine.py").write_text(
        'import nowhere\ndef made(model):\n    """Mine, in\n    two lines.\n\n    Rest."""\nalias = made\n'
    )
    (other / "broken.py").write_text("def made(")
    installed = tmp_path / "other-0.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: other\nVersion: 0\n")
    places = {"a": "mine:made", "b": "mine:alias", "c": "broken:made", "d": "missing:made"}
    points = [f"other-{name} = other.{place}" for name, place in places.items()]
    (installed / "entry_points.txt").write_text("\n".join(["[gmr_gym.trackers]", *points]))
    monkeypatch.syspath_prepend(str(tmp_path))
    lines = {name: line for name, line in trackers().items() if name.startswith("other-")}
    assert lines == {"other-a": "Mine, in two lines.", "other-b": "", "other-c": "", "other-d": ""}


def test_list_and_help_import_neither_trackers_nor_kernels():
    for words in (["list"], ["evaluate", "--help"], ["--version"]):
        program = f"import sys; sys.argv = ['gmr-gym', *{words}]\nfrom gmr_gym.cli import main\n"
        printed, heavy = answer(f"{program}try: main()\nexcept SystemExit: pass")
        assert printed and heavy == "[]\n"


@pytest.mark.parametrize(
    ("words", "wanted"),
    [
        ("evaluate gmr_gym/Tur", {TURNING}),
        (f"evaluate {TURNING} --tracker run", {"runnalls"}),
        ("evaluate gmr_gym/UnknownClutter-v0 --tracker gm", {"gm-phd", "gm-cphd"}),
        (
            f"evaluate {JUMP} --tracker mmg-15:reduction=ise",
            {"mmg-15:reduction=ise", "mmg-15:reduction=ise-unscaled"},
        ),
        ("reproduce may", {"maybeck", "maybeck-zhang"}),
        ("evaluate x --backend ", set(BACKENDS)),
        ("track z.csv --model ", {"constant-velocity"}),
    ],
)
def test_a_shell_completes_names_without_importing_what_they_name(words, wanted):
    offered, heavy = completed(words)
    assert set(offered) == wanted and heavy == "[]\n"


def test_a_shell_completes_a_papers_tables():
    offered, _ = completed("reproduce zhang --table 1")
    assert {"1", "1-quiet"} <= set(offered) and all(name.startswith("1") for name in offered)


def test_the_names_that_are_listed_are_those_of_the_library():
    assert [*REDUCTIONS] == [*REDUCERS] and all(REDUCTIONS.values())
    assert all(hypothesis_reducer(name, 3) and name not in REDUCERS for name in HYPOTHESIS_REDUCTIONS)
    assert tuple(workers.BACKENDS) == BACKENDS


def test_help_shows_what_can_be_chosen(call):
    for words, names in (
        (["evaluate", "--help"], [*BACKENDS, *TRACKED]),
        (["reproduce", "--help"], PAPERS),
        (["track", "--help"], ["constant-velocity"]),
        (["--help"], ["--install-completion", "--show-completion", "--version"]),
    ):
        code, printed, _ = call(*words)
        said = "".join(re.findall(r"[\w/:|,-]", printed))
        assert code == 0 and all(name in said for name in names)


def test_reproduce_leaves_a_papers_tables_curves_figures_and_claims(call):
    code, printed, _ = call(
        "reproduce", "zhang", "--table", 1, "--table", 2, "--runs", 4, "--jobs", 1, "--out", "r"
    )
    assert code == 0
    left = {file.name for file in Path("r").iterdir()}
    by_table = {f"{name}-{table}.{end}" for table in "12" for name, end in (
        ("runs", "csv"), ("scans", "csv"), ("figure", "png"),
    )}  # fmt: skip
    assert left == {"zhang.json", "zhang.csv", "blocks", *by_table}
    record = json.loads(Path("r/zhang.json").read_text())
    assert (record["paper"], record["runs"], record["seed"]) == ("zhang", 4, 0)
    assert [table["name"] for table in record["tables"]] == ["1", "2"]
    assert [table["settings"] for table in record["tables"]] == [{"case": "1"}, {"case": "2"}]
    assert {claim["table"] for claim in record["claims"]} == {"1", "2", "2 against 1"}
    assert {claim["verdict"] for claim in record["claims"]} <= {"too few runs", "unknown"}
    for words in (
        "zhang, table 1: case 1",
        "what the paper says",
        "MMG has the best position RMSE",
        "imm-mht-15",
    ):
        assert words in printed
    runs, scans = rows_of("r/runs-1.csv"), rows_of("r/scans-1.csv")
    names = ["mmg-10", "imm-mht-10", "imm-pda", "clairvoyant"]
    assert tuple(runs[0]) == RUN_COLUMNS
    assert [(row["tracker"], row["run"]) for row in runs] == [
        (name, str(i)) for name in names for i in range(4)
    ]
    assert [row["tracker"] for row in scans] == [name for name in names for _ in range(2 * SCANS)]
    assert tuple(scans[0])[3:] == CURVES
    figures = {(row["table"], row["tracker"], row["metric"]): row["value"] for row in rows_of("r/zhang.csv")}
    for table in record["tables"]:
        for row in table["rows"]:
            for metric, cell in row["metrics"].items():
                told = figures.pop((table["name"], row["tracker"], metric))
                assert told == ("" if cell["value"] is None else repr(cell["value"]))
    assert not figures
    with Image.open("r/figure-1.png") as image:
        assert min(image.size) > 500


def test_the_same_command_again_takes_its_runs_from_the_folder_and_leaves_the_same_bytes(call):
    words = "reproduce", "zhang", "--table", 1, "--runs", 4, "--jobs", 1, "--json", "copy.json"
    assert call(*words)[0] == 0
    folder = Path("results/zhang/table-1-runs-4")
    files = [folder / name for name in ("runs-1.csv", "scans-1.csv", "zhang.json", "zhang.csv")]
    first = [file.read_bytes() for file in files]
    assert Path("copy.json").read_bytes() == first[2]
    blocks = {file: file.stat().st_mtime_ns for file in (folder.parent / "blocks").iterdir()}
    assert len(blocks) == 4
    for file in files:
        file.unlink()
    code, _, errors = call(*words)
    assert code == 0 and "table 1: 0 of 16" not in errors and "table 1: 16 of 16" in errors
    # the times of the runs are in two of them: nothing was run again
    assert [file.read_bytes() for file in files] == first
    assert {file: file.stat().st_mtime_ns for file in (folder.parent / "blocks").iterdir()} == blocks


def test_reproduce_sets_printed_figures_beside_its_own(call):
    code, printed, _ = call("reproduce", "dortenzio", "--table", 1, "--runs", 4, "--jobs", 1, "--out", "r")
    assert code == 0
    assert {file.name for file in Path("r").iterdir()} == {
        "dortenzio.json", "dortenzio.csv", "runs-1.csv", "figure-1.png", "blocks"
    }  # fmt: skip
    record = json.loads(Path("r/dortenzio.json").read_text())
    assert "claims" not in record and len(record["tables"]) == 1
    rows = {row["tracker"]: row["metrics"] for row in record["tables"][0]["rows"]}
    assert rows["capping-30"]["track_loss"]["paper"] == pytest.approx(0.458, rel=1e-12)
    assert rows["capping-30"]["track_loss"]["verdict"] == "too few runs"
    assert "verdict" not in rows["adaptive-30"]["time_per_scan"]
    assert "paper 45.8 " in printed and "paper 39.8 " in printed  # per cent and milliseconds
    assert len(rows_of("r/runs-1.csv")) == 4 * 6


def test_a_tracker_of_ones_own_has_its_row_in_a_papers_table_on_the_same_scans(call):
    words = "reproduce", "dortenzio", "--table", 1, "--runs", 2, "--jobs", 1
    assert call(*words)[0] == 0
    code, printed, _ = call(*words, "--tracker", "runnalls-3")
    assert code == 0 and "runnalls-3" in printed and "agrees: the two differ by no more than" in printed
    (plain,), (more,) = (
        [json.loads(file.read_text()) for file in Path("results/dortenzio").glob(f"{folder}/dortenzio.json")]
        for folder in ("table-1-runs-2", "table-1-more-*-runs-2")
    )
    before, after = (
        {row["tracker"]: row["metrics"] for row in record["tables"][0]["rows"]} for record in (plain, more)
    )
    assert set(after) - set(before) == {"runnalls-3"} and "paper" not in after["runnalls-3"]["track_loss"]
    assert all(after[name]["rmse_own"] == before[name]["rmse_own"] for name in before)
    scenario = turning_target()
    (alone,) = run(scenario, {"": make_tracker("runnalls-3", scenario.model)}, 2).values()
    assert after["runnalls-3"]["components"]["value"] == pytest.approx(alone.components.mean(), rel=1e-12)


def test_a_row_that_is_there_and_results_with_other_rows_are_refused(call):
    words = "reproduce", "dortenzio", "--table", 1, "--runs", 2, "--jobs", 1, "--out", "r"
    code, _, errors = call(*words, "--tracker", "runnalls-5")
    assert code == 2 and "tracker 'runnalls-5' has its row in table 1 already" in errors
    assert call(*words)[0] == 0
    code, _, errors = call(*words, "--tracker", "pda")
    assert code == 2 and "r/dortenzio.json has the results of another call (trackers" in errors


def test_evaluate_runs_the_world_and_the_trackers_it_was_told(call):
    spec = "mmg-10:reduction=average-isd"
    code, printed, _ = call(
        "evaluate", JUMP, "--tracker", spec, "--tracker", "imm-pda", "--set", "case=2",
        "--set", "process_variance=0.01", "--runs", 4, "--seed", 3, "--jobs", 1, "--json", "copy.json",
    )  # fmt: skip
    assert code == 0 and f"imm-pda - {spec}" in printed
    scenario = jump_markov("2", process_variance=0.01)
    told = {
        spec: make_tracker("mmg", scenario.model, components=10, reduction="average-isd"),
        "imm-pda": make_tracker("imm-pda", scenario.model),
    }
    results = run(scenario, told, 4, seed=3)
    write_runs(Path("wanted.csv"), scenario, results)
    (folder,) = Path("results/evaluate").glob("JumpMarkov-v0-*")
    assert (folder / "runs.csv").read_bytes() == Path("wanted.csv").read_bytes()
    record = json.loads(Path("copy.json").read_text())
    assert record == json.loads((folder / "evaluate.json").read_text())
    assert (record["env"], record["seed"], record["runs"]) == (JUMP, 3, 4)
    table, paired = record["tables"]
    assert table["settings"] == {"case": 2, "process_variance": 0.01}
    assert [row["tracker"] for row in table["rows"]] == list(told)
    assert [row["tracker"] for row in paired["rows"]] == [f"imm-pda - {spec}"]
    wanted = summary(scenario, results)
    for row in table["rows"]:
        assert row["metrics"]["rmse_own"]["value"] == wanted[row["tracker"]]["rmse_own"].value


FEW = "evaluate", TURNING, "--tracker", "pda", "--tracker", "runnalls-2", "--set", "horizon=3"


def test_shards_merged_are_what_the_command_finds_and_the_unsharded_one_gives(call):
    words = (*FEW, "--runs", 50, "--jobs", 1)
    assert call(*words, "--out", "whole")[0] == 0
    there = 0
    for i in (1, 2, 3):
        code, printed, errors = call(*words, "--shard", f"{i}/3", "--out", f"part{i}")
        there += (mine := len(list(Path(f"part{i}/blocks").iterdir())))
        assert (
            code == 0 and f"{mine} of 6 blocks of runs are in part{i}/blocks, {6 - mine} are left" in printed
        )
        assert [file.name for file in Path(f"part{i}").iterdir()] == ["blocks"]
    assert there == 6
    Path("part3/blocks/notes.txt").touch()
    code, printed, errors = call("merge", "part1", "part2", "part3", "--into", "all")
    assert (code, errors) == (0, "")
    assert printed.splitlines() == [
        "6 blocks of runs copied to all/blocks", "part3/blocks/notes.txt: no block of runs, left out"
    ]  # fmt: skip
    code, _, errors = call(*words, "--out", "all")
    assert code == 0 and errors.splitlines() == [f"{TURNING}: 100 of 100"]
    assert Path("all/runs.csv").read_bytes() == Path("whole/runs.csv").read_bytes()
    code, printed, _ = call(*words, "--shard", "2/3", "--out", "all")
    assert code == 0 and "6 of 6 blocks of runs are in all/blocks, none is left" in printed
    code, printed, _ = call("merge", "part1", "--into", "all")
    assert code == 0 and printed.startswith("0 blocks of runs copied")
    assert printed.count("there already, the same to the last bit") == len(
        list(Path("part1/blocks").iterdir())
    )


def test_merge_refuses_by_name_what_is_no_block_and_merges_the_rest(call):
    assert call(*FEW, "--runs", 21, "--jobs", 1, "--out", "a")[0] == 0
    first, *others = sorted(Path("a/blocks").iterdir())
    first.write_text("")
    code, printed, errors = call("merge", "a", "--into", "b")
    assert code == 2 and f"{len(others)} blocks of runs copied" in printed
    assert errors.startswith(f"error: 1 refused, all else is merged: {first} is not a block of runs (")
    assert sorted(file.name for file in Path("b/blocks").iterdir()) == [file.name for file in others]


def test_one_tracker_alone_has_no_paired_differences(call):
    code, printed, _ = call(
        "evaluate", TURNING, "--tracker", "pda", "--set", "horizon=4", "--runs", 2, "--jobs", 1, "--out", "e"
    )
    assert code == 0 and "paired differences" not in printed
    assert len(json.loads(Path("e/evaluate.json").read_text())["tables"]) == 1


@pytest.mark.parametrize("settings", [(), ("--set", "case=clear")], ids=["gates", "gates without end"])
def test_watch_films_every_scan(call, settings):
    words = "watch", JUMP, "--tracker", "mmg-10", *settings, "--scans", 4, "--size", "400x420", "--fps", 5
    code, _, errors = call(*words, "--out", "films/f.gif")
    assert code == 0 and "tracking: 4 of 4" in errors
    with Image.open("films/f.gif") as film:
        assert film.n_frames == 4 and film.size == (400, 420) and film.info["duration"] == 200
        assert len(film.convert("RGB").getcolors()) > 10


def test_watch_leaves_a_page_of_several_trackers_unless_it_is_told_otherwise(call):
    words = "watch", TURNING, "--tracker", "pda", "--tracker", "nearest-neighbour", "--seed", 3, "--scans", 4
    code, printed, errors = call(*words)
    assert code == 0 and "written to episode.html" in printed and "tracking: 8 of 8" in errors
    text = Path("episode.html").read_text(encoding="utf-8")
    assert text == gmr_gym.show(TURNING, "pda", "nearest-neighbour", seed=3, scans=4).page
    assert call(*words, "--out", "again.html")[0] == 0
    assert Path("again.html").read_text(encoding="utf-8") == text


class Nowhere:
    """A tracker whose estimate is not finite."""

    def __init__(self, model):
        self.model, self.base = model, make_tracker("pda", model)

    def init(self):
        return self.base.init()

    def step(self, belief, z):
        belief, report = self.base.step(belief, z)
        return belief, report._replace(x=np.nan * report.x)


def test_a_warning_is_a_line_without_a_place_in_the_code(call, monkeypatch):
    monkeypatch.setattr(lineup, "tracker_of", lambda name, scenario: Nowhere(scenario.model))
    with warnings.catch_warnings():
        warnings.simplefilter("always")
        code, _, errors = call("watch", TURNING, "--tracker", "mine", "--scans", 2)
    said = "warning: tracker 'mine' reported numbers that are not finite in 2 of 2 scans; they are not shown"
    assert code == 0 and said in errors.splitlines() and ".py" not in errors


def test_a_page_names_the_settings_of_its_environment(call):
    path = f"trajectory={[[1.0 * t, 2.0 * t] for t in range(20)]}"
    words = "watch", TURNING, "--tracker", "pda", "--scans", 2, "--set", "clutter_rate=20", "--set", path
    assert call(*words)[0] == 0
    title = f"<title>pda: {TURNING} clutter_rate=20 {path[:57]}... seed 0</title>"
    assert title in Path("episode.html").read_text(encoding="utf-8")


def test_watch_pictures_one_scan_by_several_trackers(call):
    words = "watch", JUMP, "--tracker", "mmg-5", "--tracker", "imm-pda", "--frame", 2, "--size", 600
    code, _, errors = call(*words, "--out", "f.png")
    assert code == 0 and "tracking: 2 of 2" in errors
    with Image.open("f.png") as picture:
        assert picture.width == 600


def test_reduce_leaves_a_page_of_every_method_and_shows_what_each_costs(call):
    code, printed, errors = call("reduce", "--example", "crouse", "--method", "runnalls", "--method", "west")
    assert code == 0 and "written to reduction.html" in printed and "reducing: 18 of 18" in errors
    assert "crouse: 10 components to 5" in printed and "standard error" not in printed
    (row,) = [line.split("|")[1:] for line in printed.splitlines() if line.startswith("| runnalls")]
    assert [cell.strip() for cell in row[:3]] == ["runnalls", "5", "0.02663"]
    text = reduction_page(crouse(), ["runnalls", "west"], title="crouse")
    assert Path("reduction.html").read_text(encoding="utf-8") == text


def test_reduce_writes_the_mixture_that_one_method_leaves(call):
    assert call("reduce", "--example", "crouse", "--components", 6, "--out", "p.csv")[0] == 0
    code, printed, _ = call("reduce", "p.csv", "--method", "adaptive:loss_bound=0", "--out", "q.json")
    assert code == 0 and "p: 6 components to 3" in printed
    q = read_mixture(Path("p.csv"))
    np.testing.assert_array_equal(q.m, reducer("runnalls", 6)(crouse())[0].m)
    np.testing.assert_array_equal(read_mixture(Path("q.json")).m, reducer("runnalls", 3)(q)[0].m)


def test_reduce_draws_what_methods_leave(call):
    for example, out in (("crouse", "p.png"), ("random", "p.svg")):
        words = "reduce", "--example", example, "--method", "runnalls", "--method", "salmond:distance=0.1"
        code, printed, _ = call(*words, "--out", out)
        assert code == 0 and f"written to {out}" in printed and "salmond:distance=0.1" in printed
    with Image.open("p.png") as picture:
        assert picture.width > 1000
    drawn = Path("p.svg").read_text(encoding="utf-8")
    assert drawn.count("<use ") > 2 * (10 + 5)  # a mark at every mean


def test_reduce_compares_every_reduction_and_says_which_cannot(call, monkeypatch):
    def never(p, components):
        raise ValueError("not this one")

    def tired(p, components):
        warnings.warn("stopped at its limit", UserWarning, stacklevel=1)
        return REDUCERS["ise"](p, components)

    monkeypatch.setattr("gmr_gym.experiments.reducing.reductions", lambda: ("west", "never", "tired"))
    monkeypatch.setitem(REDUCERS, "never", never)
    monkeypatch.setitem(REDUCERS, "tired", tired)
    code, printed, errors = call(*CROUSE, "--compare", "all", "--components", 4)
    _, *rows = (line.split("|")[1:3] for line in printed.splitlines() if line.startswith("|"))
    assert code == 0 and [[cell.strip() for cell in row] for row in rows] == [["tired", "4"], ["west", "4"]]
    assert printed.count("tired: stopped at its limit") == 1
    assert "never cannot: not this one" in printed and "reducing: 3 of 3" in errors
    assert not Path("reduction.html").exists()


def test_record_writes_the_detections_and_the_truth_of_the_episode(call):
    code, _, _ = call(
        "record", TURNING, "--set", "horizon=6", "--seed", 5, "--out", "z.csv", "--truth", "x.csv"
    )
    assert code == 0
    scenario = turning_target(horizon=6)
    episode = draw(scenario, 5)
    seen, truth = detections.read_scans(Path("z.csv")), detections.read_scans(Path("x.csv"))
    assert seen.coordinates == truth.coordinates == ("x_m", "y_m")
    times = scenario.period * np.arange(1, 7)
    np.testing.assert_array_equal([seen.times, truth.times], [times, times])
    for t in range(6):
        np.testing.assert_array_equal(seen.z[t], scan(scenario, episode, t, np.zeros(2)).z)
    np.testing.assert_array_equal(np.concatenate(truth.z), episode.x[:, :2])


def test_what_a_following_window_records_is_what_its_tracker_saw(call):
    words = "record", JUMP, "--set", "window=(300, 300)", "--tracker"
    assert call(*words, "mmg-5", "--out", "mine.csv")[0] == 0
    assert call(*words, "imm-pda", "--out", "other.csv")[0] == 0
    mine, other = (detections.read_scans(Path(file)) for file in ("mine.csv", "other.csv"))
    assert len(mine.z) == len(other.z) == SCANS
    # on the same ground, so of two windows that overlap some detections are the same
    np.testing.assert_array_equal(mine.z[0], other.z[0])
    assert any(not np.array_equal(a, b) for a, b in zip(mine.z, other.z, strict=True))


# a target that flies past a radar which stands still
PASSING, STILL = [[20_000.0, 30.0 * t, 2_000.0] for t in range(5)], [[0.0, 0.0, 0.0]] * 5
SEEN_BY_RADAR = RADAR, "--set", f"trajectory={PASSING}", "--set", f"platform={STILL}"


def test_watch_films_what_a_radar_sees(call):
    code, _, errors = call("watch", *SEEN_BY_RADAR, "--out", "f.gif")
    assert code == 0 and "tracking: 5 of 5" in errors
    with Image.open("f.gif") as film:
        assert film.n_frames == 5 and min(film.size) > 500
        assert len(film.convert("RGB").getcolors()) > 10


def test_watch_films_many_targets(call):
    code, _, errors = call("watch", "gmr_gym/UnknownClutter-v0", "--set", "horizon=3", "--out", "f.gif")
    assert code == 0 and "tracking: 3 of 3" in errors
    with Image.open("f.gif") as film:
        assert film.n_frames == 3 and min(film.size) > 500
        assert len(film.convert("RGB").getcolors()) > 10


def test_record_names_what_a_radar_detects_and_track_refuses_angles(call):
    assert call("record", *SEEN_BY_RADAR, "--seed", 5, "--out", "z.csv", "--truth", "x.csv")[0] == 0
    scenario = airborne_radar(trajectory=PASSING, platform=STILL)
    tracker = make_tracker("imm-pda", scenario.model)
    seen, truth = detections.read_scans("z.csv"), detections.read_scans("x.csv")
    assert seen.coordinates == ("range_m", "azimuth_rad", "elevation_rad")
    assert truth.coordinates == ("x_m", "y_m", "z_m")
    for z, played in zip(seen.z, play(scenario, tracker, draw(scenario, 5)), strict=True):
        np.testing.assert_array_equal(z, played.scan.z)
    np.testing.assert_allclose(np.concatenate(truth.z), PASSING, rtol=1e-12)
    code, printed, errors = call(
        "track", "z.csv", "--targets", "one", "--sensor-deviation", 10, "--clutter-density", 1e-6
    )
    assert code == 2 and printed == "" and len(errors.splitlines()) == 1
    assert errors.startswith("error: z.csv, column azimuth_rad: an angle, but only positions in metres are")
    assert "gmr_gym.models.radar.cartesian" in errors and not Path("track.csv").exists()


def test_what_a_radar_recorded_is_tracked_from_python(call):
    assert call("record", *SEEN_BY_RADAR, "--set", "detection_probability=1", "--out", "z.csv")[0] == 0
    scenario = airborne_radar(trajectory=PASSING, platform=STILL, detection_probability=1)
    tracker = make_tracker("imm-pda", scenario.model)
    track = detections.track(detections.read_scans("z.csv"), lambda interval: tracker)
    assert np.linalg.norm(track.x[:, :3] - PASSING, axis=1).max() < 4 * 0.025 * 2e4  # of a look's deviations


def recorded(call):
    """A clean recording of 12 scans, its truth, and the options that fit it."""
    settings = [f"--set={text}" for text in ("horizon=12", "clutter_rate=0", "detection_probability=1")]
    assert call("record", TURNING, *settings, "--out", "z.csv", "--truth", "x.csv")[0] == 0
    truth = np.concatenate(detections.read_scans(Path("x.csv")).z)
    return truth, ("track", "z.csv", "--targets", "one", "--sensor-deviation", 10, "--clutter-density", 1e-6)


def test_track_follows_what_record_wrote(call):
    truth, words = recorded(call)
    code, printed, _ = call(
        *words, "--tracker", "runnalls:components=2,prune_weight=0", "--out", "t/track.csv"
    )
    assert code == 0 and "12 scans tracked" in printed
    rows = rows_of("t/track.csv")
    assert list(rows[0])[:5] == ["time", "x_m", "y_m", "x_m_velocity", "y_m_velocity"]
    assert "cov_x_m_y_m" in rows[0] and list(rows[0])[-2:] == ["components", "alive"]
    assert [float(row["time"]) for row in rows] == detections.read_scans(Path("z.csv")).times.tolist()
    estimates = np.array([[row["x_m"], row["y_m"]] for row in rows], float)
    assert np.linalg.norm(estimates - truth, axis=1).max() < 50  # five deviations of the sensor
    assert len({row["x_m_velocity"] for row in rows}) == 12
    assert {row["components"] for row in rows[1:]} == {"2"}  # a detection and a miss, as it was told


def test_track_starts_from_the_prior_it_is_given(call):
    truth, words = recorded(call)
    state = ",".join(map(str, [*truth[0] - truth[1] + truth[0], *(truth[1] - truth[0])]))
    tight, far = "1e-3,1e-3,1e-3,1e-3", "5000,5000,0,0"
    for prior, name in ((state, "near.csv"), (far, "far.csv")):
        assert call(*words, "--prior", prior, "--prior-deviations", tight, "--out", name)[0] == 0
    near, off = (rows_of(name)[0] for name in ("near.csv", "far.csv"))
    assert np.hypot(float(near["x_m"]) - truth[0, 0], float(near["y_m"]) - truth[0, 1]) < 20
    assert float(off["x_m"]) == pytest.approx(5000, abs=1) and float(off["y_m"]) == pytest.approx(5000, abs=1)


EVALUATE = "evaluate", JUMP, "--runs", "1", "--jobs", "1", "--tracker"
TRACK = "track", "z.csv", "--targets", "one", "--sensor-deviation", "10", "--clutter-density", "1e-6"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("reproduce", "nobody"),
            "unknown paper 'nobody'; choose one of crouse, dortenzio, li, lv, maybeck, maybeck-zhang, "
            "williams15, zhang",
        ),
        (("reproduce", "zhang", "--table", "9"), "zhang has no table '9'; choose from 1, 2, 1-quiet,"),
        (("reproduce", "dortenzio", "--table", "1-quiet"), "no table '1-quiet'; choose from 1, 2, 3, 4"),
        (
            ("reproduce", "crouse", "--table", "1d-5", "--tracker", "pda"),
            "--tracker has no row in 1d-5: it compares reductions, or settings",
        ),
        ((*EVALUATE, "pda"), "choose one with modes, such as imm-pda, imm-mht or mmg"),
        ((*EVALUATE, "mgg-5"), "unknown tracker 'mgg-5'; did you mean 'mmg'?"),
        ((*EVALUATE, "mmg-5:reduction=runalls"), "unknown reduction 'runalls'; did you mean 'runnalls'?"),
        ((*EVALUATE, "mmg-5:components=9,prune=0"), "takes no parameter 'prune'; it takes components"),
        ((*EVALUATE, "mmg-5", "--set", "case"), "expected key=value, got 'case'"),
        ((*EVALUATE, "mmg-5", "--set", "case=3"), "case must be one of 1, 2, stress, clear, got 3"),
        (
            (*EVALUATE, "mmg-5", "--set", "cas=2"),
            "argument 'cas'; did you mean 'case'? this environment takes case,",
        ),
        ((*EVALUATE, "mmg-5", "--set", "scenario=os:system"), "unknown argument 'scenario'; "),
        ((*EVALUATE, "mmg-5", "--set", "render_mode=human"), "unknown argument 'render_mode'; "),
        (("evaluate", "gmr_gym/JumpMarkow-v0", "--tracker", "mmg"), f"did you mean '{JUMP}'?"),
        (("evaluate", "JumpMarkov", "--tracker", "mmg"), f"did you mean '{JUMP}'?"),
        (("evaluate", "CartPole-v1", "--tracker", "pda"), "CartPole-v1 is not a tracking environment"),
        (("evaluate", "gmr_gym/UnknownClutter-v0", "--tracker", "pdx"), "unknown tracker 'pdx'"),
        (
            ("evaluate", "gmr_gym/UnknownClutter-v0", "--tracker", "runnalls-30"),
            "tracker 'runnalls-30' is for one target, the model for many",
        ),
        (("evaluate", "gmr_gym/UnknownClutter-v0", "--tracker", "runnalls"), "'runnalls' is for one target"),
        (
            ("evaluate", TURNING, "--tracker", "gm-phd"),
            "'gm-phd' is for many targets, the model for one",
        ),
        (
            ("evaluate", "gmr_gym/UnknownClutter-v0", "--tracker", "fmm-em:repaired=no"),
            "repaired must be True or False, got 'no'",
        ),
        (
            ("evaluate", "gmr_gym/UnknownClutter-v0", "--tracker", "gm-phd", "--set", "groups=[[0.7,[0,0]"),
            "groups cannot be read as a list",
        ),
        (
            ("evaluate", "gmr_gym/UnknownClutter-v0", "--tracker", "gm-phd", "--set", "horizon=1.5"),
            "horizon must be between 1 and the 100 scans of the path, whole, got 1.5",
        ),
        (
            (*EVALUATE, "pda", "--shard", "4/3", "--out", "e"),
            "shard must be I/N with I from 1 to N, as in 2/3",
        ),
        ((*EVALUATE, "pda", "--shard", "1/3"), "say with --out in which folder"),
        (("reproduce", "zhang", "--shard", "1/3"), "say with --out in which folder"),
        (
            (*EVALUATE, "imm-pda", "--backend", "threads"),
            "unknown backend 'threads'; choose one of loky, dask, ray",
        ),
        ((*EVALUATE, "imm-pda", "--scheduler", "tcp://a:1"), "loky stays on this machine"),
        (("merge", "nowhere", "--into", "all"), "nowhere is no folder of results: it has no blocks"),
        (("record", "gmr_gym/UnknownClutter-v0"), "many targets; choose from gmr_gym/T"),
        (
            ("watch", JUMP, "--out", "f.avi"),
            "--out must end in .html or .gif or .mp4 or .png or .svg, got 'f.avi'",
        ),
        (("watch", JUMP, "--out", "f.png"), "f.png is one picture: say of which scan by frame (--frame K)"),
        (("watch", JUMP, "--out", "f.gif", "--frame", 1), "--frame is for .png or .svg, and --out is f.gif"),
        (("watch", JUMP, "--out", "f.html", "--size", 9), "--size is for .gif or .mp4 or .png or .svg, and"),
        (
            ("watch", JUMP, "--out", "f.png", "--frame", 1, "--fps", 5),
            "--fps is for .gif or .mp4, and --out is f.png",
        ),
        (
            ("watch", JUMP, "--out", "f.gif", "--size", "4x"),
            "--size must be WIDTH or WIDTHxHEIGHT in pixels, as",
        ),
        (("watch", JUMP, "--scans", "0"), "scans must be from 1 to the 45 of the episode, got 0"),
        (
            ("watch", JUMP, *(word for i in range(5) for word in ("--tracker", f"mmg-{i + 1}"))),
            "trackers must be from 1 to 4, got 5",
        ),
        (
            ("watch", TURNING, "--tracker", "gm-phd"),
            f"'gm-phd' cannot run in {TURNING}: tracker 'gm-phd' is for many targets, the model for one",
        ),
        (("watch", JUMP, "--tracker", "pda"), f"'pda' cannot run in {JUMP}: this tracker knows one motion"),
        (("watch", TURNING, "--out", "z.csv/f.html"), "error: z.csv: not a directory"),
        (("reduce",), "give one mixture: a file, or --example, one of crouse, posterior"),
        (("reduce", "z.csv", "--example", "crouse"), "give one mixture: a file, or --example, one of crouse"),
        (("reduce", "--example", "cruse"), "unknown example 'cruse'; choose one of crouse, posterior"),
        (("reduce", "p.txt"), "MIXTURE must end in .json or .npz or .csv, got 'p.txt'"),
        (("reduce", "missing.csv"), "error: missing.csv: no such file or directory"),
        (("reduce", "z.csv"), "z.csv: expected the header w,m1,P11, got 'time,x,y'"),
        (
            (*CROUSE, "--out", "p.txt"),
            "--out must end in .html or .png or .svg or .json or .npz or .csv, got 'p.txt'",
        ),
        ((*CROUSE, "--compare", "some"), "unknown reductions to compare 'some'; choose all"),
        ((*CROUSE, "--compare", "all", "--out", "p.csv"), "--out is not for --compare, which takes all"),
        ((*CROUSE, "--compare", "all", "--method", "west"), "--method is not for --compare, which takes"),
        (
            (*CROUSE, *(word for i in range(5) for word in ("--method", f"salmond:distance={i}"))),
            "--method is given 5 times, and reduction.html takes 4",
        ),
        ((*CROUSE, "--components", 11), "--components must be from 1 to the 10 of crouse, got 11"),
        ((*CROUSE, "--method", "wst"), "unknown reduction 'wst'; did you mean 'west'?"),
        ((*CROUSE, "--axes", "1,2"), "--axes is for coordinates of more than one dimension"),
        ((*CROUSE, "--axes", "1,2", "--out", "p.csv"), "--axes is for a page or a picture, and p.csv is a"),
        (
            ("reduce", "--example", "posterior", "--axes", "0,1"),
            "--axes must be two different ones of 1 to 4",
        ),
        (
            (*CROUSE, "--method", "west", "--method", "ise", "--out", "p.csv"),
            "p.csv takes the mixture of one --method, got 2; a page takes more",
        ),
        (("track", "missing.csv", *TRACK[2:]), "error: missing.csv: no such file or directory"),
        (("evaluate", TURNING, "--tracker", "pda", "--out", "z.csv"), "error: z.csv: not a directory"),
        ((*EVALUATE, "imm-pda", "--json", "z.csv/f.json"), "error: z.csv: not a directory"),
        (("reproduce", "zhang", "--out", "z.csv/x"), "error: z.csv: not a directory"),
        (("record", TURNING, "--truth", "z.csv/t.csv"), "error: z.csv: not a directory"),
        (("watch", TURNING, "--out", "z.csv/f.gif"), "error: z.csv: not a directory"),
        ((*TRACK, "--out", "."), "error: .: is a directory"),
        (("merge", "nowhere", "--into", "z.csv"), "error: z.csv: not a directory"),
        ((*TRACK, "--model", "turning"), "unknown model 'turning'; choose constant-velocity"),
        ((*TRACK, "--prior", "0,0,0,0"), "give --prior and --prior-deviations together, or neither"),
        (
            (*TRACK, "--prior", "0,0,a,0", "--prior-deviations", "1,1,1,1"),
            "--prior must be numbers with commas between, got '0,0,a,0'",
        ),
        (
            (*TRACK, "--prior", "0,0,0", "--prior-deviations", "1,1,1,1"),
            "--prior must be 2 positions and 2 velocities, got 3 numbers",
        ),
        ((*TRACK, "--out", "x.geojson"), "--out must end in .csv, got 'x.geojson'"),
        ((*TRACK, "--speed", "0"), "--speed must be positive and finite, got 0.0"),
        ((*TRACK, "--out", "x"), "--out must end in .csv, got 'x'"),
        (("record", TURNING, "--out", "z.json"), "--out must end in .csv, got 'z.json'"),
        (("record", TURNING, "--truth", "x.gif"), "--truth must end in .csv, got 'x.gif'"),
    ],
)
def test_what_a_user_got_wrong_is_one_line_and_exit_code_2(call, words, message):
    Path("z.csv").write_text("time,x,y\n1.0,0,0\n2.0,5,5\n")
    code, printed, errors = call(*words)
    assert code == 2 and printed == ""
    *progress, line = errors.splitlines()
    assert line.startswith("error: ") and message in line
    assert all(" of " in line for line in progress)  # how far the runs had come
    assert not Path("results").exists()


def test_the_version_is_that_of_the_package(call):
    assert call("--version") == (0, f"gmr-gym {gmr_gym.__version__}\n", "")


@pytest.fixture
def trap(tmp_path, monkeypatch):
    """A module that can be imported, by its name, and whether it was."""
    (tmp_path / "trap.py").write_text("def sprung(p, components):\n    return p, [0]\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    yield lambda: sys.modules.pop("trap", None) is not None
    sys.modules.pop("trap", None)


OF_GYMNASIUM = (
    "scenario", "entry_point", "vector_entry_point", "id", "kwargs", "additional_wrappers", "wrappers",
    "max_episode_steps", "disable_env_checker", "render_mode",
)  # fmt: skip


@pytest.mark.parametrize("env_id", TRACKED)
def test_no_setting_of_an_environment_imports_what_it_names(trap, env_id):
    taken = settings(gym.spec(env_id).kwargs["scenario"])
    for name in (*taken, *OF_GYMNASIUM):
        with contextlib.suppress(ValueError):
            scenario_of(env_id, {name: "trap:sprung"})
        assert not trap(), name
    for name in OF_GYMNASIUM:
        with pytest.raises(ValueError, match=f"unknown argument '{name}'; .*this environment takes "):
            scenario_of(env_id, {name: "trap:sprung"})


def test_of_a_trackers_parameters_a_reduction_alone_imports_what_it_names(trap):
    for group, env_id in ((GROUP, JUMP), (MULTI_TARGET_GROUP, "gmr_gym/UnknownClutter-v0")):
        scenario, importing = scenario_of(env_id, {}), set()
        for point in entry_points(group=group):
            for name in list(signature(point.load()).parameters)[1:]:
                with contextlib.suppress(ValueError):
                    tracker_of(f"{point.name}:{name}=trap:sprung", scenario)
                importing |= {name} if trap() else set()
        assert importing == {"reduction"}


def test_what_is_nested_deeply_is_no_value():
    for text in ("(" * 5000, "-" * 100_000 + "1"):
        with contextlib.suppress(ValueError):
            assert key_value(f"case={text}") == ("case", text)


@pytest.mark.parametrize(
    "options", [(), ("--period", "1"), ("--prior", "0,0,0,0", "--prior-deviations", "1,1,1,1")]
)
def test_one_scan_alone_is_refused_by_what_can_be_typed(call, options):
    Path("z.csv").write_text("time,x,y\n1.0,,\n2.0,5,5\n" if len(options) < 4 else "time,x,y\n2.0,5,5\n")
    code, printed, errors = call(*TRACK, *options)
    assert code == 2 and printed == "" and not Path("track.csv").exists()
    assert errors.startswith("error: z.csv holds one scan to start from and none after it: give --prior with")
    complete = "--prior", "0,0,0,0", "--prior-deviations", "1,1,1,1", "--period", "1"
    assert call(*TRACK, *complete)[0] == 0


@pytest.mark.parametrize("rows", ["1,1e11,0\n2,1,1\n3,2,2", "1,0,0\n2,1,1\n3,1e11,2"])
def test_a_detection_too_far_to_be_tracked_is_named_by_its_line(call, rows):
    Path("z.csv").write_text(f"time,x,y\n{rows}\n")
    line = 2 if rows.startswith("1,1e11") else 4
    code, _, errors = call(*TRACK)
    assert code == 2 and errors.startswith(f"error: z.csv, line {line}, column x: 1e11 lies beyond +-1e+10")
    assert not Path("track.csv").exists()


@pytest.mark.parametrize(
    ("setting", "message"),
    [
        ("clutter_rate=text", "clutter_rate must be a number, got 'text'"),
        ("clutter_rate=[1]", "clutter_rate must be a number, got [1]"),
        ("detection_probability=None", "detection_probability must be a number, got None"),
        ("horizon=text", "horizon must be a whole number, got 'text'"),
    ],
)
def test_a_setting_that_is_no_number_is_refused_in_plain_words(call, setting, message):
    assert call("evaluate", TURNING, "--tracker", "pda", "--set", setting) == (2, "", f"error: {message}\n")


def test_tables_in_any_order_are_one_folder_and_one_question(call, monkeypatch):
    asked = []
    monkeypatch.setattr("gmr_gym.experiments.running.rerun", lambda *call: asked.append(call[3:]) or [])
    for tables in ((1, 2), (2, 1)):
        words = (word for table in tables for word in ("--table", table))
        assert call("reproduce", "dortenzio", *words, "--jobs", 1)[0] == 0
    (first, *one), (second, *other) = asked
    assert first == second and one == other and one[1].name == "table-1-table-2"


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_command_says_where_it_goes_on(call, monkeypatch, number):
    def interrupted(*_, **__):
        signal.raise_signal(number)

    monkeypatch.setattr("gmr_gym.experiments.sweeps.run", interrupted)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job has it ignored
    code, printed, errors = call(*EVALUATE, "mmg-5", "--out", "e")
    assert code == 130 and printed == ""
    assert errors == "stopped: no block of runs was finished\n"
    Path("e/blocks").mkdir(parents=True)
    Path(f"e/blocks/{'0' * 32}-0-1.npz").touch()
    code, printed, errors = call(*EVALUATE, "mmg-5", "--out", "e")
    assert code == 130 and printed == ""
    assert errors.startswith("stopped: finished blocks of runs are kept in e/blocks;")


def test_a_kernel_that_is_interrupted_while_it_is_called_stops_the_command_as_ctrl_c_does(call, monkeypatch):
    """A signal handled by Python inside numba's dispatcher comes out as a SystemError."""

    def stopped(*_, **__):
        raise SystemError("returned a result with an exception set") from KeyboardInterrupt()

    def broken(*_, **__):
        raise SystemError("of another cause")

    monkeypatch.setattr("gmr_gym.experiments.sweeps.run", stopped)
    code, _, errors = call(*EVALUATE, "mmg-5", "--out", "e")
    assert code == 130 and errors == "stopped: no block of runs was finished\n"
    monkeypatch.setattr("gmr_gym.experiments.sweeps.run", broken)
    monkeypatch.setattr(sys, "argv", [str(word) for word in ("gmr-gym", *EVALUATE, "mmg-5", "--out", "e")])
    with pytest.raises(SystemError, match="of another cause"):
        main()


@pytest.mark.parametrize(
    ("words", "lost"),
    [
        ((*TRACK, "--out", "./z.csv"), "z.csv"),
        (("record", TURNING, "--out", "z.csv", "--truth", "./z.csv"), "z.csv"),
        (("reduce", "z.csv", "--out", "./z.csv"), "z.csv"),
        (("evaluate", TURNING, "--tracker", "pda", "--out", "e", "--json", "e/runs.csv"), "e/runs.csv"),
    ],
    ids=["track over what it reads", "truth over detections", "mixture", "figures over runs"],
)
def test_no_command_writes_over_what_it_reads_or_writes_twice_to_one_file(call, words, lost):
    Path("z.csv").write_text("time,x,y\n1.0,0,0\n2.0,5,5\n3.0,7,7\n")
    code, printed, errors = call(*words)
    assert code == 2 and printed == ""
    assert errors == f"error: {lost} is named twice, and what it holds would be lost; choose another file\n"
    assert Path("z.csv").read_text().startswith("time,x,y\n1.0,0,0\n")


# what is asked, and where its results are

QUICK = "evaluate", TURNING, "--tracker", "pda", "--set", "horizon=3", "--jobs", 1


def test_two_evaluations_leave_their_own_results_and_share_their_runs(call):
    assert call(*QUICK, "--runs", 2)[0] == 0
    (first,) = set(Path("results/evaluate").iterdir()) - {Path("results/evaluate/blocks")}
    before = {file: file.read_bytes() for file in first.iterdir()}
    code, _, errors = call(*QUICK, "--tracker", "runnalls-2", "--runs", 2)
    assert code == 0 and f"{TURNING}: 2 of 4" in errors  # the runs of pda are there
    for words in (("--seed", 1), ("--set", "clutter_rate=7"), ("--tracker", "clairvoyant")):
        assert call(*QUICK, "--runs", 2, *words)[0] == 0
    folders = set(Path("results/evaluate").iterdir()) - {Path("results/evaluate/blocks")}
    assert len(folders) == 5 and {file: file.read_bytes() for file in first.iterdir()} == before
    assert call(*QUICK, "--runs", 2)[0] == 0  # asked again it is written again
    assert set(Path("results/evaluate").iterdir()) == folders | {Path("results/evaluate/blocks")}


def test_a_folder_with_the_results_of_another_call_is_refused_before_anything_is_run(call):
    assert call(*QUICK, "--runs", 2, "--out", "e")[0] == 0
    before = Path("e/evaluate.json").read_bytes()
    code, printed, errors = call(*QUICK, "--runs", 3, "--out", "e")
    assert (code, printed) == (2, "") and len(errors.splitlines()) == 1
    assert "e/evaluate.json has the results of another call (runs 2, asked 3); choose another" in errors
    assert Path("e/evaluate.json").read_bytes() == before
    assert call(*QUICK, "--runs", 2, "--out", "e")[0] == 0


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ('{"format": 7, "version": "9.1"}', "has format 7, left by 9.1, and this version reads format 1"),
        ('{"env": "x", "runs": 2}', "has format None, left by an earlier version"),
        ("[1", "is no record of results"),
        ("[1]", "is no record of results"),
    ],
)
def test_a_record_that_cannot_be_read_is_refused_by_name_and_stays(call, content, message):
    Path("e").mkdir()
    Path("e/evaluate.json").write_text(content)
    code, printed, errors = call(*QUICK, "--runs", 2, "--out", "e")
    assert (code, printed) == (2, "") and f"e/evaluate.json {message}" in errors
    assert errors.endswith("choose another folder with --out, or delete it\n") and "\n" not in errors[:-1]
    assert Path("e/evaluate.json").read_text() == content


def test_a_papers_results_are_named_by_what_was_asked_of_it(call):
    words = "reproduce", "zhang", "--table", "clear", "--jobs", 1
    for runs in (2, 3):
        assert call(*words, "--runs", runs)[0] == 0
    assert call(*words, "--runs", 2, "--seed", 4)[0] == 0
    root = Path("results/zhang")
    assert {folder.name for folder in root.iterdir()} == {
        "blocks", "table-clear-runs-2", "table-clear-runs-3", "table-clear-runs-2-seed-4"
    }  # fmt: skip
    assert json.loads((root / "table-clear-runs-3/zhang.json").read_text())["runs"] == 3
    code, printed, errors = call(*words, "--runs", 3, "--out", root / "table-clear-runs-2")
    assert (code, printed) == (2, "") and "(runs 2, asked 3)" in errors


def test_one_record_holds_all_that_the_screen_and_the_folder_have(call):
    spec = "runnalls-2:prune_weight=1e-4"
    code, printed, _ = call(*QUICK, "--tracker", spec, "--runs", 2, "--seed", 5, "--json", "r.json")
    record = json.loads(Path("r.json").read_text())
    assert code == 0 and record["version"] == version("gmr-gym") and record["level"] == 0.95
    assert record["settings"] == {"horizon": 3} and (record["runs"], record["seed"]) == (2, 5)
    assert record["trackers"] == {
        "pda": {"name": "pda", "parameters": {}},
        spec: {"name": "runnalls-2", "parameters": {"prune_weight": 1e-4}},
    }
    table, paired = record["tables"]
    assert [row["tracker"] for row in paired["rows"]] == [f"{spec} - pda"]
    metrics = {metric for part in (table, paired) for row in part["rows"] for metric in row["metrics"]}
    assert set(record["units"]) == metrics
    assert record["units"]["rmse_own"] == "m" and record["units"]["time_per_scan"] == "s"
    assert all(note in printed for note in record["notes"]) and len(record["notes"]) == 1
    own, common = "own: over the runs that a tracker kept", "common: over those that every tracker kept"
    assert f"RMSE: root mean square error; error: mean distance from the truth; {own}; {common}\n" in printed


def test_few_runs_are_said_to_be_too_few(call):
    said = "too few to judge"
    _, printed, _ = call(*QUICK, "--runs", 4)
    assert f"4 runs: {said}" in printed
    _, printed, _ = call(*QUICK, "--runs", FEWEST)
    assert said not in printed


def test_a_tracker_that_lost_every_run_is_named_and_the_others_are_compared(call):
    words = "evaluate", "gmr_gym/RecordedFlight-v0", "--runs", 3, "--jobs", 1
    code, printed, _ = call(*words, "--tracker", "pda", "--tracker", "clairvoyant", "--json", "r.json")
    assert code == 0 and "pda lost every run and has no errors: 'common' is over the runs that all" in printed
    pda, best = json.loads(Path("r.json").read_text())["tables"][0]["rows"]
    assert pda["metrics"]["track_loss"]["value"] == 1 and pda["metrics"]["error_common"]["value"] is None
    assert 0 < best["metrics"]["error_common"]["value"] < 30


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((*QUICK, "--set", "horizon=4"), "horizon is given twice, as 3 and as 4"),
        ((*QUICK, "--tracker", "pda"), "--tracker pda is given twice"),
        ((*QUICK, "--tracker", "mht:components=3,components=4"), "components is given twice, as 3 and as 4"),
        ((*QUICK, "--tracker", "runnalls-3:components=4"), "components is given twice, as 3 in the name and"),
        ((*QUICK, "--seed", 1, "--seed=2"), "--seed is given 2 times"),
        ((*QUICK, "--jobs", 2), "--jobs is given 2 times"),
        (("watch", JUMP, "--tracker", "imm", "--tracker", "imm:"), "--tracker imm: is given twice"),
        (("watch", JUMP, "--scans", 1, "--scans", 2), "--scans is given 2 times"),
        (("leaderboard", "--env", JUMP, "--env", JUMP), f"--env {JUMP} is given twice"),
        (("watch", JUMP, "--set", "case=1", "--set", "case=2"), "case is given twice, as 1 and as 2"),
        (("record", JUMP, "--out", "a", "--out", "b", "--out", "c"), "--out is given 3 times"),
        (("reproduce", "zhang", "--table", 1, "--table", 1), "--table 1 is given twice"),
        ((*TRACK, "--speed", 1, "--speed", 2), "--speed is given 2 times"),
        (("merge", "a", "--into", "b", "--into", "c"), "--into is given 2 times"),
    ],
)
def test_what_is_given_twice_is_refused(call, words, message):
    code, printed, errors = call(*words)
    assert (code, printed) == (2, "") and errors.startswith("error: ") and message in errors
    assert len(errors.splitlines()) == 1 and not list(Path().iterdir())


@pytest.mark.parametrize("encoding", ["ascii", "cp1251", "utf-8"])
def test_a_console_of_any_encoding_gets_what_it_can_show_and_the_files_are_there(tmp_path, encoding):
    def run_command(*words):
        environment = os.environ | {"PYTHONIOENCODING": encoding}
        program = "import sys; from gmr_gym.cli import main; sys.argv[0] = 'gmr-gym'; main()"
        done = subprocess.run(
            [sys.executable, "-c", program, *map(str, words)],
            cwd=tmp_path, env=environment, capture_output=True,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout.decode(encoding)

    shown = run_command(*QUICK, "--runs", 2, "--out", "é²")
    assert ("gate area, m²" if encoding == "utf-8" else "gate area, m^2") in shown
    rows = [line for line in shown.splitlines() if line.startswith(("|", "+"))]
    assert len({len(row) for row in rows}) == 1
    assert {file.name for file in (tmp_path / "é²").iterdir()} == {
        "blocks", "runs.csv", "evaluate.json", "report.html",
    }  # fmt: skip
    if encoding == "cp1251":
        run_command("reproduce", "zhang", "--table", "clear", "--runs", 1, "--jobs", 1, "--out", "r")
        assert (tmp_path / "r/zhang.json").exists() and (tmp_path / "r/zhang.csv").exists()
        run_command("list")
