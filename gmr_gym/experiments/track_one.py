"""The track of one target through a file of detections, and the files it is written to."""

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from gmr_gym.envs.lookup import parsed
from gmr_gym.evaluation import recordings
from gmr_gym.evaluation.smoothed_recordings import smoothed_track
from gmr_gym.experiments import specs
from gmr_gym.experiments.detection_options import OUTPUT, TARGET, TRACKS, said_by
from gmr_gym.experiments.figures import counted
from gmr_gym.experiments.reading import one_target_model, one_target_scans
from gmr_gym.experiments.screen import waiting
from gmr_gym.experiments.tracks import is_smoothed, smoothed_beside
from gmr_gym.filters.registry import make_tracker
from gmr_gym.filters.tracker import Tracker
from gmr_gym.mixture import Mixture
from gmr_gym.models.priors import constant_velocity_model, prior_from_first_scan, prior_given
from gmr_gym.recorded.configuration import Configuration

SHARED = "smooth", "acceleration_deviation", "overwrite"  # options of one target and of many
USUAL = {"tracker": "runnalls-30", "prior": "", "prior_deviations": "", "speed": 150.0, "period": None}


def track_one(
    file: Path, out: Path | None, settings: Configuration, given: Mapping[str, Any], own: Mapping[str, Any]
) -> Iterator[str]:
    """Track the target of a file, write its track, and say what was done; `given` are options by name, `own`
    those of one target alone, None where they were not."""
    own = {name: USUAL[name] if value is None else value for name, value in own.items()}
    smooth = is_smoothed(settings, given)
    files = [out or Path("track.csv")]
    files += [smoothed_beside(files[0])] if smooth else []
    _check(given, own)
    specs.check_writable(*files, beside=[file])
    specs.check_ending("--out", files[0], ".csv")
    for option, written in zip(("--out", "--smooth"), files, strict=False):
        specs.check_absent(option, written, given["overwrite"])
    scans = one_target_scans(file, settings, given)
    with waiting(f"tracking {counted(len(scans.times), 'scan')}"):
        tracks, names = _tracked(file, scans, own, smooth, one_target_model(settings, given))
    for name, track in zip(files, tracks, strict=True):
        recordings.write_track(name, track, names)
    times = tracks[0].times
    for i in (~tracks[0].alive).nonzero()[0][:1]:
        yield f"given up at scan {i + 1}, time {times[i]:g}: from there on it only coasts"
    yield f"{counted(len(times), 'scan')} tracked; written to {', '.join(map(str, files))}"


def _check(given: Mapping[str, Any], own: Mapping[str, Any]) -> None:
    """ValueError for what one target's track does not have, and for a prior or speed that is none."""
    for name in said_by(given, OUTPUT, TARGET, TRACKS):
        if name not in SHARED:
            raise ValueError(f"--{name.replace('_', '-')} is of many targets; give --targets many")
    check_start(own)


def check_start(own: Mapping[str, Any]) -> None:
    """ValueError for a prior or a speed that is none."""
    if bool(own["prior"]) != bool(own["prior_deviations"]):
        raise ValueError("give --prior and --prior-deviations together, or neither")
    if not 0 < own["speed"] < float("inf"):
        raise ValueError(f"--speed must be positive and finite, got {own['speed']}")


def _tracked(
    file: Path,
    scans: recordings.Scans,
    own: Mapping[str, Any],
    smooth: bool,
    assumed: dict[str, float],
) -> tuple[list[recordings.Track], list[str]]:
    """The track through the scans of a file, to `smooth` also the smoothed one, and the names of its state,
    from the prior that was typed, its mean and standard deviations, or from the first scan; `assumed` is the
    rest of the filter model."""
    scans, start, prior_time = started(file, scans, own, assumed)
    build, period = builder(own["tracker"], start, len(scans.coordinates), assumed), own["period"]
    if smooth:
        found = [*smoothed_track(scans, build, period, prior_time)]
    else:
        found = [recordings.track(scans, build, period, prior_time)]
    return found, [*scans.coordinates, *(f"{name}_velocity" for name in scans.coordinates)]


def started(
    file: Path, scans: recordings.Scans, own: Mapping[str, Any], assumed: Mapping[str, Any]
) -> tuple[recordings.Scans, Mixture, float | None]:
    """The scans from which on the target of a file is tracked, its prior, and the time of that where it is of
    the first scan."""
    prior = own["prior"], own["prior_deviations"]
    if prior[0]:
        start, prior_time = _prior_typed(prior, len(scans.coordinates)), None
    else:
        scans = recordings.from_first_detection(scans)
        start = prior_from_first_scan(scans.z[0], assumed["sensor_deviation"], own["speed"])
        prior_time = scans.times[0]
    if len(scans.times) == 1 and not (prior[0] and own["period"]):
        raise ValueError(
            f"{file} holds one scan to start from and none after it: give --prior with --prior-deviations, "
            "and --period, or a file with another scan"
        )
    return scans, start, prior_time


def _prior_typed(prior: tuple[str, str], axes: int) -> Mixture:
    state = specs.numbers("--prior", prior[0]), specs.numbers("--prior-deviations", prior[1])
    for name, values in zip(("--prior", "--prior-deviations"), state, strict=True):
        if len(values) != 2 * axes:
            raise ValueError(
                f"{name} must be {axes} positions and {axes} velocities, got {len(values)} numbers"
            )
    return prior_given(*state)


def builder(
    tracker: str, start: Mixture, axes: int, assumed: Mapping[str, Any]
) -> Callable[[float], Tracker]:
    """Makes the tracker NAME:key=value,key=value for an interval, s."""

    def build(interval: float) -> Tracker:
        model = constant_velocity_model(interval, start, axes=axes, **assumed)
        name, parameters = parsed(tracker)
        return make_tracker(name, model, **parameters)

    return build
