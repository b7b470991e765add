"""Drawings that more than one paper's tables ask for, and how all are kept."""

from collections.abc import Callable, Mapping
from pathlib import Path

from matplotlib.figure import Figure as Drawing

from gmr_gym.evaluation.summary import Estimate
from gmr_gym.evaluation.writing import whole


def save(drawing: Drawing, file: Path) -> None:
    """The drawing as a file of its ending."""
    with whole(file) as partial:
        drawing.savefig(partial, dpi=120)


def error_against_time(
    rows: Mapping[str, Mapping[str, Estimate]], metric: str, label: str, short: Callable[[str], str]
) -> Drawing:
    """An error of every tracker against the time it takes for a scan, each point with the tracker's short
    name and the share of runs it lost."""
    drawing = Drawing(figsize=(8, 6), layout="constrained")
    axes = drawing.subplots()
    for name, row in rows.items():
        error, time = row[metric], 1e3 * row["time_per_scan"].value
        bar = [[error.value - error.low], [error.high - error.value]]
        axes.errorbar(time, error.value, yerr=bar, fmt="o", ms=4, lw=1)
        text = f"{short(name)} ({100 * row['track_loss'].value:.3g} % lost)"
        axes.annotate(text, (time, error.value), xytext=(5, 3), textcoords="offset points", fontsize=7)
    axes.set(xlabel="time a scan, ms", ylabel=label, xscale="log")
    return drawing
