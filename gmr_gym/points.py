"""The door for points from outside, rows of a scan or of a set: what is a point, and which are there."""

import numpy as np

from gmr_gym.kernels import leaf_kernel

# m or rad, of any coordinate: filters drawn apart by detections farther away could not be merged, for their
# covariances drown in the squares of such distances
FARTHEST = 1e10


def check_points(z, p: int, farthest: float = FARTHEST) -> np.ndarray:
    """The points z as floats of their own (k, p), (0, p) for none; a row with a masked coordinate is absent.

    ValueError when the shape does not fit, for what is no number, and naming the row, as counted without the
    absent, for one that is not finite or has a coordinate beyond +-`farthest`."""
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
    """Without the rows in which anything is masked; what masks nothing is returned as it is."""
    hidden = absent(points)
    return points if hidden is None else np.ma.getdata(points)[~hidden]


def absent(points) -> np.ndarray | None:
    """Which rows (k,) of points (k, ...) have anything masked; None where nothing can be."""
    if type(points) is np.ndarray:
        return None
    if isinstance(points, list | tuple) and any(isinstance(row, np.ma.MaskedArray) for row in points):
        points = np.ma.array(points)
    if not isinstance(points, np.ma.MaskedArray):
        return None
    hidden = np.ma.getmaskarray(points)
    return np.asarray(hidden.any(axis=tuple(range(1, hidden.ndim))))


def check_unmasked(name: str, values) -> None:
    """Raise ValueError naming the argument if any of the values is masked, where none can be absent."""
    hidden = absent(values)
    if hidden is not None and hidden.any():
        raise ValueError(f"{name} must be given in full, but some of it is masked")


@leaf_kernel
def _first_beyond(z, reach):
    """The first row of z (k, p) with a coordinate that is not within +-reach, -1 for none."""
    for j in range(z.shape[0]):
        for r in range(z.shape[1]):
            if not abs(z[j, r]) <= reach:
                return j
    return -1
