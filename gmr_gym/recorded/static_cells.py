"""Spots at which something is detected again and again: piers, masts, what is moored."""

from collections.abc import Sequence

import numpy as np

from gmr_gym.recorded.scans import Scan

CELL = 10.0  # m, side of the cells in which returns at one spot are counted
STATIC = 0.3  # share of the scans from which on a cell holds something that does not move


def static_rows(points: np.ndarray, scans: Sequence[Scan]) -> tuple[np.ndarray, int]:
    """Detections in cells that are hit in more than `STATIC` of the scans.

    Parameters
    ----------
    points : ndarray (n, p)
        Local positions of the detections, m.
    scans : sequence of Scan

    Returns
    -------
    rows : ndarray of bool (n,)
    cells : int
        How many cells there are of this kind.
    """
    number = np.zeros(len(points), int)
    for i, scan in enumerate(scans):
        number[scan.rows] = i
    cells, cell = np.unique(np.floor(points[:, :2] / CELL), axis=0, return_inverse=True)
    seen = np.unique(np.column_stack([cell.ravel(), number]), axis=0)[:, 0]
    often = np.bincount(seen, minlength=len(cells)) > STATIC * max(len(scans), 1)
    return often[cell.ravel()], int(often.sum())
