"""Figures as tables on a screen of any width, and what is to be said of them."""

import unicodedata
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from rich import box
from rich.console import Console, ConsoleOptions
from rich.padding import Padding
from rich.table import Table as Grid
from rich.text import Text

from gmr_gym.evaluation.summary import FEWEST, Estimate


class Metric(NamedTuple):
    """How a figure is called, its unit in files, and on a screen where that is another one."""

    heading: str
    unit: str = "1"
    shown: str = ""
    scale: float = 1  # from the one to the other


SHARE, TIME = ("1", "%", 100), ("s", "ms", 1e3)
METRICS = {
    "track_loss": Metric("lost", *SHARE), "components": Metric("components"),
    "error_capped": Metric("capped error", "m"), "anees_own": Metric("ANEES"),
    **{f"error_{over}": Metric(f"error {over}", "m") for over in ("own", "common")},
    **{f"{part}rmse_{over}": Metric(f"{words}RMSE {over}", unit) for part, words, unit in (
        ("", "", "m"), ("velocity_", "velocity ", "m/s"), ("level_", "level ", "m"),
        ("level_velocity_", "level velocity ", "m/s"), *((f"{axis}_", f"{axis} ", "m") for axis in "xyz"),
    ) for over in ("own", "common", "all")},
    **{f"{field}_{over}": Metric(words if over == "own" else f"{words} {over}", "dB")
       for field, words in (("nci", "NCI"), ("inclination", "inclination"))
       for over in ("own", "common", "all")},
    "sight_bias_own": Metric("bias along the line of sight", "m"),
    "position_anees_own": Metric("ANEES of position"),
    "gate_area": Metric("gate area", "m^2 (volume, m^3)"), "gate_volume": Metric("gate volume", "m^3"),
    "time_per_scan": Metric("time a scan", *TIME), "time_worst": Metric("longest", *TIME),
    "ospa": Metric("OSPA", "m"), "gospa": Metric("GOSPA", "m"),
    **{part: Metric(part, "m^2") for part in ("localisation", "missed", "false")},
    "cardinality_bias": Metric("named less there"), "cardinality_error": Metric("number wrong by"),
    "wasserstein": Metric("Wasserstein", "m"), "wasserstein_printed": Metric("Wasserstein by eq. 41", "m"),
    "wasserstein_undefined": Metric("without one", *SHARE), "density_error": Metric("clutter wrong by"),
}  # fmt: skip
RAISED = str.maketrans({"²": "^2", "³": "^3", "–": "-", "×": "x", "°": " degrees"})
HEADINGS = {
    name: ", ".join(filter(None, (
        one.heading, one.shown or one.unit.replace("^2", "²").replace("^3", "³").removeprefix("1"),
    )))
    for name, one in METRICS.items()
}  # fmt: skip
VERDICTS = (
    "paper: as printed; agrees: the two differ by no more than chance allows 99 times in a hundred; "
    "[ ]: 95 % intervals of ours"
)
LEGEND = {
    "RMSE": "root mean square error", "error": "mean distance from the truth",
    "own": "over the runs that a tracker kept", "common": "over those that every tracker kept",
    "all": "over all runs",
}  # fmt: skip
LEFT_TO_FILES = {"rmse_common", "error_own", "inclination_own"}  # of many figures a reader sees none
PADDING = 3  # characters of a column beside its cells


