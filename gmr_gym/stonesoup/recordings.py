"""Any detector of Stone Soup, a simulator or a reader of files, as a recording here."""

from collections.abc import Iterable
from datetime import datetime
from typing import Any, NamedTuple

import numpy as np
from stonesoup.models.measurement.linear import LinearGaussian
from stonesoup.models.measurement.nonlinear import CartesianToBearingRange, CartesianToElevationBearingRange

from gmr_gym.evaluation.recordings import Scans
from gmr_gym.recorded.detections import CARTESIAN, POLAR, Detections, SensorSpec, from_arrays, objects
from gmr_gym.stonesoup.detections import described, same, scan_of
from gmr_gym.stonesoup.mixtures import rows_of
from gmr_gym.stonesoup.models import sensor_of
from gmr_gym.stonesoup.tracks import utc

MOVES = "translation_offset", "rotation_offset"  # of a sensor from scan to scan
POSITIONS = (2, 3)  # axes


def scans_of(detector: Iterable, measurement_model: Any) -> tuple[Scans, datetime]:
    """Scans of a detector of one sensor, for trackers of scans.

    Parameters
    ----------
    detector : DetectionReader
        Iterated to its end.
    measurement_model : LinearGaussian or CartesianToElevationBearingRange
        Of all detections.

    Returns
    -------
    scans : gmr_gym.evaluation.recordings.Scans
        Times are seconds since `start`.
    start : datetime
        Time of the first scan.

    Raises
    ------
    ValueError
        As `scan_of`, and for a detector without scans.
    """
    times, z = [], []
    for time, detections in detector:
        times.append(time)
        z.append(scan_of(detections, measurement_model, time)[1])
    if not times:
        raise ValueError("detector must give at least one scan, got none")
    seconds = np.array([(time - times[0]).total_seconds() for time in times])
    return Scans(seconds, z, sensor_of(measurement_model).coordinates), times[0]


class _Block(NamedTuple):
    """Detections of a scan with one measurement model, in SI units."""

    times: list[datetime]
    z: np.ndarray  # (k, p)
    origin: np.ndarray  # (3,)
    sensor: int
    scan: int
    truth: list[str | None]
    metadata: list[dict]


def recording_of(detector: Iterable, measurement_model: Any = None) -> Detections:
    """A detector of any number of sensors as a recording, which `gmr_gym.recorded` tracks.

    Sensors that differ only by where they are and how far they are turned about the vertical are one that
    moves. Every time of the detector is a scan.

    Parameters
    ----------
    detector : DetectionReader
        Iterated to its end.
    measurement_model : MeasurementModel, optional
        Of detections that have none: LinearGaussian, CartesianToBearingRange or
        CartesianToElevationBearingRange. Without any, detections are positions of a noise that is not known.

    Returns
    -------
    Detections

    Raises
    ------
    ValueError
        For a detection without a time, or of another measurement model, and for no detection at all.
    """
    blocks: list[_Block] = []
    empty: list[datetime] = []
    models: list[Any] = []
    for number, (time, detections) in enumerate(detector):
        if not detections:
            empty.append(time)
        groups: dict[int, list] = {}
        for one in detections:
            if one.timestamp is None:
                raise ValueError(f"detections must have a timestamp, got one without in the scan at {time}")
            groups.setdefault(id(one.measurement_model), []).append(one)
        for found in groups.values():
            own = found[0].measurement_model
            model = measurement_model if own is None else own
            blocks.append(_block(found, model, _number(models, model), number))
    if not blocks:
        raise ValueError("detector must give at least one detection, got none")
    return _joined(blocks, empty, models)


def _number(models: list[Any], model: Any) -> int:
    """Index of the sensor, which is added where it is not known."""
    for i, other in enumerate(models):
        if model is other or (model is not None and other is not None and same(model, other, MOVES)):
            return i
    models.append(model)
    return len(models) - 1


