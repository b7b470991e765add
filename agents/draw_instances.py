"""Draws the tables in `gmr_gym/data/instances/`; `python -m agents.draw_instances` writes them again.

An instance that no tracker can follow teaches nothing: one is kept if a tracker that prunes little loses no
more than seven runs of ten on it.
"""

import csv
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from gmr_gym import data
from gmr_gym.envs.tuning import ReductionTuningEnv
from gmr_gym.tuning.instances import SCANS, TABLES, Instance, trajectory
from gmr_gym.tuning.thresholds import Thresholds, to_action

SIZES = (56, 16, 24, 12)  # rows, table by table
SEED = 20261122
RUNS, MOST_LOST = 10, 7
THOROUGH = Thresholds(alpha=0.05, prune=1e-5)
JUMPS = "jump-markov"
SEEN = (
    "turning-target", JUMPS, "refuelling-orbit", "agile-flight", "zero-gravity-departure", JUMPS,
    "turning-target", "zero-gravity-parabolas",
)  # fmt: skip
# largest acceleration, m/s^2, clutter rate, P_D, and the share of that acceleration that the filter is told
INSIDE = (6.0, (50, 400), (0.7, 0.98), (0.4, 1.3))
# one number lies beyond its range and the others where the target can be followed all the same
BEYOND = ((3.0, (450, 600), (0.85, 0.98), (1.0, 2.5)), (3.0, (50, 100), (0.6, 0.7), (1.0, 2.5)))
UNSEEN = ("refuelling-racetrack", JUMPS, "zero-gravity-turn")  # in the table of extrapolation alone


def main(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for number, (table, size) in enumerate(zip(TABLES, SIZES, strict=True)):
        rng = np.random.default_rng((SEED, number))
        names = UNSEEN if table == "extrapolation" else SEEN
        # clutter decides most, and in a few rows it falls as it may: each has a share of its range of its own
        shares = (rng.permutation(size) + rng.random(size)) / size
        kept: list[Instance] = []
        while len(kept) < size:
            row = len(kept)
            candidate = drawn(rng, f"{table}-{row:02}", names[row % len(names)], number, shares[row])
            if followed(candidate):
                kept.append(candidate)
                print(*candidate, flush=True)
        write(folder / f"{table}.csv", kept)


def drawn(rng: np.random.Generator, name: str, kind: str, number: int, share: float) -> Instance:
    """A candidate of table `number`, its clutter at that share of its range. The paths of one table that are
    drawn are in no other."""
    path = f"{JUMPS}-{100 * number + rng.integers(100)}" if kind == JUMPS else kind
    x = trajectory(path)
    first = int(rng.integers(max(1, len(x) - SCANS)))
    peak = np.linalg.norm(np.diff(x[first : first + SCANS + 1, :2], 2, axis=0), axis=1).max()  # m/s^2
    ranges = INSIDE if TABLES[number] != "extrapolation" else BEYOND[rng.integers(len(BEYOND))]
    hardest, rates, probabilities, expectations = ranges
    manoeuvre = min(in_log(rng.random(), (1.0, hardest)) / peak, 2.0)
    rate = in_log(share, rates)
    seen = rng.uniform(*probabilities)
    deviation = rng.uniform(5, 12)
    told = deviation * rng.uniform(0.9, 1.2)
    expected = max(0.8, manoeuvre * peak * in_log(rng.random(), expectations))
    numbers = (manoeuvre, rate, seen, deviation, told, expected)
    return Instance(name, path, first, *(float(f"{value:.3g}") for value in numbers))


def in_log(share: float, ends: tuple[float, float]) -> float:
    """The number at a share of the way between two ends, on a logarithmic scale."""
    return float(ends[0] * (ends[1] / ends[0]) ** share)


def followed(instance: Instance) -> bool:
    """Whether a tracker that prunes little loses no more than MOST_LOST of RUNS episodes."""
    with TemporaryDirectory() as folder:
        write(Path(folder) / "one.csv", [instance])
        env = ReductionTuningEnv(instances=str(Path(folder) / "one.csv"))
    action, count = to_action(THOROUGH, env.parameters), 0
    for seed in range(RUNS):
        env.reset(seed=seed)
        terminated = truncated = False
        while not (terminated or truncated):
            _, _, terminated, truncated, _ = env.step(action)
        count += terminated
        if count > MOST_LOST:
            return False
    return True


def write(file: Path, rows: list[Instance]) -> None:
    with file.open("w", newline="", encoding="utf-8") as stream:
        csv.writer(stream, lineterminator="\n").writerows([Instance._fields, *rows])


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(data.__file__).parent / "instances")
