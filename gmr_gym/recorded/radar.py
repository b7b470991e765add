"""A radar's recorded scans as a scenario: real detections and clutter, and targets whose paths are known."""

from collections.abc import Sequence
from functools import partial

import numpy as np
from scipy.optimize import linear_sum_assignment

from gmr_gym.checks import _check_positive, check_probability, check_whole
from gmr_gym.mixture import Mixture
from gmr_gym.models.clutter import Clutter, uniform_clutter
from gmr_gym.models.kalman import position_sensor
from gmr_gym.models.motions import constant_velocity
from gmr_gym.models.multi_target import multi_target_model
from gmr_gym.recorded.accuracy import CUTOFF, ORDER
from gmr_gym.recorded.folders import Recording, recordings
from gmr_gym.recorded.truth import at_times
from gmr_gym.simulation.multi_target import MultiTargetEpisode, RecordedScenario, part_of

MARGIN = 0.05  # of the box about all detections, on each side
GRID = 4  # Gaussians of births along each side of the box
ALIKE = 0.1  # relative difference of the periods of recordings that one model is assumed of


def recorded_radar(
    folder: str = "",
    recording: str | None = None,
    horizon: int | None = None,
    *,
    sensor_deviation: float = 4.0,
    detection_probability: float = 0.9,
    clutter_rate: float = 3.0,
    survival_probability: float = 0.99,
    birth_rate: float = 0.02,
    acceleration_deviation: float = 0.3,
    speed_deviation: float = 5.0,
    cutoff: float = CUTOFF,
) -> RecordedScenario:
    """Recordings of a radar, played back: detections, false alarms and targets are those of the files.

    All numbers but the cutoff are of the filter model: what is true is not known.

    Parameters
    ----------
    folder : str
        Where the files are: of each recording NAME_detections.json and NAME_groundTruth.json of the Autoferry
        data set, or NAME_plots.csv and NAME_truth.csv, whose columns are found by their names. Without a name
        a file is called `plots.csv` or the like, and the recording as its folder.
    recording : str, optional
        Name of the only one that is played; by default all are, the seed chooses.
    horizon : int, optional
        Number of scans, from one on that the seed chooses; by default those of the shortest recording.
    sensor_deviation : float
        Standard deviation of the measurement noise along each axis, m.
    detection_probability : float
        P_D.
    clutter_rate : float
        False alarms per scan, uniform in the box about all detections.
    survival_probability : float
        P_S, from scan to scan.
    birth_rate : float
        Expected number of targets that appear in a scan, anywhere in the box.
    acceleration_deviation : float
        Standard deviation of the process noise, m/s^2.
    speed_deviation : float
        Standard deviation of the velocity of a new target along each axis, m/s.
    cutoff : float
        Of the distance that scores estimates, m.

    Returns
    -------
    RecordedScenario
        States are [x, y, vx, vy], x east and y north. The period is the median of the recorded ones.

    Raises
    ------
    ValueError
        Naming the argument that is invalid, or the file and what is wrong with it.
    """
    _check_positive(
        sensor_deviation=sensor_deviation, clutter_rate=clutter_rate, birth_rate=birth_rate,
        acceleration_deviation=acceleration_deviation, speed_deviation=speed_deviation, cutoff=cutoff,
    )  # fmt: skip
    check_probability("detection_probability", detection_probability)
    check_probability("survival_probability", survival_probability)
    found = recordings(folder, recording)
    period, scans = _period(found), _horizon(found, horizon)
    points = np.concatenate([each.z for each in found])
    low, high = _box(points, sensor_deviation)
    targets = max(len(set(each.truth.target.tolist())) for each in found)
    episodes = tuple(episode_of(each, targets, cutoff) for each in found)
    motion, sensor = constant_velocity(period, acceleration_deviation), position_sensor(sensor_deviation)
    births = _births(low, high, birth_rate, speed_deviation)
    clutter = uniform_clutter(low, high, clutter_rate)
    model = multi_target_model(motion, sensor, detection_probability, survival_probability, births, clutter)
    return RecordedScenario(
        model=model,
        truth=partial(_truth, episodes, scans),
        targets=targets,
        sensor=sensor,
        detection_probability=model.detection_probability,
        clutter=partial(_unknown, low, high),
        horizon=scans,
        period=period,
        position=(0, 1),
        velocity=(2, 3),
        cutoff=float(cutoff),
        order=ORDER,
        recordings=episodes,
    )


