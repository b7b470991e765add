"""Figures as tables on a screen of any width, and what is to be said of them."""

import re
import unicodedata
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from rich import box
from rich.console import Console, ConsoleOptions
from rich.padding import Padding
from rich.table import Table as Grid
from rich.text import Text

from gmr_gym.evaluation.summary import FEWEST, Estimate
from gmr_gym.experiments.figures import METRICS, heading

RAISED = str.maketrans({"²": "^2", "³": "^3", "–": "-", "×": "x", "°": " degrees", "±": "+-"})
VERDICTS = (
    "paper: as printed; agrees: the two differ by no more than chance allows 99 times in a hundred; "
    "[ ]: 95 % intervals of ours"
)
PADDING = 3  # characters of a column beside its cells


class Sheet(NamedTuple):
    """A table for a screen of any width. Where the columns do not fit beside one another it is turned, if it
    takes fewer tables then; columns that are left stand below, beside the first one again. Only headings and
    the first column are wrapped, no figure is."""

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]

    def natural(self) -> list[int]:
        """Width of each column with its heading in one line."""
        return [
            max(len(line) for cell in column for line in cell.split("\n"))
            for column in zip(self.headings, *self.rows, strict=True)
        ]

    def least(self) -> list[int]:
        """Width of each column with headings and first column wrapped between words."""
        rows = [(_in_words(row[0]), *row[1:]) for row in self.rows]
        return Sheet("", [*map(_in_words, self.headings)], rows).natural()

    def turned(self) -> "Sheet":
        """The same with its columns as rows."""
        headings, *rows = zip(self.headings, *self.rows, strict=True)
        return Sheet(self.title, headings, rows)

    def fits(self, width: int) -> bool:
        return 1 + sum(self.natural()) + PADDING * len(self.headings) <= width

    def split(self, width: int) -> tuple[list[int], list[list[int]]]:
        """Width of every column, and the columns of each table; as few tables as there can be, with the first
        column wrapped no more than that takes."""
        natural = self.natural()
        if self.fits(width):
            return natural, [list(range(len(natural)))]
        least, *others = self.least()
        most = max(min(natural[0], width - 1 - 2 * PADDING - max(others)), 8)
        ways = ([first, *others] for first in range(most, min(least, most) - 1, -1))
        return min(((way, _side_by_side(way, width)) for way in ways), key=lambda found: len(found[1]))

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Grid]:
        straight = Sheet(*_plain(tuple(self), console.encoding))
        ways = [(sheet, *sheet.split(options.max_width)) for sheet in (straight, straight.turned())]
        sheet, widths, tables = min(ways[: 1 + _is_whole(*ways[1][:2])], key=lambda way: len(way[2]))
        terminal, natural, title = console.is_terminal, sheet.natural(), sheet.title
        lines = terminal and any("\n" in cell for row in sheet.rows for cell in row)
        for columns in tables:
            grid = Grid(
                title=title, title_justify="left", show_lines=lines,
                box=box.SIMPLE_HEAD if terminal else box.ASCII2,
            )  # fmt: skip
            spare = options.max_width - 1 - sum(widths[i] + PADDING for i in columns)
            wide = {}
            for i in columns:
                wide[i] = widths[i] + min(max(natural[i] - widths[i], 0), spare)
                grid.add_column(_broken(sheet.headings[i], wide[i]), width=wide[i], overflow="fold")
                spare -= wide[i] - widths[i]
            for row in sheet.rows:
                grid.add_row(_broken(row[0], wide[0]), *(row[i] for i in columns[1:]))
            yield grid
            title = ""


def _is_whole(sheet: Sheet, widths: Sequence[int]) -> bool:
    """Whether no word in the first column is cut."""
    return widths[0] >= sheet.least()[0]


PARTS = re.compile(r"(?<=[:,])(?=\S)")  # where NAME:key=value,key=value is broken


def _in_words(text: str) -> str:
    return "\n".join(PARTS.sub(" ", text).split())


def _broken(text: str, width: int) -> str:
    return text if len(text) <= width else PARTS.sub("\n", text)


def _side_by_side(widths: Sequence[int], width: int) -> list[list[int]]:
    """Columns of each table: the first, and as many of the others as fit."""
    tables = [[0]]
    for i in range(1, len(widths)):
        if len(tables[-1]) > 1 and 1 + sum(widths[j] + PADDING for j in (*tables[-1], i)) > width:
            tables.append([0])
        tables[-1].append(i)
    return tables


