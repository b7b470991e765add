"""Drawings that more than one paper's tables ask for, and how all are kept."""

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Drawing

from gmr_gym.evaluation.summary import Estimate
from gmr_gym.evaluation.writing import whole


def save(drawing: Drawing, file: Path) -> None:
    """The drawing as a file of its ending."""
    with whole(file) as partial:
        drawing.savefig(partial, dpi=120)


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
    """The legend of the first panel, outside of all."""
    handles = drawing.axes[0].get_legend_handles_labels()
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
