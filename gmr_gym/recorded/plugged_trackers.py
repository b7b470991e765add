"""Trackers of many targets that are found by name, on recorded scans: for each interval and sensor a tracker
of its own, with one belief. What they declare has the labels, rules and rows of all tracks."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.filters.registry import tracker_maker
from gmr_gym.filters.tracker import MultiTargetTracker
from gmr_gym.mixture import gaussian
from gmr_gym.models import kalman
from gmr_gym.models.clutter import uniform_clutter
from gmr_gym.models.intervals import switching_over, transition
from gmr_gym.models.multi_target import MultiTargetModel, multi_target_model
from gmr_gym.models.positions import Look
from gmr_gym.models.spherical import debiased_of
from gmr_gym.recorded.declared_tracks import Declared
from gmr_gym.recorded.detections import Detections
from gmr_gym.recorded.looks import checked_look
from gmr_gym.recorded.model import TrackingModel, polar
from gmr_gym.recorded.scans import Scan
from gmr_gym.recorded.tracks import Tracks, joined_rows, no_rows

LEAST_CLUTTER = 1e-3  # false alarms a scan: trackers need a density of them
SHORTEST = 1e-3  # s, between two scans


class Plugged(NamedTuple):
    """A tracker by name, for each interval s and index of a sensor, and what it does not use."""

    name: str
    make: Callable[[float, int], MultiTargetTracker]
    noise: tuple[np.ndarray, ...]  # (p, p) of each sensor, m^2
    unused: tuple[str, ...]


def plugged(
    name: str,
    parameters: Mapping[str, Any],
    detections: Detections,
    scans: Sequence[Scan],
    model: TrackingModel,
) -> Plugged:
    """The tracker of a name for the sensors of detections.

    Parameters
    ----------
    name : str
        Of an installed tracker of many targets.
    parameters : mapping of str to object
        Its parameters.
    detections : Detections
    scans : sequence of Scan
    model : TrackingModel

    Returns
    -------
    Plugged

    Raises
    ------
    ValueError
        As `make_tracker`.
    """
    noise = tuple(_noise(detections, model, sensor) for sensor in range(len(model.sensors)))
    fastest = max(model.modes, key=lambda mode: mode.deviation)
    alone = model._replace(modes=(fastest,))
    unused = _unused(detections, scans)
    of_model = tracker_maker(name, True, **parameters)
    try:
        of_model(_model(model, noise, 1.0, 0))
    except ValueError:
        of_model(_model(alone, noise, 1.0, 0))
        unused.append(f"motion models other than that of {fastest.deviation:g} m/s^2")
        model = alone

    @lru_cache(maxsize=1000)
    def make(interval: float, sensor: int) -> MultiTargetTracker:
        return of_model(_model(model, noise, interval, sensor))

    return Plugged(name, make, noise, tuple(unused))


def track_plugged(
    tracker: Plugged, detections: Detections, scans: Iterable[Scan], model: TrackingModel
) -> Tracks:
    """Track over a file by a tracker of positions.

    Parameters
    ----------
    tracker : Plugged
    detections : Detections
    scans : iterable of Scan
        In order of time.
    model : TrackingModel
        Its rules of tracks hold for what the tracker declares.

    Returns
    -------
    Tracks
        `detection` is that of the gate nearest to the track, `weight` the track's existence where there is
        one; `nis` and `modes` are NaN.
    """
    scans = list(scans)
    times = np.array([scan.time for scan in scans])
    steps = np.diff(times)
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    intervals = np.maximum(np.append(usual, steps), SHORTEST).round(9).tolist()
    declared, parts = Declared(model), [no_rows(model.axes, len(model.modes))]
    belief: Any = None
    for scan, interval in zip(scans, intervals, strict=bool(scans)):
        one = tracker.make(interval, scan.sensor)
        look = checked_look(
            model, -np.inf, scan.time, detections.z[scan.rows, : model.axes], None, None, scan.sensor,
            detections.origin[scan.rows],
        )  # fmt: skip
        z = _positions(look)
        belief, report = one.step(one.init() if belief is None else belief, z)
        rows = declared.update(scan.time, z, report, tracker.noise[scan.sensor], scan.sensor)
        rows = rows._replace(
            detection=np.append(scan.rows, -1)[rows.detection],
            modes=np.full((len(rows.time), len(model.modes)), np.nan),
        )
        parts.append(rows)
    return joined_rows(parts)


def _model(
    model: TrackingModel, noise: tuple[np.ndarray, ...], interval: float, sensor: int
) -> MultiTargetModel:
    """The filter model of an interval and a sensor."""
    bank, spec, p = model.bank(), model.sensors[sensor], model.axes
    d, low, high = bank.states(p), np.array(model.low), np.array(model.high)
    deviation = np.concatenate([(high - low) / np.sqrt(12), np.full(p, model.max_speed / np.sqrt(p + 2))])
    deviation = np.append(deviation, np.full(d - 2 * p, bank.parameters[:, 0].max()))
    box = gaussian(np.append((low + high) / 2, np.zeros(d - p)), np.diag(deviation**2))
    return multi_target_model(
        tuple(kalman.motion(*transition(bank, q, interval, p, d)) for q in range(len(model.modes))),
        kalman.sensor(np.eye(p, d), noise[sensor]),
        spec.detection_probability,
        model.survival_probability**interval,
        box._replace(w=np.array([model.birth_rate * interval])),
        uniform_clutter(low, high, max(spec.clutter_per_scan, LEAST_CLUTTER)),
        initial=box._replace(w=np.array([model.undetected])),
        switching=switching_over(bank, interval),
    )


def _noise(detections: Detections, model: TrackingModel, sensor: int) -> np.ndarray:
    """Covariance (p, p) of a sensor's positions, the mean over its detections, m^2."""
    spec, p = model.sensors[sensor], model.axes
    rows = np.flatnonzero(detections.sensor == sensor)
    if not polar(spec) or not len(rows):
        return np.diag(np.array(spec.deviation[:p]) ** 2)
    return _converted(detections.z[rows, :p], np.array(spec.deviation))[1].mean(axis=0)


def _converted(z: np.ndarray, deviation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Debiased positions (k, p) about the sensor of polar detections, and their covariances (k, p, p)."""
    p, spherical, noise = z.shape[1], np.zeros((len(z), 3)), np.zeros(3)
    spherical[:, :p], noise[:p] = z, deviation[:p]
    place, R = debiased_of(spherical, noise)
    return place[:, :p], R[:, :p, :p]


def _positions(look: Look) -> np.ndarray:
    """The detections as positions (k, p)."""
    p = look.z.shape[1]
    return _converted(look.z, look.deviation)[0] + look.origin[:, :p] if look.polar else look.z


def _unused(detections: Detections, scans: Iterable[Scan]) -> list[str]:
    """What of the detections a tracker of positions does not use."""
    names = {
        "times within a scan": any((detections.time[scan.rows] != scan.time).any() for scan in scans),
        "directions of a scan": any(scan.azimuths is not None for scan in scans),
        "range rates": np.isfinite(detections.range_rate).any(),
        "identities": any(name is not None for name in detections.identity.tolist()),
        "the noise of each detection (a sensor has their mean)": any(map(polar, detections.sensors)),
    }
    return [name for name, there in names.items() if there]
