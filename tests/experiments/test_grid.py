"""`gmr-gym sweep`: a grid of settings as it is typed, its runs shared, cut and resumed, what it leaves."""

import csv
import io
import json
import signal
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from gmr_gym.cli import main
from gmr_gym.evaluation import blocks
from gmr_gym.experiments.drawings import over_settings
from gmr_gym.experiments.grid import MOST, grid_of

TURNING, MANY = "gmr_gym/TurningTarget-v0", "gmr_gym/UnknownClutter-v0"
GRID = (
    "sweep", TURNING, "--tracker", "pda", "--tracker", "nearest-neighbour", "--set", "horizon=5", "--jobs", 1
)  # fmt: skip
CLUTTER = "--set", "clutter_rate=20,100"


@pytest.fixture
def call(monkeypatch, capsys, tmp_path):
    """The command line in a folder of its own: (exit code, what it printed, its errors)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("COLUMNS", raising=False)

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["gmr-gym", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
        return ended.value.code, *capsys.readouterr()

    return call


def without_times(folder):
    """What the files of a sweep hold, but for times, which are the clock's."""
    record = json.loads((folder / "sweep.json").read_text())
    for table in record["tables"]:
        for row in table["rows"]:
            row["metrics"].pop("time_per_scan", None)
    lines = (folder / "sweep.csv").read_text().splitlines()
    return (
        record,
        [line for line in lines if "time_per_scan" not in line],
        (folder / "sweep-runs.csv").read_bytes(),
    )


@pytest.mark.parametrize(
    ("texts", "settings", "axes"),
    [
        (["a=1,2"], {}, {"a": [1, 2]}),
        (["b=400,50", "a=0.5"], {"a": 0.5}, {"b": [50, 400]}),
        (["b=1,2", "a=x, y"], {}, {"a": ["x", "y"], "b": [1, 2]}),
        (["case=stress,1"], {}, {"case": ["stress", 1]}),
        (["window=(300, 300),(500, 500)"], {}, {"window": [(300, 300), (500, 500)]}),
        (["a=[[1, (2, 3)], 4]", "b=1,2"], {"a": [[1, (2, 3)], 4]}, {"b": [1, 2]}),
    ],
)
def test_commas_outside_of_brackets_part_values(texts, settings, axes):
    assert grid_of(texts, False) == grid_of(texts[::-1], False) == (settings, axes)


def test_a_grid_has_a_cell_for_every_combination():
    assert [*grid_of(["b=2,1", "a=x,y"], False).cells()] == ["a=x, b=1", "a=x, b=2", "a=y, b=1", "a=y, b=2"]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["clutter_rate=50,,100"], "clutter_rate has an empty value; expected clutter_rate=value,value, got"),
        (["clutter_rate="], "clutter_rate has an empty value; expected clutter_rate=value,value, got"),
        (["clutter_rate=50,100,50.0"], "clutter_rate has the value 50.0 twice"),
        (["clutter_rate=50,many"], "clutter_rate must be a number, got 'many'"),
        (["clutter_rate=50,-1"], "clutter must be between 0 and a million false alarms per scan, got -1"),
        (["cluter_rate=50,100"], "unknown argument 'cluter_rate'; did you mean 'clutter_rate'?"),
        (["clutter_rate"], "expected key=value or key=value,value, got 'clutter_rate'"),
        (["clutter_rate=50"], "no setting has several values, as in --set clutter_rate=50,100,200"),
        (["clutter_rate=50,60", "clutter_rate=70"], "clutter_rate is given twice; several values of it have"),
        (["box=[1,2", "clutter_rate=1,2"], "box cannot be read as a list"),
        (
            [f"clutter_rate={','.join(map(str, range(1, 101)))}", "horizon=1,2,3,4,5,6,7,8,9,10,11"],
            f"the grid has 1100 settings, more than {MOST}; say --yes to run it",
        ),
    ],
)
def test_a_grid_that_is_wrong_is_one_line(call, words, message):
    code, printed, errors = call(
        "sweep", TURNING, "--tracker", "pda", *(word for text in words for word in ("--set", text))
    )
    assert (code, printed) == (2, "") and len(errors.splitlines()) == 1 and message in errors
    assert not list(Path().iterdir())


def test_a_drawing_that_would_be_too_wide_is_refused_before_anything_is_run(call):
    words = "--set", "horizon=1,2,3,4,5,6,7,8,9", "--set", f"clutter_rate={','.join(map(str, range(10)))}"
    code, printed, errors = call("sweep", TURNING, "--tracker", "pda", *words, "--plot")
    assert (code, printed) == (2, "") and not list(Path().iterdir())
    assert errors == "error: --plot has room for 8 panels beside one another, and the grid has 9\n"


