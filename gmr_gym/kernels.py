"""How kernels are compiled: numba with a cache on disk."""

import multiprocessing
import os
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import cache, lru_cache, partial
from typing import Any

import numpy as np
from numba import config, njit
from numba.core.caching import FunctionCache

# Arguments for kernels: numba compiles a kernel once more for an integer literal. A kernel goes through LLVM
# again, with all that it calls, in every kernel that calls it; so intermediate kernels are inlined where that
# was measured to save time.
ZERO, ONE = np.int64(0), np.int64(1)


class KernelCache(FunctionCache):
    """numba's cache on disk, without errors in the middle of a call. A damaged file is compiled again;
    where the disk is full nothing is kept."""

    def load_overload(self, sig, target_context):
        """The compiled code for the signature; None if there is none."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # unpickling may raise anything
            self.flush()  # otherwise the new code could not be saved either
            return None

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


def kernel(function: Callable | None = None, **options) -> Any:
    """Compiles a function when it is first called, and saves the code on disk where that is possible.

    A decorator: `@kernel`, or with options of numba's, `@kernel(inline="always")`.
    """
    if function is None:
        return partial(kernel, **options)
    compiled = njit(error_model="numpy", **options)(function)
    if not config.DISABLE_JIT:  # type: ignore[attr-defined]
        try:
            compiled._cache = KernelCache(function)
        except (RuntimeError, OSError):  # no writable folder
            warn_uncached()
    return compiled


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


def together(call: Callable[..., object], shares: Sequence[tuple]) -> None:
    """Runs `call(*share)` for every share on threads, the first on the caller's own. An exception of any of
    them is raised."""
    helpers = len(shares) - 1
    pool = _pool(os.getpid(), helpers) if helpers else None
    others = [pool.submit(call, *share) for share in shares[1:]] if pool else []
    call(*shares[0])
    for other in others:
        other.result()


@lru_cache
def _pool(process: int, helpers: int) -> ThreadPoolExecutor:
    """Threads beside the caller's own; a forked process needs a pool of its own."""
    return ThreadPoolExecutor(helpers, "gmr_gym")
