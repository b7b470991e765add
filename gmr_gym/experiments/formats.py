"""Tables and records in the formats that other programs read."""

import csv
import io
import json
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from gmr_gym.experiments.figures import METRICS
from gmr_gym.experiments.records import text_of
from gmr_gym.experiments.screen import console
from gmr_gym.experiments.sheets import Sayings, Sheet

FIGURE = ("value", "low", "high")
LATEX = {
    **{letter: rf"\{letter}" for letter in "{}$&#_%"}, "\\": r"\textbackslash{}", "^": r"\textasciicircum{}",
    "~": r"\textasciitilde{}", "²": r"\textsuperscript{2}", "³": r"\textsuperscript{3}", "×": r"$\times$",
    "<": r"\textless{}", ">": r"\textgreater{}", "|": r"\textbar{}", "°": r"$^\circ$",
}  # fmt: skip


def write_out(lines: Iterable[Any], form: str, file: Path, metrics: Sequence[str] = ()) -> None:
    """Prints what a command gives, tables and remarks, in a format: but for a table the remarks go to the
    error stream. CSV and JSON are of the record in the file, CSV of these metrics, or of all."""
    if form == "table":
        screen = console()
        for line in lines:
            screen.print(line, highlight=False, markup=False)
        return
    write = {"markdown": markdown, "latex": latex}.get(form)
    for line in lines:
        if isinstance(line, str):
            print(line, file=sys.stderr)
        elif write:
            print(write(line.sheet if isinstance(line, Sayings) else line))
    if not write:
        record = json.loads(file.read_text(encoding="utf-8"))
        sys.stdout.write(text_of(record) if form == "json" else _csv(record, metrics))


def markdown(sheet: Sheet) -> str:
    """A table of Markdown under its title."""
    return f"**{_piped(sheet.title)}**\n\n{piped(sheet.headings, sheet.rows)}\n"


def piped(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of Markdown."""
    lines = [headings, ["---"] * len(headings), *rows]
    return "\n".join(f"| {' | '.join(map(_piped, line))} |" for line in lines)


def _piped(cell: str) -> str:
    return cell.replace("|", r"\|").replace("\n", "<br>")


def latex(sheet: Sheet) -> str:
    """A table of LaTeX for booktabs, turned where it is narrower then; its title is a comment."""
    sheet = min(sheet, sheet.turned(), key=lambda one: len(one.headings))
    head, *rows = [" & ".join(map(_tex, line)) + r" \\" for line in (sheet.headings, *sheet.rows)]
    return "\n".join([
        f"% {sheet.title}; needs \\usepackage{{booktabs}}",
        rf"\begin{{tabular}}{{l{'r' * (len(sheet.headings) - 1)}}}",
        r"\toprule", head, r"\midrule", *rows, r"\bottomrule", r"\end{tabular}", "",
    ])  # fmt: skip


def _tex(cell: str) -> str:
    escaped = "".join(LATEX.get(letter, letter) for letter in cell.replace("\n", "; "))
    if escaped.startswith("["):  # else an argument of the end of the row before
        escaped = "{}" + escaped
    return re.sub(r"(?<![\w-])-(?=[\d ])", "$-$", escaped)


def rows_of(record: dict[str, Any], metrics: Sequence[str] = ()) -> Iterator[list[Any]]:
    """A header, then a row for each figure of a record: its table, the settings that the record has several
    values of, the tracker, the metric with its interval and its unit; of a paper also the printed figure."""
    axes = [*record.get("axes", ())]
    further = ["paper", "verdict"] if "paper" in record else []
    yield ["table", *axes, "tracker", "metric", *FIGURE, "unit", *further]
    for table in record["tables"]:
        before = [table["name"], *(table["settings"][axis] for axis in axes)]
        for row in table["rows"]:
            for metric, cell in row["metrics"].items():
                if not metrics or metric in metrics:
                    unit = METRICS[metric].unit if metric in METRICS else ""
                    figure = [cell.get(key) for key in FIGURE]
                    yield [*before, row["tracker"], metric, *figure, unit, *map(cell.get, further)]


def _csv(record: dict[str, Any], metrics: Sequence[str]) -> str:
    stream = io.StringIO()
    csv.writer(stream, lineterminator="\n").writerows(rows_of(record, metrics))
    return stream.getvalue()
