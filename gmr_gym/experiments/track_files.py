"""The files that tracks of many targets leave behind."""

import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.checks import _check_positive, check_choice
from gmr_gym.envs.lookup import parsed
from gmr_gym.evaluation.csv_columns import check_memory
from gmr_gym.experiments import specs
from gmr_gym.experiments.detection_options import OUTPUT, typed
from gmr_gym.experiments.figures import counted
from gmr_gym.experiments.options import TARGETS
from gmr_gym.experiments.proposing import asks, proposed
from gmr_gym.experiments.reading import detections_of
from gmr_gym.experiments.tracks import (
    are_reports,
    is_smoothed,
    many_targets_model,
    smoothed_beside,
    tracker_asked,
)
from gmr_gym.recorded.accuracy import accuracy, label_accuracy
from gmr_gym.recorded.array_records import chosen
from gmr_gym.recorded.configuration import Configuration
from gmr_gym.recorded.detections import Detections
from gmr_gym.recorded.figures import Figure
from gmr_gym.recorded.geojson import check_georeferenced, write_geojson
from gmr_gym.recorded.labels import write_labelled
from gmr_gym.recorded.model import TRACKERS, TrackingModel
from gmr_gym.recorded.output import confirmed_only, write_mot, write_tracks
from gmr_gym.recorded.plugged_trackers import Plugged, plugged, track_plugged
from gmr_gym.recorded.quality import quality
from gmr_gym.recorded.report import ENDINGS, in_lines, in_short, write_report
from gmr_gym.recorded.scans import Scan, cut
from gmr_gym.recorded.smoothing import smooth
from gmr_gym.recorded.tracking import track
from gmr_gym.recorded.tracks import Tracks
from gmr_gym.recorded.truth import Truth, at_times, truth_of
from gmr_gym.replay.page import write_page
from gmr_gym.replay.tracked import recording_of

BYTES = 1200  # of a detection's scan, row of a track and figures, at least
KINDS = {
    "out": (".csv",), "smooth": (".csv",), "geojson": (".geojson", ".json"), "html": (".html",),
    "mot": (".txt",), "labelled": (".csv", ".txt", ".tsv"), "report": ENDINGS,
}  # fmt: skip


def track_many(
    file: Path, out: Path | None, settings: Configuration, given: Mapping[str, Any], own: Mapping[str, Any]
) -> Iterator[str]:
    """Track the targets of a file, write what is asked for, and say what was done; `given` are options by
    name, `own` those of one target alone, which are refused."""
    for name in (name for name, value in own.items() if value is not None and name != "tracker"):
        raise ValueError(f"--{name.replace('_', '-')} is of one target; give --targets one")
    asked, tracker = outputs(out, file, settings, given), tracker_asked(own["tracker"], settings)
    found = detections_of(file, settings)
    n = len(found.time)
    check_memory(f"{file}: tracks of {n} detections", n * BYTES, "choose rows with --where")
    scans = cut(found, window=given["scan_window"])
    if asks(settings):
        settings, proposal = proposed(found, scans, settings)
        yield from (f"proposed: {line}" for line in proposal.lines)
        found = detections_of(file, settings)
    model = many_targets_model(found, settings, given, tracker)
    found = found._replace(sensors=model.sensors)  # with what is assumed where nothing is known
    run = Run(
        file, settings, found, scans, are_reports(found, scans), model, _command(file, tracker, given, asked)
    )
    truth, other = check_run(run, asked), plugged_for(tracker, run)
    if asked["dry_run"]:
        yield from planned(run, asked)
        return
    yield f"tracking {_size(run)} by {tracker}"
    yield from unused(other) if other else ()
    if other:
        tracks = track_plugged(other, found, scans, model)
    else:
        tracks = track(found, scans, model, reports=run.reports)
    yield from write_all(tracks, run, asked, truth)


class Run(NamedTuple):
    """What was tracked, and how."""

    source: Path
    settings: Configuration
    detections: Detections
    scans: Sequence[Scan]
    reports: bool  # whether scans are single reports of targets
    model: TrackingModel
    command: str

    @property
    def modes(self) -> list[str]:
        """Names of the motion models."""
        return [f"{mode.motion}_{mode.deviation:g}" for mode in self.model.modes]


def plugged_for(tracker: str, run: Run) -> Plugged | None:
    """The installed tracker of this name for the detections of a run, which must be scans; None for those of
    `TRACKERS`."""
    if tracker in TRACKERS:
        return None
    name, parameters = parsed(tracker)
    if run.reports:
        raise ValueError(
            f"tracker {name!r} needs scans, and these are reports of single targets: give --scan-window, or "
            f"one of {', '.join(TRACKERS)}"
        )
    return plugged(name, parameters, run.detections, run.scans, run.model)


def unused(other: Plugged) -> list[str]:
    """What a tracker does not use, in a line."""
    line = f"{other.name} does not use {'; '.join(other.unused)}: {', '.join(TRACKERS)} do"
    return [line] if other.unused else []


