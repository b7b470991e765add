"""Where the detections of no track lie: cells of the place, beside what clutter spread evenly would give."""

from collections.abc import Iterator

import numpy as np
from scipy.spatial import ConvexHull
from scipy.special import pdtrik

from gmr_gym.recorded.figures import Figure

CELLS = 100  # that the place is cut into, about
FULLEST = 3  # cells that are named
ERROR = 0.025  # probability that any cell of evenly spread clutter has more than expected


def unused_by_cell(points: np.ndarray, left: np.ndarray, scans: int) -> Iterator[Figure]:
    """Figures of the detections of no track by cells, squares of one size.

    Parameters
    ----------
    points : ndarray (n, 2)
        Of all detections, m; not all on a line.
    left : ndarray (n,)
        Probability of each to be of no track.
    scans : int

    Yields
    ------
    Figure
        The index of dispersion of their numbers over the cells whose middle is within the convex hull of all
        detections: 1 for clutter spread evenly, more where it gathers. Then the fullest cells, each by its
        middle, with the number a scan.
    """
    hull, low, extent = ConvexHull(points), points.min(axis=0), np.ptp(points, axis=0).max()
    side = max(np.sqrt(hull.volume / CELLS), extent / CELLS)
    cell = np.floor((points - low) / side).astype(int)
    counts = np.zeros(cell.max(axis=0) + 1)
    np.add.at(counts, tuple(cell.T), left)
    middle = low + side * (np.indices(counts.shape).reshape(2, -1).T + 0.5)
    within = (middle @ hull.equations[:, :2].T + hull.equations[:, 2] <= 0).all(axis=1)
    middle, count = middle[within], counts.ravel()[within]
    n = len(count)
    if n < 2 or not count.any():
        return
    mean, half = float(count.mean()), 2 * np.sqrt(2 / (n - 1))
    name = f"index of dispersion of unused detections over cells of {side:.3g} m"
    yield Figure(name, float(count.var(ddof=1) / mean), "", n, max(1 - half, 0.0), 1 + half)
    most, digits = np.ceil(pdtrik(1 - ERROR / n, mean)) / scans, max(0, int(np.ceil(1 - np.log10(side))))
    for i in np.argsort(-count, kind="stable")[:FULLEST]:
        about = ", ".join(f"{one:.{digits}f}" for one in middle[i])
        yield Figure(
            f"cell about {about} m: unused detections a scan", count[i] / scans, "", scans, 0.0, most
        )
