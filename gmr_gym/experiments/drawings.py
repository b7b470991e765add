"""Drawings that more than one paper's tables ask for, and how all are kept."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.figure import Figure as Drawing

from gmr_gym.evaluation.summary import Estimate
from gmr_gym.evaluation.writing import whole
from gmr_gym.experiments.figures import METRICS, cell_name, heading


def save(drawing: Drawing, file: Path) -> None:
    """The drawing as a file of its ending."""
    # an SVG would otherwise have the time in it, and names by chance
    timeless: dict[str, Any] = {"metadata": {"Date": None}} if file.suffix == ".svg" else {}
    with whole(file) as partial, rc_context({"svg.hashsalt": file.stem}):
        drawing.savefig(partial, dpi=120, **timeless)


def canvas(width: float, height: float, rows: int = 1, columns: int = 1, **told: Any) -> tuple[Drawing, Any]:
    """A drawing of so many inches, and the axes of its panels as `subplots` has them."""
    drawing = Drawing(figsize=(width, height), layout="constrained")
    return drawing, drawing.subplots(rows, columns, **told)


def by_tracker(
    width: float, height: float, time: np.ndarray, panels: Mapping[str, Mapping[str, np.ndarray]]
) -> tuple[Drawing, np.ndarray]:
    """Panels below one another, each under its label with a curve for every tracker; the tenth is the last
    that is drawn through."""
    drawing, every = canvas(width, height, len(panels), sharex=True, squeeze=False)
    for axes, (label, curves) in zip(every[:, 0], panels.items(), strict=True):
        for i, (name, curve) in enumerate(curves.items()):
            axes.plot(time, curve, "-" if i < 10 else "--", lw=1, label=name)
        axes.set(ylabel=label)
    return drawing, every[:, 0]


def legend_above(drawing: Drawing, **told: Any) -> None:
    """The legend of the first panel, outside of all; a dollar in a name is a dollar."""
    handles = drawing.axes[0].get_legend_handles_labels()
    with rc_context({"text.parse_math": False}):
        drawing.legend(*handles, loc="outside upper center", **told)


def error_against_time(
    rows: Mapping[str, Mapping[str, Estimate]], metric: str, label: str, short: Callable[[str], str]
) -> Drawing:
    """An error of every tracker against the time it takes for a scan, each point with the tracker's short
    name and the share of runs it lost."""
    drawing, axes = canvas(8, 6)
    for name, row in rows.items():
        error, time = row[metric], 1e3 * row["time_per_scan"].value
        bar = [[error.value - error.low], [error.high - error.value]]
        axes.errorbar(time, error.value, yerr=bar, fmt="o", ms=4, lw=1)
        text = f"{short(name)} ({100 * row['track_loss'].value:.3g} % lost)"
        axes.annotate(text, (time, error.value), xytext=(5, 3), textcoords="offset points", fontsize=7)
    axes.set(xlabel="time a scan, ms", ylabel=label, xscale="log")
    return drawing


def over_settings(
    cells: Mapping[str, Mapping[str, Mapping[str, Any]]],
    axes: Mapping[str, Sequence[Any]],
    metrics: Sequence[str],
) -> Drawing:
    """Metrics of records by cell and tracker against the setting with the most values, a curve for every
    tracker with its intervals as a band: a panel for each metric and, beside one another, for what the other
    settings are."""
    along = max(axes, key=lambda axis: len(axes[axis]))
    others = {axis: values for axis, values in axes.items() if axis != along}
    rest = [dict(zip(others, values, strict=True)) for values in product(*others.values())]
    columns = len(rest) if others else 2 - len(metrics) % 2
    rows = len(metrics) * len(rest) // columns
    drawing, panels = canvas(
        1 + 3.5 * columns, 0.6 + 2.4 * rows, rows, columns, squeeze=False,
        sharex=True, sharey="row" if others else False,
    )  # fmt: skip
    for axis, (metric, fixed) in zip(panels.flat, product(metrics, rest), strict=True):
        points = [
            cells[cell_name({key: ({along: value} | fixed)[key] for key in axes})] for value in axes[along]
        ]
        _curves(axis, axes[along], points, metric)
        axis.set(ylabel=heading(metric))
    for axis, fixed in zip(panels[0], rest, strict=False):
        axis.set_title(cell_name(fixed), fontsize=9)
    for axis in panels[-1]:
        axis.set(xlabel=along)
    legend_above(drawing, ncols=4, fontsize=8)
    return drawing


def _curves(axis: Any, values: Sequence[Any], points: Sequence[Mapping[str, Any]], metric: str) -> None:
    """One metric of every tracker against the values of a setting."""
    numbers = all(isinstance(value, int | float) for value in values)
    x, scale = [*values] if numbers else [*range(len(values))], METRICS[metric].scale
    every = []
    for i, tracker in enumerate(points[0]):
        keys = ("value", "low", "high")
        found = np.array([[point[tracker][metric][key] for key in keys] for point in points], float) * scale
        axis.fill_between(x, found[:, 1], found[:, 2], alpha=0.2, lw=0)
        axis.plot(x, found[:, 0], "o-" if i < 10 else "o--", ms=3, lw=1, label=tracker)
        every += [*found[:, 0]]
    if numbers and _spread(x):
        axis.set_xscale("log")
    if _spread(every):
        axis.set_yscale("log")
        axis.yaxis.set_major_formatter("{x:g}")
    axis.set_xticks(x, [str(value) for value in values])
    axis.tick_params(axis="x", which="minor", bottom=False, labelbottom=False)


def _spread(values: Iterable[float]) -> bool:
    """Whether they are positive and span more than a decade."""
    finite = [value for value in values if np.isfinite(value)]
    return bool(finite) and min(finite) > 0 and max(finite) > 10 * min(finite)
