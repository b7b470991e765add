"""Simulators and readers of Stone Soup as scenarios here."""

from collections.abc import Collection, Sequence
from copy import deepcopy
from datetime import datetime
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from stonesoup.base import Base
from stonesoup.simulator.simple import SimpleDetectionSimulator
from stonesoup.types.groundtruth import GroundTruthPath

from gmr_gym.models.model import Model
from gmr_gym.models.multi_target import MultiTargetModel
from gmr_gym.recorded.radar import _truth, _unknown
from gmr_gym.simulation.loss import truth_outside_gates
from gmr_gym.simulation.multi_target import MultiTargetEpisode, RecordedScenario
from gmr_gym.simulation.single_target import Scenario, Truth, Window
from gmr_gym.stonesoup.detections import scan_of
from gmr_gym.stonesoup.models import linear_sensor
from gmr_gym.stonesoup.tracks import truth_of


def seeded_copies(simulator: Any, count: int, seed: int = 0) -> list[Any]:
    """Copies of a simulator that draw episodes of their own, the same for the same seed.

    Of a simulator of Stone Soup every part has a generator of its own, or that of NumPy where it has no seed;
    here all parts of a copy share one.

    Parameters
    ----------
    simulator : Simulator
        Not iterated yet.
    count : int
    seed : int

    Returns
    -------
    list of Simulator
    """
    sequence = np.random.SeedSequence(seed)
    return [_drawing(simulator, np.random.MT19937(each)) for each in sequence.spawn(count)]


def episode_of(
    detector: Any, measurement_model: Any, truth: Collection[GroundTruthPath] | None = None
) -> tuple[MultiTargetEpisode, list[datetime]]:
    """A detector's scans and ground truth as an episode.

    Parameters
    ----------
    detector : DetectionReader
        Iterated to its end.
    measurement_model : LinearGaussian
        Of all detections.
    truth : collection of GroundTruthPath, optional
        By default those of a simulator's `groundtruth`, and of true detections.

    Returns
    -------
    episode : MultiTargetEpisode
        A detection is of the target that Stone Soup says it is of.
    times : list of T datetime

    Raises
    ------
    ValueError
        As `scan_of`, and where there is no ground truth.
    """
    times, z, origins, paths = [], [], [], list(truth or ())
    for time, detections in detector:
        found, scan = scan_of(detections, measurement_model, time)
        if truth is None:
            reader = getattr(detector, "groundtruth", None)
            current = list(getattr(reader, "groundtruth_paths", ()))
            current += [one.groundtruth_path for one in found if hasattr(one, "groundtruth_path")]
            paths += [path for path in current if not any(path is other for other in paths)]
        times.append(time)
        z.append(scan)
        origins += [getattr(one, "groundtruth_path", None) for one in found]
    if not paths:
        raise ValueError("detector must have ground truth, got none; give the paths as truth")
    number = {id(path): j for j, path in enumerate(paths)}
    first = np.cumsum([0, *map(len, z)])
    origin = np.array([number.get(id(path), -1) for path in origins], int)
    return MultiTargetEpisode(truth_of(paths, times), np.concatenate(z), origin, first), times


def scenario_of(
    detectors: Sequence[Any],
    model: MultiTargetModel,
    measurement_model: Any,
    *,
    position: tuple[int, ...],
    velocity: tuple[int, ...],
    cutoff: float,
    truth: Sequence[Collection[GroundTruthPath]] | None = None,
) -> RecordedScenario:
    """A scenario whose episodes are those of detectors of Stone Soup: simulators, or readers of files.

    Parameters
    ----------
    detectors : sequence of DetectionReader
        Each is iterated to its end, once; see `seeded_copies` of a simulator.
    model : MultiTargetModel
        What trackers assume.
    measurement_model : LinearGaussian
        Of all detections.
    position, velocity : tuple of int
        Which of the true states are coordinates (m) and velocities (m/s).
    cutoff : float
        Of the distance between sets that scores an estimate, m.
    truth : sequence of collections of GroundTruthPath, optional
        Of each detector; see `episode_of`.

    Returns
    -------
    RecordedScenario
        Its period is the median of all; its horizon the shortest detector.

    Raises
    ------
    ValueError
        As `episode_of`, and for no detector.
    """
    if not detectors:
        raise ValueError("detectors must be at least one")
    given: Sequence[Any] = [None] * len(detectors) if truth is None else truth
    drawn = [episode_of(one, measurement_model, paths) for one, paths in zip(detectors, given, strict=True)]
    gaps = [(b - a).total_seconds() for _, times in drawn for a, b in pairwise(times)]
    horizon = min(len(times) for _, times in drawn)
    targets = max(episode.x.shape[1] for episode, _ in drawn)
    episodes = tuple(_padded(episode, targets) for episode, _ in drawn)
    return RecordedScenario(
        model=model,
        truth=partial(_truth, episodes, horizon),
        targets=targets,
        sensor=model.sensor,
        detection_probability=model.detection_probability,
        clutter=partial(_unknown, model.clutter.low, model.clutter.high),
        horizon=horizon,
        period=float(np.median(gaps)) if gaps else 1.0,
        position=position,
        velocity=velocity,
        cutoff=float(cutoff),
        order=2.0,
        recordings=episodes,
    )


