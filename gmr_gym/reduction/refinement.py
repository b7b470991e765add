"""Refinement: a reduced mixture moved to where its integral squared error from the original is least."""

from functools import partial

import numpy as np

from gmr_gym.checks import check_count, check_flag, sound
from gmr_gym.mixture import Mixture
from gmr_gym.reduction.distances import pack
from gmr_gym.reduction.ise_descent import descend
from gmr_gym.reduction.ise_gradient import matched, matched_objective, moved, objective, problem_of
from gmr_gym.reduction.protocol import Reduced, through, warn_unfinished
from gmr_gym.reduction.pruning import weighing
from gmr_gym.reduction.transport_sweeps import divergences, half_log_determinants
from gmr_gym.reduction.transportation import transportation
from gmr_gym.reduction.units import into, out_of, standard

STEPS = 500  # of the descent; some 40 are needed from 10 components to 5


def refine(
    p: Mixture, components: int, reduction: str = "runnalls", match: bool = False, steps: int = STEPS
) -> Reduced:
    """Any reduction, then a quasi-Newton descent of the integral squared error from the original mixture over
    the weights, means and covariances of what is left.

    The total weight is that of the reduction. Mean and covariance of the whole are not kept, unless
    `match`. The least error near the start is found, not the least of all.

    Parameters
    ----------
    p : Mixture
    components : int
        Upper limit of the number of components that remain.
    reduction : str
        Where the descent starts: a name that `reducer` takes.
    match : bool
        Whether total weight, mean and covariance stay those of the original: the descent is then one over
        mixtures that are shifted and stretched to them, and ends at more error.
    steps : int
        Limit of the steps of the descent.

    Returns
    -------
    Reduced
        The reduced mixture, and the origin (n,): of each component i, the j of largest responsibility
        v_j exp(-KL(i || j)). Every j is the origin of some: where none is left to it, the component of most
        responsibility is taken from those that share another.

    Raises
    ------
    ValueError
        For `components` or `steps` below 1, an unknown `reduction`, or a mixture that fails `checked`.

    Warns
    -----
    UserWarning
        Where the descent stops at the limit of steps.

    Notes
    -----
    The descent ends where the next step promises less than 1e-7 of the error, or less than 1e-11 of the
    integral of the square of p: the least error is found no closer than that. The error itself, a difference
    of near equals, is accurate to about 1e-16 of that integral.

    A step takes a square matrix of L (1 + d + d^2) rows, for L components left in d dimensions: from 300 to
    150 in four dimensions, the descent takes some 40 s.

    A component that overlaps with nothing of p stays where it is. Where the covariance of the whole is lost
    in rounding, the reduction is returned as it is.

    References
    ----------
    Schieferdecker and Huber 2009; Crouse et al. 2011; the gradient: Williams 2003, eq. 3.45.

    Examples
    --------
    >>> from gmr_gym.mixture import mixture
    >>> from gmr_gym.reduction.distances import integral_squared_difference
    >>> from gmr_gym.reduction.runnalls import runnalls
    >>> p = mixture([0.3, 0.3, 0.4], [[0.0], [1.0], [2.5]], [[[1.0]], [[0.5]], [[1.0]]])
    >>> [round(integral_squared_difference(p, f(p, 2)[0]), 5) for f in (runnalls, refine)]
    [0.00157, 0.00016]
    """
    from gmr_gym.reduction.registry import reducer  # which knows this reduction by its name

    p, place = weighing(p)
    start, _ = weighing(reducer(reduction, components)(p)[0])
    return _refined(p, place, start, match, steps)


def gmrc(p: Mixture, components: int, match: bool = False, steps: int = STEPS) -> Reduced:
    """Gaussian mixture reduction via clustering: `runnalls`, then k-means by the Kullback-Leibler divergence,
    which is `transportation`, then a quasi-Newton descent of the integral squared error as in `refine`.

    Parameters
    ----------
    p : Mixture
    components : int
        Upper limit of the number of components that remain.
    match, steps
        As of `refine`.

    Returns
    -------
    Reduced
        As of `refine`.

    Raises
    ------
    ValueError
        As `refine`.

    Warns
    -----
    UserWarning
        Where the clustering or the descent stops at a limit.

    Notes
    -----
    Departs: the weights are moved together with means and covariances; Crouse fits them by a quadratic
    programme.

    References
    ----------
    Schieferdecker and Huber 2009; Crouse et al. 2011, section IV.
    """
    p, place = weighing(p)
    start, _ = transportation(p, components)
    return _refined(p, place, start, match, steps)


def _refined(p: Mixture, place: np.ndarray, start: Mixture, match: bool, steps: int) -> Reduced:
    steps = check_count(steps, "steps")
    check_flag("match", match)
    if len(start.w) == len(p.w):
        return start, place
    g = _descended(p, start, match, steps)
    return g, through(place, _by_responsibility(p, g))


def _by_responsibility(p: Mixture, g: Mixture) -> np.ndarray:
    """The j (n,) of the largest v_j exp(-KL(component || j)), with none of g left out."""
    columns, half = pack(p.m, p.P), half_log_determinants(p.P)
    score = (np.log(g.w)[:, None] - divergences(columns, half, *g)).T
    origin = score.argmax(axis=1)
    for j in range(len(g.w)):
        if (origin != j).all():
            shared = np.flatnonzero(np.bincount(origin)[origin] > 1)
            origin[shared[score[shared, j].argmax()]] = j
    return origin


def _descended(p: Mixture, start: Mixture, match: bool, steps: int) -> Mixture:
    """The mixture with the least error from p, near the start."""
    try:
        units, f = standard(p)
        g = into(units, start)
        problem = problem_of(f, matched(g) if match else g)
    except np.linalg.LinAlgError:
        return start
    if not 0.0 < problem.square < np.inf:
        return start
    error = partial(matched_objective if match else objective, problem)
    x, finished = descend(error, problem.own / problem.square, 1 + p.m.shape[1] * (1 + p.m.shape[1]), steps)
    if not finished:
        warn_unfinished("refinement", steps)
    g = moved(problem, x)
    found = out_of(units, matched(g) if match else g)
    return weighing(found)[0] if sound(*found) else start