class Sayings(NamedTuple):
    """What a paper says: a table where it fits, else two lines for each sentence."""

    sheet: Sheet

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Any]:
        if self.sheet.fits(options.max_width):
            yield self.sheet
            return
        title, _, rows = _plain(tuple(self.sheet), console.encoding)
        yield Text(title, style="italic")
        for table, runs, claim, measure, value, threshold, verdict in rows:
            yield Text(f"{table}, {runs}: {claim}")
            yield Padding(Text(f"{measure}: {value}, holds above {threshold}: {verdict}"), (0, 0, 0, 4))


def figures_table(title: str, rows: dict[str, dict[str, Estimate]]) -> Sheet:
    """A table of figures with their intervals, one row per tracker."""
    metrics = [*next(iter(rows.values()))]
    cells = [[name, *(shown(metric, row[metric]) for metric in metrics)] for name, row in rows.items()]
    return Sheet(title, ["", *map(heading, metrics)], cells)


def comparison(title: str, record: dict[str, Any], metrics: Sequence[str]) -> Sheet:
    """A table of `table_record`: our figure, and under it the printed one with its verdict."""
    rows = []
    for row in record["rows"]:
        cells = []
        for metric in metrics:
            cell = row["metrics"][metric]
            text = shown(metric, figure_of(cell))
            if "paper" in cell:
                text += f"\npaper {cell['paper'] * _scale(metric):.4g} {cell.get('verdict', '')}".rstrip()
            cells.append(text)
        rows.append([row["tracker"], *cells])
    return Sheet(title, ["", *map(heading, metrics)], rows)


def claims_table(records: list[dict[str, Any]]) -> Sayings:
    """What a paper says, by table and set of runs: the number, its interval and the verdict."""
    headings = ["table", "runs", "claim", "measure", "value", "holds above", "verdict"]
    rows = [
        [
            record["table"], record["runs"], record["claim"], record["measure"], shown("", figure_of(record)),
            f"{record['threshold']:g}", record["verdict"],
        ]
        for record in records
    ]  # fmt: skip
    return Sayings(Sheet("what the paper says", headings, rows))


def notes(rows: dict[str, dict[str, Estimate]], runs: int) -> list[str]:
    """What a reader of the figures must know, a line each."""
    said = []
    lost = [name for name, row in rows.items() if "track_loss" in row and row["track_loss"].value == 1]
    if lost and len(lost) < len(rows):
        said.append(
            f"{', '.join(lost)} lost every run and has no errors: "
            "'common' is over the runs that all others kept"
        )
    elif lost:
        said.append("every run was lost by every tracker: there is no error of a run kept")
    if runs < FEWEST:
        said.append(
            f"{runs} run{'s' * (runs > 1)}: too few to judge; intervals of fewer than {FEWEST} are too narrow"
        )
    return said


def shown(metric: str, figure: Estimate) -> str:
    """The figure and its interval, in the unit of the screen; a dash for one that is not defined."""
    if np.isnan(figure.value):
        return "-"
    scaled = (_scale(metric) * number for number in figure)
    value, low, high = (f"{number:.3g}" if abs(number) < 1000 else f"{number:.0f}" for number in scaled)
    return value if np.isnan(figure.low) else f"{value} [{low}, {high}]"


def figure_of(cell: dict[str, Any]) -> Estimate:
    """The figure and its interval of a record."""
    return Estimate(*(np.nan if cell[key] is None else cell[key] for key in Estimate._fields))


def plain(text: str) -> str:
    """The text in letters that every console has."""
    letters = unicodedata.normalize("NFKD", text.translate(RAISED))
    return "".join(c for c in letters if not unicodedata.combining(c)).encode("ascii", "replace").decode()


def _plain(said: Any, encoding: str) -> Any:
    """Text, or tuples of it, as a console of that encoding can show it."""
    if not isinstance(said, str):
        return tuple(_plain(part, encoding) for part in said)
    try:
        said.encode(encoding)
        return said
    except UnicodeEncodeError:
        return plain(said)


def _scale(metric: str) -> float:
    return METRICS[metric].scale if metric in METRICS else 1
