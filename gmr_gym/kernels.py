"""How kernels are compiled, all of them alike but for what they ask for."""

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

# For kernels to be called with: for an integer written down there, numba compiles the kernel once more. A
# kernel compiled by itself goes through LLVM again, with all that it calls, in every kernel that calls it, so
# those that stand between others are inlined, where it has been measured to pay.
ZERO, ONE = np.int64(0), np.int64(1)


class KernelCache(FunctionCache):
    """numba's cache on disk, which raises in the middle of a call where a file is damaged or the disk is
    full: here what cannot be read is compiled again, and what cannot be written is not kept."""

    def load_overload(self, sig, target_context):
        """What was compiled for the signature, None where that is not there."""
        try:
            return super().load_overload(sig, target_context)
        except Exception:  # unpickling raises whatever there is
            self.flush()  # or what is compiled now could not be kept either
            return None

    def save_overload(self, sig, data):
        """Keeps what was compiled for the signature, if that can be."""
        try:
            super().save_overload(sig, data)
        except Exception:
            warn_uncached()

    def flush(self):
        """Forgets all that is kept of the function, if that can be."""
        try:
            super().flush()
        except OSError:
            warn_uncached()


def kernel(function: Callable | None = None, **options) -> Any:
    """Compiles a function when it is first called, and keeps that on disk if there is a place for it.
    Decorates with options of numba's, `@kernel(inline="always")`, or without, `@kernel`."""
    if function is None:
        return partial(kernel, **options)
    compiled = njit(error_model="numpy", **options)(function)
    if not config.DISABLE_JIT:  # type: ignore[attr-defined]
        try:
            compiled._cache = KernelCache(function)
        except (RuntimeError, OSError):  # no folder can be written to
            warn_uncached()
    return compiled


@cache  # once, and not in every worker
def warn_uncached() -> None:
    """Warns, in one line, that kernels are compiled anew at every start, and says what to do about it."""
    if multiprocessing.parent_process() is None:
        # from no file: its source would be a second line
        warnings.warn_explicit(
            "compiled kernels cannot be kept, and every start compiles them anew: no folder can be written "
            "to, or the disk is full; set NUMBA_CACHE_DIR to a folder with room",
            UserWarning, "gmr_gym", 1,
        )  # fmt: skip


# Compiles what makes no array and hands none back, without counting references to those it is given: each is
# an atomic operation, and half of the time of a scan went into them. It may call none but its like, which
# would otherwise be compiled as it is.
leaf_kernel = kernel(nogil=True, _nrt=False)


def together(call: Callable[..., object], shares: Sequence[tuple]) -> None:
    """call(*share) for every share, the first on the thread of the caller; what one raises is raised."""
    helpers = len(shares) - 1
    pool = _pool(os.getpid(), helpers) if helpers else None
    others = [pool.submit(call, *share) for share in shares[1:]] if pool else []
    call(*shares[0])
    for other in others:
        other.result()


@lru_cache
def _pool(process: int, helpers: int) -> ThreadPoolExecutor:
    """Threads to help the caller's own; a forked process has to have others than its parent."""
    return ThreadPoolExecutor(helpers, "gmr_gym")