def test_a_grid_of_any_size_is_run_if_one_says_so():
    texts = [f"a={','.join(map(str, range(MOST + 1)))}"]
    assert len(grid_of(texts, True).cells()) == MOST + 1


def test_every_setting_is_run_as_evaluate_runs_it_and_finds_what_that_has_run(call):
    words = [word for word in GRID if word != "sweep"]
    assert call("evaluate", *words, "--runs", 3, "--set", "clutter_rate=100", "--json", "e.json")[0] == 0
    code, printed, errors = call(*GRID, *CLUTTER, "--runs", 3, "--format", "json")
    assert code == 0 and errors.startswith("2 settings x 2 trackers x 3 runs: 12 in all\n")
    assert f"{TURNING}: 6 of 12" in errors and f"{TURNING}: 9 of 12" not in errors
    record, alone = json.loads(printed), json.loads(Path("e.json").read_text())
    assert [table["name"] for table in record["tables"]] == [
        f"clutter_rate={cell}{paired}" for cell in (20, 100) for paired in ("", ", paired differences")
    ]
    for mine, theirs in zip(record["tables"][2:], alone["tables"], strict=True):
        assert mine["rows"] == theirs["rows"] and mine["settings"] == theirs["settings"]  # times too
    assert record["settings"] == {"horizon": 5} and record["axes"] == {"clutter_rate": [20, 100]}
    assert record["notes"] == alone["notes"] and errors.count("too few to judge") == 1
    (folder,) = Path("results/sweep").iterdir()
    assert (folder / "sweep.json").read_text() == printed
    rows = list(csv.DictReader(io.StringIO((folder / "sweep.csv").read_text())))
    figures = {(row["clutter_rate"], row["table"], row["tracker"], row["metric"]): row for row in rows}
    assert len(figures) == len(rows) and {row["clutter_rate"] for row in rows} == {"20", "100"}
    cell = record["tables"][2]["rows"][1]["metrics"]["components"]
    assert figures["100", "clutter_rate=100", "nearest-neighbour", "components"]["high"] == repr(cell["high"])


def test_the_order_of_settings_and_values_is_not_a_question(call):
    two = "--set", "detection_probability=0.9,0.5", "--runs", 2
    assert call(*GRID, *CLUTTER, *two)[0] == 0
    (folder,) = Path("results/sweep").iterdir()
    before = without_times(folder)
    code, _, errors = call(*GRID, *two, "--set", "clutter_rate=100,20")
    assert (
        code == 0 and f"{TURNING}: 0 of 16" not in errors and [*Path("results/sweep").iterdir()] == [folder]
    )
    after = without_times(folder)
    assert {**before[0], "command": ""} == {**after[0], "command": ""} and before[1:] == after[1:]
    assert call(*GRID, *two, "--set", "clutter_rate=20", "--out", folder)[0] == 2  # another question


def test_a_table_of_each_metric_has_a_row_for_each_setting(call):
    code, printed, _ = call(*GRID, *CLUTTER, "--runs", 2, "--metric", "gate_area", "--format", "markdown")
    title, _, header, _, *rows = printed.strip().splitlines()
    cells = [[cell.strip() for cell in row.split("|")[1:-1]] for row in (header, *rows)]
    assert code == 0 and title == "**gate area, m² (volume, m³)**"
    assert cells[0] == ["clutter_rate", "pda", "nearest-neighbour"] and [row[0] for row in cells[1:]] == [
        "20",
        "100",
    ]


def test_shards_merged_are_what_the_unsharded_sweep_is(call):
    words = (*GRID, *CLUTTER, "--runs", 21)
    assert call(*words, "--out", "whole")[0] == 0
    for i in (1, 2):
        code, printed, _ = call(*words, "--shard", f"{i}/2", "--out", f"part{i}")
        assert code == 0 and f"of 8 blocks of runs are in part{i}/blocks" in printed
        assert [file.name for file in Path(f"part{i}").iterdir()] == ["blocks"]
    assert call("merge", "part1", "part2", "--into", "all")[0] == 0
    code, _, errors = call(*words, "--out", "all")
    assert code == 0 and errors.splitlines()[1:] == [f"{TURNING}: 42 of 84", f"{TURNING}: 84 of 84"]
    assert without_times(Path("all")) == without_times(Path("whole"))


