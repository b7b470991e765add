"""A tracker of one target is tuned on the first half of a recording, and judged on the rest."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.evaluation import recordings
from gmr_gym.evaluation.innovations import log_likelihood
from gmr_gym.evaluation.summary import bootstrap_mean
from gmr_gym.experiments import trials
from gmr_gym.experiments.screen import progress
from gmr_gym.experiments.search_space import Space
from gmr_gym.experiments.sheets import shown
from gmr_gym.experiments.sweeps import stopped
from gmr_gym.experiments.track_one import builder
from gmr_gym.experiments.tuned import spec_with, trials_said, verdict, write_trials
from gmr_gym.mixture import Mixture


class TunedRecording(NamedTuple):
    """A tracker and a recording in 2 * `parts` parts of equal length: the tracker runs through all of it, and
    is tuned by the figures of the first half."""

    scans: recordings.Scans
    start: Mixture  # the prior
    prior_time: float | None
    period: float | None
    assumed: Mapping[str, float]
    spec: str
    truth: np.ndarray  # (T, p), m; nan where it is not known; (0, p) for none
    cutoff: float  # m, at which an error counts as this much
    parts: int

    def check(self, parameters: Mapping[str, Any]) -> None:
        """Makes the trackers."""
        self.prepared(parameters)

    def prepared(
        self, parameters: Mapping[str, Any]
    ) -> tuple[recordings.Scans, list[float], dict[float, Any]]:
        """As `gmr_gym.evaluation.recordings.prepared`, with these parameters."""
        return recordings.prepared(self.scans, self.build(parameters), self.period, self.prior_time)

    def build(self, parameters: Mapping[str, Any]) -> Callable[[float], Any]:
        """Makes a tracker with these parameters for an interval, s."""
        return builder(
            spec_with(self.spec, parameters), self.start, len(self.scans.coordinates), self.assumed
        )

    def values(self, parameters: Mapping[str, Any], first: int, stop: int) -> np.ndarray:
        """Mean of each part first, ..., stop - 1: of the position error, m, or of minus log likelihood."""
        ends = np.linspace(0, len(self.scans.times), 2 * self.parts + 1).round().astype(int)
        figures = self.by_scan(parameters, ends[stop])
        return np.array([np.nanmean(figures[ends[i] : ends[i + 1]]) for i in range(first, stop)])

    def by_scan(self, parameters: Mapping[str, Any], scans: int) -> np.ndarray:
        """The figure of each of the first scans; nan where there is none."""
        _, intervals, built = self.prepared(parameters)
        tracker, found = next(iter(built.values())), np.full(scans, np.nan)
        belief, before, volume = tracker.init(), tracker.model.prior.w, _volume(self.scans)
        axes = len(self.scans.coordinates)
        for t in range(int(not intervals[0]), scans):
            tracker = built[intervals[t]]
            belief, report = tracker.step(belief, self.scans.z[t])
            if len(self.truth):
                found[t] = min(np.linalg.norm(report.x[0, :axes] - self.truth[t]), self.cutoff)
            else:
                found[t] = -log_likelihood(tracker.model, report, before, self.scans.z[t], volume)
            before = report.mixture.w
        return found


def truth_at(file: Path | None, scans: recordings.Scans) -> np.ndarray:
    """True positions (T, p) at the times of scans, m, linear between the rows of a file of positions;
    nan before the first and after the last. (0, p) without a file; ValueError for a file of another kind."""
    axes, times = len(scans.coordinates), scans.times
    if file is None:
        return np.empty((0, axes))
    rows = recordings.read_scans(file)
    if len(rows.coordinates) != axes or any(len(z) != 1 for z in rows.z):
        raise ValueError(f"--truth-file {file} must have a time and {axes} positions a row, one row a time")
    position = np.array([z[0] for z in rows.z])
    within = (times >= rows.times[0]) & (times <= rows.times[-1])
    found = np.column_stack([np.interp(times, rows.times, position[:, i]) for i in range(axes)])
    return np.where(within[:, None], found, np.nan)


def check_parts(problem: TunedRecording) -> None:
    """ValueError where parts of the recording would have no scan, or none with a truth."""
    T, parts = len(problem.scans.times), problem.parts
    if T < 4 * parts:
        raise ValueError(
            f"--parts {parts} to tune on and as many held out need {4 * parts} scans, got {T}; give fewer"
        )
    ends = np.linspace(0, T, 2 * parts + 1).round().astype(int)
    for first, stop in pairwise(ends) if len(problem.truth) else ():
        if not np.isfinite(problem.truth[max(first, 1) : stop]).any():
            raise ValueError(
                f"the truth has no time between scans {first + 1} and {stop}; give fewer --parts"
            )


def tune_recording(
    problem: TunedRecording,
    space: Space,
    default: Mapping[str, Any],
    plan: trials.Plan,
    asked: dict[str, Any],
    out: Path,
) -> Iterator[str]:
    """Tries parameters, runs the best on the rest of the recording beside the default, leaves the trials in
    `out`, and says what was found."""
    study = trials.opened(out / "trials.log", space, default, asked)
    with stopped(out, "trials.log", f"trials are kept in {out}", "no trial was made"):
        with progress("parts tried") as report:
            found = trials.search(study, space, problem, plan, report)
    write_trials(out / "trials.csv", found, space)
    best, parts = trials.best(found), range(problem.parts, 2 * problem.parts)
    values = [problem.values(one, parts.start, parts.stop) for one in ({}, best.parameters)]
    yield from trials_said(found)
    yield from _judged(values, problem, spec_with(problem.spec, best.parameters))
    yield f"use it: gmr-gym track FILE --targets one --tracker {spec_with(problem.spec, best.parameters)}"
    yield f"written to {out}"


def _judged(values: Sequence[np.ndarray], problem: TunedRecording, tuned: str) -> Iterator[str]:
    name = "error" if len(problem.truth) else "likelihood"
    what = "error, m" if len(problem.truth) else "minus log likelihood a scan"
    for spec, figures in zip((problem.spec, tuned), values, strict=True):
        yield f"{spec}: {what}, {shown(name, bootstrap_mean(figures))} in the second half"
    difference = bootstrap_mean(values[1] - values[0])
    yield f"{verdict(difference)}: {shown(name, difference)} in {problem.parts} parts not tuned on"


def _volume(scans: recordings.Scans) -> float:
    """Of the box about all detections, m^p."""
    return float(np.prod(np.ptp(np.concatenate(scans.z), axis=0)))
