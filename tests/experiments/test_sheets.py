"""Tables as a reader meets them: whole at any width of the screen."""

import io

import pytest
from rich.console import Console

from gmr_gym.evaluation.summary import Estimate
from gmr_gym.experiments.figures import METRICS, legend
from gmr_gym.experiments.sheets import claims_table, comparison, figures_table, notes, plain, shown

NAMES = ["runnalls-30", "mmg-15:reduction=average-isd", "clairvoyant"]
METRIC_NAMES = ["track_loss", "rmse_own", "velocity_rmse_own", "gate_area", "localisation", "time_per_scan"]
ROWS = {
    name: {metric: Estimate(12345.6 * (i + 1), 11111.1, 23456.7) for metric in METRIC_NAMES}
    for i, name in enumerate(NAMES)
}
CLAIMS = [
    {
        "table": "1-quiet", "runs": "kept 812",
        "claim": "MMG has the lowest position RMSE for most of the time",
        "measure": "better rival's average less MMG's, m/s", "value": -0.0123, "low": -0.0456, "high": 0.0789,
        "threshold": 0.5, "verdict": "too few runs",
    }
]  # fmt: skip


def printed(what, width, terminal=True):
    """The lines that a screen of so many characters shows."""
    screen = Console(width=width, file=io.StringIO(), force_terminal=terminal, color_system=None)
    screen.print(what, highlight=False, markup=False)
    return [line.rstrip() for line in screen.file.getvalue().splitlines()]


@pytest.mark.parametrize("terminal", [True, False])
@pytest.mark.parametrize("width", [40, 80, 120, 240])
def test_no_figure_and_no_interval_is_cut_at_any_width(width, terminal):
    lines = printed(figures_table("a title", ROWS), width, terminal)
    assert max(map(len, lines)) <= width and "…" not in "".join(lines)
    text = "\n".join(lines)
    for name, row in ROWS.items():
        for metric, figure in row.items():
            assert text.count(shown(metric, figure)) >= 1, (name, metric)
    for metric in METRIC_NAMES:
        for word in METRICS[metric].heading.split():
            assert word in text


def test_a_screen_that_is_wide_enough_has_one_table_and_one_of_80_has_several_that_name_the_rows_again():
    wide, narrow = ("\n".join(printed(figures_table("a title", ROWS), width)) for width in (240, 80))
    assert wide.count("clairvoyant") == 1 and narrow.count("clairvoyant") == 3
    assert wide.count("a title") == narrow.count("a title") == 1


@pytest.mark.parametrize(("trackers", "tables", "turned"), [(2, 1, True), (4, 2, True), (12, 3, False)])
def test_a_table_is_turned_where_it_takes_fewer_tables_then(trackers, tables, turned):
    row = dict.fromkeys(METRIC_NAMES, Estimate(0.01234, 0.01123, 0.02346))
    rows = {f"runnalls-{i}": row for i in range(trackers)}
    lines = printed(figures_table("", rows), 80, terminal=False)
    heads = [line for line in lines if line.startswith("|  ")]
    assert len(heads) == tables and all(("runnalls" in head) == turned for head in heads)


def test_the_name_of_a_tracker_is_broken_between_its_parameters_where_it_is_too_long():
    spec = "mmg-15:reduction=average-isd,prune_weight=0.001,max_hypotheses=200"
    text = "\n".join(printed(figures_table("", {name: ROWS["clairvoyant"] for name in ("pda", spec)}), 60))
    assert all(f" {part}" in text for part in spec.replace(":", ": ").replace(",", ", ").split())


def test_a_printed_figure_and_its_verdict_stay_with_ours():
    cell = {"value": 0.123, "low": 0.1, "high": 0.15, "paper": 0.458, "verdict": "too few runs"}
    record = {"rows": [{"tracker": name, "metrics": dict.fromkeys(METRIC_NAMES, cell)} for name in NAMES]}
    text = "\n".join(printed(comparison("a title", record, METRIC_NAMES), 80))
    assert text.count("paper 45.8 too few runs") == 3 and text.count("12.3 [10, 15]") == 3


@pytest.mark.parametrize("width", [80, 240])
def test_a_sentence_its_number_and_its_verdict_are_read_at_any_width(width):
    text = " ".join(" ".join(printed(claims_table(CLAIMS), width)).split())
    for words in ("MMG has the lowest position RMSE for most of the time", "-0.0123 [-0.0456, 0.0789]"):
        assert words in text
    assert "too few runs" in text and "1-quiet" in text and "kept 812" in text
    assert text.startswith("what the paper says") and "[italic]" not in text


def test_plain_letters_are_those_of_every_console():
    assert plain("m² × 3–4°, é Σ") == "m^2 x 3-4 degrees, e ?"


def test_notes_are_of_lost_runs_and_of_few():
    lost, kept = {"track_loss": Estimate(1.0)}, {"track_loss": Estimate(0.5)}
    assert notes({"a": kept, "b": kept}, 100) == []
    (said,) = notes({"a": lost, "b": kept, "c": lost}, 100)
    assert said.startswith("a, c lost every run")
    assert notes({"a": lost}, 100) == ["every run was lost by every tracker: there is no error of a run kept"]
    assert notes({"a": {"ospa": Estimate(1.0)}}, 1)[0].startswith("1 run: too few to judge")


def test_a_legend_has_the_words_that_are_in_the_headings_and_no_other():
    assert legend(["track_loss", "components"]) == []
    assert legend(["rmse_own", "track_loss"]) == [
        "RMSE: root mean square error; own: over the runs that a tracker kept"
    ]
    assert legend(["error_common"])[0].startswith("error: mean distance from the truth; common: over those")
