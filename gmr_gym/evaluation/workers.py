"""Calls shared among processes of this machine, or of a Dask or Ray cluster; made again where one died."""

from collections.abc import Iterator, Mapping
from importlib.util import find_spec
from typing import Any, TypeVar

import joblib
from joblib.externals.loky.process_executor import TerminatedWorkerError

from gmr_gym.evaluation import clusters
from gmr_gym.evaluation.clusters import Unreachable, WorkerDied

BACKENDS = {"loky": "joblib", "dask": "distributed", "ray": "ray"}  # -> the package that it takes
ATTEMPTS = 3  # in a row without a single result
SECONDS = 5.0  # in which the scheduler of a cluster that was lost may come back
Task = TypeVar("Task")


class WorkersLost(RuntimeError):
    """Workers died again and again before anything was finished."""

    advice = ". Fewer jobs, or more memory for each worker, may help"


class ClusterLost(WorkersLost):
    """The scheduler of a cluster that had answered does so no more."""

    advice = ""


def check_workers(jobs: int, backend: str, scheduler: str | None) -> None:
    """ValueError for no jobs, for a backend that is none, or whose address is missing or of no use;
    ImportError, with the extra that brings it, for one that is not installed."""
    if jobs == 0:
        raise ValueError("jobs must be a number of processes, or -1 for one a core, got 0")
    if backend not in BACKENDS:
        raise ValueError(f"unknown backend {backend!r}; choose one of {', '.join(BACKENDS)}")
    if not find_spec(BACKENDS[backend]):
        raise ImportError(f"backend {backend!r} is not installed; pip install 'gmr-gym[{backend}]'")
    if backend == "loky" and scheduler:
        raise ValueError("scheduler is for the backends dask and ray; loky stays on this machine")
    if backend != "loky" and not scheduler:
        raise ValueError(f"backend {backend!r} needs scheduler, the address of a cluster that is running")


def results(
    calls: Mapping[Task, tuple], jobs: int = 1, backend: str = "loky", scheduler: str | None = None
) -> Iterator[tuple[Task, Any]]:
    """(task, result) of every call (function, *arguments) as it is finished, each once.

    On this machine `jobs` processes make them, negative numbers counted from -1 for one a core; of a cluster
    all that it has. A call whose worker dies is made again; raises WorkersLost when that has happened
    ATTEMPTS times in a row without a result, and ClusterLost where a scheduler is gone for SECONDS.
    """
    left, attempts, seconds = dict(calls), 0, None
    while left:
        try:
            for task, result in _attempt(left, jobs, backend, scheduler, seconds):
                attempts = 0
                del left[task]
                yield task, result
        except Unreachable as error:
            if seconds is None:  # it never answered
                raise
            raise ClusterLost(f"the cluster at {scheduler} was lost") from error
        except (TerminatedWorkerError, WorkerDied) as death:
            attempts, seconds = attempts + 1, SECONDS
            if attempts == ATTEMPTS:
                reason = str(death).splitlines()[0]
                raise WorkersLost(f"workers died {ATTEMPTS} times in a row ({reason})") from death


def _attempt(
    calls: Mapping[Task, tuple], jobs: int, backend: str, scheduler: str | None, seconds: float | None
) -> Iterator:
    if not scheduler:
        # joblib starts all it is given, however few the calls; but one it would be itself, and with the call
        # that kills it this process would die
        yield from _parallel(calls, n_jobs=min(joblib.effective_n_jobs(jobs), max(2, len(calls))))
        return
    with getattr(clusters, backend)(scheduler, seconds) as connected:
        # all at once: workers that join a cluster on the way find something to do
        yield from _parallel(calls, n_jobs=-1, backend=connected, pre_dispatch="all")


def _parallel(calls: Mapping[Task, tuple], **options) -> Iterator:
    parallel = joblib.Parallel(return_as="generator_unordered", batch_size=1, **options)
    # one tuple: joblib would leave a large argument with one worker of Dask, and it would die with it
    return parallel(joblib.delayed(_call)((task, *call)) for task, call in list(calls.items()))


def _call(told: tuple) -> tuple:
    task, function, *arguments = told
    return task, function(*arguments)
