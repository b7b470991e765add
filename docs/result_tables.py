"""Records of results as tables of Markdown."""

from collections.abc import Mapping, Sequence
from typing import Any

from gmr_gym.evaluation.summary import Estimate
from gmr_gym.experiments.figures import HEADINGS
from gmr_gym.experiments.formats import piped
from gmr_gym.experiments.sheets import figure_of
from gmr_gym.experiments.sheets import shown as as_shown

# fields of a claim's record, and what they are called above a table
CLAIM = {
    "table": "table", "runs": "runs", "claim": "the paper says", "measure": "measured as",
    "threshold": "holds above",
}  # fmt: skip


def figures_table(tables: Sequence[Mapping[str, Any]], columns: Sequence[str]) -> str:
    """A row for each tracker, a column for each metric, or all; the table's name where there are several."""
    columns = columns or [*tables[0]["rows"][0]["metrics"]]
    rows = [
        [table["name"]] * (len(tables) > 1)
        + [row["tracker"], *(figure(metric, row["metrics"][metric]) for metric in columns)]
        for table in tables
        for row in table["rows"]
    ]
    of, names = tables[0].get("of", "tracker"), [HEADINGS.get(metric, metric) for metric in columns]
    return piped(["table"] * (len(tables) > 1) + [of, *names], rows)


def figure(metric: str, cell: Mapping[str, Any]) -> str:
    """The figure with its interval as a screen shows it, and after a semicolon the printed one with the
    verdict on it; a dash for one that is not defined."""
    value = as_shown(metric, figure_of(cell))
    if "paper" not in cell:
        return value
    printed = as_shown(metric, Estimate(cell["paper"]))
    return f"{value}; {printed} {cell.get('verdict', '')}".rstrip()


def claims_table(claims: Sequence[Mapping[str, Any]], across: Sequence[str]) -> str:
    """A row for each claim, a column for each of what it is judged on, without what all have in common."""
    varying = [key for key in CLAIM if len({claim[key] for claim in claims}) > 1 or key == "claim"]
    kept = [key for key in varying if key not in across and (key != "threshold" or "measure" not in across)]
    columns = [", ".join(claim[key] for key in across) for claim in claims]
    rows: dict[tuple[str, ...], dict[str, str]] = {}
    for claim, column in zip(claims, columns, strict=True):
        row = rows.setdefault(tuple(str(claim[key]) for key in kept), dict.fromkeys(columns, "-"))
        row[column] = f"{claim['verdict']} {figure('', claim)}"
    header = [*(CLAIM[key] for key in kept), *dict.fromkeys(columns)]
    return piped(header, [[*key, *row.values()] for key, row in rows.items()])
