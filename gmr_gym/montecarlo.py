"""Monte Carlo runs of trackers in a scenario: the loop, on any number of workers, resumable."""

import marshal
import os
import sys
import zlib
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple
from zipfile import BadZipFile

import joblib
import numpy as np
from threadpoolctl import threadpool_limits

from gmr_gym.association import crowding
from gmr_gym.crowd import ManyScenario
from gmr_gym.crowd_runs import CrowdRuns, crowd_once
from gmr_gym.play import play
from gmr_gym.simulate import Scenario, draw
from gmr_gym.tracker import Tracker
from gmr_gym.version import __version__

BLOCK = 20  # runs in one task, and in one file on disk
# of the package's source, what only looks at runs and has no part in them
LOOKERS = (
    "cli.py", "commands.py", "crowd_summary.py", "curves.py", "output.py", "summary.py", "watch.py",
    "reproduce", "envs",
)  # fmt: skip


class Runs(NamedTuple):
    """What one tracker did, run by run (first axis) and scan by scan (second)."""

    truth: np.ndarray  # (runs, T, d)
    x: np.ndarray  # (runs, T, d), estimates
    P: np.ndarray  # (runs, T, d, d), the covariances claimed for them
    components: np.ndarray  # (runs, T), hypotheses kept
    gate_volume: np.ndarray  # (runs, T), mean over the gates
    gated: np.ndarray  # (runs, T), detections in a gate, mean over the gates
    off_target: np.ndarray  # (runs, T), given up, or missed by the scenario's loss rule
    modes: np.ndarray  # (runs, T, r), probability of each of the motions the tracker knows
    seconds: np.ndarray  # (runs, T), of the tracker alone


def run(
    scenario: Scenario | ManyScenario,
    trackers: Mapping[str, Any],
    runs: int,
    seed: int = 0,
    *,
    jobs: int = 1,
    folder: Path | str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict[str, Any]:
    """Every tracker through the same `runs` episodes: what it did, as Runs, or of many targets as CrowdRuns.

    Run i draws its episode from (seed, i) alone, whatever the tracker and the number of runs or of
    workers; the results are the same to the last bit on any number of workers, `seconds` apart.
    With a `folder`, finished blocks of runs are kept there, found again by the content of scenario,
    tracker, seed and source code, and not run a second time. progress(done, total) counts runs.
    """
    if runs < 1:
        raise ValueError(f"runs must be at least 1, got {runs}")
    if not trackers:
        raise ValueError("trackers must hold at least one tracker")
    tasks = [(name, first) for name in trackers for first in range(0, runs, BLOCK)]
    files = {}
    if folder is not None:
        told = {name: joblib.hash((scenario, t, _code(t), seed, __version__)) for name, t in trackers.items()}
        files = {
            (name, first): Path(folder) / f"{told[name]}-{first}-{min(first + BLOCK, runs)}.npz"
            for name, first in tasks
        }
    results = {task: _load(file, _kind(scenario)) for task, file in files.items() if file.exists()}
    total = runs * len(trackers)
    done = sum(len(result.seconds) for result in results.values())
    missing = [task for task in tasks if task not in results]
    if progress:
        progress(done, total)
    for name in {name for name, _ in missing}:
        # compiled here, once: every worker then finds it on disk
        _once(scenario)(scenario, trackers[name], np.random.SeedSequence(seed), scans=3)
    calls = (
        joblib.delayed(_block)(scenario, trackers[name], seed, (name, first), runs) for name, first in missing
    )
    for task, result in joblib.Parallel(n_jobs=jobs, return_as="generator_unordered")(calls):
        results[task] = result
        if task in files:
            _save(files[task], result)
        done += len(result.seconds)
        if progress:
            progress(done, total)
    # blocks are let go as they are joined: the covariances of many runs are gigabytes
    return {
        name: _joined(
            _kind(scenario), np.concatenate, [results.pop(task) for task in tasks if task[0] == name]
        )
        for name in trackers
    }


def run_once(
    scenario: Scenario,
    tracker: Tracker,
    seed: int | np.random.SeedSequence,
    scans: int | None = None,
) -> Runs:
    """One run of all scans, or of the first few; the arrays of Runs without their first axis."""
    episode = draw(scenario, seed)
    rows = []
    unseen = np.full(len(scenario.sensor.R), np.nan)
    for t, (z, origin), report, seconds in islice(play(scenario, tracker, episode), scans):
        gates, x = report.gates, episode.x[t]
        placed = tracker.model.sensor.placed(z)
        own = placed[origin == 0]
        target = own[0] if len(own) else unseen
        rows.append((
            x, report.x[0], report.P[0], len(report.mixture.w), *crowding(gates, placed),
            not report.alive or scenario.off_target(gates, x, target), report.modes, seconds,
        ))  # fmt: skip
    return _joined(Runs, np.array, rows)


def _block(scenario, tracker, seed, task, runs) -> tuple[tuple[str, int], Runs]:
    first = task[1]
    # several threads would change the last bits of a sum, and only slow small matrices down
    with threadpool_limits(1):
        rows = [
            _once(scenario)(scenario, tracker, np.random.SeedSequence(seed, spawn_key=(i,)))
            for i in range(first, min(first + BLOCK, runs))
        ]
    return task, _joined(_kind(scenario), np.array, rows)


def _once(scenario: Scenario | ManyScenario) -> Callable:
    return crowd_once if isinstance(scenario, ManyScenario) else run_once


def _kind(scenario: Scenario | ManyScenario) -> type:
    return CrowdRuns if isinstance(scenario, ManyScenario) else Runs


def _joined(kind: type, join: Callable, rows: list):
    """Runs of many rows, field by field."""
    return kind(*map(join, zip(*rows, strict=True)))


def _code(tracker: Tracker) -> str:
    """Digest of the source that a run depends on, so that an edited tracker is run again."""
    things = list(_things(tracker))
    where = [getattr(sys.modules.get(thing.__module__), "__file__", None) for thing in things]
    # what was typed at a prompt has no file, but its own code
    typed = [
        marshal.dumps(thing.__code__.replace(co_filename=""))
        for thing, file in zip(things, where, strict=True)
        if file is None and hasattr(thing, "__code__")
    ]
    root = Path(__file__).parent
    own = [file for file in root.glob("**/*.py") if file.relative_to(root).parts[0] not in LOOKERS]
    files = sorted(own) + [Path(file) for file in sorted(filter(None, set(where)))]
    return joblib.hash([*typed, *(file.read_bytes() for file in files)])


def _things(tracker) -> Iterator[Callable]:
    """The class of a tracker and the functions it holds, and those of trackers that it holds."""
    yield type(tracker)
    for field in getattr(tracker, "__dataclass_fields__", ()):
        part = getattr(tracker, field, None)
        yield from _things(part) if hasattr(part, "__dataclass_fields__") else _functions(part)


def _functions(part) -> Iterator[Callable]:
    """The function, or those inside a partial one."""
    if isinstance(part, partial):
        for inner in (part.func, *part.args, *part.keywords.values()):
            yield from _functions(inner)
    elif callable(part):
        yield part


def _save(file: Path, result) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    partial = file.with_suffix(f".{os.getpid()}.part")
    with partial.open("wb") as stream:
        np.savez(stream, **result._asdict())
    partial.replace(file)


def _load(file: Path, kind):
    try:
        with np.load(file, allow_pickle=False) as stored:
            return kind(**{field: stored[field] for field in kind._fields})
    except (OSError, ValueError, KeyError, EOFError, zlib.error, BadZipFile) as error:
        raise ValueError(f"{file} is not a block of runs ({error}); delete it to have it run again") from None
