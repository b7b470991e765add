"""Draws the tables of `ReductionTuning-v1` in `gmr_gym/data/instances/`; the command
`python -m agents.draw_wide_instances` writes them again.

The filter model assumes from a fifth to two and a half times the largest acceleration of the path, and beyond
that in the table of extrapolation. An instance is kept if a tracker that assumes the right noise, and prunes
little, loses no more than seven runs of ten on it.
"""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from agents.draw_instances import JUMPS, MOST_LOST, RUNS, in_log, write
from gmr_gym import data
from gmr_gym.envs.tuning import ReductionTuningEnv
from gmr_gym.tuning.instances import SCANS, WIDE, Instance, trajectory
from gmr_gym.tuning.thresholds import RANGES, Thresholds, to_action

SIZES = (96, 24, 48, 24, 12)  # rows, table by table
SEED = 20261129
SEEN = (
    "turning-target",
    JUMPS,
    "refuelling-orbit",
    JUMPS,
    "agile-flight",
    JUMPS,
    "zero-gravity-departure",
    JUMPS,
)
UNSEEN = ("refuelling-racetrack", JUMPS, "zero-gravity-parabolas", "zero-gravity-turn")
RECORDED = ("refuelling-racetrack", "zero-gravity-parabolas", "zero-gravity-turn")  # flown as they were
SHARE = 0.7  # of the largest acceleration: the right process noise, about


class Ranges(NamedTuple):
    """What the numbers of an instance are drawn from."""

    acceleration: tuple[float, float] = (0.5, 8.0)  # m/s^2, the largest of the path
    clutter_rate: tuple[float, float] = (20.0, 500.0)
    detection_probability: tuple[float, float] = (0.6, 0.98)
    sensor_deviation: tuple[float, float] = (3.0, 15.0)  # m
    told_sensor: tuple[float, float] = (0.7, 1.4)  # of the true deviation
    told_acceleration: tuple[float, float] = (0.2, 2.5)  # of the largest acceleration


INSIDE = Ranges()
# one number lies beyond its range, and the acceleration where the target can be followed all the same
BEYOND = (
    Ranges((0.5, 4.0), clutter_rate=(550, 900), detection_probability=(0.8, 0.98)),
    Ranges((0.5, 4.0), clutter_rate=(20, 100), detection_probability=(0.45, 0.6)),
    Ranges((0.5, 8.0), told_acceleration=(0.1, 0.2)),
    Ranges((0.5, 4.0), told_acceleration=(2.5, 5.0)),
)


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for number in range(len(WIDE)):
        kept = list(rows_of(number))
        write(folder / f"{WIDE[number]}.csv", kept)
        print(f"{WIDE[number]}: {len(kept)} rows", flush=True)


def rows_of(number: int):
    """The rows of table `number`, one after the other."""
    rng, table, size = np.random.default_rng((SEED, number)), WIDE[number], SIZES[number]
    names = {"wide-extrapolation": UNSEEN, "real": RECORDED}.get(table, SEEN)
    # clutter and the assumed noise decide most, and in a few rows they fall as they may
    clutter, told = ((rng.permutation(size) + rng.random(size)) / size for _ in range(2))
    for row in range(size):
        ranges = BEYOND[row // len(UNSEEN) % len(BEYOND)] if table == "wide-extrapolation" else INSIDE
        while True:
            shares = float(clutter[row]), float(told[row])
            candidate = drawn(rng, f"{table}-{row:02}", names[row % len(names)], number, ranges, shares)
            if followed(candidate):
                yield candidate
                break


def drawn(
    rng: np.random.Generator, name: str, kind: str, number: int, ranges: Ranges, shares: tuple[float, float]
) -> Instance:
    """A candidate of table `number`, clutter and assumed acceleration at these shares of their ranges. The
    paths of one table that are drawn are in no other."""
    path = f"{JUMPS}-{1000 + 200 * number + rng.integers(200)}" if kind == JUMPS else kind
    x = trajectory(path)
    first = int(rng.integers(max(1, len(x) - SCANS)))
    peak = acceleration_of(x[first : first + SCANS + 1])
    wanted = in_log(rng.random(), ranges.acceleration)
    manoeuvre = 1.0 if WIDE[number] == "real" else min(wanted / peak, 3.0)
    seen = rng.uniform(*ranges.detection_probability)
    deviation = in_log(rng.random(), ranges.sensor_deviation)
    told_deviation = deviation * in_log(rng.random(), ranges.told_sensor)
    told = max(manoeuvre * peak * in_log(shares[1], ranges.told_acceleration), 0.05)
    numbers = manoeuvre, in_log(shares[0], ranges.clutter_rate), seen, deviation, told_deviation, told
    return Instance(name, path, first, *(float(f"{value:.3g}") for value in numbers))


def acceleration_of(x: np.ndarray) -> float:
    """The largest acceleration along positions (T, >= 2), a row a second, m/s^2."""
    return float(np.linalg.norm(np.diff(x[:, :2], 2, axis=0), axis=1).max())


def followed(instance: Instance) -> bool:
    """Whether a tracker that assumes the right process noise loses at most MOST_LOST of RUNS episodes."""
    with TemporaryDirectory() as folder:
        write(Path(folder) / "one.csv", [instance])
        env = ReductionTuningEnv(
            ("history", "prune", "process_noise"), str(Path(folder) / "one.csv"), reducer="n-scan"
        )
    x = trajectory(instance.trajectory)[instance.first_scan :][: SCANS + 1]
    right = SHARE * instance.manoeuvre * acceleration_of(x) / instance.told_acceleration_deviation
    thorough = Thresholds(
        history=3, prune=1e-4, process_noise=float(np.clip(right, *RANGES["process_noise"]))
    )
    action, count = to_action(thorough, env.parameters), 0
    for seed in range(RUNS):
        env.reset(seed=seed)
        terminated = truncated = False
        while not (terminated or truncated):
            _, _, terminated, truncated, _ = env.step(action)
        count += terminated
        if count > MOST_LOST:
            return False
    return True


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(data.__file__).parent / "instances")
