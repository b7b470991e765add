"""The record of an evaluation as a page that a browser shows: figures with their intervals, paired
differences, figures over time, what was run, and how to run it again."""

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure as Drawing

from gmr_gym.experiments.drawings import by_tracker, legend_above
from gmr_gym.experiments.figures import METRICS, heading, legend
from gmr_gym.experiments.pages import definition_list, drawing, figures, page, section

QUIET = "#7a8088"  # ink that is read on white and on black
STYLE: Any = {
    "svg.fonttype": "none", "svg.hashsalt": "gmr_gym", "font.family": "sans-serif", "legend.framealpha": 0.0,
    **dict.fromkeys(("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color"), QUIET),
}  # fmt: skip
PAIRED = "Run by run on the same episodes, from the first tracker."


def report(record: Mapping[str, Any], period: float) -> str:
    """The page of a record.

    Parameters
    ----------
    record : mapping
        As `gmr-gym evaluate` leaves it.
    period : float
        Time between scans, s.

    Returns
    -------
    str
        HTML.
    """
    table, *paired = record["tables"]
    words = legend(table["rows"][0]["metrics"])
    parts = [
        definition_list(_about(record)),
        section("Figures", figures(table["rows"]), "; ".join([*words, *record["notes"]])),
        *(section("Paired differences", figures(one["rows"], zero=True), PAIRED) for one in paired),
        section("Over time", _over_time(record["by_scan"], period)),
        section("Trackers", definition_list(dict(_parameters(record)))),
    ]  # fmt: skip
    return page(record["env"], parts, record["command"])


def _about(record: Mapping[str, Any]) -> dict[str, str]:
    settings = ", ".join(f"{key}={value}" for key, value in record["settings"].items())
    return {
        "runs": f"{record['runs']} of every tracker, the same episodes, seed {record['seed']}",
        **({"settings": settings} if settings else {}),
        "intervals": f"{100 * record['level']:g} %",
        "versions": ", ".join(f"{name} {number}" for name, number in record["versions"].items()),
    }


def _parameters(record: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    for tracker, parameters in record["parameters"].items():
        yield tracker, ", ".join(f"{key}={value}" for key, value in parameters.items())


def _over_time(scans: Mapping[str, Mapping[str, list[float | None]]], period: float) -> str:
    """A drawing with a panel for each figure by scan."""
    metrics = [*next(iter(scans.values()))]
    panels = {
        heading(metric): {
            name: METRICS[metric].scale * np.array(figures[metric], float) for name, figures in scans.items()
        }
        for metric in metrics
    }
    times = period * np.arange(1, len(next(iter(scans.values()))[metrics[0]]) + 1)
    with rc_context(STYLE):
        return drawing(_drawn(times, panels), f"{', '.join(panels)}, over time for every tracker")


def _drawn(times: np.ndarray, panels: Mapping[str, Mapping[str, np.ndarray]]) -> Drawing:
    drawn, axes = by_tracker(9, 2.1 * len(panels), times, panels)
    axes[-1].set(xlabel="time, s")
    legend_above(drawn, ncols=4, fontsize=8)
    return drawn
