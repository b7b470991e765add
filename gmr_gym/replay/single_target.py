"""The columns of a tracker of one target."""

from collections.abc import Callable
from itertools import islice
from typing import Any

import numpy as np

from gmr_gym.evaluation.loop import Played, is_off_target, play
from gmr_gym.evaluation.metrics import lost_at
from gmr_gym.filters.trace import Trace
from gmr_gym.filters.tracker import Report, Tracker
from gmr_gym.mixture import Mixture
from gmr_gym.models.gating import Gates
from gmr_gym.replay.columns import Reported, gathered, upper
from gmr_gym.simulation.single_target import Episode, Scenario, draw

__all__ = ["columns_of", "draw", "truth_of"]
GROUPS = {
    "z": ("z",),
    "gate": ("gate", "gate_shape"),
    "kept": ("kept_w", "kept", "kept_P", "full_per_kept"),
    "full": ("full_w", "full", "full_P", "full_parent", "full_detection", "full_into", "full_mode"),
}
NEGLIGIBLE = 1e-4  # weight, below which a hypothesis is left out, unless it is the heaviest of a merge


def truth_of(scenario: Scenario, episode: Episode, scans: int) -> dict[str, np.ndarray]:
    """The column of the true positions (T, 2) in the first scans of an episode."""
    return {"truth": episode.x[:scans, scenario.position[:2]]}


def columns_of(
    scenario: Scenario, tracker: Tracker, name: str, episode: Episode, scans: int, tell: Callable[[int], None]
) -> dict[str, np.ndarray]:
    """Run a tracker through the first scans of an episode.

    Parameters
    ----------
    scenario : Scenario
    tracker : Tracker
    name : str
        Of the tracker, in messages.
    episode : Episode
    scans : int
    tell : callable
        Called after each scan with the number of scans done.

    Returns
    -------
    dict of str to ndarray
        The tracker's columns, as in `gmr_gym.replay.recording.Recording`.

    Raises
    ------
    ValueError
        For a report whose shapes do not fit.

    Warns
    -----
    UserWarning
        For numbers that are not finite.
    """
    traced, reported, rows = _Traced(tracker), Reported(name), []
    before = 1 << 31  # of the mixture that it starts with, which the tracker alone knows
    for played in islice(play(scenario, traced, episode), scans):
        reported.scan = played.t + 1
        row = _row(scenario, tracker, reported, played, episode.x[played.t])
        if traced.trace is not None:
            row |= _full(scenario, reported, traced, played, before)
        rows.append(row)
        before = row["count"]
        tell(reported.scan)
    reported.warn()
    columns = gathered(rows, GROUPS)
    columns["lost_at"] = lost_at(columns["off_target"][None], scenario.patience)
    return columns


class _Traced:
    """A tracker whose trace of the last scan, None where it has none, is kept while `play` runs it."""

    def __init__(self, tracker: Any):
        self.init, self._step = tracker.init, getattr(tracker, "trace", None) or tracker.step
        self.model, self.knows_origin = tracker.model, getattr(tracker, "knows_origin", False)
        self.trace: Any = None

    def step(self, belief: Any, z: np.ndarray) -> tuple[Any, Report]:
        """Belief after the scan `z` (k, p), and its report."""
        belief, report, *trace = self._step(belief, z)
        self.trace = trace[0] if trace else None
        return belief, report


def checked(scenario: Scenario, reported: Reported, report: Report) -> Report:
    """A tracker's report, with nan for numbers that are not finite and without the gates that have any.

    Parameters
    ----------
    scenario : Scenario
    reported : Reported
        Of the tracker, at the scan of the report.
    report : Report

    Returns
    -------
    Report

    Raises
    ------
    ValueError
        For what is no Report, for wrong shapes, and for an estimate that is not finite where the window
        follows it.
    """
    d = scenario.model.prior.m.shape[1]
    reported.fields("report", report, Report)
    x, P = reported.array("x", report.x, 1, d), reported.array("P", report.P, 1, d, d)
    if scenario.window.follows and not np.isfinite(x).all():
        raise ValueError(f"{reported.place('x')}: the window follows the estimate, which is not finite")
    return Report(
        x,
        P,
        _gates(reported, report.gates, scenario),
        reported.mixture("mixture", report.mixture, d),
        bool(reported.array("alive", report.alive)),
        reported.array("modes", report.modes, None),
    )


