"""What is drawn on the axes of a sheet, and in which colours."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import EllipseCollection
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D

INK, CLUTTER, TRUTH, ESTIMATE, HYPOTHESIS = "#222222", "#9aa0a6", "#1a7f37", "#c5221f", "#1967d2"
GATES, PAPER = "#d0d7de", "#ffffff"
INKS = INK, CLUTTER, TRUTH, ESTIMATE, HYPOTHESIS, GATES

EDGE = 5.99  # squared Mahalanobis distance, within which 95 % of a Gaussian of the plane lie


def ellipses(axes: Axes, centres: np.ndarray, shapes: np.ndarray, **style: Any) -> EllipseCollection:
    """A collection of the ellipses (x - centre)' shape^-1 (x - centre) = 1.

    Parameters
    ----------
    axes : matplotlib Axes
    centres : ndarray (n, 2)
    shapes : ndarray (n, 2, 2)
    **style
        Of matplotlib's EllipseCollection.

    Returns
    -------
    EllipseCollection
    """
    values, vectors = np.linalg.eigh(shapes)
    axes_lengths = 2 * np.sqrt(values)
    angles = np.degrees(np.arctan2(vectors[:, 1, 1], vectors[:, 0, 1]))
    return EllipseCollection(
        axes_lengths[:, 1], axes_lengths[:, 0], angles, units="xy", offsets=centres,
        offset_transform=axes.transData, facecolors="none", **style,
    )  # fmt: skip


def ring(colour: str, label: str, **style: Any) -> Line2D:
    """What stands for ellipses in a legend."""
    return Line2D([], [], ls="", marker="o", ms=8, mfc="none", mec=colour, mew=1.8, label=label, **style)


def add_ellipses(
    axes: Axes,
    centres: np.ndarray,
    shapes: np.ndarray,
    colour: str,
    width: float,
    opacity: np.ndarray | float = 1.0,
    **style: Any,
) -> None:
    """Draw `ellipses` (n), in points wide, as opaque as given for all or for each (n,), but for those with a
    number that is not finite."""
    opacity = np.broadcast_to(opacity, len(centres))
    sound = np.isfinite(centres).all(axis=1) & np.isfinite(shapes).all(axis=(1, 2)) & np.isfinite(opacity)
    colours = [(*to_rgb(colour), share) for share in opacity[sound]]
    drawn = ellipses(axes, centres[sound], shapes[sound], edgecolors=colours, linewidths=width, **style)
    axes.add_collection(drawn, autolim=False)


def style_plane(axes: Axes, labelled: bool) -> None:
    """Axes of the plane, in metres; only those at the left have numbers at their left."""
    axes.set_aspect("equal")
    axes.locator_params(axis="x", nbins=4)  # labels of six figures under a narrow box would overlap
    axes.tick_params(labelleft=labelled)
    axes.set_xlabel("x, m", color=INK)
    axes.set_ylabel("y, m" if labelled else "", color=INK)


def style_strip(axes: Axes, scans: int, labelled: bool) -> None:
    """Axes over the scans."""
    axes.set(xlim=(0, scans + 1), ylim=(0, 10))
    axes.locator_params(axis="x", integer=True)
    axes.locator_params(axis="y", nbins=2, integer=True)
    axes.tick_params(labelleft=labelled)
    axes.set_xlabel("scan", color=INK)


def over_scans(axes: Axes, name: str, counts: Mapping[str, Sequence[float]]) -> None:
    """Draw numbers, scan by scan, each kind in its colour."""
    if not axes.lines:
        for colour in counts:
            axes.step([], [], where="mid", color=colour, lw=1.4)
        axes.set_ylabel(name, color=INK, fontsize=9)
    for line, values in zip(axes.lines, counts.values(), strict=True):
        line.set_data(np.arange(1, len(values) + 1), values)


def link(strips: Sequence[Axes]) -> None:
    """Give strips side by side one scale, from 0, that doubles where it must; only the first is labelled."""
    most = max(np.max(line.get_ydata(), initial=0) for strip in strips for line in strip.lines)
    top = strips[0].get_ylim()[1]
    while top <= most:
        top *= 2
    for strip in strips:
        strip.set_ylim(0, top)
    for strip in strips[1:]:
        strip.set_ylabel("")
