"""What `evaluate` prints in each format, and records that can be read without the command that left them."""

import csv
import io
import json
import re
import shlex
import sys
from pathlib import Path

import pytest

from gmr_gym.catalogue import GROUP, MULTI_TARGET_GROUP, tracker_entry_points
from gmr_gym.cli import main
from gmr_gym.envs.lookup import scenario_of, tracker_of
from gmr_gym.evaluation.montecarlo import run
from gmr_gym.evaluation.multi_target_summary import multi_target_summary
from gmr_gym.evaluation.summary import summary
from gmr_gym.experiments import figures
from gmr_gym.experiments.figures import LEGEND, METRICS
from gmr_gym.experiments.formats import latex, markdown
from gmr_gym.experiments.records import text_of
from gmr_gym.experiments.sheets import Sheet, figure_of, shown
from gmr_gym.experiments.specs import complete
from gmr_gym.filters.registry import FORMER_PARAMETERS

TURNING, MANY = "gmr_gym/TurningTarget-v0", "gmr_gym/UnknownClutter-v0"
SPEC = "runnalls-2:prune_weight=1e-4"
QUICK = (
    "evaluate", TURNING, "--tracker", "pda", "--tracker", SPEC, "--set", "horizon=3", "--runs", 2, "--jobs", 1
)  # fmt: skip


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


def the_record():
    (file,) = Path("results").glob("evaluate/*/evaluate.json")
    return json.loads(file.read_text())


def figures_in(record):
    """(table, tracker, metric) and figure of all that a record holds."""
    return {
        (table["name"], row["tracker"], metric): cell
        for table in record["tables"]
        for row in table["rows"]
        for metric, cell in row["metrics"].items()
    }


def test_json_is_the_record_to_the_last_byte_and_nothing_else_is_printed(call):
    code, printed, errors = call(*QUICK, "--format", "json")
    (file,) = Path("results").glob("evaluate/*/evaluate.json")
    assert code == 0 and printed == file.read_text()
    assert "too few to judge" in errors and "written to" in errors


def test_csv_has_every_figure_with_its_interval_and_unit_and_of_chosen_metrics_those(call):
    code, printed, _ = call(*QUICK, "--format", "csv")
    rows, wanted = list(csv.DictReader(io.StringIO(printed))), figures_in(the_record())
    assert code == 0 and len(rows) == len(wanted)
    for row in rows:
        cell = wanted[row["table"], row["tracker"], row["metric"]]
        for key in ("value", "low", "high"):
            assert row[key] == ("" if cell[key] is None else repr(cell[key]))
        assert row["unit"] == METRICS[row["metric"]].unit
    _, printed, _ = call(*QUICK, "--format", "csv", "--metric", "nci_own", "--metric", "track_loss")
    assert {row["metric"] for row in csv.DictReader(io.StringIO(printed))} == {"nci_own", "track_loss"}


def test_markdown_has_the_tables_of_a_screen_and_remarks_apart(call):
    code, printed, errors = call(*QUICK, "--format", "markdown")
    tables = [block.splitlines() for block in printed.split("\n\n") if block.startswith("|")]
    assert code == 0 and [len(table) for table in tables] == [4, 3]
    assert all(len({line.count("|") for line in table}) == 1 for table in tables)
    header, _, *rows = ([cell.strip() for cell in line.split("|")[1:-1]] for line in tables[0])
    assert header[1] == "lost, %" and [row[0] for row in rows] == ["pda", SPEC]
    assert rows[0][1] == "0 [0, 65.8]" and LEGEND["RMSE"] in errors and LEGEND["RMSE"] not in printed


def sound(text):
    """Rows of a LaTeX table, of which each has as many cells as there are columns."""
    columns = re.search(r"\\begin\{tabular\}\{(l?r*)\}", text)[1]
    body = [line for line in text.splitlines() if line.endswith(r"\\")]
    bare = re.sub(r"\\[{}$&#_%]", "", text.partition("\n")[2])
    assert bare.count("{") == bare.count("}") and bare.count("$") % 2 == 0
    assert not re.search(r"[#_%^~]", bare) and not re.search(r"[²³×]", bare)
    assert all(line.replace(r"\&", "").count("&") == len(columns) - 1 for line in body)
    rules = re.findall(r"^\\(toprule|midrule|bottomrule)$", text, re.M)
    assert rules == ["toprule", "midrule", "bottomrule"] and text.rstrip().endswith(r"\end{tabular}")
    return body