def _block(found: list, model: Any, sensor: int, scan: int) -> _Block:
    """Detections of one measurement model in the coordinates of a recording."""
    z = rows_of("detections", [one.state_vector for one in found], angles=True)
    origin, polar = np.zeros(3), not (model is None or isinstance(model, LinearGaussian))
    if polar and not isinstance(model, CartesianToBearingRange | CartesianToElevationBearingRange):
        raise ValueError(
            f"measurement_model {type(model).__name__} cannot be recorded; there are LinearGaussian, "
            "CartesianToBearingRange and CartesianToElevationBearingRange"
        )
    if polar:
        offset, turn = (np.asarray(getattr(model, name), float).ravel() for name in MOVES)
        if turn[:2].any():
            raise ValueError(f"a sensor may be turned about the vertical alone, got {turn.tolist()}")
        origin[: len(offset)] = offset
        z = z[:, ::-1].copy()
        z[:, 1] = np.mod(z[:, 1] + turn[2] + np.pi, 2 * np.pi) - np.pi
    if z.shape[1] not in POSITIONS:
        raise ValueError(f"detections must have two or three coordinates, got {z.shape[1]}")
    paths = [getattr(one, "groundtruth_path", None) for one in found]
    truth = [None if path is None else path.id for path in paths]
    return _Block(
        [one.timestamp for one in found], z, origin, sensor, scan, truth, [one.metadata for one in found]
    )


def _joined(blocks: list[_Block], empty: list[datetime], models: list[Any]) -> Detections:
    times = [time for each in blocks for time in each.times]
    start = min(times + empty)
    seconds = np.array([(time - start).total_seconds() for time in times])
    z = np.full((len(times), max(each.z.shape[1] for each in blocks)), np.nan)
    counts = [len(each.z) for each in blocks]
    for first, each in zip(np.cumsum([0, *counts]).tolist(), blocks, strict=False):
        z[first : first + len(each.z), : each.z.shape[1]] = each.z
    scan = np.repeat([each.scan for each in blocks], counts)
    order = np.lexsort((*z.T[::-1], scan, seconds))  # of time, and then not of a set
    p = z.shape[1]
    sensors = tuple(_spec(model, i, p) for i, model in enumerate(models))
    polar = all(spec.kind == POLAR for spec in sensors)
    names = ("range_m", "azimuth_rad", "elevation_rad") if polar else ("x_m", "y_m", "z_m")
    metadata = [one or {} for each in blocks for one in each.metadata]
    keys = dict.fromkeys(key for one in metadata for key in one)
    return from_arrays(
        seconds[order],
        z[order],
        sensor=np.repeat([each.sensor for each in blocks], counts)[order],
        sensors=sensors,
        origin=np.repeat([each.origin for each in blocks], counts, axis=0)[order],
        scan=scan[order],
        truth=objects([path for each in blocks for path in each.truth])[order],
        metadata={str(key): [str(metadata[i].get(key, "")) for i in order.tolist()] for key in keys},
        empty_time=np.array([(time - start).total_seconds() for time in empty]),
        empty_sensor=np.zeros(len(empty), int),
        coordinates=names[:p],
        start=utc(start),
    )


def _spec(model: Any, number: int, p: int) -> SensorSpec:
    """The sensor of a measurement model."""
    if model is None:
        return SensorSpec(f"sensor {number + 1}", deviation=(np.nan,) * p)
    R = np.asarray(model.covar(), float)
    if np.count_nonzero(R - np.diag(np.diag(R))):
        raise ValueError(f"noise_covar of {described(model)} must be diagonal, got {R.tolist()}")
    deviation = np.sqrt(np.diag(R)).tolist()
    if isinstance(model, LinearGaussian):
        return SensorSpec(f"sensor {number + 1}", CARTESIAN, deviation=tuple(deviation))
    offset = np.zeros(3)
    offset[: model.translation_offset.size] = np.asarray(model.translation_offset, float).ravel()
    return SensorSpec(f"sensor {number + 1}", POLAR, tuple(offset.tolist()), tuple(deviation[::-1]))
