"""Runs of reductions: mixtures reduced one after another, and what each lost."""

from collections.abc import Callable
from time import thread_time
from typing import NamedTuple

import numpy as np

from gmr_gym.evaluation.mixture_problems import MixtureProblem
from gmr_gym.evaluation.reductions import divergence, reduced
from gmr_gym.mixture import Mixture
from gmr_gym.reduction.distances import integral_squared_difference, normalised_integral_squared_difference
from gmr_gym.reduction.protocol import Reduced


class ReductionRuns(NamedTuple):
    """Results of one reduction by run (first axis); the second axis, of scans, has length 1."""

    ise: np.ndarray  # (runs, 1), integral squared error
    nise: np.ndarray  # (runs, 1), divided by Jff + Jgg
    divergence: np.ndarray  # (runs, 1), of the original from the reduced mixture, KL(f||g)
    reverse_divergence: np.ndarray  # (runs, 1), KL(g||f)
    components: np.ndarray  # (runs, 1), that remain
    seconds: np.ndarray  # (runs, 1), processor time of the call


def run_reduction_once(
    problem: MixtureProblem,
    reduce: Callable[[Mixture], Reduced],
    seed: int | np.random.SeedSequence,
    scans: int | None = None,
) -> ReductionRuns:
    """Reduce one mixture.

    Parameters
    ----------
    problem : MixtureProblem
    reduce : callable
        A reduction of a Mixture, as of `gmr_gym.reduction.reducer`.
    seed : int or SeedSequence
    scans : int, optional
        Has no meaning here.

    Returns
    -------
    ReductionRuns
        Arrays without the axis of runs.
    """
    p = problem.draw(seed)
    begun = thread_time()
    result = reduce(p)
    seconds = thread_time() - begun
    q, _ = reduced(p, lambda p: result)
    (forth, _), (back, _) = divergence(p, q, problem.samples), divergence(q, p, problem.samples)
    ise, nise = integral_squared_difference(p, q), normalised_integral_squared_difference(p, q)
    return ReductionRuns(*(np.array([each]) for each in (ise, nise, forth, back, len(q.w), seconds)))