def test_latex_has_the_tables_of_a_screen_with_names_that_it_can_set(call):
    code, printed, errors = call(*QUICK, "--format", "latex")
    tables = re.split(r"(?m)^(?=% )", printed)[1:]
    assert code == 0 and len(tables) == 2 and "written to" in errors
    rows = sound(tables[0])
    assert r"runnalls-2:prune\_weight=1e-4" in printed and r"lost, \% & 0 [0, 65.8] & 0 [0, 65.8] \\" in rows
    assert r" & runnalls-2:prune\_weight=1e-4 $-$ pda \\" in tables[1] and "& 0 [$-$65.8, 65.8]" in tables[1]
    sound(tables[1])


def test_what_latex_and_markdown_take_for_themselves_is_escaped():
    sheet = Sheet("50 %", ["", "a_b & c", "{x}$^~#\\"], [["[1, 2]", "1\npaper 2", "m²|-3<4"], ["-"] * 3])
    head, row, _ = sound(latex(sheet))
    assert head == r" & a\_b \& c & \{x\}\$\textasciicircum{}\textasciitilde{}\#\textbackslash{} \\"
    assert row == r"{}[1, 2] & 1; paper 2 & m\textsuperscript{2}\textbar{}$-$3\textless{}4 \\"
    assert markdown(sheet).splitlines()[-2] == r"| [1, 2] | 1<br>paper 2 | m²\|-3<4 |"


def test_chosen_metrics_are_those_that_a_table_shows_and_it_says_where_the_others_are(call):
    _, printed, _ = call(*QUICK)
    assert "evaluate.json also has rmse_common, error_own, nci_own, inclination_own;" in printed
    code, printed, _ = call(*QUICK, "--metric", "nci_own", "--metric", "components")
    assert code == 0 and re.search(r"\| NCI, dB +\| components +\|\n", printed) and "lost, %" not in printed
    assert "paired differences" not in printed and len(the_record()["tables"]) == 2


def test_a_paper_is_printed_in_a_format_as_well(call):
    words = "reproduce", "dortenzio", "--table", 1, "--runs", 2, "--jobs", 1, "--out", "r"
    code, printed, errors = call(*words, "--format", "csv")
    assert code == 0 and printed == Path("r/dortenzio.csv").read_text() and "are in r" in errors
    assert {row["paper"] for row in csv.DictReader(io.StringIO(printed))} > {"", "0.458"}
    _, printed, _ = call(*words, "--format", "latex")
    assert "; paper 45.8 too few runs &" in printed
    sound(printed)
    again = json.loads(Path("r/dortenzio.json").read_text())["command"]
    assert again == "gmr-gym reproduce dortenzio --table 1 --runs 2 --seed 0"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ("--metric", "track_los"),
            "unknown metric 'track_los'; did you mean 'track_loss'? (there are ",
        ),
        (("--metric", "nci_own", "--metric", "nci_own"), "--metric nci_own is given twice"),
        (("--metric", "gospa"), "unknown metric 'gospa' (there are track_loss, rmse_own,"),
        (("--format", "excel"), "unknown format 'excel'; choose one of table, markdown, csv, latex, json"),
    ],
)
def test_a_metric_or_format_that_there_is_not_is_one_line(call, words, message):
    code, printed, errors = call(*QUICK, *words)
    assert (code, printed) == (2, "") and len(errors.splitlines()) == 1 and message in errors
    assert not Path("results").exists()


def test_the_metrics_that_can_be_chosen_are_those_of_the_summaries():
    for env_id, spec, summarise, of in (
        (TURNING, "pda", summary, figures.ONE_TARGET),
        (MANY, "gm-phd", multi_target_summary, figures.MULTI_TARGET),
    ):
        scenario = scenario_of(env_id, {"horizon": 2})
        (row,) = summarise(scenario, run(scenario, {spec: tracker_of(spec, scenario)}, 1)).values()
        assert {*row} == {*of.shown, *of.left} and not {*of.shown} & {*of.left} and {*of.swept} <= {*row}