class Sheet(NamedTuple):
    """A table for a screen of any width. Where the columns do not fit beside one another, those that are left
    stand below, beside the first one again; only headings and the first column are wrapped, no figure is."""

    title: str
    headings: Sequence[str]
    rows: Sequence[Sequence[str]]

    def natural(self) -> list[int]:
        """Width of each column with its heading in one line."""
        return [
            max(len(line) for cell in column for line in cell.split("\n"))
            for column in zip(self.headings, *self.rows, strict=True)
        ]

    def fits(self, width: int) -> bool:
        return 1 + sum(self.natural()) + PADDING * len(self.headings) <= width

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> Iterator[Grid]:
        sheet = Sheet(*_plain(tuple(self), console.encoding))
        terminal, natural = console.is_terminal, sheet.natural()
        widths = list(natural)
        if not sheet.fits(options.max_width):
            words = ["\n".join(heading.split()) for heading in sheet.headings]
            widths = Sheet("", words, sheet.rows).natural()
            widths[0] = max(min(widths[0], options.max_width - 1 - 2 * PADDING - max(widths[1:])), 8)
        title = sheet.title
        for columns in _side_by_side(widths, options.max_width):
            grid = Grid(
                title=title, title_justify="left", show_lines=terminal,
                box=box.SIMPLE_HEAD if terminal else box.ASCII2,
            )  # fmt: skip
            spare = options.max_width - 1 - sum(widths[i] + PADDING for i in columns)
            for i in columns:
                wider = min(max(natural[i] - widths[i], 0), spare)
                grid.add_column(sheet.headings[i], width=widths[i] + wider, overflow="fold")
                spare -= wider
            for row in sheet.rows:
                grid.add_row(*(row[i] for i in columns))
            yield grid
            title = ""


def _side_by_side(widths: Sequence[int], width: int) -> Iterator[list[int]]:
    """Columns of each table: the first, and as many of the others as fit."""
    columns = [0]
    for i in range(1, len(widths)):
        if len(columns) > 1 and 1 + sum(widths[j] + PADDING for j in (*columns, i)) > width:
            yield columns
            columns = [0]
        columns.append(i)
    yield columns


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
    """A table of the main figures with their intervals, one row per tracker."""
    metrics = on_screen(rows)
    cells = [[name, *(shown(metric, row[metric]) for metric in metrics)] for name, row in rows.items()]
    return Sheet(title, _headings(metrics), cells)


def on_screen(rows: dict[str, dict[str, Estimate]]) -> list[str]:
    """The metrics that `figures_table` shows."""
    return [metric for metric in next(iter(rows.values())) if metric not in LEFT_TO_FILES]


def comparison(title: str, record: dict[str, Any], metrics: Sequence[str]) -> Sheet:
    """A table of `table_record`: our figure, and under it the printed one with its verdict."""
    rows = []
    for row in record["rows"]:
        cells = []
        for metric in metrics:
            cell = row["metrics"][metric]
            text = shown(metric, _figure(cell))
            if "paper" in cell:
                text += f"\npaper {cell['paper'] * _scale(metric):.4g} {cell.get('verdict', '')}"
            cells.append(text)
        rows.append([row["tracker"], *cells])
    return Sheet(title, _headings(metrics), rows)


def claims_table(records: list[dict[str, Any]]) -> Sayings:
    """What a paper says, by table and set of runs: the number, its interval and the verdict."""
    headings = ["table", "runs", "claim", "measure", "value", "holds above", "verdict"]
    rows = [
        [
            record["table"], record["runs"], record["claim"], record["measure"], shown("", _figure(record)),
            f"{record['threshold']:g}", record["verdict"],
        ]
        for record in records
    ]  # fmt: skip
    return Sayings(Sheet("what the paper says", headings, rows))


def legend(metrics: Iterable[str]) -> list[str]:
    """A line on the words in the headings of these metrics; none where no word needs one."""
    words = {word for metric in metrics for word in HEADINGS.get(metric, metric).replace(",", "").split()}
    said = [f"{word}: {meaning}" for word, meaning in LEGEND.items() if word in words]
    return ["; ".join(said)] if said else []


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
    scaled = (_scale(metric) * number for number in figure)
    value, low, high = (f"{number:.3g}" if abs(number) < 1000 else f"{number:.0f}" for number in scaled)
    return value if np.isnan(figure.low) else f"{value} [{low}, {high}]"


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


def _figure(cell: dict[str, Any]) -> Estimate:
    return Estimate(*(np.nan if cell[key] is None else cell[key] for key in Estimate._fields))


def _headings(metrics: Sequence[str]) -> list[str]:
    return ["", *(HEADINGS.get(metric, metric) for metric in metrics)]


def _scale(metric: str) -> float:
    return METRICS[metric].scale if metric in METRICS else 1
