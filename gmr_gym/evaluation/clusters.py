"""joblib's backends for Dask and Ray, which report the death of a worker."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

SECONDS = 10  # to wait for the first worker of a cluster
LOGGERS = ("distributed.client", "tornado.application", "asyncio")  # of Dask's connection


class WorkerDied(RuntimeError):
    """A worker died during a call, more often than the cluster itself repeats it."""


class Unreachable(OSError):
    """No cluster with a worker answers at the address."""


class _Reporting:
    """Raises the exceptions of a cluster. joblib alone waits forever where a cluster gives a call up, or
    takes the exception for the result.
    """

    deaths: tuple[type[BaseException], ...] = ()

    def retrieve_result_callback(self, out: Any) -> Any:
        if isinstance(out, self.deaths):
            raise WorkerDied(f"{type(out).__name__}: {out}")
        if isinstance(out, BaseException):
            raise out
        return super().retrieve_result_callback(out)  # type: ignore[misc]


@contextmanager
def dask(scheduler: str, seconds: float | None = None) -> Iterator[Any]:
    """Backend of a Dask cluster, connected to its scheduler.

    Parameters
    ----------
    scheduler : str
        Address.
    seconds : float, optional
        Time to wait for an answer; by default as Dask is configured.

    Yields
    ------
    Backend of joblib

    Raises
    ------
    ValueError
        If `scheduler` is no address, or a worker has several threads.
    Unreachable
        If no cluster answers, or it has no worker.
    """
    from concurrent.futures import CancelledError

    from distributed import Client
    from distributed.comm.addressing import get_address_host
    from distributed.scheduler import KilledWorker
    from joblib._dask import DaskDistributedBackend

    class Dask(_Reporting, DaskDistributedBackend):
        deaths = (KilledWorker, CancelledError)

        def effective_n_jobs(self, n_jobs):
            # joblib makes calls for one worker in this process, where nothing should be computed
            return max(2, super().effective_n_jobs(n_jobs))

        def submit(self, func, callback=None):
            future = super().submit(func, callback)
            future.add_done_callback(partial(_failed, callback))
            return future

    # a client that refuses an address waits for a minute when it is closed
    get_address_host(scheduler)
    with _silent(), _connected(Client, scheduler, seconds) as client:
        for address, worker in client.scheduler_info(n_workers=-1)["workers"].items():
            if (threads := worker["nthreads"]) > 1:
                raise ValueError(
                    f"worker {address} has {threads} threads, of which one could compute at a time; start it "
                    f"with --nthreads 1 --nworkers {threads}"
                )
        yield Dask(client=client)


@contextmanager
def _connected(client: type, scheduler: str, seconds: float | None) -> Iterator[Any]:
    """A connected client, once the cluster has a worker."""
    try:
        connected = client(scheduler, set_as_default=False, **({"timeout": seconds} if seconds else {}))
    except OSError as error:
        raise Unreachable(f"no cluster answers at {scheduler}: {error}") from error
    with connected:
        try:
            connected.wait_for_workers(1, timeout=SECONDS)
        except OSError as error:
            raise Unreachable(f"the cluster at {scheduler} has no worker after {SECONDS} s") from error
        yield connected


@contextmanager
def _silent() -> Iterator[None]:
    """Silences the loggers of the connection: a lost cluster is reported once, by an exception."""
    loggers = [logging.getLogger(name) for name in LOGGERS]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL + 1)
    try:
        yield
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.setLevel(level)


def _failed(callback, future) -> None:
    if error := future.exception():
        callback(error)


@contextmanager
def ray(scheduler: str, seconds: float | None = None) -> Iterator[Any]:
    """Backend of a Ray cluster; it stays connected.

    Parameters
    ----------
    scheduler : str
        Address, or "auto".
    seconds : float, optional
        Not used: Ray waits as long as it is configured to.

    Yields
    ------
    Backend of joblib

    Raises
    ------
    Unreachable
        If no cluster answers.
    """
    import ray
    from ray import exceptions
    from ray.util.joblib.ray_backend import RayBackend

    class Ray(_Reporting, RayBackend):
        deaths = (
            exceptions.RayActorError, exceptions.WorkerCrashedError, exceptions.NodeDiedError,
            exceptions.OutOfMemoryError, exceptions.ObjectLostError,
        )  # fmt: skip
        supports_return_generator = True  # only multiprocessing's pools do not

    try:
        ray.init(address=scheduler, ignore_reinit_error=True, log_to_driver=False)
    except OSError as error:
        raise Unreachable(f"no cluster answers at {scheduler}: {error}") from error
    yield Ray()