def test_a_record_says_by_what_and_how_it_is_made_again(call):
    _, printed, _ = call(*QUICK, "--format", "json", "--seed", 7)
    record = json.loads(printed)
    assert {"python", "gmr-gym", "numpy", "numba"} <= record["versions"].keys()
    assert record["parameters"] == {
        "pda": {}, SPEC: {"components": 2, "prune_weight": 1e-4, "prune_density": 1e-10}
    }  # fmt: skip
    program, *words = shlex.split(record["command"])
    code, again, _ = call(*words, "--jobs", 1, "--format", "json")
    assert program == "gmr-gym" and code == 0 and again == printed  # times too: the runs are there


def test_a_record_has_error_and_loss_scan_by_scan(call):
    words = "evaluate", TURNING, "--tracker", "nearest-neighbour", "--set", "horizon=60"
    _, printed, _ = call(*words, "--runs", 4, "--jobs", 1, "--format", "json")
    record = json.loads(printed)
    by_scan, cells = record["by_scan"]["nearest-neighbour"], figures_in(record)
    metrics = {metric: cell["value"] for (_, _, metric), cell in cells.items()}
    assert {name: len(values) for name, values in by_scan.items()} == dict.fromkeys(by_scan, 60)
    assert by_scan["track_loss"][-1] == metrics["track_loss"] > 0 == by_scan["track_loss"][0]
    assert by_scan["track_loss"] == sorted(by_scan["track_loss"])
    for metric in ("error_common", "components"):
        assert sum(by_scan[metric]) / 60 == pytest.approx(metrics[metric], rel=1e-12)


def test_numbers_of_a_list_stand_in_one_line_and_text_stays_as_it_is():
    record = {"a": [1, 2.5, None, -1e-9], "b": ["x", [1]], "c": "[\n1,  2\n]", "d": []}
    assert '"a": [1, 2.5, null, -1e-09]' in text_of(record)
    assert json.loads(text_of(record)) == record


def test_all_parameters_of_a_tracker_are_known_by_their_present_names():
    for group, env_id in ((GROUP, "gmr_gym/JumpMarkov-v0"), (MULTI_TARGET_GROUP, MANY)):
        scenario = scenario_of(env_id, {})
        for name in tracker_entry_points(group):
            assert "" not in complete(name, scenario)
        assert complete(name, scenario)
    former, (present, *_) = next(iter(FORMER_PARAMETERS.items()))
    assert complete(f"imm-pda:{former}=5", scenario_of(TURNING, {})) == {present: 5, "mixing": "augmented"}


@pytest.mark.parametrize(
    ("env_id", "trackers"),
    [
        (TURNING, ("pda", "nearest-neighbour", "runnalls-30:prune_weight=1e-4", "adaptive-30")),
        (
            "gmr_gym/AirborneRadar-v0",
            ("imm-pda", *(f"imm-pda:give_up_ratio={ratio}" for ratio in (9, 14, 19))),
        ),
        (MANY, ("gm-phd", "learning-pmb", "pmb", "gm-phd:components=20")),
    ],
    ids=["in the plane", "of a radar", "many targets"],
)
def test_on_80_columns_every_figure_of_a_table_is_read(call, monkeypatch, env_id, trackers):
    monkeypatch.setenv("COLUMNS", "80")
    words = "evaluate", env_id, "--set", "horizon=3", "--runs", 2, "--jobs", 1
    for count in (4, 3, 2):  # the runs are there after the first
        chosen = [word for spec in trackers[:count] for word in ("--tracker", spec)]
        code, printed, _ = call(*words, *chosen, "--json", "r.json")
        assert code == 0 and "…" not in printed and max(map(len, printed.splitlines())) <= 80
        of = figures.MULTI_TARGET if env_id == MANY else figures.ONE_TARGET
        for (_, _, metric), cell in figures_in(json.loads(Path("r.json").read_text())).items():
            assert metric in of.left or shown(metric, figure_of(cell)) in printed
