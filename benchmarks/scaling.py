"""How time and memory grow with detections, components, dimension and environments, and what bounds them:
`python benchmarks/scaling.py results/scaling.png` draws it, writes the points beside the drawing, as CSV, and
prints a table of exponents. All by processor time, on one thread."""

import argparse
import ctypes
import gc
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter
from panels import PANELS, Panel
from table import markdown
from threadpoolctl import threadpool_limits
from timing import timed

from gmr_gym.experiments.output import write_rows

ENOUGH = 0.2  # s of repeats
LONGEST = 20.0  # s, a curve ends before a point that would take longer
ALLOCATOR = ctypes.CDLL(None)
LEAST = 0.1  # MB that a page or two more or less leave as it is


class Curve(NamedTuple):
    panel: str
    name: str
    x: np.ndarray
    seconds: np.ndarray
    megabytes: np.ndarray


def main() -> None:
    parser = argparse.ArgumentParser(description="Draw how time and memory grow.")
    parser.add_argument("file", type=Path)
    file = parser.parse_args().file
    file.parent.mkdir(parents=True, exist_ok=True)
    with threadpool_limits(1):
        limits = [limit_curve(panel, name) for panel in PANELS for name in panel.limits]
        timings = [times(panel, name) for panel in PANELS for name in panel.works]
        ALLOCATOR.mallopt(-3, 1 << 16)  # M_MMAP_THRESHOLD: what is freed is given back
        curves = [with_memory(*timing) for timing in timings]
    header = "panel", "curve", "x", "seconds", "megabytes"
    rows = [(c.panel, c.name, *point) for c in curves + limits for point in zip(*c[2:], strict=True)]
    write_rows(file.with_suffix(".csv"), header, rows)
    drawing(curves, limits).savefig(file, dpi=120)
    print(table(curves, limits))


def times(panel: Panel, name: str) -> tuple[Panel, str, list[float]]:
    """Seconds at the first points of a panel, the best of the repeats: a busy machine only adds."""
    (work, parts), seconds = panel.works[name], []
    for x in panel.points:
        if parts * _expected(panel.points, seconds) > LONGEST:
            break
        call = work(x)
        if not seconds:
            call()  # compiles
        watch, taken = timed(call, parts=parts), []
        while sum(taken) * parts < ENOUGH:
            taken.append(watch())
        seconds.append(min(taken))
    return panel, name, seconds


def _expected(x: Sequence[int], seconds: Sequence[float]) -> float:
    """Of the next point, if time grows on as between the last two."""
    k = len(seconds)
    if k < 2:
        return 0.0
    power = np.log(seconds[-1] / seconds[-2]) / np.log(x[k - 1] / x[k - 2])
    return float(seconds[-1] * (x[k] / x[k - 1]) ** power)


def with_memory(panel: Panel, name: str, seconds: list[float]) -> Curve:
    """The same points with the peak memory of the work and of what it is given."""
    work, _ = panel.works[name]
    megabytes = [peak(lambda x=x: work(x)()) for x in panel.points[: len(seconds)]]
    return Curve(
        panel.x, name, np.array(panel.points[: len(seconds)]), np.array(seconds), np.array(megabytes)
    )


def limit_curve(panel: Panel, name: str) -> Curve:
    seconds, megabytes = np.transpose([panel.limits[name](x) for x in panel.points])
    return Curve(panel.x, name, np.array(panel.points), seconds, megabytes)


def peak(call: Callable[[], object]) -> float:
    """Memory that a call takes at most beyond what is there before, MB; nan below LEAST. Linux alone."""
    gc.collect()
    ALLOCATOR.malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5")  # the peak is what there is now
    before = _resident("VmHWM")
    call()
    taken = (_resident("VmHWM") - before) / 1024
    return taken if taken >= LEAST else np.nan


def _resident(what: str) -> int:
    return int(re.search(rf"{what}:\s+(\d+) kB", Path("/proc/self/status").read_text())[1])


def exponent(x: np.ndarray, y: np.ndarray) -> float:
    """Of the power of x that fits y in the upper half of the range of x, in logarithms."""
    upper = (x > 0.99 * np.sqrt(x[0] * x[-1])) & (y > 0)
    return float(np.polyfit(np.log(x[upper]), np.log(y[upper]), 1)[0]) if upper.sum() > 1 else np.nan


def table(curves: Sequence[Curve], limits: Sequence[Curve]) -> str:
    """A row for each curve: where it ends and how it grows, and how far it is from each limit there."""
    rows = []
    for c in curves:
        last = len(c.x) - 1
        beside = [one for one in limits if one.panel == c.panel]
        over_time = [_times(c.seconds[last] / one.seconds[last], one.name) for one in beside]
        over_memory = [_times(c.megabytes[last] / one.megabytes[last], one.name) for one in beside]
        rows.append([
            c.panel, c.name, f"{c.x[last]:g}",
            *(_power(exponent(c.x, y)) for y in (c.seconds, c.megabytes)),
            "; ".join(filter(None, over_time)), "; ".join(filter(None, over_memory)),
        ])  # fmt: skip
    header = "x", "curve", "up to", "time grows as", "memory as", "time there", "memory there"
    return markdown(header, rows)


def _power(exponent: float) -> str:
    return "-" if np.isnan(exponent) else f"x^{exponent:.2f}"


def _times(ratio: float, of: str) -> str:
    return "" if np.isnan(ratio) else f"{ratio:,.{max(1 - int(np.floor(np.log10(ratio))), 0)}f} × {of}"


def drawing(curves: Sequence[Curve], limits: Sequence[Curve]) -> Figure:
    """Time above, memory below, the limits dashed."""
    figure = Figure(figsize=(16, 7.5), layout="constrained")
    axes = figure.subplots(2, len(PANELS))
    for column, panel in zip(axes.T, PANELS, strict=True):
        for ax, field, label in zip(column, ("seconds", "megabytes"), ("s", "peak memory, MB"), strict=True):
            for c in curves:
                if c.panel == panel.x:
                    slope = _power(exponent(c.x, getattr(c, field)))
                    ax.plot(c.x, getattr(c, field), "o-", label=f"{c.name}, {slope}")
            for c in limits:
                if c.panel == panel.x and np.isfinite(getattr(c, field)).any():
                    ax.plot(c.x, getattr(c, field), "--", label=c.name)
            ax.set(xlabel=panel.x, ylabel=label, xscale="log", yscale="log")
            ax.yaxis.set_minor_formatter(NullFormatter())
            if panel.points[-1] < 10 * panel.points[0]:  # within which a logarithmic scale labels too much
                ax.set_xticks(panel.points, [f"{x}" for x in panel.points])
                ax.set_xticks([], minor=True)
            ax.grid(alpha=0.3)
            ax.legend(fontsize="small")
    return figure


if __name__ == "__main__":
    main()