def test_a_sweep_that_is_killed_goes_on_and_leaves_what_an_unbroken_one_does(call, monkeypatch):
    words = (*GRID, *CLUTTER, "--runs", 21)

    def save_and_be_killed(*arguments):
        save(*arguments)
        if len(list(Path("killed").glob("blocks/*.npz"))) == 5:  # in the second setting
            signal.raise_signal(signal.SIGTERM)

    with monkeypatch.context() as patch:
        save = blocks.save
        patch.setattr(blocks, "save", save_and_be_killed)
        code, printed, errors = call(*words, "--out", "killed")
    assert (code, printed) == (130, "")
    assert "finished blocks of runs are kept in killed/blocks; the same command goes on there" in errors
    assert [file.name for file in Path("killed").iterdir()] == ["blocks"]
    code, _, errors = call(*words, "--out", "killed")
    assert code == 0 and f"{TURNING}: 42 of 84" in errors and f"{TURNING}: 0 of 84" not in errors
    assert call(*words, "--out", "whole")[0] == 0
    assert without_times(Path("killed")) == without_times(Path("whole"))


def test_curves_of_many_targets_are_drawn_the_same_again(call):
    words = "sweep", MANY, "--tracker", "gm-phd", "--set", "horizon=2", "--set", "told=uniform,true"
    code, printed, _ = call(*words, "--runs", 2, "--jobs", 1, "--plot", "--out", "s")
    assert code == 0 and "GOSPA, m" in printed
    assert {file.name for file in Path("s").iterdir()} == {
        "blocks", "sweep-runs.csv", "sweep.csv", "sweep.json", "sweep.png", "sweep.svg"
    }  # fmt: skip
    with Image.open("s/sweep.png") as image:
        assert min(image.size) > 400
    first = Path("s/sweep.svg").read_bytes()
    assert call(*words, "--runs", 2, "--jobs", 1, "--plot", "--out", "s")[0] == 0
    assert Path("s/sweep.svg").read_bytes() == first


def drawn(axes, metrics=("track_loss", "time_per_scan")):
    """The panels of two trackers over a grid: the value of a figure is the least of the settings'."""
    grid = grid_of([f"{axis}={','.join(map(str, values))}" for axis, values in axes.items()], True)
    cells = {}
    for name, cell in grid.cells().items():
        row = {metric: {"value": float(min(cell.values())), "low": None, "high": 2.0} for metric in metrics}
        cells[name] = {"a": row, "b": row}
    return over_settings(cells, axes, metrics).axes


def test_a_curve_goes_through_its_figures_over_a_logarithm_where_they_span_a_decade():
    near, far = drawn({"rate": [1, 2, 10]}), drawn({"rate": [1, 2, 20]})
    assert [panel.get_xscale() for panel in (*near, *far)] == ["linear"] * 2 + ["log"] * 2
    assert [panel.get_yscale() for panel in (near[1], far[1])] == ["linear", "log"]
    (line, _), (_, in_ms) = (panel.lines for panel in far)
    np.testing.assert_array_equal(line.get_xydata(), [(1, 100), (2, 200), (20, 2000)])  # per cent
    np.testing.assert_array_equal(in_ms.get_ydata(), [1e3, 2e3, 2e4])
    assert [tick.get_text() for tick in far[1].get_xticklabels()] == ["1", "2", "20"]
    assert [panel.get_ylabel() for panel in far] == ["lost, %", "time a scan, ms"]


@pytest.mark.parametrize(("count", "columns"), [(1, 1), (2, 2), (3, 1), (4, 2)])
def test_no_panel_is_left_empty(count, columns):
    metrics = ("track_loss", "time_per_scan", "components", "gate_area")[:count]
    panels = drawn({"rate": [1, 2]}, metrics)
    assert len(panels) == count and all(len(panel.lines) == 2 for panel in panels)
    assert [panel.get_xlabel() for panel in panels] == [""] * (count - columns) + ["rate"] * columns


def test_of_two_settings_that_with_more_values_is_drawn_along_and_the_other_is_a_panel_each():
    panels = drawn({"case": [1, 2], "rate": [1, 2, 3]})
    assert len(panels) == 4 and panels[0].get_ylim() == panels[1].get_ylim()
    assert [panel.get_title() for panel in panels] == ["case=1", "case=2", "", ""]
    assert [panel.get_xlabel() for panel in panels] == ["", "", "rate", "rate"]
    assert panels[1].lines[0].get_ydata().tolist() == [100, 200, 200]  # per cent
