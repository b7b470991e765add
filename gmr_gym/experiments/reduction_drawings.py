"""Figures of reductions against the time they take, with fronts."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure as Drawing
from matplotlib.ticker import LogLocator, NullFormatter

from gmr_gym.evaluation.fronts import front
from gmr_gym.evaluation.summary import Estimate
from gmr_gym.experiments.drawings import canvas
from gmr_gym.experiments.figures import METRICS, heading

MARKERS = "osD^v<>P*Xphd"
COLOURS = 10  # of the usual cycle
Rows = Mapping[str, Mapping[str, Estimate]]


def against_time(panels: Mapping[str, tuple[Rows, Sequence[str]]], time: str) -> Drawing:
    """Under each title a panel for each of its figures against the time: a mark with its interval for every
    row, those of one reduction, `NAME, NUMBER`, joined, and the front dashed, with its names."""
    columns = max(len(figures) for _, figures in panels.values())
    drawing, every = canvas(2.5 + 3.6 * columns, 3.2 * len(panels), len(panels), columns, squeeze=False)
    names = sorted({_reduction(key) for rows, _ in panels.values() for key in rows})
    marks = {name: f"C{i % COLOURS}{MARKERS[i % len(MARKERS)]}" for i, name in enumerate(names)}
    for axes, (title, (rows, figures)) in zip(every, panels.items(), strict=True):
        for axis, figure in zip(axes, figures, strict=True):
            _panel(axis, rows, time, figure, marks)
            axis.set(xlabel=heading(time), ylabel=heading(figure))
            axis.set_title(title, fontsize=8)
    handles: dict[str, Any] = {}
    for axis in drawing.axes:
        handles |= dict(zip(*axis.get_legend_handles_labels()[::-1], strict=True))
    drawing.legend([handles[name] for name in names], names, loc="outside right upper", fontsize=7)
    return drawing


def _panel(axis: Any, rows: Rows, time: str, figure: str, marks: Mapping[str, str]) -> None:
    at = METRICS[time].scale * np.array([row[time].value for row in rows.values()])
    found = METRICS[figure].scale * np.array([row[figure] for row in rows.values()])
    value, bars = found[:, 0], np.abs(np.nan_to_num(found[:, 1:] - found[:, :1])).T
    keys = np.array([_reduction(key) for key in rows])
    for name in dict.fromkeys(keys.tolist()):
        mine = np.flatnonzero(keys == name)
        mine = mine[np.argsort(at[mine])]
        axis.errorbar(at[mine], value[mine], bars[:, mine], fmt=f"{marks[name]}-", ms=4, lw=0.7, label=name)
    _logarithmic(axis, "x", at)
    _logarithmic(axis, "y", value)
    on = np.flatnonzero(front(at, value))
    on = on[np.argsort(at[on])]
    axis.plot(at[on], value[on], "k--", lw=1, drawstyle="steps-post", zorder=0)
    for i in on:
        axis.annotate([*rows][i], (at[i], value[i]), xytext=(3, 3), textcoords="offset points", fontsize=6)


def _logarithmic(axis: Any, which: str, values: np.ndarray) -> None:
    """A logarithmic scale, below the least positive value linear where there is one that is not positive."""
    told: dict[str, Any] = {"value": "log"}
    if not (values > 0).all():
        told = {"value": "symlog", "linthresh": values[values > 0].min(initial=1.0)}
    getattr(axis, f"set_{which}scale")(**told)
    if which == "x" or values.max() < 1000 * values.min():
        side = getattr(axis, f"{which}axis")
        side.set_major_locator(LogLocator(subs=(1, 2, 5)))
        side.set_major_formatter("{x:g}")
        side.set_minor_formatter(NullFormatter())


def _reduction(key: str) -> str:
    return key.rpartition(", ")[0] or key
