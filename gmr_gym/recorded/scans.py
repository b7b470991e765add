"""Detections cut into scans."""

from typing import NamedTuple

import numpy as np


class Scan(NamedTuple):
    """Detections of one look of one sensor over what it covers."""

    time: float  # s, of the whole scan: its last row
    first: float  # s, of its first row
    last: float  # s, of its last row
    rows: np.ndarray  # (k,) int, indices into `Detections`, in order of time
    sensor: int
    azimuths: tuple[float, float] | None = None  # rad, from and to, of a sensor that turns
