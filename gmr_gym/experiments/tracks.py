"""Detections in files: an episode recorded, and a recording tracked."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from gmr_gym.envs.lookup import parsed, tracker_of
from gmr_gym.evaluation import recordings
from gmr_gym.evaluation.loop import play
from gmr_gym.experiments.specs import numbers
from gmr_gym.filters.registry import make_tracker
from gmr_gym.filters.tracker import Tracker
from gmr_gym.mixture import Mixture
from gmr_gym.models.priors import constant_velocity_model, prior_from_first_scan, prior_given
from gmr_gym.points import FARTHEST
from gmr_gym.simulation.single_target import Scenario, draw


def record_episode(scenario: Scenario, tracker: str, seed: int, out: Path, truth: Path | None) -> None:
    """Writes the detections of an episode, and its truth where a file for it is given. A window that follows
    a tracker follows this one."""
    episode = draw(scenario, seed)
    z = [played.scan.z for played in play(scenario, tracker_of(tracker, scenario), episode)]
    times = scenario.period * np.arange(1, len(z) + 1)
    recordings.write_scans(out, times, z, scenario.sensor.coordinates)
    if truth:
        positions = episode.x[:, list(scenario.position)]
        names = [f"{axis}_m" for axis in "xyz"[: positions.shape[1]]]
        recordings.write_scans(truth, times, list(positions[:, None]), names)


def track_file(
    file: Path, tracker: str, prior: tuple[str, str], speed: float, period: float | None, **assumed: float
) -> tuple[recordings.Track, list[str]]:
    """The track through a file of detections and the names of its state, from the prior that was typed, its
    mean and standard deviations, or from the first scan; `assumed` is the rest of the filter model."""
    scans = recordings.read_scans(file, farthest=FARTHEST)
    recordings.check_positions(file, scans)
    axes = len(scans.coordinates)
    if prior[0]:
        start, prior_time = _prior_typed(prior, axes), None
    else:
        scans = recordings.from_first_detection(scans)
        start = prior_from_first_scan(scans.z[0], assumed["sensor_deviation"], speed)
        prior_time = scans.times[0]
    if len(scans.times) == 1 and not (prior[0] and period):
        raise ValueError(
            f"{file} holds one scan to start from and none after it: give --prior with --prior-deviations, "
            "and --period, or a file with another scan"
        )
    track = recordings.track(scans, _builder(tracker, start, axes, assumed), period, prior_time)
    return track, [*scans.coordinates, *(f"{name}_velocity" for name in scans.coordinates)]


def _prior_typed(prior: tuple[str, str], axes: int) -> Mixture:
    state = numbers("--prior", prior[0]), numbers("--prior-deviations", prior[1])
    for name, values in zip(("--prior", "--prior-deviations"), state, strict=True):
        if len(values) != 2 * axes:
            raise ValueError(
                f"{name} must be {axes} positions and {axes} velocities, got {len(values)} numbers"
            )
    return prior_given(*state)


def _builder(tracker: str, start: Mixture, axes: int, assumed: dict[str, Any]) -> Callable[[float], Tracker]:
    def build(interval: float) -> Tracker:
        model = constant_velocity_model(interval, start, axes=axes, **assumed)
        name, parameters = parsed(tracker)
        return make_tracker(name, model, **parameters)

    return build
