"""The loop: a tracker through the scans of an episode."""

from collections.abc import Iterator
from time import perf_counter
from typing import NamedTuple

from gmr_gym.filters.tracker import Report, Tracker
from gmr_gym.simulation.single_target import Episode, Scan, Scenario, scan


class Played(NamedTuple):
    """One scan and what the tracker made of it."""

    t: int  # from 0
    scan: Scan
    report: Report
    seconds: float  # the tracker alone


def play(scenario: Scenario, tracker: Tracker, episode: Episode) -> Iterator[Played]:
    """The tracker's account of every scan. A window that follows is centred on what it said of the
    scan before; a tracker with `knows_origin` is handed the target's own detection and no clutter."""
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
