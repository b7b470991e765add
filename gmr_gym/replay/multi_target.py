"""The columns of a tracker of many targets."""

from collections.abc import Callable
from itertools import islice
from typing import Any

import numpy as np

from gmr_gym.evaluation.metrics import gospa
from gmr_gym.evaluation.multi_target_runs import play
from gmr_gym.filters.tracker import MultiTargetReport, MultiTargetTracker
from gmr_gym.mixture import Mixture, joined
from gmr_gym.models.clutter import Clutter
from gmr_gym.replay.columns import Reported, gathered, upper
from gmr_gym.simulation.multi_target import MultiTargetEpisode, MultiTargetScenario, draw

__all__ = ["columns_of", "draw", "truth_of"]
GROUPS = {
    "declared": ("declared", "existence", "label"),
    "kept": ("kept_w", "kept", "kept_P"),
    "guess": ("guess", "guess_P"),
}
EDGE = 5.99  # squared Mahalanobis distance within which 95 % of a Gaussian of the plane lie


def truth_of(scenario: MultiTargetScenario, episode: MultiTargetEpisode, scans: int) -> dict[str, np.ndarray]:
    """The columns of the true positions (T, n, 2), nan where a target is absent, and of the true clutter.

    Parameters
    ----------
    scenario : MultiTargetScenario
    episode : MultiTargetEpisode
    scans : int
    """
    clutter = gathered(
        (_ellipses("clutter", _groups(scenario.clutter(t))) for t in range(scans)),
        {"clutter": ("clutter", "clutter_P")},
    )
    return {"truth": episode.x[:scans][:, :, list(scenario.position[:2])], **clutter}


def columns_of(
    scenario: MultiTargetScenario,
    tracker: MultiTargetTracker,
    name: str,
    episode: MultiTargetEpisode,
    scans: int,
    tell: Callable[[int], None],
) -> dict[str, np.ndarray]:
    """Run a tracker through the first scans of an episode.

    Parameters, what is returned, raised and warned of are as in `gmr_gym.replay.single_target.columns_of`.
    """
    reported, rows = Reported(name), []
    for t, (report, _) in islice(enumerate(play(tracker, episode)), scans):
        reported.scan = t + 1
        rows.append(_row(scenario, reported, report, episode.x[t]))
        tell(reported.scan)
    reported.warn()
    last = episode.first[scans]
    seen = {"z": episode.z[:last, :2], "origin": episode.origin[:last], "z_start": episode.first[: scans + 1]}
    return seen | gathered(rows, GROUPS)


def _row(
    scenario: MultiTargetScenario, reported: Reported, report: MultiTargetReport, states: np.ndarray
) -> dict[str, Any]:
    """What is shown of a scan."""
    reported.fields("report", report, MultiTargetReport)
    d, at = states.shape[1], list(scenario.position)
    x = reported.array("x", report.x, None, d)
    intensity = reported.mixture("intensity", report.intensity, d)
    guess = reported.mixture("clutter", _groups(report.clutter), len(scenario.sensor.R))
    found, truth = x[np.isfinite(x).all(axis=1)], states[np.isfinite(states).all(axis=1)]
    return {
        "declared": x[:, at[:2]],
        "existence": reported.array("existence", report.existence, len(x)),
        "label": reported.rows("label", report.label, len(x), 1 << 31),
        "kept_w": intensity.w,
        "kept": intensity.m[:, at[:2]],
        "kept_P": upper(intensity.P, at[:2]),
        **_ellipses("guess", guess),
        "expected": reported.array("expected_targets", report.expected_targets),
        "gospa": gospa(found[:, at], truth[:, at], scenario.cutoff, scenario.order).total,
        "present": len(truth),
        "count": len(intensity.w),
    }


def _groups(clutter: Clutter) -> Mixture:
    """The parts of the clutter that are not uniform in its box: ellipses that hold 95 % of each."""
    return joined((clutter.gaussians._replace(P=EDGE * clutter.gaussians.P), clutter.ellipses))


def _ellipses(name: str, groups: Mixture) -> dict[str, np.ndarray]:
    """The columns of ellipses."""
    return {name: groups.m[:, :2], f"{name}_P": upper(groups.P)}
