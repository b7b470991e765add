"""What smoothing, and a second motion model, are worth on targets that turn.

A recorded path is the truth, and is detected with simulated noise, misses and false alarms:

    python benchmarks/smoothing.py                    # the recorded flights of the package
    python benchmarks/smoothing.py UAV_Rot.csv        # positions of one target, in any file that is read
"""

import argparse
from pathlib import Path

import numpy as np

from gmr_gym.data import flight, flight_names
from gmr_gym.recorded import LiveTracker, SensorSpec, cut, from_arrays, read, smooth, track, tracking_model
from gmr_gym.recorded.model import TRACKERS
from gmr_gym.recorded.tracks import COASTED, CONFIRMED, joined_rows

QUIET = 0.3  # m/s^2, of a target that does not turn
LAG = 5  # scans
DETECTION, FALSE = 0.9, 1.0  # probability of detection, and false alarms a scan
FAR = 5.0  # deviations of the sensor from the truth beyond which a track is none of the target
TURN = 1.0  # m/s^2 across the course, from which the target counts as turning


def paths(file: Path | None) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Times (T,), s, and positions (T, 2), m, by name."""
    if file is None:
        found = {name: flight(name) for name in flight_names()}
        return {name: (np.arange(float(len(x))), x) for name, x in found.items()}
    found = read(file)
    return {file.name: (found.time, found.z[:, :2])}


def velocity_and_turning(time: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Velocity (T, 2) of the truth, and where it turns (T,)."""
    v = np.gradient(x, time, axis=0)
    a = np.gradient(v, time, axis=0)
    speed = np.linalg.norm(v, axis=1)
    across = np.abs(v[:, 0] * a[:, 1] - v[:, 1] * a[:, 0]) / np.maximum(speed, 1e-9)
    return v, across > TURN


def rows_of(
    time: np.ndarray, x: np.ndarray, deviation: float, motion: tuple[float, ...], seed: int, tracker: str
):
    """Filtered, late and smoothed rows of tracks of one simulated recording of the path."""
    rng = np.random.default_rng(seed)
    low, high = x.min(axis=0) - 10 * deviation, x.max(axis=0) + 10 * deviation
    at, z = [], []
    for t, place in zip(time, x, strict=True):
        seen = rng.normal(place, deviation, (int(rng.random() < DETECTION), 2))
        false = rng.uniform(low, high, (rng.poisson(FALSE), 2))
        z += [seen, false]
        at += [t] * (len(seen) + len(false))
    sensor = SensorSpec(
        "", deviation=(deviation, deviation), detection_probability=DETECTION, clutter_per_scan=FALSE
    )
    found = from_arrays(at, np.concatenate(z), sensors=[sensor])
    speed = 1.5 * np.linalg.norm(velocity_and_turning(time, x)[0], axis=1).max()
    model = tracking_model(
        [sensor], low, high, acceleration_deviation=motion, max_speed=speed, tracker=tracker
    )
    scans, live = cut(found), LiveTracker(model, lag=LAG)
    tracks, late = track(found, scans, model), []
    for scan in scans:
        live.update(scan.time, found.z[scan.rows])
        late.append(live.smoothed())
    late = joined_rows([*late, *(live.smoothed(lag) for lag in range(LAG - 1, -1, -1))])
    return tracks, late, smooth(tracks, found, model)


def errors(
    time: np.ndarray, x: np.ndarray, deviation: float, motion: tuple[float, ...], seed: int, tracker: str
):
    """Of each scan at which a confirmed track is near the truth: whether the truth turns there, and squared
    errors of position and velocity (3,), filtered, late and smoothed; and the share of such scans."""
    v, turning = velocity_and_turning(time, x)
    found = rows_of(time, x, deviation, motion, seed, tracker)
    tracks, there = found[0], []
    for t in range(len(time)):
        declared = (tracks.status == CONFIRMED) | (tracks.status == COASTED)
        rows = np.flatnonzero(declared & (tracks.time == time[t]))
        away = np.linalg.norm(tracks.x[rows, :2] - x[t], axis=1)
        if len(rows) and away.min() < FAR * deviation:
            row = rows[away.argmin()]
            off = [each.x[row] - [*x[t], *v[t]] for each in found]
            there.append([turning[t], *(o[:2] @ o[:2] for o in off), *(o[2:] @ o[2:] for o in off)])
    return np.array(there), len(there) / len(time)


def table(
    file: Path | None, deviation: float, acceleration: float, runs: int, tracker: str = "pmb"
) -> list[str]:
    """Lines of a Markdown table."""
    heads = [f"{where}, {unit}" for unit in ("m", "m/s") for where in ("in turns", "elsewhere")]
    lines = [f"| path | motion | followed, % | {' | '.join(heads)} |", "|---" * 7 + "|"]
    for name, (time, x) in paths(file).items():
        for motion in (QUIET,), (acceleration,), (QUIET, acceleration):
            made = [errors(time, x, deviation, motion, seed, tracker) for seed in range(runs)]
            found = np.concatenate([each for each, _ in made])
            turns = found[:, 0] == 1
            cells = [rms(found[where, of]) for of in (slice(1, 4), slice(4, 7)) for where in (turns, ~turns)]
            followed = 100 * np.mean([share for _, share in made])
            title = f"{' and '.join(f'{one:g}' for one in motion)} m/s²"
            lines.append(f"| {name} | {title} | {followed:.0f} | {' | '.join(cells)} |")
    return lines


def rms(squares: np.ndarray) -> str:
    """Root mean squares: filtered / late / smoothed."""
    if not len(squares):
        return "-"
    return " / ".join(f"{one:.3g}" for one in np.sqrt(squares.mean(axis=0)))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("file", nargs="?", type=Path, help="positions of one target, taken as the truth")
    parser.add_argument("--deviation", type=float, default=20.0, help="of the simulated sensor, m")
    parser.add_argument("--acceleration", type=float, default=3.0, help="of a target that turns, m/s^2")
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--tracker", choices=TRACKERS, default=TRACKERS[0])
    asked = parser.parse_args()
    print("\n".join(table(asked.file, asked.deviation, asked.acceleration, asked.runs, asked.tracker)))
