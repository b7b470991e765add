"""Small recordings of a radar, in files of the Autoferry form."""

import atexit
import json
from functools import cache
from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp

import numpy as np

from gmr_gym.envs.registry import RECORDED

START, PERIOD = 1.6e9, 2.0  # s since 1970, s
SHIPS = np.array([[0.0, 100.0, 3.0, 0.0], [400.0, 0.0, 0.0, -4.0]])  # x, y, vx, vy at START
MOST = 24  # detections in a scan


def place(t):
    """Where the ships are after t seconds, east and north."""
    return SHIPS[:, :2] + t * SHIPS[:, 2:]


def write_recording(folder: Path, name: str, scans: int, seed: int = 0) -> None:
    """Scans a period apart of a radar that moves north: both ships, 3 m off, and false alarms; scan 2 detects
    nothing, scan 3 ship 0 alone. Ship 1 is known until scan 5 only. Beside them are rows of a camera."""
    rng, records, known = np.random.default_rng(seed), [], []
    for t in range(scans):
        own = np.array([0.0, 5.0 * t])
        points = place(PERIOD * t) + 3.0 * rng.choice([-1, 1], (2, 2)) / 2**0.5
        false = rng.uniform([-500, 300], [900, 700], (MOST - 2 if t == 1 else rng.integers(4), 2))
        points = {2: np.empty((0, 2)), 3: points[:1]}.get(t, np.concatenate([points, false])) - own
        north_east = points[:, ::-1].T.tolist()
        if len(points) < 2:  # as the files have them
            north_east = [row[0] for row in north_east if row]
        time, at = START + PERIOD * t, own[::-1].tolist()
        records.append({"sensorID": 3, "time": time, "measurement": 0.4, "ownshipPosition": at})
        records.append({"sensorID": 2, "time": time, "measurement": north_east, "ownshipPosition": at})
    for t in np.arange(-1.0, PERIOD * scans, 0.5):
        ships = [
            {"targetID": i, "position": [y, x, 0.0], "time": START + t}
            for i, (x, y) in enumerate(place(t).tolist(), start=1)
        ]
        known.append(ships if t <= PERIOD * 5 else ships[:1])
    folder.mkdir(parents=True, exist_ok=True)
    (folder / f"{name}_detections.json").write_text(json.dumps(records))
    (folder / f"{name}_groundTruth.json").write_text(json.dumps(known))


def given(env_id: str) -> dict:
    """The arguments that an environment cannot be made without."""
    return {"folder": two_recordings()} if env_id in RECORDED else {}


@cache
def two_recordings() -> str:
    """A folder with a longer and a shorter recording."""
    folder = Path(mkdtemp())
    atexit.register(rmtree, folder, ignore_errors=True)
    write_recording(folder, "long", 20, seed=1)
    write_recording(folder / "below", "short", 8, seed=2)
    return str(folder)
