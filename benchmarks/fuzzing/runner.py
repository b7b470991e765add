"""Cases run in processes of their own, each watched: one that takes too long is killed, one that dies is
replaced, and what it was doing is known."""

import multiprocessing
import os
import resource
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from multiprocessing.connection import Connection, wait
from time import monotonic
from typing import Any, NamedTuple

import numpy as np

from fuzzing.cases import FINE, OUTCOMES, Target, drawn, judged, numbers_in

CHUNK = 100  # cases that a worker is handed at a time
COMPILING = 900.0  # s, that compiling in one call may take
GROWTH = 2**19  # kB by which one call may raise the most memory the worker ever had
TRIES = 20  # hangs and crashes of one target, after which the rest of its cases is passed over

# a worker's heartbeat, shared with its parent
TARGET, CASE, SINCE, BUSY = range(4)  # BUSY: how deep in compiling


class Found(NamedTuple):
    """A finding that a worker or its parent reports."""

    target: str
    case: int
    legal: bool
    outcome: str
    message: str
    size: int  # numbers in the input


class Chunk(NamedTuple):
    target: int
    first: int
    stop: int


class Worker:
    """A process and what its parent knows of it. Counts outlive the process."""

    def __init__(self, context, targets: Sequence[Target], seed: int, memory: float):
        self._start, self.seed = (context, targets, seed, memory), seed
        self.beat = context.RawArray("d", 4)
        self.counts = context.RawArray("q", len(targets) * 2 * len(OUTCOMES))
        self.chunk: Chunk | None = None
        self.start()

    def start(self) -> None:
        context, targets, seed, memory = self._start
        self.connection, other = context.Pipe()
        self.process = context.Process(
            target=work, args=(other, self.beat, self.counts, targets, seed, memory), daemon=True
        )
        self.process.start()
        other.close()

    def hand(self, chunk: Chunk) -> None:
        self.chunk = chunk
        self.beat[SINCE], self.beat[BUSY], self.beat[TARGET], self.beat[CASE] = (
            monotonic(), 0, chunk.target, chunk.first,
        )  # fmt: skip
        self.connection.send(chunk)

    def overdue(self, targets: Sequence[Target], seconds: float) -> bool:
        if self.chunk is None:
            return False
        limit = seconds * targets[self.chunk.target].patience
        return monotonic() - self.beat[SINCE] > (COMPILING if self.beat[BUSY] else limit)

    def stop(self) -> int:
        """Ends the process; its exit code."""
        self.process.kill()
        self.process.join()
        self.connection.close()
        return self.process.exitcode or 0


def run(
    targets: Sequence[Target],
    chunks: Sequence[Chunk],
    seed: int,
    seconds: float,
    jobs: int,
    memory: float,
    progress: Callable[[int, list[Found]], None] = lambda done, findings: None,
) -> tuple[np.ndarray, list[Found], list[str]]:
    """Counts (targets, illegal and legal, outcomes), findings, and the targets that were given up."""
    method = "fork" if "fork" in multiprocessing.get_all_start_methods() else "spawn"
    context = multiprocessing.get_context(method)
    to_do, findings, lost = list(reversed(chunks)), [], np.zeros(len(targets), int)
    workers = [Worker(context, targets, seed, memory) for _ in range(min(jobs, len(chunks)))]
    try:
        while to_do or any(worker.chunk for worker in workers):
            for worker in workers:
                if worker.chunk is None and to_do:
                    worker.hand(to_do.pop())
            for found, rest in _events(workers, targets, seconds):
                findings.append(found)
                if rest is not None:
                    lost[rest.target] += 1
                    to_do += [rest] if rest.first < rest.stop else []
                    if lost[rest.target] >= TRIES:
                        to_do = [chunk for chunk in to_do if chunk.target != rest.target]
            progress(sum(sum(worker.counts) for worker in workers), findings)
    finally:
        for worker in workers:
            worker.stop()
    counts = sum(np.array(worker.counts) for worker in workers).reshape(len(targets), 2, len(OUTCOMES))
    return counts, findings, [targets[i].name for i in np.flatnonzero(lost >= TRIES)]


