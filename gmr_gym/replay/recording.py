"""An episode with all that trackers report of it, as plain arrays."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.models.radar import Radar
from gmr_gym.replay import multi_target, single_target
from gmr_gym.replay.lineup import check_shown, scans_shown
from gmr_gym.simulation.multi_target import MultiTargetScenario
from gmr_gym.simulation.single_target import Scenario


class Recording(NamedTuple):
    """An episode, and what each tracker made of it.

    Attributes
    ----------
    environment : str
        Its id, or another name.
    seed : int or None
        None of recorded detections.
    kind : str
        "one" target, or "many".
    period : float
        s.
    scans : int
        T.
    patience : int
        Scans in a row off target that make a track lost; 0 for many targets.
    radar : bool
        Whether positions are about a radar.
    modes : tuple of str
        Names of the motion models.
    trackers : tuple of str
    columns : dict of str to ndarray
        By name; those of tracker i begin with "i/".

    Notes
    -----
    Positions have two coordinates, m, and covariances three entries: xx, xy, yy. Rows of scan t, from 0, are
    at G_start[t] : G_start[t + 1] where there is such a column; all others have a row a scan. What is missing
    is nan. Of one target there is the `truth` (T, 2), and of each tracker:

    ==================================================  ======================================================
    z; target                                           detections; row of the target-originated one, or -1
    gate, gate_shape                                    gates: (z - gate)' shape^-1 (z - gate) <= 1
    kept_w, kept, kept_P; count                         mixture after the reduction; number of its components
    full_w, full, full_P                                hypotheses before it, where the tracker has a trace
    full_per_kept                                       number of them that went into each component of kept
    full_parent, full_detection, full_into, full_mode   of each, as in `gmr_gym.filters.trace.Trace`
    full_rest_count, full_rest_merged, full_rest_w      hypotheses of negligible weight that are left out:
                                                        number of pruned and of merged ones, weight of all
    estimate, estimate_P, error                         position, its covariance, distance from the truth, m
    alive, off_target                                   not given up; off target by the loss rule
    lost_at                                             (1,), scan at which the track is lost, or -1
    mode_p                                              (T, r), probabilities of motion models, where r > 1
    ==================================================  ======================================================

    Of many targets there is the `truth` (T, n, 2), nan where a target is absent, the ellipses of the true
    clutter, `clutter` and `clutter_P`, of recorded detections the `time` of each scan, and of each tracker:

    ==================================================  ======================================================
    z, origin                                           detections; index of the target of each, or -1
    declared, existence, label                          declared targets
    kept_w, kept, kept_P; count                         intensity; number of its components
    guess, guess_P                                      ellipses of the clutter that the tracker assumes
    expected, present, gospa                            expected and true number of targets; distance of the
                                                        declared ones from the true ones, m
    ==================================================  ======================================================
    """

    environment: str
    seed: int | None
    kind: str
    period: float
    scans: int
    patience: int
    radar: bool
    modes: tuple[str, ...]
    trackers: tuple[str, ...]
    columns: dict[str, np.ndarray]


def record(
    scenario: Scenario | MultiTargetScenario,
    trackers: Mapping[str, Any],
    seed: int = 0,
    scans: int | None = None,
    *,
    environment: str = "",
    progress: Callable[[int, int], None] | None = None,
) -> Recording:
    """Run trackers through the episode of a seed, and keep what they report.

    Parameters
    ----------
    scenario : Scenario or MultiTargetScenario
    trackers : mapping of str to Tracker or MultiTargetTracker
        From 1 to `gmr_gym.replay.lineup.MOST_TRACKERS`.
    seed : int
    scans : int, optional
        The first scans of the episode; all by default.
    environment : str
        Name of the environment.
    progress : callable, optional
        Called with the numbers of scans done and of all, of all trackers.

    Returns
    -------
    Recording

    Raises
    ------
    ValueError
        For another number of trackers or one that does not fit, fewer than 1 scan or more than there are, and
        reports of wrong shapes.

    Warns
    -----
    UserWarning
        For a tracker that reports numbers that are not finite.

    Examples
    --------
    >>> from gmr_gym import make_tracker
    >>> from gmr_gym.replay import record
    >>> from gmr_gym.scenarios.dortenzio import turning_target
    >>> scenario = turning_target(clutter_rate=20)
    >>> kept = record(scenario, {"pda": make_tracker("pda", scenario.model)}, seed=1, scans=3)
    >>> kept.columns["truth"].shape, kept.columns["0/count"].tolist()
    ((3, 2), [1, 1, 1])
    """
    check_shown(trackers, seed, scenario, environment)
    kind: Any = single_target
    if isinstance(scenario, MultiTargetScenario):
        kind, label, patience, motions = multi_target, "many", 0, 0
    else:
        label, patience = "one", scenario.patience
        motions = max(len(tracker.model.motions) for tracker in trackers.values())
    episode = kind.draw(scenario, int(seed))
    total = scans_shown(len(episode.x), scans)
    columns = kind.truth_of(scenario, episode, total)
    for i, (name, tracker) in enumerate(trackers.items()):

        def tell(done: int, before: int = i * total) -> None:
            if progress:
                progress(before + done, total * len(trackers))

        own = kind.columns_of(scenario, tracker, name, episode, total, tell)
        columns |= {f"{i}/{column}": values for column, values in own.items()}
    modes = tuple(f"motion {i + 1}" for i in range(motions))
    radar = isinstance(scenario.model.sensor, Radar)
    return Recording(
        environment,
        int(seed),
        label,
        scenario.period,
        total,
        patience,
        radar,
        modes,
        tuple(trackers),
        columns,
    )
