"""One computation in shares, on threads: for compiled loops that let go of the interpreter's lock."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache


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
