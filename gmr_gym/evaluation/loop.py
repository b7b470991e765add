"""The loop that runs a tracker through the scans of an episode."""

from collections.abc import Iterator
from time import perf_counter
from typing import NamedTuple

import numpy as np

from gmr_gym.filters.tracker import Report, Tracker
from gmr_gym.simulation.single_target import Episode, Scan, Scenario, scan


class Played(NamedTuple):
    """One scan, and the tracker's report of it."""

    t: int  # from 0
    scan: Scan
    report: Report
    seconds: float  # the tracker alone


def play(scenario: Scenario, tracker: Tracker, episode: Episode) -> Iterator[Played]:
    """Run a tracker through an episode, scan by scan.

    A window that follows is centred on the estimate of the scan before. A tracker with `knows_origin` gets
    the target-originated measurement and no clutter.

    Parameters
    ----------
    scenario : Scenario
    tracker : Tracker
    episode : Episode

    Yields
    ------
    Played

    Examples
    --------
    >>> from gmr_gym import make_tracker
    >>> from gmr_gym.evaluation import play
    >>> from gmr_gym.scenarios.dortenzio import turning_target
    >>> from gmr_gym.simulation import draw
    >>> scenario = turning_target(clutter_rate=20, horizon=3)
    >>> tracker = make_tracker("nearest-neighbour", scenario.model)
    >>> [played.t for played in play(scenario, tracker, draw(scenario, seed=1))]
    [0, 1, 2]
    """
    knows_origin = getattr(tracker, "knows_origin", False)
    belief = tracker.init()
    prior = scenario.model.prior
    centre = scenario.centre(prior.w @ prior.m)
    for t in range(len(episode.x)):
        seen = scan(scenario, episode, t, centre)
        z = seen.z[seen.origin >= 0] if knows_origin else seen.z
        started = perf_counter()
        belief, report = tracker.step(belief, z)
        seconds = perf_counter() - started
        yield Played(t, seen, report, seconds)
        centre = scenario.centre(report.x[0])


def is_off_target(
    scenario: Scenario, report: Report, x: np.ndarray, points: np.ndarray, origin: np.ndarray
) -> bool:
    """Whether a scan counts as off target: the track is given up, or off by the scenario's loss rule.

    Parameters
    ----------
    scenario : Scenario
    report : Report
        The tracker's report of the scan.
    x : ndarray (d,)
        True state.
    points : ndarray (k, p)
        Detections in the gates' space of the tracker.
    origin : ndarray (k,)
        Index of the target (0), -1 for clutter.

    Returns
    -------
    bool
    """
    own = points[origin == 0]
    target = own[0] if len(own) else np.full(points.shape[1], np.nan)
    return bool(not report.alive or scenario.loss_rule(report.gates, x, target))