def episode_of(recording: Recording, targets: int, cutoff: float) -> MultiTargetEpisode:
    """A recording as an episode.

    Parameters
    ----------
    recording : Recording
    targets : int
        As many states as there are in a scan; nan beyond those of the recording.
    cutoff : float
        A detection is taken for a target's within so many metres of it; of each target one at most, so that
        most have one, as near as can be.

    Returns
    -------
    MultiTargetEpisode
    """
    time, z, first = recording.time, recording.z, recording.first
    truth = recording.truth
    position, _ = at_times(truth.time, truth.target, truth.position[:, :2], time)
    x = np.full((len(time), targets, 4), np.nan)
    for j in range(position.shape[1]):
        there = np.flatnonzero(np.isfinite(position[:, j, 0]))  # one after the other
        x[there, j, :2], x[there, j, 2:] = position[there, j], 0.0
        if len(there) > 1:
            x[there, j, 2:] = np.gradient(position[there, j], time[there], axis=0)
    origin = np.full(len(z), -1)
    for t in range(len(time)):
        present = np.flatnonzero(np.isfinite(x[t, :, 0]))
        away = np.linalg.norm(z[first[t] : first[t + 1], None] - x[t, present, :2], axis=2)
        row, column = linear_sum_assignment(np.minimum(away, cutoff))
        near = away[row, column] < cutoff
        origin[first[t] + row[near]] = present[column[near]]
    return MultiTargetEpisode(x, z, origin, first)


def _period(found: Sequence[Recording]) -> float:
    """The median of all periods, s; ValueError where those of two recordings are not alike."""
    slow, fast = max(found, key=lambda each: each.period), min(found, key=lambda each: each.period)
    if slow.period > (1 + ALIKE) * fast.period:
        raise ValueError(
            f"folder must be of recordings of one period, got {slow.period:.3g} s of {slow.name} and "
            f"{fast.period:.3g} s of {fast.name}; choose one with recording"
        )
    return float(np.median(np.concatenate([np.diff(each.time) for each in found])))


def _horizon(found: Sequence[Recording], horizon: int | None) -> int:
    shortest = min(found, key=lambda each: len(each.time))
    if horizon is None:
        return len(shortest.time)
    check_whole("horizon", horizon, 1)
    if horizon > len(shortest.time):
        raise ValueError(
            f"horizon must be at most the {len(shortest.time)} scans of {shortest.name}, got {horizon}"
        )
    return int(horizon)


def _box(points: np.ndarray, deviation: float) -> tuple[np.ndarray, np.ndarray]:
    """Corners of a box about points, which is what the radar is taken to cover."""
    low, high = points.min(axis=0), points.max(axis=0)
    margin = MARGIN * (high - low) + deviation
    return low - margin, high + margin


def _births(low: np.ndarray, high: np.ndarray, rate: float, speed_deviation: float) -> Mixture:
    """Gaussians on a grid, half its spacing wide, so that births are as likely anywhere in the box, to 3 %,
    and half as likely at its edge."""
    spacing = (high - low) / GRID
    cells = np.stack(np.meshgrid(*[np.arange(GRID) + 0.5] * 2), axis=-1).reshape(-1, 2)
    m = np.column_stack([low + cells * spacing, np.zeros_like(cells)])
    P = np.diag([*(spacing / 2) ** 2, speed_deviation**2, speed_deviation**2])
    return Mixture(np.full(len(m), rate / len(m)), m, np.tile(P, (len(m), 1, 1)))


def _truth(episodes: Sequence[MultiTargetEpisode], horizon: int, rng: np.random.Generator) -> np.ndarray:
    return part_of(episodes, horizon, rng).x


def _unknown(low: np.ndarray, high: np.ndarray, t: int) -> Clutter:
    """The box, and a number of false alarms that is not known."""
    return uniform_clutter(low, high, np.nan)
