"""Calls shared among processes of this machine, or of a Dask or Ray cluster, and repeated where a worker
died.
"""

from collections.abc import Iterator, Mapping
from importlib.util import find_spec
from typing import Any, TypeVar

import joblib
from joblib.externals.loky.process_executor import TerminatedWorkerError

from gmr_gym.evaluation import clusters
from gmr_gym.evaluation.clusters import Unreachable, WorkerDied

BACKENDS = {"loky": "joblib", "dask": "distributed", "ray": "ray"}  # and the package it needs
ATTEMPTS = 3  # in a row without a single result
SECONDS = 5.0  # to wait for the scheduler of a lost cluster
Task = TypeVar("Task")


class WorkersLost(RuntimeError):
    """Workers died again and again without a result."""

    advice = ". Fewer jobs, or more memory for each worker, may help"


class ClusterLost(WorkersLost):
    """The scheduler of a cluster no longer answers."""

    advice = ""


def check_workers(jobs: int, backend: str, scheduler: str | None) -> None:
    """Check the arguments that choose workers.

    Parameters
    ----------
    jobs : int
        Number of processes; negative numbers are counted from -1 for one per core.
    backend : str
        One of `BACKENDS`.
    scheduler : str or None
        Address of the cluster; None for "loky".

    Raises
    ------
    ValueError
        For 0 jobs, an unknown backend, or an address that is missing or not used.
    ImportError
        For a backend that is not installed, with the extra that brings it.
    """
    if jobs == 0:
        raise ValueError("jobs must be a number of processes, or -1 for one per core, got 0")
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
    """Yield (task, result) of every call as it is finished, each once.

    Parameters
    ----------
    calls : mapping of task to `(function, *arguments)`
    jobs : int
        Number of processes of this machine; negative numbers are counted from -1 for one per core. A cluster
        uses all its workers.
    backend : str
        One of `BACKENDS`.
    scheduler : str, optional
        Address of the cluster.

    Raises
    ------
    WorkersLost
        If workers died ATTEMPTS times in a row without a result. Until then their calls are repeated.
    ClusterLost
        If the scheduler does not answer for SECONDS.
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
        # joblib starts as many processes as it is given, however few the calls. With one job it would make
        # the call in this process, which would die with it
        yield from _parallel(calls, n_jobs=min(joblib.effective_n_jobs(jobs), max(2, len(calls))))
        return
    with getattr(clusters, backend)(scheduler, seconds) as connected:
        # all calls at once: workers that join the cluster later find something to do
        yield from _parallel(calls, n_jobs=-1, backend=connected, pre_dispatch="all")


def _parallel(calls: Mapping[Task, tuple], **options) -> Iterator:
    parallel = joblib.Parallel(return_as="generator_unordered", batch_size=1, **options)
    # one tuple: joblib would store a large argument on one worker of Dask, and lose it with that worker
    return parallel(joblib.delayed(_call)((task, *call)) for task, call in list(calls.items()))


def _call(call: tuple) -> tuple:
    task, function, *arguments = call
    return task, function(*arguments)
