"""Validation of points given by the user, rows of a scan or of a set: their shape, their range, the
absent rows."""

import numpy as np

from gmr_gym.kernels import leaf_kernel

# m or rad, of any coordinate: components updated with detections farther away could not be merged, because
# their covariances would be lost in rounding beside the squares of such distances
FARTHEST = 1e10


def check_points(z, p: int, farthest: float = FARTHEST) -> np.ndarray:
    """The points as a float array of its own.

    Parameters
    ----------
    z : array_like (k, p)
        Points; empty for none. A row with a masked coordinate is absent.
    p : int
        Dimension of a point.
    farthest : float
        Limit of the absolute value of a coordinate, m or rad.

    Returns
    -------
    ndarray (k, p)
        Without the absent rows; (0, p) for none.

    Raises
    ------
    ValueError
        For another shape, for entries that are not numbers, and for a row that is not finite or beyond
        +-`farthest`. The row is counted without the absent ones.

    Examples
    --------
    >>> check_points([[1, 2], [3, 4]], 2).tolist()
    [[1.0, 2.0], [3.0, 4.0]]
    >>> check_points([], 2).shape
    (0, 2)
    """
    try:
        z = np.asarray(present(z))
        z = z.astype(float, order="C", casting="same_kind") if z.size else np.empty((0, p))
    except (TypeError, ValueError):
        raise ValueError(f"z must be numbers of shape (k, {p}), one detection a row") from None
    if z.ndim != 2 or z.shape[1] != p:
        raise ValueError(f"z must have shape (k, {p}), one detection a row, got {z.shape}")
    row = _first_beyond(z, farthest)
    if row >= 0:
        if not np.isfinite(z[row]).all():
            raise ValueError(f"z must be finite; row {row} is not")
        raise ValueError(f"z must lie within +-{farthest:g}; row {row} is {z[row].tolist()}")
    return z


def present(points):
    """The points without the rows that have a masked entry; returned as they are if nothing is masked."""
    hidden = absent(points)
    return points if hidden is None else np.ma.getdata(points)[~hidden]


def absent(points) -> np.ndarray | None:
    """Mask (k,) of the rows of points (k, ...) with a masked entry; None for points that cannot be masked."""
    if type(points) is np.ndarray:
        return None
    if isinstance(points, list | tuple) and any(isinstance(row, np.ma.MaskedArray) for row in points):
        points = np.ma.array(points)
    if not isinstance(points, np.ma.MaskedArray):
        return None
    hidden = np.ma.getmaskarray(points)
    return np.asarray(hidden.any(axis=tuple(range(1, hidden.ndim))))


def check_unmasked(name: str, values) -> None:
    """Raise ValueError naming the argument if any of its values is masked."""
    hidden = absent(values)
    if hidden is not None and hidden.any():
        raise ValueError(f"{name} must be given in full, but some of it is masked")


@leaf_kernel
def _first_beyond(z, limit):
    """First row of z (k, p) with a coordinate outside +-limit, or not a number; -1 if there is none."""
    for j in range(z.shape[0]):
        for r in range(z.shape[1]):
            if not abs(z[j, r]) <= limit:
                return j
    return -1