def _events(workers: list[Worker], targets, seconds: float) -> Iterator[tuple[Found, Chunk | None]]:
    """What has been found since, with what is left of a chunk whose worker is no more."""
    by_connection = {worker.connection: worker for worker in workers if worker.chunk}
    for connection in wait(list(by_connection), timeout=0.2):
        worker = by_connection[connection]  # type: ignore[index]
        try:
            while worker.connection.poll():
                said = worker.connection.recv()
                if said is None:
                    worker.chunk = None
                else:
                    yield said, None
        except (EOFError, OSError):
            yield _ended(worker, targets, "crash")
    for worker in workers:
        if worker.overdue(targets, seconds):
            yield _ended(worker, targets, "hang")


def _ended(worker: Worker, targets, outcome: str) -> tuple[Found, Chunk]:
    """The finding of a worker that hangs or has died; a new one takes its place."""
    chunk, case = worker.chunk, int(worker.beat[CASE])
    assert chunk is not None
    waited = monotonic() - worker.beat[SINCE]
    if outcome == "crash":
        worker.process.join()
        message = _died(worker.process.exitcode or 0)
    else:
        message = f"no result after {waited:.0f} s" + (" of compiling" if worker.beat[BUSY] else "")
    worker.stop()
    worker.chunk = None
    worker.start()
    size, legal = _input(targets[chunk.target], worker.seed, case)
    _count(worker.counts, chunk.target, legal, outcome)
    return Found(targets[chunk.target].name, case, legal, outcome, message, size), chunk._replace(
        first=case + 1
    )


def _input(target: Target, seed: int, case: int) -> tuple[int, bool]:
    """How large the input of a case is, and whether it is legal."""
    try:
        arguments, spoilt = drawn(target, seed, case)
    except Exception:
        return 0, True
    return numbers_in(arguments), spoilt is None


def _died(code: int) -> str:
    return (
        f"the process died by {signal.Signals(-code).name}" if code < 0 else f"the process left with {code}"
    )


def _count(counts, target: int, legal: bool, outcome: str) -> None:
    counts[(2 * target + legal) * len(OUTCOMES) + OUTCOMES.index(outcome)] += 1


def work(connection: Connection, beat, counts, targets: Sequence[Target], seed: int, memory: float) -> None:
    """What a worker does until its parent is gone."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if memory:
        resource.setrlimit(resource.RLIMIT_AS, (int(memory * 2**30),) * 2)
    _watch_compiling(beat)
    smallest: dict[tuple, int] = {}
    parent = os.getppid()
    while True:
        while not connection.poll(5):
            if os.getppid() != parent:
                return
        chunk = connection.recv()
        for case in range(chunk.first, chunk.stop):
            beat[CASE], beat[SINCE] = case, monotonic()
            found = _case(targets[chunk.target], seed, case)
            _count(counts, chunk.target, found.legal, found.outcome)
            kind = found.target, found.legal, found.outcome
            if found.outcome not in FINE and found.size < smallest.get(kind, sys.maxsize):
                smallest[kind] = found.size
                connection.send(found)
        connection.send(None)


def _case(target: Target, seed: int, case: int) -> Found:
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    outcome, legal, message, size = judged(target, seed, case)
    grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    if grown > GROWTH:
        outcome, message = "memory", f"one call took {grown // 1024} MB more than all before"
    return Found(target.name, case, legal, outcome, message, size)


def _watch_compiling(beat) -> None:
    """Compiling does not count as the time of a call."""
    from numba.core import event

    class Listener(event.Listener):
        def on_start(self, event: Any) -> None:
            beat[BUSY] += 1

        def on_end(self, event: Any) -> None:
            beat[BUSY] -= 1
            beat[SINCE] = monotonic()

    event.register("numba:compile", Listener())
