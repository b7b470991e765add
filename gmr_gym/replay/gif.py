"""Films as .gif files, written frame by frame in the colours that canvases draw with."""

from collections.abc import Iterable
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from gmr_gym.envs.render_marks import INKS, PAPER

STAYS = 1.5  # seconds, that the last frame of a .gif is shown
# shares of an ink in a pixel at an edge of what it draws, or that is drawn faintly
TINTS = 1.0, 0.82, 0.65, 0.49, 0.34, 0.2, 0.08


class Palette:
    """The colours of a .gif, the same for every film: inks as they are, their tints, and what two of them mix
    to. So no colour flickers, and one that covers little is there from the first frame to the last.

    Attributes
    ----------
    colours : ndarray (n, 3)
    """

    def __init__(self) -> None:
        from PIL import ImageColor

        *inks, paper = np.array([ImageColor.getrgb(ink) for ink in (*INKS, PAPER)], float)
        tints = [paper + share * (ink - paper) for ink in inks for share in TINTS]
        mixed = [(one + other) / 2 for one, other in combinations(inks, 2)]
        self.colours = np.round([paper, *tints, *mixed]).astype(np.uint8)
        self._tree = cKDTree(self.colours)
        self._nearest = np.full(1 << 24, len(self.colours), np.uint8)  # by colour, where it has been met

    def indices(self, picture: np.ndarray) -> np.ndarray:
        """Rows of `colours` (height, width), the nearest to each pixel of a picture."""
        numbers = picture.astype(np.uint32) @ np.array([1 << 16, 1 << 8, 1], np.uint32)
        new = np.unique(numbers[self._nearest[numbers] == len(self.colours)])
        self._nearest[new] = self._tree.query(np.stack([new >> 16, new >> 8 & 255, new & 255], axis=1))[1]
        return self._nearest[numbers]


def write_gif(out: Path, pictures: Iterable[np.ndarray], total: int, fps: float) -> None:
    """Write pictures to a .gif file, one by one, in one palette.

    Each frame is the part that differs from the frame before, see-through where it does not.

    Parameters
    ----------
    out : Path
    pictures : iterable of ndarray (height, width, 3)
    total : int
        How many there are: the last one stays a moment.
    fps : float
        Frames a second.
    """
    from PIL import Image
    from PIL.GifImagePlugin import getdata, getheader

    palette = Palette()
    clear, colours = len(palette.colours), palette.colours.tobytes() + bytes(3)
    before = None
    with out.open("wb") as file:
        for i, picture in enumerate(pictures):
            now = palette.indices(picture)
            rows, columns = _differing(now, before)
            part = now[rows, columns]
            if before is not None:
                part = np.where(part == before[rows, columns], clear, part).astype(np.uint8)
            image = Image.fromarray(part)
            image.putpalette(colours)
            if before is None:
                file.writelines(getheader(image, info={"loop": 0})[0])
            last = i == total - 1
            file.writelines(getdata(
                image, (columns.start, rows.start), transparency=clear, disposal=1,
                duration=round(100 / fps) * 10 + 1000 * STAYS * last,
            ))  # fmt: skip
            before = now
        file.write(b";")


def _differing(now: np.ndarray, before: np.ndarray | None) -> tuple[slice, slice]:
    """Rows and columns of the box in which two frames differ; one pixel where they do not."""
    if before is None:
        return slice(0, now.shape[0]), slice(0, now.shape[1])
    differs = now != before
    sides = (np.flatnonzero(differs.any(axis=axis)) for axis in (1, 0))
    rows, columns = (slice(side[0], side[-1] + 1) if len(side) else slice(0, 1) for side in sides)
    return rows, columns
