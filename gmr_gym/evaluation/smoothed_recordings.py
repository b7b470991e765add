"""A recording of one target tracked, and then smoothed along the histories of its hypotheses."""

from collections.abc import Callable

import numpy as np

from gmr_gym.evaluation.recordings import Scans, Track, prepared
from gmr_gym.filters.trace import Trace, Tracing
from gmr_gym.filters.tracker import Tracker
from gmr_gym.mixture import Mixture, moments
from gmr_gym.models.kalman import Motion


def smoothed_track(
    scans: Scans,
    build: Callable[[float], Tracker],
    period: float | None = None,
    prior_time: float | None = None,
) -> tuple[Track, Track]:
    r"""Run a tracker over recorded scans, and smooth its estimates.

    Parameters
    ----------
    scans, build, period, prior_time
        As in `recordings.track`; the trackers have one motion model.

    Returns
    -------
    filtered : Track
        That of `recordings.track`.
    smoothed : Track
        The same with estimates given all scans.

    Raises
    ------
    ValueError
        For a tracker that does not say where its hypotheses come from, and as `recordings.track` does.

    Notes
    -----
    Every hypothesis of the last scan is followed back from parent to parent, where several were merged to the
    parent of the heaviest, by the recursion of Rauch, Tung and Striebel (1965):

    .. math::

        m^- = F m + b, \qquad P^- = F P F^T + Q, \qquad G = P F^T (P^-)^{-1}

    .. math:: m^s = m + G (m^s_+ - m^-), \qquad P^s = P + G (P^s_+ - P^-) G^T

    Estimates are the moments of these, with the weights of the last scan: exact where nothing is pruned or
    merged.

    References
    ----------
    Rauch, Tung and Striebel 1965.
    """
    scans, intervals, built = prepared(scans, build, period, prior_time)
    steps = [(built[interval], z) for interval, z in zip(intervals, scans.z, strict=True) if interval]
    belief, prior = steps[0][0].init(), steps[0][0].model.prior
    kept, parents, alive = [prior], [], [True]
    estimates = [moments(prior)]
    for tracker, z in steps:
        if not isinstance(tracker, Tracing):
            raise ValueError("smoothing needs a tracker with `trace`, such as runnalls-30, mht or pda")
        belief, report, trace = tracker.trace(belief, z)
        kept.append(report.mixture)
        parents.append(_heaviest_parents(trace, len(report.mixture.w)))
        alive.append(report.alive)
        estimates.append((report.x[0], report.P[0]))
    back = _smoothed(kept, parents, [tracker.model.motion for tracker, _ in steps])
    at = slice(1 if intervals[0] else 0, None)  # the prior is of the first scan, or of none
    count, seen = np.array([len(mixture.w) for mixture in kept])[at], np.array(alive)[at]
    filtered, smoothed = (
        Track(
            scans.times, np.array([x for x, _ in each[at]]), np.array([P for _, P in each[at]]), count, seen
        )
        for each in (estimates, back)
    )
    return filtered, smoothed


def _heaviest_parents(trace: Trace, n: int) -> np.ndarray:
    """For each of n hypotheses kept the parent of the heaviest that went into it."""
    heaviest = np.where(trace.into == np.arange(n)[:, None], trace.full.w, -1.0).argmax(axis=1)
    parents = trace.parent[heaviest]
    if (parents < 0).any():
        raise ValueError("smoothing needs hypotheses that have one parent each, such as those of runnalls-30")
    return parents


def _smoothed(
    kept: list[Mixture], parents: list[np.ndarray], motions: list[Motion]
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Mean and covariance of each of the mixtures kept, given all scans."""
    w, m, P = kept[-1]
    row, found = np.arange(len(w)), [moments(kept[-1])]
    for before, parent, (F, Q, offset) in zip(kept[-2::-1], parents[::-1], motions[::-1], strict=True):
        row = parent[row]
        m_here, P_here = before.m[row], before.P[row]
        ahead = F @ P_here @ F.T + Q
        G = np.linalg.solve(ahead, F @ P_here).swapaxes(1, 2)
        m = m_here + (G @ (m - m_here @ F.T - offset)[:, :, None])[:, :, 0]
        P = P_here + G @ (P - ahead) @ G.swapaxes(1, 2)
        found.append(moments(Mixture(w, m, P)))
    return found[::-1]
