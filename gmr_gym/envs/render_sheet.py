"""The sheet that scans are drawn on: panels side by side, a legend below, in memory or in a window."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from gmr_gym.envs.render_marks import INK

SIZE = 640, 640  # pixels, of the image of an environment
LARGEST = 4000  # pixels, of a side
# inches, at a hundred pixels each where a panel is 640 pixels wide
LEFT, RIGHT, TOP, AXIS, GAP, STRIP, ROW, COLUMN = 0.82, 0.24, 0.32, 0.48, 0.26, 0.72, 0.19, 2.05
LEAST = 0.8  # of a panel's sides


class Sheet:
    """A figure of planes side by side, each with strips over the scans below it.

    Parameters
    ----------
    size : tuple of int
        Width and height, pixels.
    panels : int
        Number of planes.
    strips : int
        Number of strips below each.
    marks : int
        Names in the legend.
    across : bool
        Whether strips are as wide as all planes together, and there is one column of them.
    on_screen : bool
        Whether to open a window.

    Attributes
    ----------
    planes : list of Axes
    strips : list of list of Axes
        Of each plane, or of all.

    Raises
    ------
    ValueError
        For a size that is no number of pixels up to LARGEST, or that leaves no room for the planes.
    """

    def __init__(
        self,
        size: tuple[int, int] = SIZE,
        panels: int = 1,
        strips: int = 0,
        marks: int = 0,
        across: bool = False,
        on_screen: bool = False,
    ):
        check_size(size)
        self._dots = _dots(size[0], panels)
        self._background: Any = None
        self._limits: Any = None  # of all axes, as the background has them
        self._inches = size[0] / self._dots, size[1] / self._dots
        self._window: Any = None
        if on_screen:
            import matplotlib.pyplot as plt

            self._window = plt
            self.figure = plt.figure(figsize=self._inches, dpi=self._dots)
        else:
            self.figure = Figure(figsize=self._inches, dpi=self._dots)
            self._pixels = FigureCanvasAgg(self.figure)
        width = plane_width(size[0], panels)
        height = self._inches[1] - around(size[0], panels, strips, marks)
        if min(width, height) < LEAST:
            what = "a panel" if panels == 1 else f"{panels} panels"
            raise ValueError(f"size {size[0]}x{size[1]} leaves no room for {what} and the legend")
        low = self._inches[1] - TOP - height
        rooms = [(LEFT + i * (width + GAP), low, width, height) for i in range(panels)]
        below = [low - AXIS - STRIP - i * (STRIP + GAP / 2) for i in range(strips)]
        self.planes = [self._axes(room) for room in rooms]
        widths = [(LEFT, self._inches[0] - LEFT - RIGHT)] if across else [(x, width) for x, *_ in rooms]
        self.strips = [[self._axes((x, y, width, STRIP)) for y in below] for x, width in widths]

    def _axes(self, room: Sequence[float]) -> Axes:
        width, height = self._inches
        axes = self.figure.add_axes(tuple(np.array(room) / (width, height, width, height)))
        axes.tick_params(colors=INK, labelsize=9)
        axes.spines[:].set_color(INK)
        return axes

    def name(self, marks: Iterable[Artist]) -> None:
        """Write the legend, once for all panels: the labels of marks.

        Parameters
        ----------
        marks : iterable of Artist
        """
        self.figure.legend(
            handles=[*marks], loc="lower center", ncols=_columns(self._inches[0]), fontsize=8, frameon=False,
            labelcolor=INK, handlelength=1.6, borderpad=0.2, borderaxespad=0.2, columnspacing=1.2,
        )  # fmt: skip

    def shown(self) -> np.ndarray | None:
        """The image (height, width, 3); None where it is shown in a window.

        Frames, ticks and legend are drawn anew only where limits of axes have changed.
        """
        if self._window is not None:
            self._window.pause(1e-3)
            return None
        moving = {axes: _moving(axes) for axes in self.figure.axes}
        limits = [tuple(axes.viewLim.extents) for axes in moving]
        if limits != self._limits:
            for artist in (artist for artists in moving.values() for artist in artists):
                artist.set_animated(True)
            self._pixels.draw()
            self._background, self._limits = self._pixels.copy_from_bbox(self.figure.bbox), limits
        self._pixels.restore_region(self._background)
        for axes, artists in moving.items():
            for artist in artists:
                axes.draw_artist(artist)
        return np.asarray(self._pixels.buffer_rgba())[..., :3].copy()

    def save(self, out: Path) -> None:
        """Write the figure to a file, .svg with vectors, .png with pixels.

        Parameters
        ----------
        out : Path
        """
        undated = {"Date": None} if out.suffix.lower() == ".svg" else None
        with rc_context({"svg.hashsalt": "gmr_gym"}):  # the same file for the same picture
            self.figure.savefig(out, dpi=self._dots, metadata=undated)

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close(self.figure)


def _moving(axes: Axes) -> list[Artist]:
    """What changes from scan to scan, in the order it is drawn."""
    return sorted([*axes.collections, *axes.lines, *axes.texts], key=lambda artist: artist.get_zorder())


def check_size(size: tuple[int, int]) -> None:
    """ValueError unless both sides are between 1 and LARGEST pixels."""
    for side in size:
        if not 1 <= side <= LARGEST:
            raise ValueError(f"size must be between 1 and {LARGEST} pixels a side, got {side}")


def _dots(width: int, panels: int) -> float:
    """Pixels an inch: letters grow with a panel, and stay legible in a small one."""
    return 100 * max(width / panels / SIZE[0], 0.75)


def _columns(inches: float) -> int:
    return max(int(inches / COLUMN), 1)


def plane_width(width: int, panels: int) -> float:
    """Inches, of each of the planes in a figure so many pixels wide."""
    return (width / _dots(width, panels) - LEFT - RIGHT - GAP * (panels - 1)) / panels


def around(width: int, panels: int, strips: int, marks: int) -> float:
    """Inches, of the height that is not the planes'."""
    rows = -(-marks // _columns(width / _dots(width, panels)))
    below = strips * STRIP + (strips - 1) * GAP / 2 + AXIS if strips else 0.0
    return TOP + AXIS + below + rows * ROW + 0.05


def height_for(width: int, panels: int, strips: int, marks: int, ratio: float) -> int:
    """Pixels, an even number, of a figure whose planes are `ratio` times as high as wide."""
    inches = around(width, panels, strips, marks) + ratio * plane_width(width, panels)
    return 2 * round(inches * _dots(width, panels) / 2)
