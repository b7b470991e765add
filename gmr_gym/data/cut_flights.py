"""Cut the segments of `flights/` from the samples of the Python package `traffic` 2.13.

    python gmr_gym/data/cut_flights.py SAMPLES_DIR

SAMPLES_DIR is `traffic/data/samples` of the unpacked wheel. Prints the
numbers quoted in `flights/LICENCE.md`.
"""

import gzip
import json
import sys
from datetime import datetime
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.interpolate import make_smoothing_spline

TAU = 4.0  # s, a sinusoid of period 2 pi TAU = 25 s loses half its amplitude
MARGIN = 30  # s smoothed on either side and then dropped: splines are poor at their ends
LONGEST_GAP = 2.0  # s between two fresh positions
WORST_LATENESS = 1.0  # s of flight: a stamp is only good to the second it fell in
WORST_ACROSS = 30.0  # m


class Segment(NamedTuple):
    """One file to write."""

    name: str
    sample: str  # path below SAMPLES_DIR
    start: str  # UTC
    duration: int  # s


ZERO_GRAVITY = "featured/zero_gravity.json.gz"
REFUELLING = "military/inflight_refuelling.json.gz"

SEGMENTS = (
    Segment("refuelling-orbit", REFUELLING, "2020-06-30T22:11:26Z", 300),
    Segment("refuelling-racetrack", REFUELLING, "2020-06-30T21:24:06Z", 300),
    Segment("zero-gravity-departure", ZERO_GRAVITY, "2020-06-25T07:17:27Z", 200),
    Segment("zero-gravity-parabolas", ZERO_GRAVITY, "2020-06-25T07:51:47Z", 300),
    Segment("zero-gravity-turn", ZERO_GRAVITY, "2020-06-25T08:39:32Z", 300),
)


def main(samples):
    """Write every segment and print its row of numbers."""
    for segment in SEGMENTS:
        callsign, stamps, latlon_deg = fixes(samples / segment.sample, segment)
        x, along, across = smoothed(stamps, east_north(latlon_deg), segment)
        path = Path(__file__).parent / "flights" / f"{segment.name}.csv"
        path.write_text(text(segment, callsign, x, along, across), encoding="utf-8")
        print(segment.name, summary(x), f"residual rms {along:.0f} m along, {across:.1f} m across")


def fixes(path, segment):
    """Callsign, seconds after the segment's start (k,) and [lat, lon] (k, 2) of its fresh fixes."""
    start = datetime.fromisoformat(segment.start).timestamp()
    rows = [
        (row["timestamp"] / 1000 - start, row["latitude"], row["longitude"], row["callsign"])
        for row in json.loads(gzip.decompress(path.read_bytes()))
    ]
    rows = [row for row in rows if -MARGIN <= row[0] <= segment.duration + MARGIN]
    # a second without a new position repeats the last one, which is no fix
    rows = rows[:1] + [row for last, row in pairwise(rows) if row[1:3] != last[1:3]]
    stamps = np.array([row[0] for row in rows])
    if np.diff(stamps).max() > LONGEST_GAP:
        raise ValueError(
            f"{segment.name} has a gap of {np.diff(stamps).max():.0f} s, more than "
            f"{LONGEST_GAP:.0f} s; choose another start"
        )
    return rows[0][3], stamps, np.array([row[1:3] for row in rows], float)


def east_north(latlon_deg):
    """Metres (k, 2) in the plane tangent to the WGS-84 ellipsoid at the first of [lat, lon] (k, 2).

    Heights are left out: 9 km up, a metre over the ground is 1.0014 m in the air.
    """
    a, e2 = 6378137.0, 6.69437999014e-3  # equatorial radius in m, eccentricity squared
    lat, lon = np.radians(latlon_deg).T
    normal = a / np.sqrt(1 - e2 * np.sin(lat) ** 2)
    earth_centred = np.stack(
        [
            normal * np.cos(lat) * np.cos(lon),
            normal * np.cos(lat) * np.sin(lon),
            normal * (1 - e2) * np.sin(lat),
        ],
        axis=1,
    )
    (sin_lat, sin_lon), (cos_lat, cos_lon) = np.sin([lat[0], lon[0]]), np.cos([lat[0], lon[0]])
    east = [-sin_lon, cos_lon, 0.0]
    north = [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat]
    return (earth_centred - earth_centred[0]) @ np.array([east, north]).T


def smoothed(stamps, z, segment):
    """Positions (T, 2) at 1 Hz from the origin, and the rms of the residuals along and across track.

    The cubic spline minimises the sum of squared residuals plus TAU^4 times the integral of
    squared acceleration. The residuals are nearly all along track, where a stamp some tenths of
    a second wrong is tens of metres.
    """
    splines = [make_smoothing_spline(stamps, c, lam=TAU**4) for c in z.T]
    v = np.stack([spline.derivative()(stamps) for spline in splines], axis=1)
    residual = z - np.stack([spline(stamps) for spline in splines], axis=1)
    speed = np.hypot(*v.T)
    along = (residual * v).sum(1) / speed
    across = (residual[:, 1] * v[:, 0] - residual[:, 0] * v[:, 1]) / speed
    inside = (stamps >= 0) & (stamps <= segment.duration)
    late, wide = abs(along / speed)[inside].max(), abs(across[inside]).max()
    if late > WORST_LATENESS or wide > WORST_ACROSS:
        raise ValueError(
            f"{segment.name} holds an outlier, {late:.1f} s along track or {wide:.0f} m across, "
            f"beyond {WORST_LATENESS:.0f} s or {WORST_ACROSS:.0f} m; choose another start"
        )
    seconds = np.arange(segment.duration + 1.0)
    x = np.stack([spline(seconds) for spline in splines], axis=1)
    return x - x[0], np.sqrt(np.mean(along[inside] ** 2)), np.sqrt(np.mean(across[inside] ** 2))


def text(segment, callsign, x, along, across):
    """The file: comments, column names, rows."""
    rows = [f"{t},{east:.2f},{north:.2f}\n" for t, (east, north) in enumerate(x + 0.0)]
    return (
        "# Aircraft track from the Python package traffic 2.13 by Xavier Olive, MIT licence"
        " (see LICENCE.md)\n"
        f"# flight {callsign}, sample {segment.sample}, from {segment.start}\n"
        "# ADS-B latitude and longitude, projected on the plane tangent to WGS-84 at the start,\n"
        f"# stale positions dropped, cubic smoothing spline, lam = ({TAU:.0f} s)^4, read at 1 Hz\n"
        f"# smoothed away, rms: {along:.0f} m along track (late stamps), {across:.1f} m across\n"
        "time_s,east_m,north_m\n" + "".join(rows)
    )


def summary(x):
    """Duration, speeds, peak accelerations along and across track, heading swept."""
    v, a = (x[2:] - x[:-2]) / 2, x[2:] - 2 * x[1:-1] + x[:-2]  # at 1 Hz, so per second
    speed = np.hypot(*v.T)
    along = (a * v).sum(1) / speed
    across = (v[:, 0] * a[:, 1] - v[:, 1] * a[:, 0]) / speed
    heading = np.degrees(np.unwrap(np.arctan2(v[:, 0], v[:, 1])))
    return (
        f"{len(x) - 1} s, {speed.min():.0f}-{speed.max():.0f} m/s, peak acceleration "
        f"{abs(along).max():.1f} m/s^2 along, {abs(across).max():.1f} across, "
        f"{np.hypot(*a.T).max():.1f} in all, headings span {np.ptp(heading):.0f} degrees"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
