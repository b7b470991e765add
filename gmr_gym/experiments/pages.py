"""Results as one self-contained page: tables that sort, intervals as bars, drawings, and how to run it again.

Nothing in a page is fetched: style, script and drawings stand in it.
"""

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from io import StringIO
from typing import Any

from matplotlib.figure import Figure as Drawing

from gmr_gym.evaluation.summary import Estimate
from gmr_gym.experiments.figures import heading
from gmr_gym.experiments.sheets import shown

NOT_A_NUMBER = "–"


def page(title: str, parts: Iterable[str], command: str) -> str:
    """A whole page: the parts, and below them the command that makes it again.

    Parameters
    ----------
    title : str
    parts : iterable of str
        HTML.
    command : str
        As it is typed in a shell.

    Returns
    -------
    str
        HTML.
    """
    style, script = (files(__package__).joinpath(name).read_text("utf-8") for name in ("page.css", "page.js"))
    again = section("Run it again", f"<pre><code>{escape(command)}</code></pre>")
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{style}</style>\n</head>\n<body>\n<main>\n"
        f"<h1>{escape(title)}</h1>\n{''.join(parts)}{again}</main>\n<script>\n{script}</script>\n</body>\n</html>\n"
    )


def section(title: str, content: str, note: str = "") -> str:
    """A heading, content (HTML), and a note (text) below it."""
    below = f'<p class="note">{escape(note)}</p>\n' if note else ""
    return f"<section>\n<h2>{escape(title)}</h2>\n{content}\n{below}</section>\n"


def definition_list(entries: Mapping[str, str]) -> str:
    """What each word is, as a list."""
    lines = (f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in entries.items())
    return f"<dl>{''.join(lines)}</dl>\n"


def figures(rows: Sequence[Mapping[str, Any]], zero: bool = False) -> str:
    """A table of rows of a record, each cell with its interval as a bar on the scale of its column.

    Parameters
    ----------
    rows : sequence of mapping
        With `tracker`, and `metrics`: cells with `value`, `low` and `high`, None for what is not defined.
    zero : bool
        Whether the scale has 0 in its middle, as for differences.

    Returns
    -------
    str
        HTML.
    """
    metrics = list(rows[0]["metrics"])
    scales = {metric: _scale([row["metrics"][metric] for row in rows], zero) for metric in metrics}
    head = "".join(
        f'<th scope="col"><button type="button">{escape(heading(metric))}</button></th>' for metric in metrics
    )
    body = []
    for row in rows:
        cells = "".join(_cell(metric, row["metrics"][metric], *scales[metric], zero) for metric in metrics)
        body.append(f'<tr><th scope="row">{escape(row["tracker"])}</th>{cells}</tr>')
    return (
        f'<div class="wide"><table class="figures"><thead><tr><th></th>{head}</tr></thead>\n'
        f"<tbody>\n{chr(10).join(body)}\n</tbody></table></div>"
    )


def drawing(figure: Drawing, about: str) -> str:
    """A drawing of Matplotlib in line, readable on light and dark; `about` says what it shows."""
    stream = StringIO()
    figure.savefig(stream, format="svg", transparent=True, metadata={"Date": None})
    _, _, svg = stream.getvalue().partition("<svg")
    return f'<figure role="img" aria-label="{escape(about)}"><svg{svg}</figure>'


def _cell(metric: str, cell: Mapping[str, Any], low: float, high: float, zero: bool) -> str:
    value = cell["value"]
    if value is None:
        return f'<td data-value="">{NOT_A_NUMBER}</td>'
    text, bar = shown(metric, Estimate(value)), ""
    if cell["low"] is not None:
        bar = _bar([(cell[key] - low) / (high - low) * 100 for key in ("value", "low", "high")], zero)
        ends = " to ".join(shown(metric, Estimate(cell[key])) for key in ("low", "high"))
        return f'<td data-value="{value!r}" title="95 % interval {ends}">{text}{bar}</td>'
    return f'<td data-value="{value!r}">{text}</td>'


def _bar(places: Sequence[float], zero: bool) -> str:
    """A value and the ends of its interval, in per cent of the column's scale."""
    value, low, high = places
    middle = '<i class="zero"></i>' if zero else ""
    return (
        f'<span class="bar">{middle}<i class="interval" style="left:{low:.1f}%;width:{high - low:.1f}%"></i>'
        f'<i class="value" style="left:{value:.1f}%"></i></span>'
    )


def _scale(cells: Sequence[Mapping[str, Any]], zero: bool) -> tuple[float, float]:
    """Ends of the scale of a column: from 0, or about it, to the largest end of an interval."""
    ends = [cell[key] for cell in cells for key in ("value", "low", "high") if cell[key] is not None]
    reach = max(map(abs, ends), default=0.0) or 1.0
    low = -reach if zero or min(ends, default=0.0) < 0 else 0.0
    return low, reach
