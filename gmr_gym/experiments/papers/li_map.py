"""The map of where which conversion wins, drawn."""

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure as Drawing

from gmr_gym.evaluation.summary import Estimate
from gmr_gym.experiments.drawings import save
from gmr_gym.experiments.tables import SettingsGrid
from gmr_gym.scenarios.li import REGIMES

SAVED = "debiased saves on extended, %"


def map_figures(entry: SettingsGrid, rows: Mapping[str, Mapping[str, Estimate]], out: Path) -> None:
    """By update, how much worse it is than the best, a ring where chance may have made it worse, and where
    debiasing beats linearising; over the period and r s^2 / s_r."""
    shape = [len(values) for values in entry.axes.values()]
    range_deviation = REGIMES[entry.settings["regime"]].range_deviation
    distance = np.linalg.norm(REGIMES[entry.settings["regime"]].start)
    ratio = distance * np.array(entry.axes["angle_deviation"]) ** 2 / range_deviation
    period = np.array(entry.axes["period"])
    drawing = Drawing(figsize=(13, 9), layout="constrained")
    panels = drawing.subplots(2, 5, sharex=True, sharey=True)
    for axes, column in zip(panels.flat, entry.columns, strict=True):
        value, low, high = (
            np.array([getattr(row[column], part) for row in rows.values()]).reshape(shape)
            for part in Estimate._fields
        )
        last = column == SAVED
        shown = value if last else 100 * (value - 1)
        limits, colours = (-30, 30) if last else (0, 30), "RdBu" if last else "magma_r"
        mesh = axes.pcolormesh(
            _edges(ratio), _edges(period), shown, cmap=colours, vmin=limits[0], vmax=limits[1]
        )
        marked = (low > 0) | (high < 0) if last else low <= 1
        at = np.meshgrid(ratio, period)
        axes.plot(at[0][marked], at[1][marked], "o", mfc="none", mec="0.4", ms=7)
        axes.set(xscale="log", yscale="log", title=column)
        if axes in panels[:, -1]:
            label = "saved, %" if last else "worse than the best, %"
            drawing.colorbar(mesh, ax=axes, label=label, extend="both" if last else "max")
    drawing.supxlabel("r σ² / σ_r")
    drawing.supylabel("period, s")
    drawing.suptitle(
        "rings: not worse than the best beyond chance (95 %); in the last panel, beyond chance", size=10
    )
    save(drawing, out / f"{entry.name}.png")


def _edges(centres: np.ndarray) -> np.ndarray:
    """Where cells meet on a logarithmic axis."""
    log = np.log(centres)
    middle = [(a + b) / 2 for a, b in pairwise(log)]
    return np.exp([log[0] - (middle[0] - log[0]), *middle, log[-1] + (log[-1] - middle[-1])])
