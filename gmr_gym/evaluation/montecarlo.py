"""Monte Carlo runs of trackers in a scenario: the loop, on any number of workers, resumable."""

from collections.abc import Callable, Container, Iterator, Mapping
from itertools import islice
from pathlib import Path
from threading import Lock
from typing import Any, NamedTuple

import joblib
import numpy as np
from threadpoolctl import threadpool_limits

from gmr_gym.evaluation import batch, blocks, source, workers
from gmr_gym.evaluation.loop import play
from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns, run_multi_target_once
from gmr_gym.filters.tracker import Tracker
from gmr_gym.models.gating import gate_statistics
from gmr_gym.simulation.multi_target import MultiTargetScenario
from gmr_gym.simulation.single_target import Scenario, draw
from gmr_gym.version import __version__

BLOCK = 20  # runs in one task, and in one file on disk
BATCH_FROM = 500  # runs from which it pays to compile the call that plays a block of them together
_ALONE = Lock()  # the threads of a worker share what limits them


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
    seconds: np.ndarray  # (runs, T), of the tracker alone; nan in a run played together with others


def run(
    scenario: Scenario | MultiTargetScenario,
    trackers: Mapping[str, Any],
    runs: int,
    seed: int = 0,
    *,
    jobs: int = 1,
    folder: Path | str | None = None,
    progress: Callable[[int, int], None] | None = None,
    backend: str = "loky",
    scheduler: str | None = None,
) -> dict[str, Any]:
    """Every tracker through the same `runs` episodes: what it did, as Runs, or of many targets as
    MultiTargetRuns.

    Run i draws its episode from (seed, i) alone, whatever the tracker and the number of runs or of
    workers; the results are the same to the last bit on any number of workers, `seconds` apart. `jobs`
    processes of this machine are the workers or, with the backend "dask" or "ray", all that the cluster at
    the address `scheduler` has. With a `folder`, finished blocks of runs are kept there, found again by the
    content of scenario, tracker, seed and source code, and not run a second time. progress(done, total)
    counts runs. Of at least MANY runs, those of a block are played by one compiled call where
    `gmr_gym.evaluation.batch` offers that, but for the first, which is timed as any tracker is. Raises
    workers.WorkersLost when they die again and again.
    """
    sweep = _Sweep(scenario, trackers, runs, seed, folder, progress, jobs, backend, scheduler)
    tasks, files = sweep.tasks(), sweep.files()
    results = dict(blocks.load_all(files, _kind(scenario)))
    if folder is not None:
        blocks.check_folder(Path(folder))
    results.update(_computed(sweep, tasks, results, files))
    # blocks are let go as they are joined: the covariances of many runs are gigabytes
    return {
        name: _joined(
            _kind(scenario), np.concatenate, [results.pop(task) for task in tasks if task[0] == name]
        )
        for name in trackers
    }