def _row(
    scenario: Scenario, tracker: Tracker, reported: Reported, played: Played, truth: np.ndarray
) -> dict[str, Any]:
    """What is shown of a scan, but for its full posterior."""
    scan, report = played.scan, checked(scenario, reported, played.report)
    position, sensor = list(scenario.position), scenario.model.sensor
    points = tracker.model.sensor.to_gate_space(scan.z)
    modes = {}
    if len(report.modes) > 1:
        modes["mode_p"] = reported.array("modes", report.modes, len(tracker.model.motions))
    return {
        "z": sensor.to_gate_space(scan.z)[:, :2],
        "target": np.append(np.flatnonzero(scan.origin == 0), -1)[0],
        "estimate": report.x[0, position[:2]],
        "estimate_P": upper(report.P, position[:2])[0],
        "error": np.linalg.norm(report.x[0, position] - truth[position]),
        "alive": report.alive,
        "off_target": is_off_target(scenario, report, truth, points, scan.origin),
        **_ellipses(report.mixture, report.gates, position[:2]),
        **modes,
    }


def _ellipses(kept: Mixture, gates: Gates, at: list[int]) -> dict[str, Any]:
    """The hypotheses that were kept, and the outlines of the gates, none where they are without end."""
    z, S, threshold = gates if np.isfinite(gates.threshold) else (gates.z[:0], gates.S[:0], 1.0)
    return {
        "gate": z[:, :2],
        "gate_shape": upper(S * threshold),
        "kept_w": kept.w,
        "kept": kept.m[:, at],
        "kept_P": upper(kept.P, at),
        "count": len(kept.w),
    }


def _gates(reported: Reported, gates: Gates, scenario: Scenario) -> Gates:
    """The gates but for those with numbers that are not finite: such a gate contains nothing."""
    reported.fields("gates", gates, Gates)
    p = len(scenario.model.sensor.H)
    z = reported.array("gates.z", gates.z, None, p)
    S = reported.array("gates.S", gates.S, len(z), p, p)
    sound = np.isfinite(z).all(axis=1) & np.isfinite(S).all(axis=(1, 2))
    return Gates(z[sound], S[sound], float(gates.threshold))


def _full(
    scenario: Scenario, reported: Reported, traced: _Traced, played: Played, before: int
) -> dict[str, Any]:
    """The hypotheses before the reduction, and what became of each; `before` were kept of the scan before."""
    reported.fields("trace", traced.trace, Trace)
    full = reported.mixture("trace.full", traced.trace.full, scenario.model.prior.m.shape[1])
    given = np.append(np.flatnonzero((played.scan.origin >= 0) | (not traced.knows_origin)), -1)
    kept = len(played.report.mixture.w)
    below = before, len(given) - 1, kept, len(traced.model.motions)
    rows = {
        field: reported.rows(f"trace.{field}", getattr(traced.trace, field), len(full.w), end)
        for field, end in zip(("parent", "detection", "into", "mode"), below, strict=True)
    }
    rows["detection"] = given[rows["detection"]]
    into, heaviest = rows["into"], np.zeros(kept)
    merged = into >= 0
    np.maximum.at(heaviest, into[merged], full.w[merged])
    shown = full.w >= NEGLIGIBLE
    shown[merged] |= full.w[merged] == heaviest[into[merged]]
    at = scenario.position[:2]
    return {
        "full_w": full.w[shown],
        "full": full.m[shown][:, at],
        "full_P": upper(full.P[shown], at),
        **{f"full_{field}": values[shown] for field, values in rows.items()},
        "full_per_kept": np.bincount(into[merged], minlength=kept),
        "full_rest_count": (~shown & ~merged).sum(),
        "full_rest_merged": (~shown & merged).sum(),
        "full_rest_w": full.w[~shown].sum(),
    }
