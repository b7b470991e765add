"""First calls of kernels, made in plain Python instead of waiting for the compiler.

Only kernels whose plain form gives the same bits: loops over scalars, and functions of `math`.
"""

import multiprocessing
import os
import pickle
import subprocess
import sys
from atexit import register
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib import import_module
from queue import Empty, Queue
from threading import Thread
from time import perf_counter
from types import FunctionType
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher

FEW = 10_000  # numbers in the arguments of a plain call, about a tenth of a second
SECONDS = 1.0  # of plain calls of a kernel, about as long as compiling takes
IDLE = 2.0  # s, without a request, after which a process that compiles ends
NICENESS = 5  # of a process that compiles what can wait


@cache
def plain(compiled: Any) -> Callable:
    """The kernel in plain Python, and in it those that it calls."""
    function = compiled.py_func
    names = dict(function.__globals__)
    for name in function.__code__.co_names:
        if isinstance(names.get(name), Dispatcher):
            names[name] = plain(names[name])
    return FunctionType(function.__code__, names, function.__name__, function.__defaults__)


class PlainForm:
    """The plain form of a kernel, for as long as its calls together take less time than compiling."""

    seconds = SECONDS  # of the class: `compiled_at_once` sets it

    def __init__(self, compiled: Any):
        self._compiled = compiled
        self._spent = 0.0

    def suits(self, args: tuple) -> bool:
        """Whether the plain form may still be called, with these arguments."""
        return self._spent < PlainForm.seconds and sum(getattr(a, "size", 0) for a in args) <= FEW

    def __call__(self, *args: Any) -> Any:
        started = perf_counter()
        try:
            with np.errstate(all="ignore"):
                return plain(self._compiled)(*args)
        finally:
            self._spent += perf_counter() - started


@contextmanager
def compiled_at_once() -> Iterator[None]:
    """Within it every kernel is compiled when it is first called in this process."""
    seconds, PlainForm.seconds = PlainForm.seconds, 0.0
    try:
        yield
    finally:
        PlainForm.seconds = seconds


def for_few_calls(compiled: Any) -> Callable:
    """The kernel, for places where most programs call it a few times: plain where no code is loaded."""
    if not isinstance(compiled, Dispatcher):  # under NUMBA_DISABLE_JIT
        return compiled
    form = PlainForm(compiled)

    def call(*args: Any) -> Any:
        return (form if not compiled.overloads and form.suits(args) else compiled)(*args)

    return call


class Compiler:
    """Another Python that compiles kernels one after another, and ends when it has been idle.

    Parameters
    ----------
    niceness : int
        How much of its priority it leaves to others, where the system knows that.
    """

    def __init__(self, niceness: int = 0):
        self._niceness = niceness
        self._process: subprocess.Popen | None = None

    def request(self, function: Callable, signature: Any) -> bool:
        """Whether the kernel of the function will be compiled for the signature, unless the process fails."""
        if not _has_room_beside():
            return False
        try:
            request = pickle.dumps((function.__module__, function.__name__, signature)).hex()
            if not self.is_running():
                self._start()
            self._process.stdin.write(f"{request}\n".encode())  # type: ignore[union-attr]
            self._process.stdin.flush()  # type: ignore[union-attr]
        except (OSError, pickle.PicklingError, TypeError, AttributeError):
            return False
        return True

    def is_running(self) -> bool:
        """Whether the process has been started and has not ended."""
        return self._process is not None and self._process.poll() is None

    def _start(self) -> None:
        """Starts the process; OSError if there can be no more, or if one failed."""
        if self._process is not None and self._process.returncode != 0:
            raise OSError("kernels cannot be compiled in another process")
        code = f"from gmr_gym.first_calls import serve; serve({self._niceness})"
        folders = [entry for entry in sys.path if isinstance(entry, str)]  # Python ignores others
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(folders)}
        command = [sys.executable, "-P", "-c", code]  # -P: the current folder only if it is in the path
        pipe, quiet = subprocess.PIPE, subprocess.DEVNULL
        self._process = subprocess.Popen(command, env=environment, stdin=pipe, stdout=quiet, stderr=quiet)
        register(_stop, self._process)


def _has_room_beside() -> bool:
    """Whether another Python can be started beside this one, and helps: not by a worker, on a single core, or
    by a program with Python inside, which would start itself again."""
    is_python = os.path.basename(sys.executable or "").lower().startswith("python")
    return is_python and (os.cpu_count() or 1) > 1 and multiprocessing.parent_process() is None


def _stop(process: subprocess.Popen) -> None:
    process.kill()
    process.wait()
    with suppress(OSError):  # of a request that it did not read
        process.stdin.close()  # type: ignore[union-attr]


def serve(niceness: int) -> None:
    """Compiles what the lines of the standard input request; fails where the code cannot be saved."""
    if hasattr(os, "nice"):
        os.nice(niceness)
    requests: Queue[str] = Queue()
    Thread(target=_receive, args=(requests,), daemon=True).start()
    with suppress(Empty):
        while True:
            module, name, signature = pickle.loads(bytes.fromhex(requests.get(timeout=IDLE)))
            compiled = getattr(import_module(module), name)
            compiled.compile(signature)
            if not compiled._cache.has_saved(signature, compiled.targetctx):
                sys.exit(1)


def _receive(requests: Queue) -> None:
    for line in sys.stdin:
        requests.put(line)
    os._exit(1)  # the process that wanted the kernels has ended


_compiler = Compiler(NICENESS)


class PlainFirst:
    """Stands in a kernel for numba's step from arguments to compiled code, which then is called.

    Code that is not on disk is compiled in another process, and the plain form is called meanwhile.
    """

    def __init__(self, compiled: Any):
        self._compiled, self._code_for = compiled, compiled._compile_for_args
        self._form = PlainForm(compiled)
        self._requested: dict[tuple, Any] = {}  # signatures; for each the file of code when it was last read

    def __call__(self, *args: Any) -> Callable:
        if self._form.suits(args) and self._is_awaited(tuple(map(self._compiled.typeof_pyval, args))):
            return self._form
        return self._code_for(*args)

    def _is_awaited(self, signature: tuple) -> bool:
        """Whether another process is compiling the kernel for the signature."""
        compiled, new = self._compiled, signature not in self._requested
        saved = compiled._cache.stamp()
        if new or saved != self._requested[signature]:
            if compiled._cache.has_saved(signature, compiled.targetctx):
                return False
            if new and not _compiler.request(compiled.py_func, signature):
                return False
            self._requested[signature] = saved
        return _compiler.is_running()
