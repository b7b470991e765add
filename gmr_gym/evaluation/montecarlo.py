"""Monte Carlo runs of trackers in a scenario, on any number of workers, resumed where interrupted."""

from collections.abc import Callable, Container, Iterator, Mapping
from itertools import islice
from pathlib import Path
from threading import Lock
from typing import Any, NamedTuple

import joblib
import numpy as np
from threadpoolctl import threadpool_limits

from gmr_gym.evaluation import batch, blocks, source, workers
from gmr_gym.evaluation.loop import is_off_target, play
from gmr_gym.evaluation.mixture_problems import MixtureProblem
from gmr_gym.evaluation.multi_target_runs import MultiTargetRuns, run_multi_target_once
from gmr_gym.evaluation.reduction_runs import ReductionRuns, run_reduction_once
from gmr_gym.filters.tracker import Tracker
from gmr_gym.models.gating import gate_statistics
from gmr_gym.simulation.multi_target import MultiTargetScenario
from gmr_gym.simulation.single_target import Scenario, draw
from gmr_gym.version import __version__

BLOCK = 20  # runs in one task, and in one file on disk
BATCH_FROM = 500  # runs from which compiling the call for a whole block pays off
Problem = Scenario | MultiTargetScenario | MixtureProblem  # what runs are of
_ALONE = Lock()  # the limit on a worker's threads is shared by them: one block at a time


class Runs(NamedTuple):
    """Results of one tracker, by run (first axis) and scan (second)."""

    truth: np.ndarray  # (runs, T, d)
    x: np.ndarray  # (runs, T, d), estimates
    P: np.ndarray  # (runs, T, d, d), covariances of the estimates
    components: np.ndarray  # (runs, T), hypotheses kept
    gate_volume: np.ndarray  # (runs, T), mean over the gates
    gated: np.ndarray  # (runs, T), detections in a gate, mean over the gates
    off_target: np.ndarray  # (runs, T), track given up, or off target by the scenario's loss rule
    modes: np.ndarray  # (runs, T, r), probability of each motion model of the tracker
    seconds: np.ndarray  # (runs, T), time of the tracker alone; nan in a run batched with others


