"""Detections in files: an episode recorded, and a recording tracked, as of one target or of many."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from gmr_gym.catalogue import GROUP, MULTI_TARGET_GROUP, tracker_entry_points
from gmr_gym.envs.lookup import parsed, tracker_of
from gmr_gym.evaluation import recordings
from gmr_gym.evaluation.loop import play
from gmr_gym.experiments.detection_options import TARGET, TRACKS, said_by
from gmr_gym.experiments.specs import numbers
from gmr_gym.models.intervals import Mode
from gmr_gym.points import FARTHEST
from gmr_gym.recorded.configuration import Configuration
from gmr_gym.recorded.detections import CARTESIAN, Detections
from gmr_gym.recorded.model import TRACKERS, TrackingModel, tracking_model
from gmr_gym.recorded.positions import box_of
from gmr_gym.recorded.roles import check_plain
from gmr_gym.recorded.scans import Scan, cut, equal_times
from gmr_gym.recorded.units import did_you_mean
from gmr_gym.simulation.single_target import Scenario, draw


def record_episode(scenario: Scenario, tracker: str, seed: int, out: Path, truth: Path | None) -> None:
    """Writes the detections of an episode, and its truth where a file for it is given. A window that follows
    a tracker follows this one."""
    episode = draw(scenario, seed)
    z = [played.scan.z for played in play(scenario, tracker_of(tracker, scenario), episode)]
    times = scenario.period * np.arange(1, len(z) + 1)
    recordings.write_scans(out, times, z, scenario.sensor.coordinates, time="time_s")
    if truth:
        positions = episode.x[:, list(scenario.position)]
        names = [f"{axis}_m" for axis in "xyz"[: positions.shape[1]]]
        recordings.write_scans(truth, times, list(positions[:, None]), names, time="time_s")


def plain_scans(file: Path) -> recordings.Scans:
    """Scans of a file of times in seconds and positions in metres, and of nothing else."""
    scans = recordings.read_scans(file, farthest=FARTHEST)
    recordings.check_positions(file, scans)
    check_plain(f"{file}", scans.coordinates, scans.times)
    return scans


def scans_of_positions(found: Detections, window: float | None) -> recordings.Scans:
    """Scans of detections in local coordinates, m, of one sensor of positions."""
    if found.kind != CARTESIAN or len(found.sensors) > 1:
        raise ValueError(
            "one target is tracked in positions of one sensor, and these are of "
            f"{len(found.sensors)}, {found.kind}; choose one with --where, or give --targets many"
        )
    times, z = equal_times(found, cut(found, window=window))
    axes = found.z.shape[1]
    return recordings.Scans(times, z, ("x_m", "y_m", "z_m")[:axes])


def tracker_asked(typed: str | None, settings: Configuration) -> str:
    """The tracker of many targets, NAME or NAME:key=value,key=value: as typed, or else as the settings say,
    or else `pmb`."""
    spec = typed or str(settings.tracks.get("tracker", TRACKERS[0]))
    if spec in TRACKERS:
        return spec
    name, installed = parsed(spec)[0], tracker_entry_points(MULTI_TARGET_GROUP)
    if name in TRACKERS:
        raise ValueError(f"tracker {name!r} of files of detections takes no parameters, got {spec!r}")
    if {name, name.rpartition("-")[0]} & installed.keys():
        return spec
    one = tracker_entry_points(GROUP)
    if {name, name.rpartition("-")[0]} & one.keys():
        raise ValueError(
            f"tracker {name!r} is for one target; give --targets one, or one of {', '.join(TRACKERS)}"
        )
    known = sorted({*TRACKERS, *installed})
    raise ValueError(f"unknown tracker {name!r}{did_you_mean(name, known)}; choose from {', '.join(known)}")


def many_targets_model(
    found: Detections, settings: Configuration, given: Mapping[str, Any], tracker: str = TRACKERS[0]
) -> TrackingModel:
    """What is assumed of the targets and the sensors of detections; of a tracker that is none of `TRACKERS`,
    what its tracks are assumed to be."""
    low, high = box_of(found)
    volume = float(np.prod(high - low))
    specs = []
    for i, spec in enumerate(found.sensors):
        rates = found.range_rate[found.sensor == i]
        if np.isfinite(rates).any() and not spec.range_rate_deviation > 0:
            raise ValueError(
                f"sensor {spec.name!r} measures range rates; give their deviation too, such as "
                "--sensor-deviation range=50,azimuth=0.1deg,range_rate=1"
            )
        if not all(deviation > 0 for deviation in spec.deviation):
            way = "50 (m)" if spec.kind == CARTESIAN else "range=50,azimuth=0.1deg"
            raise ValueError(f"sensor {spec.name!r} has no deviation; give --sensor-deviation, such as {way}")
        if not np.isnan(spec.clutter_density):
            spec = spec._replace(clutter_per_scan=spec.clutter_density * volume)
        specs.append(spec)
    said = _targets(settings, given) | ({"tracker": tracker} if tracker in TRACKERS else {})
    return tracking_model(specs, low.tolist(), high.tolist(), **said)


def _targets(settings: Configuration, given: Mapping[str, Any]) -> dict[str, Any]:
    """Arguments of `tracking_model`, from the settings and what was typed over them."""
    typed = said_by(given, TARGET, TRACKS)
    said = {**settings.target, **settings.tracks, **typed}
    if "motion" in typed or "acceleration_deviation" in typed:
        said.pop("modes", None)
    if "modes" in said:
        said["motion"] = [
            Mode(str(each.get("motion", "constant-velocity")), float(each["acceleration_deviation"]))
            for each in said.pop("modes")
        ]
    elif "acceleration_deviation" in said:
        deviation = numbers("--acceleration-deviation", str(said["acceleration_deviation"]).strip("[]() "))
        if len(deviation) > 1 and said.get("motion", "imm") != "imm":
            raise ValueError(
                f"--motion {said['motion']} has one acceleration deviation, got {len(deviation)}; give one, "
                "or --motion imm"
            )
        said["acceleration_deviation"] = tuple(deviation)
    for rule in ("confirm", "delete"):
        ratio, existence = said.pop(rule, None), said.pop(f"{rule}_existence", None)
        if ratio is not None and existence is not None:
            if (rule in typed) == (f"{rule}_existence" in typed):
                raise ValueError(f"--{rule} and --{rule}-existence are two rules; give one of them")
            ratio = ratio if rule in typed else None
        if ratio is not None:
            said[rule] = _ratio(f"--{rule}", str(ratio))
        elif existence is not None:
            said[rule] = float(existence)
    for name in ("targets", "tracker"):
        said.pop(name, None)
    if any(sensor.learn_clutter for sensor in settings.sensors):
        said["learn_clutter"] = True
    return said


def _ratio(name: str, text: str) -> tuple[int, int]:
    m, _, n = text.partition("/")
    if not (m.strip().isdigit() and n.strip().isdigit()):
        raise ValueError(f"{name} must be M/N, such as 3/5, got {text!r}")
    return int(m), int(n)


def is_smoothed(settings: Configuration, given: Mapping[str, Any]) -> bool:
    """Whether smoothed tracks are asked for, too."""
    return given["smooth"] or settings.output.get("smooth", False)


def smoothed_beside(out: Path) -> Path:
    """The file of smoothed tracks beside that of tracks."""
    return out.with_stem(f"{out.stem}-smoothed")


def are_reports(found: Detections, scans: list[Scan]) -> bool:
    """Whether scans are single reports of targets with identities."""
    return len(scans) == len(found.time) and all(name is not None for name in found.identity.tolist())