def run_shard(
    scenario: Scenario | MultiTargetScenario,
    trackers: Mapping[str, Any],
    runs: int,
    seed: int = 0,
    *,
    shard: tuple[int, int],
    folder: Path | str,
    jobs: int = 1,
    progress: Callable[[int, int], None] | None = None,
    backend: str = "loky",
    scheduler: str | None = None,
) -> tuple[int, int]:
    """One machine's part of `run`, kept in the folder: with shard (i, n) every n-th block of each tracker.
    How many blocks are in the folder then, and of how many.

    Which blocks these are their content decides, so n machines that share nothing do all of them, each
    once. The folders merged (`blocks.merge`), `run` finds every block.
    """
    i, n = shard
    if not 1 <= i <= n:
        raise ValueError(f"shard must be (i, n) with 1 <= i <= n, got {shard}")
    sweep = _Sweep(scenario, trackers, runs, seed, folder, progress, jobs, backend, scheduler)
    files = sweep.files()
    Path(folder).mkdir(parents=True, exist_ok=True)  # for `merge`, where this shard has nothing to do
    # not the first n-th for all: in a sweep of many small parts the first machine had the most to do
    mine = [task for task, file in files.items() if (int(file.name[:8], 16) + task[1] // BLOCK) % n == i - 1]
    # a damaged one is found now, not after all is merged
    there = {task for task, _ in blocks.load_all({task: files[task] for task in mine}, _kind(scenario))}
    for _ in _computed(sweep, mine, there, files):
        pass
    return sum(file.exists() for file in files.values()), len(files)


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
        placed = tracker.model.sensor.to_gate_space(z)
        own = placed[origin == 0]
        target = own[0] if len(own) else unseen
        rows.append((
            x, report.x[0], report.P[0], len(report.mixture.w), *gate_statistics(gates, placed),
            not report.alive or scenario.loss_rule(gates, x, target), report.modes, seconds,
        ))  # fmt: skip
    return _joined(Runs, np.array, rows)


class _Sweep(NamedTuple):
    """What `run` was asked."""

    scenario: Scenario | MultiTargetScenario
    trackers: Mapping[str, Any]
    runs: int
    seed: int
    folder: Path | str | None
    progress: Callable[[int, int], None] | None = None
    jobs: int = 1
    backend: str = "loky"
    scheduler: str | None = None

    def tasks(self) -> list[tuple[str, int]]:
        """Tracker and first run of each block."""
        if self.runs < 1:
            raise ValueError(f"runs must be at least 1, got {self.runs}")
        if not self.trackers:
            raise ValueError("trackers must hold at least one tracker")
        workers.check_workers(self.jobs, self.backend, self.scheduler)
        return [(name, first) for name in self.trackers for first in range(0, self.runs, BLOCK)]

    def size(self, task: tuple[str, int]) -> int:
        return min(BLOCK, self.runs - task[1])

    def files(self) -> dict[tuple[str, int], Path]:
        """Where each block is kept, if anywhere."""
        if self.folder is None:
            return {}
        # by themselves: hashed together they would tell whether a model is one object or two that are equal
        world = joblib.hash(self.scenario)
        told = {
            name: joblib.hash((world, joblib.hash(tracker), source.code(tracker), self.seed, __version__))
            for name, tracker in self.trackers.items()
        }
        return {
            task: blocks.named(self.folder, told[task[0]], task[1], task[1] + self.size(task))
            for task in self.tasks()
        }


def _computed(sweep: _Sweep, tasks: list, there: Container, files: Mapping) -> Iterator[tuple[Any, Any]]:
    """(task, block) of those of these tasks that are not there yet, as they are finished and kept."""
    missing = [task for task in tasks if task not in there]
    total, left = (sum(map(sweep.size, some)) for some in (tasks, missing))
    done, finished = total - left, len(tasks) - len(missing)
    if sweep.progress and tasks:
        sweep.progress(done, total)
    sources, twice = {}, 2 * [np.random.SeedSequence(sweep.seed)]
    for name in {name for name, _ in missing}:
        tracker = sweep.trackers[name]
        # compiled here, once: every worker of this machine then finds it on disk
        _played(sweep.scenario, tracker, twice, sweep.runs >= BATCH_FROM, scans=3)
        sources[name] = {} if sweep.backend == "loky" else source.sources(tracker)
    calls: dict = {}
    for task in missing:
        asked = sweep.scenario, sweep.trackers[task[0]], sweep.seed, task, sweep.runs
        calls[task] = _block_alone, sources[task[0]], *asked
    try:
        for task, result in workers.results(calls, sweep.jobs, sweep.backend, sweep.scheduler):
            if task in files:
                blocks.save(files[task], result)
            done, finished = done + sweep.size(task), finished + 1
            if sweep.progress:
                sweep.progress(done, total)
            yield task, result
    except workers.WorkersLost as error:
        kept = (
            f"kept in {sweep.folder}: the same again goes on from there" if files else "lost without a folder"
        )
        raise type(error)(
            f"{error}; {finished} of {len(tasks)} blocks of runs are done and {kept}{error.advice}"
        ) from error


def _block_alone(sources: Mapping[str, str], *asked) -> Any:
    """A block, where the worker may be another machine's, with other source, or with several threads."""
    source.check_sources(sources)
    with _ALONE:
        return _block(*asked)


def _block(scenario, tracker, seed, task, runs):
    first = task[1]
    seeds = [np.random.SeedSequence(seed, spawn_key=(i,)) for i in range(first, min(first + BLOCK, runs))]
    # several threads would change the last bits of a sum, and only slow small matrices down
    with threadpool_limits(1):
        return _played(scenario, tracker, seeds, runs >= BATCH_FROM)


def _played(scenario, tracker, seeds, together, scans=None):
    """The runs of these seeds, all of their scans or the first few; where `together`, and where that can be,
    all but the first in one call."""
    together = together and batch.can_batch(scenario, tracker)
    alone = [_once(scenario)(scenario, tracker, seed, scans) for seed in seeds[: 1 if together else None]]
    runs = _joined(_kind(scenario), np.array, alone)
    if len(alone) == len(seeds):
        return runs
    truth, *said = batch.run_batch(scenario, tracker, [draw(scenario, seed) for seed in seeds[1:]], scans)
    sure, untimed = np.ones((*truth.shape[:2], 1)), np.full(truth.shape[:2], np.nan)
    others = Runs._make((truth, *said, sure, untimed))
    return _joined(Runs, np.concatenate, [runs, others])


def _once(scenario: Scenario | MultiTargetScenario) -> Callable:
    return run_multi_target_once if isinstance(scenario, MultiTargetScenario) else run_once


def _kind(scenario: Scenario | MultiTargetScenario) -> type:
    return MultiTargetRuns if isinstance(scenario, MultiTargetScenario) else Runs


def _joined(kind: type, join: Callable, rows: list):
    """Runs of many rows, field by field."""
    return kind(*map(join, zip(*rows, strict=True)))