def run(
    scenario: Problem,
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
    """Run every tracker through the same `runs` episodes, or every reduction on the same mixtures.

    Run i draws its episode from (seed, i) alone, whatever the tracker and the number of runs or workers. The
    results are equal to the last bit on any number of workers, `seconds` apart.

    Parameters
    ----------
    scenario : Scenario, MultiTargetScenario or MixtureProblem
    trackers : mapping of str to Tracker
        Of a MixtureProblem, reductions of a mixture.
    runs : int
    seed : int
    jobs : int
        Number of processes of this machine, negative numbers counted from -1 for one per core. A cluster uses
        all its workers.
    folder : Path or str, optional
        Where finished blocks of runs are kept. A block is found again by the content of scenario, tracker,
        seed and source code, and is not run a second time.
    progress : callable, optional
        Called as progress(done, total), in runs.
    backend : {"loky", "dask", "ray"}
    scheduler : str, optional
        Address of the cluster, for "dask" and "ray".

    Returns
    -------
    dict of str to Runs, MultiTargetRuns or ReductionRuns

    Raises
    ------
    ValueError
        Naming the argument that is invalid, or blocks in the folder that are not readable.
    workers.WorkersLost
        If workers die again and again.

    Notes
    -----
    Of at least `BATCH_FROM` runs, those of a block are run by one compiled call where
    `gmr_gym.evaluation.batch` can, except for the first, which is timed.

    Examples
    --------
    >>> from gmr_gym import make_tracker
    >>> from gmr_gym.evaluation import run
    >>> from gmr_gym.scenarios.dortenzio import turning_target
    >>> scenario = turning_target(clutter_rate=20, horizon=3)
    >>> tracker = make_tracker("nearest-neighbour", scenario.model)
    >>> run(scenario, {"nearest-neighbour": tracker}, runs=2)["nearest-neighbour"].x.shape
    (2, 3, 4)
    """
    sweep = _Sweep(scenario, trackers, runs, seed, folder, progress, jobs, backend, scheduler)
    tasks, files = sweep.tasks(), sweep.files()
    results = dict(blocks.load_all(files, _kind(scenario)))
    if folder is not None:
        blocks.check_folder(Path(folder))
    results.update(_computed(sweep, tasks, results, files))
    # blocks are freed as they are joined: the covariances of many runs take gigabytes
    return {
        name: _joined(
            _kind(scenario), np.concatenate, [results.pop(task) for task in tasks if task[0] == name]
        )
        for name in trackers
    }


def run_shard(
    scenario: Problem,
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
    """Run one machine's part of `run`, and keep it in the folder.

    With shard (i, n) these are every n-th of the blocks, chosen by their content: n machines that share
    nothing run all of them, each once. After the folders are merged (`blocks.merge`), `run` finds every
    block.

    Parameters
    ----------
    scenario, trackers, runs, seed, folder, jobs, progress, backend, scheduler
        As for `run`.
    shard : (int, int)
        (i, n), with 1 <= i <= n.

    Returns
    -------
    present : int
        Number of blocks in the folder afterwards.
    total : int
        Number of blocks of the whole sweep.

    Raises
    ------
    ValueError
        As `run`, and for an invalid shard.
    """
    i, n = shard
    if not 1 <= i <= n:
        raise ValueError(f"shard must be (i, n) with 1 <= i <= n, got {shard}")
    sweep = _Sweep(scenario, trackers, runs, seed, folder, progress, jobs, backend, scheduler)
    files = sweep.files()
    Path(folder).mkdir(parents=True, exist_ok=True)  # for `merge`, where this shard has nothing to do
    # the offset depends on the content: else the first machine had the most to do in a sweep of small parts
    mine = [task for task, file in files.items() if (int(file.name[:8], 16) + task[1] // BLOCK) % n == i - 1]
    # a damaged block is found now, not after the merge
    present = {task for task, _ in blocks.load_all({task: files[task] for task in mine}, _kind(scenario))}
    for _ in _computed(sweep, mine, present, files):
        pass
    return sum(file.exists() for file in files.values()), len(files)


def run_once(
    scenario: Scenario,
    tracker: Tracker,
    seed: int | np.random.SeedSequence,
    scans: int | None = None,
) -> Runs:
    """Run a tracker through one episode.

    Parameters
    ----------
    scenario : Scenario
    tracker : Tracker
    seed : int or SeedSequence
    scans : int, optional
        Number of scans to run; all by default.

    Returns
    -------
    Runs
        Arrays without the axis of runs.

    Examples
    --------
    >>> from gmr_gym import make_tracker
    >>> from gmr_gym.evaluation import run_once
    >>> from gmr_gym.scenarios.dortenzio import turning_target
    >>> scenario = turning_target(clutter_rate=20)
    >>> runs = run_once(scenario, make_tracker("nearest-neighbour", scenario.model), seed=1, scans=3)
    >>> runs.x.shape, runs.off_target.tolist()
    ((3, 4), [False, False, False])
    """
    episode = draw(scenario, seed)
    rows = []
    for t, (z, origin), report, seconds in islice(play(scenario, tracker, episode), scans):
        gates, x = report.gates, episode.x[t]
        points = tracker.model.sensor.to_gate_space(z)
        rows.append((
            x, report.x[0], report.P[0], len(report.mixture.w), *gate_statistics(gates, points),
            is_off_target(scenario, report, x, points, origin), report.modes, seconds,
        ))  # fmt: skip
    return _joined(Runs, np.array, rows)


class _Sweep(NamedTuple):
    """The arguments of `run`."""

    scenario: Problem
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
        # hashed apart: a common hash depends on whether equal models are one object or two
        scenario = joblib.hash(self.scenario)
        digests = {
            name: joblib.hash((scenario, joblib.hash(tracker), source.code(tracker), self.seed, __version__))
            for name, tracker in self.trackers.items()
        }
        return {
            task: blocks.named(self.folder, digests[task[0]], task[1], task[1] + self.size(task))
            for task in self.tasks()
        }


def _computed(sweep: _Sweep, tasks: list, present: Container, files: Mapping) -> Iterator[tuple[Any, Any]]:
    """Yield (task, block) of those of the tasks that are not present yet, as they are finished and kept."""
    missing = [task for task in tasks if task not in present]
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
        first, stop = task[1], min(task[1] + BLOCK, sweep.runs)
        arguments = sweep.scenario, sweep.trackers[task[0]], sweep.seed, first, stop, sweep.runs >= BATCH_FROM
        calls[task] = _block_alone, sources[task[0]], *arguments
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
            f"kept in {sweep.folder}: the same call resumes from there" if files else "lost without a folder"
        )
        raise type(error)(
            f"{error}; {finished} of {len(tasks)} blocks of runs are done and {kept}{error.advice}"
        ) from error


def _block_alone(sources: Mapping[str, str], *arguments) -> Any:
    """A block on a worker that may be of another machine, with other source, or have several threads."""
    source.check_sources(sources)
    with _ALONE:
        return run_block(*arguments)


def run_block(
    scenario: Problem,
    tracker: Any,
    seed: int,
    first: int,
    stop: int,
    together: bool = False,
    scans: int | None = None,
) -> Any:
    """Runs first, ..., stop - 1 of `run`, in this process.

    Parameters
    ----------
    scenario : Scenario, MultiTargetScenario or MixtureProblem
    tracker : Tracker
    seed : int
    first, stop : int
    together : bool
        Whether all but the first are run by one compiled call, where `gmr_gym.evaluation.batch` can.
    scans : int, optional
        Number of scans to run; all by default.

    Returns
    -------
    Runs, MultiTargetRuns or ReductionRuns
    """
    seeds = [np.random.SeedSequence(seed, spawn_key=(i,)) for i in range(first, stop)]
    # several threads would change the last bits of a sum, and small matrices are slower with them
    with threadpool_limits(1):
        return _played(scenario, tracker, seeds, together, scans)


def _played(scenario, tracker, seeds, together, scans=None):
    """The runs of these seeds, all of their scans or the first few; all but the first in one call if
    `together` and if `can_batch`.
    """
    together = together and batch.can_batch(scenario, tracker)
    alone = [_once(scenario)(scenario, tracker, seed, scans) for seed in seeds[: 1 if together else None]]
    runs = _joined(_kind(scenario), np.array, alone)
    if len(alone) == len(seeds):
        return runs
    truth, *fields = batch.run_batch(scenario, tracker, [draw(scenario, seed) for seed in seeds[1:]], scans)
    others = Runs._make((truth, *fields, np.full(truth.shape[:2], np.nan)))
    return _joined(Runs, np.concatenate, [runs, others])


def _once(scenario: Problem) -> Callable:
    if isinstance(scenario, MixtureProblem):
        return run_reduction_once
    return run_multi_target_once if isinstance(scenario, MultiTargetScenario) else run_once


def _kind(scenario: Problem) -> type:
    if isinstance(scenario, MixtureProblem):
        return ReductionRuns
    return MultiTargetRuns if isinstance(scenario, MultiTargetScenario) else Runs


def _joined(kind: type, join: Callable, rows: list):
    """Runs of many rows, field by field."""
    return kind(*map(join, zip(*rows, strict=True)))