def outputs(
    out: Path | None, source: Path, settings: Configuration, given: Mapping[str, Any]
) -> dict[str, Any]:
    """What is written, by option: as typed, or else as the settings say. Refused before the work: files that
    could not be written, that are there already, or whose ending is of another kind."""
    asked = {name: given[name] for name in OUTPUT}
    for name, value in settings.output.items():
        if name in OUTPUT and asked[name] == OUTPUT[name].default:
            asked[name] = Path(value) if name in KINDS and name != "smooth" else value
    asked["out"] = out or Path(settings.output.get("out", "tracks.csv"))
    asked["only"] = asked["only"] or "confirmed"
    asked["smooth"] = smoothed_beside(asked["out"]) if is_smoothed(settings, given) else None
    check_choice("--only", asked["only"], ("confirmed", "all"))
    _check_positive(**{"--cutoff": asked["cutoff"]})
    files = {name: asked[name] for name in KINDS if asked[name]}
    for name, file in files.items():
        specs.check_ending(f"--{name}", file, *KINDS[name])
        specs.check_absent(f"--{name}", file, asked["overwrite"])
    specs.check_writable(*files.values(), beside=(source, given["config"], given["truth_file"]))
    return asked


def targets_asked(typed: str | None, settings: Configuration) -> str:
    """Whether one target or many are in the file: as typed, or else as the settings say, or else many."""
    found = typed or settings.tracks.get("targets", "many")
    check_choice("targets", found, TARGETS)
    return found


def planned(run: Run, asked: Mapping[str, Any]) -> list[str]:
    """What would be done, in words."""
    return [
        f"{_size(run)} would be tracked",
        f"would write {_named(asked)}",
    ]


def check_run(run: Run, asked: Mapping[str, Any]) -> Truth | None:
    """The truth, where there is a file of it; ValueError for what the detections do not allow."""
    if asked["geojson"]:
        check_georeferenced(run.detections)
    return truth_of(asked["truth_file"], run.detections) if asked["truth_file"] else None


def write_all(tracks: Tracks, run: Run, asked: Mapping[str, Any], truth: Truth | None) -> Iterator[str]:
    """Write every file that is asked for, and say what was done and how good it is."""
    times = np.unique([scan.time for scan in run.scans])
    kept = _shown(tracks, asked)
    groups, over_time = _figures(tracks, run, asked, truth, times)
    write_tracks(asked["out"], kept, run.detections, modes=run.modes, command=run.command)
    if asked["smooth"]:
        whole = chosen(tracks, np.isin(tracks.track, kept.track))
        smoothed = _shown(smooth(whole, run.detections, run.model), asked)
        write_tracks(asked["smooth"], smoothed, run.detections, modes=run.modes, command=run.command)
        if truth:
            groups["Smoothed, with a truth"], _ = accuracy(smoothed, truth, times, asked["cutoff"])
    if asked["geojson"]:
        write_geojson(asked["geojson"], kept, run.detections)
    if asked["html"]:
        _write_page(asked["html"], kept, run, truth)
    if asked["mot"]:
        write_mot(asked["mot"], kept, times)
    if asked["labelled"]:
        form = {k: v for k, v in run.settings.reading.items() if k in ("delimiter", "encoding", "header")}
        write_labelled(asked["labelled"], kept, run.detections, run.source, **form)
    if asked["report"]:
        write_report(asked["report"], groups, over_time, command=run.command, remarks=run.detections.remarks)
    yield from run.detections.remarks
    (_, first), *others = groups.items()
    lines = in_short(first)
    for title, figures in others:
        lines += [f"{title}:", *in_lines(figures)]
    yield from lines
    if any(line.endswith("!") for line in lines):
        yield "! marks what is not as expected"
    sizes = counted(len(run.scans), "scan"), counted(len(np.unique(kept.track)), "track")
    yield f"{', '.join(sizes)}; written to {_named(asked)}"


def _shown(tracks: Tracks, asked: Mapping[str, Any]) -> Tracks:
    """The rows that are written."""
    return confirmed_only(tracks) if asked["only"] == "confirmed" else tracks


def _write_page(file: Path, tracks: Tracks, run: Run, truth: Truth | None) -> None:
    true = None
    if truth:
        at = np.array([scan.time for scan in run.scans])
        true, _ = at_times(truth.time, truth.target, truth.position[:, :2], at)
    write_page(recording_of(tracks, run.detections, run.scans, title=run.source.name, truth=true), file)


def _command(source: Path, tracker: str, given: Mapping[str, Any], asked: Mapping[str, Any]) -> str:
    """What was typed, with all that it was understood as."""
    by = ["--tracker", tracker] if tracker != TRACKERS[0] else []
    words = ["track", f"{source}", "--targets", "many", *by, *typed(given), "--out", f"{asked['out']}"]
    return shlex.join(["gmr-gym", *words])


def _size(run: Run) -> str:
    return f"{counted(len(run.detections.time), 'detection')} in {counted(len(run.scans), 'scan')}"


def _named(asked: Mapping[str, Any]) -> str:
    return ", ".join(str(asked[name]) for name in KINDS if asked[name])


def _figures(
    tracks: Tracks, run: Run, asked: Mapping[str, Any], truth: Truth | None, times: np.ndarray
) -> tuple[dict[str, list[Figure]], dict[str, list[float]]]:
    """Figures by title, and those by scan."""
    groups = {"Without a truth": quality(tracks, run.detections, run.scans, reports=run.reports)}
    over_time: dict[str, list[float]] = {}
    if any(name is not None for name in run.detections.truth):
        groups["With the targets that the input names"] = label_accuracy(tracks, run.detections)
    if truth:
        groups["With a truth"], over_time = accuracy(tracks, truth, times, asked["cutoff"])
    return groups, over_time
