"""What reductions cost, over many mixtures: measured on any number of processes, and kept in blocks."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import thread_time
from typing import Any, NamedTuple

import joblib
import numpy as np
from threadpoolctl import threadpool_limits

from gmr_gym.evaluation import blocks, source, workers
from gmr_gym.evaluation.reductions import divergence, reduced
from gmr_gym.mixture import Mixture
from gmr_gym.reduction.distances import integral_squared_difference, normalised_integral_squared_difference
from gmr_gym.reduction.protocol import Reduced
from gmr_gym.version import __version__

TIMED = 2  # calls, of which the shortest counts


class Costs(NamedTuple):
    """What a reduction costs, by mixture (first axis); the second axis has length 1.

    All but `seconds` is nan, and `components` 0, where the reduction is left out, see `Reducing`.
    """

    components: np.ndarray  # (n, 1), that remain
    ise: np.ndarray  # (n, 1), integral squared error
    nise: np.ndarray  # (n, 1), the same divided by Jff + Jgg
    divergence: np.ndarray  # (n, 1), KL(f||g) of the original f from the reduced g
    reverse_divergence: np.ndarray  # (n, 1), KL(g||f)
    seconds: np.ndarray  # (n, 1), processor time of a call


@dataclass(frozen=True)
class Reducing:
    """A reduction of several mixtures.

    Parameters
    ----------
    reduce : callable
        A reduction of a Mixture, as of `gmr_gym.reduction.reducer`.
    mixtures : sequence of Mixture
    samples : int
        Points that each divergence is estimated by.
    longest : float
        s. A reduction whose first call takes more processor time is left out, and so is one that refuses any
        mixture.
    """

    reduce: Callable[[Mixture], Reduced]
    mixtures: Sequence[Mixture]
    samples: int
    longest: float


def measured(
    asked: Mapping[Any, Reducing],
    *,
    jobs: int = 1,
    folder: Path | str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> dict[Any, Costs]:
    """What each reduction costs on its mixtures.

    Parameters
    ----------
    asked : mapping of key to Reducing
    jobs : int
        Number of processes, as for `gmr_gym.evaluation.run`.
    folder : Path or str, optional
        Where results are kept, a block for each. One is found again by the content of mixtures, reduction
        and source code, and is not measured a second time.
    progress : callable, optional
        Called as progress(done, total).

    Returns
    -------
    dict of key to Costs

    Raises
    ------
    ValueError
        For blocks in the folder that are not readable.
    """
    workers.check_workers(jobs, "loky", None)
    files = {key: _file(one, folder) for key, one in asked.items()} if folder is not None else {}
    found = dict(blocks.load_all(files, Costs))
    calls = {key: (costs, one) for key, one in asked.items() if key not in found}
    report = progress or (lambda done, total: None)
    report(len(found), len(asked))
    for key, result in workers.results(calls, jobs):
        if key in files:
            blocks.save(files[key], result)
        found[key] = result
        report(len(found), len(asked))
    return {key: found[key] for key in asked}


def costs(asked: Reducing) -> Costs:
    """What a reduction costs on its mixtures.

    Parameters
    ----------
    asked : Reducing

    Returns
    -------
    Costs
    """
    with threadpool_limits(1):
        try:
            asked.reduce(asked.mixtures[0])  # compiles
            seconds = _timed(asked.reduce, asked.mixtures[0])
            if seconds > asked.longest:
                return _left_out(seconds, len(asked.mixtures))
            rows = [_row(asked, p) for p in asked.mixtures]
        except ValueError:  # for instance of too many components
            return _left_out(np.nan, len(asked.mixtures))
    return Costs(*(np.array(column)[:, None] for column in zip(*rows, strict=True)))


def _row(asked: Reducing, p: Mixture) -> tuple[float, ...]:
    q, _ = reduced(p, asked.reduce)
    return (
        len(q.w), integral_squared_difference(p, q), normalised_integral_squared_difference(p, q),
        divergence(p, q, asked.samples)[0], divergence(q, p, asked.samples)[0],
        min(_timed(asked.reduce, p) for _ in range(TIMED)),
    )  # fmt: skip


def _left_out(seconds: float, n: int) -> Costs:
    nothing = np.full((n, 1), np.nan)
    return Costs(np.zeros((n, 1), int), *(nothing,) * 4, np.full((n, 1), seconds))


def _timed(reduce: Callable[[Mixture], Reduced], p: Mixture) -> float:
    begun = thread_time()
    reduce(p)
    return thread_time() - begun


def _file(asked: Reducing, folder: Path | str) -> Path:
    digest = joblib.hash((joblib.hash(asked), source.code(asked), __version__))
    return blocks.named(folder, digest, 0, len(asked.mixtures))