def single_target_scenario_of(
    simulator: SimpleDetectionSimulator,
    model: Model,
    *,
    position: tuple[int, ...],
    velocity: tuple[int, ...],
    patience: int = 1,
    cutoff: float = 100.0,
) -> Scenario:
    """The scenario of a simulator of one target, whose path Stone Soup draws, and detections and clutter not.

    Scans begin one time step after the simulator's initial state, which is what the prior is of.

    Parameters
    ----------
    simulator : SimpleDetectionSimulator
        Of the ground truth of one target, and a linear measurement model. Its seeds are not used.
    model : Model
        What trackers assume; see `model_of`.
    position, velocity : tuple of int
        Which of the states are coordinates (m) and velocities (m/s).
    patience : int
        Scans in a row outside every gate that make a track lost.
    cutoff : float
        Largest error that counts, m.

    Returns
    -------
    Scenario

    Raises
    ------
    ValueError
        For another simulator, and a measurement model that is not linear.
    """
    if not isinstance(simulator, SimpleDetectionSimulator):
        raise ValueError(
            f"simulator must be a SimpleDetectionSimulator, got {type(simulator).__name__}; of any detector "
            "scenario_of makes a scenario of many targets"
        )
    truth, (low, high) = simulator.groundtruth, np.array(simulator.meas_range, float).T
    return Scenario(
        model=model,
        truth=partial(_path, truth),
        sensor=linear_sensor(simulator.measurement_model),
        detection_probability=float(simulator.detection_probability),
        clutter_rate=float(simulator.clutter_rate),
        window=Window(low, high, follows=False, limits_view=False),  # it reports targets outside
        horizon=truth.number_steps - 1,
        period=truth.timestep.total_seconds(),
        position=position,
        velocity=velocity,
        loss_rule=partial(truth_outside_gates, model.sensor.H),
        patience=patience,
        cutoff=cutoff,
    )


def _drawing(simulator: Any, bits: Any) -> Any:
    """A copy of the simulator, all parts of which draw from these bits."""
    copy, generator = deepcopy(simulator), np.random.RandomState(bits)
    left, known = [copy], set()
    while left:
        part = left.pop()
        if isinstance(part, list | tuple):
            left += part
        elif isinstance(part, Base) and id(part) not in known:
            known.add(id(part))
            left += [getattr(part, name, None) for name in type(part).properties]
            if hasattr(part, "random_state"):
                part.random_state = generator
    return copy


def _path(groundtruth: Any, rng: np.random.Generator) -> Truth:
    """The states of a simulator of one target after its initial one."""
    drawing = _drawing(groundtruth, np.random.MT19937(int(rng.integers(2**63))))
    paths: list[GroundTruthPath] = []
    times = []
    for time, current in drawing:
        times.append(time)
        paths += [path for path in current if not any(path is other for other in paths)]
    if len(paths) != 1:
        raise ValueError(f"simulator must be of one target, got {len(paths)}")
    x = truth_of(paths, times)[1:, 0]
    return Truth(x, np.full(len(x), -1))


def _padded(episode: MultiTargetEpisode, targets: int) -> MultiTargetEpisode:
    """The episode with as many targets, the others absent."""
    T, m, d = episode.x.shape
    absent = np.full((T, targets - m, d), np.nan)
    return episode._replace(x=np.concatenate([episode.x, absent], axis=1))
