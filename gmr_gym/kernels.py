"""How kernels are compiled: numba with a cache on disk, which processes fill together."""

import gc
import multiprocessing
import os
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import cache, lru_cache, partial
from hashlib import sha256
from typing import Any

import numpy as np
from filelock import BaseFileLock, FileLock, Timeout
from numba import config, njit
from numba.core.caching import FunctionCache
from numba.core.sigutils import normalize_signature

from gmr_gym.first_calls import Compiler, PlainFirst

# Arguments for kernels: numba compiles a kernel once more for an integer literal. A kernel goes through LLVM
# again, with all that it calls, in every kernel that calls it; so intermediate kernels are inlined where that
# was measured to save time.
ZERO, ONE = np.int64(0), np.int64(1)
OPTIONS: dict[str, Any] = {"error_model": "numpy", "no_cfunc_wrapper": True}
PATIENCE = 120.0  # s, for another process that compiles the same kernel


class KernelCache(FunctionCache):
    """numba's cache on disk, without errors in the middle of a call. A damaged file is compiled again;
    where the disk is full nothing is kept. While one process compiles a kernel, others wait for its code."""

    patience = PATIENCE  # of the class: who has waited in vain does not wait again for every other kernel
    _lock: BaseFileLock | None = None

    def __init__(self, function: Callable):
        super().__init__(function)
        held = [cell.cell_contents.py_func for cell in function.__closure__ or ()]
        self._held = [(inner.__module__, inner.__qualname__, *_stamp(inner)) for inner in held]

    def _index_key(self, sig, codegen):
        """What compiled code is found by. Kernels that a closure holds count by their names and files: numba
        takes ids instead, which are others in every process."""
        code = sha256(self._py_func.__code__.co_code).hexdigest()
        return sig, codegen.magic_tuple(), (code, *self._held)

    def load_overload(self, sig, target_context):
        """The compiled code for the signature; None if there is none, and then this process compiles it."""
        found = self._read(sig, target_context)
        if found is None and self._claim():
            found = self._read(sig, target_context)  # another process may have saved it meanwhile
        return found

    def _read(self, sig, target_context):
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # unpickling may raise anything
            self.flush()  # otherwise the new code could not be saved either
            return None

    def stamp(self) -> tuple[int, int] | None:
        """Time and size of the list of what is saved for the function; None if there is none."""
        try:
            file = os.stat(self._cache_file._index_path)
        except OSError:
            return None
        return file.st_mtime_ns, file.st_size

    def has_saved(self, signature: Any, target_context: Any) -> bool:
        """Whether compiled code for the signature is saved."""
        key = self._index_key(normalize_signature(signature)[0], target_context.codegen())
        try:
            return key in self._cache_file._load_index()
        except Exception:  # unpickling may raise anything
            return False

    def _claim(self) -> bool:
        """Whether this process alone may compile the kernel now; False where no files can be locked."""
        try:
            if self._lock is None:
                self._lock = FileLock(f"{self._cache_file._index_path}.lock", is_singleton=True)
            self._lock.acquire(KernelCache.patience)
        except Timeout:  # the other process hangs
            KernelCache.patience = 0.0
            return False
        except Exception:  # the file system knows no locks
            return False
        return True

    def release(self):
        """Lets other processes read or compile the kernel."""
        if self._lock is not None:
            with suppress(OSError):  # of a file system that was lost meanwhile
                self._lock.release()

    def save_overload(self, sig, data):
        """Saves the compiled code for the signature, if possible."""
        try:
            super().save_overload(sig, data)
        except Exception:
            warn_uncached()

    def flush(self):
        """Deletes everything saved for the function, if possible."""
        try:
            super().flush()
        except OSError:
            warn_uncached()


def kernel(function: Callable | None = None, plain_first: bool = False, **options) -> Any:
    """Compiles a function when it is first called, and saves the code on disk where that is possible.

    A decorator: `@kernel`, or with options of numba's, `@kernel(inline="always")`. With `plain_first` it is
    compiled in another process, and called in plain Python meanwhile.
    """
    if function is None:
        return partial(kernel, plain_first=plain_first, **options)
    compiled = njit(**{**OPTIONS, **options})(function)
    if not config.DISABLE_JIT:  # type: ignore[attr-defined]
        try:
            compiled._cache = KernelCache(function)
            compiled.compile = partial(_compile, compiled.compile, compiled._cache)
            if plain_first:
                compiled._compile_for_args = PlainFirst(compiled)
        except (RuntimeError, OSError):  # no writable folder
            warn_uncached()
    return compiled


def _stamp(function: Callable) -> tuple[float, int]:
    """Time and size of the file of a function."""
    file = os.stat(function.__code__.co_filename)
    return file.st_mtime, file.st_size


def _compile(compile: Callable, cache: KernelCache, signature: Any) -> Any:
    """Compiles, or loads, the kernel of the cache for the signature.

    Python's garbage collector is off meanwhile: it would look through the compiler's many objects again and
    again.
    """
    collects = gc.isenabled()
    gc.disable()
    try:
        return compile(normalize_signature(signature)[0])
    finally:
        cache.release()
        if collects:
            gc.enable()


@cache  # once, and not in every worker
def warn_uncached() -> None:
    """Warns, in one line, that kernels are compiled again at every start, and says how to avoid it."""
    if multiprocessing.parent_process() is None:
        # without a file: its source would be printed as a second line
        warnings.warn_explicit(
            "compiled kernels cannot be kept, and every start compiles them again: no folder can be written "
            "to, or the disk is full; set NUMBA_CACHE_DIR to a folder with room",
            UserWarning, "gmr_gym", 1,
        )  # fmt: skip


# For kernels that neither allocate nor return arrays: compiled without reference counting, whose atomic
# operations took half of the time of a scan. Such a kernel may call only other leaf kernels.
leaf_kernel = kernel(nogil=True, _nrt=False)


def compile_ahead(compiled: Any, signature: str) -> None:
    """Starts to compile the kernel for the signature in a process of its own, if its code is not on disk.

    The caller goes on meanwhile and finds the code when it calls the kernel.
    """
    cache = getattr(compiled, "_cache", None)  # under NUMBA_DISABLE_JIT a plain function, without one
    if not isinstance(cache, KernelCache) or os.path.exists(cache._cache_file._index_path):
        return
    Compiler().request(compiled.py_func, signature)


def together(call: Callable[..., object], shares: Sequence[tuple], threads: int) -> None:
    """Runs `call(*share)` for every share on threads, the caller's own among them. An exception of any of
    them is raised.

    Each takes another share when it has done one, and who has not begun when none is left is not waited for:
    on a busy machine a thread may start later than all the work takes.
    """
    left = iter(shares)

    def run() -> None:
        for share in left:
            call(*share)

    helpers = min(threads, len(shares)) - 1
    others = [_pool(os.getpid(), helpers).submit(run) for _ in range(helpers)]
    run()
    for other in others:
        if not other.cancel():
            other.result()


@lru_cache
def _pool(process: int, helpers: int) -> ThreadPoolExecutor:
    """Threads beside the caller's own; a forked process needs a pool of its own."""
    return ThreadPoolExecutor(helpers, "gmr_gym")
