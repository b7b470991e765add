"""Detections of a scan, as Stone Soup has them and as an array."""

from collections.abc import Iterable, Iterator, Sequence
from datetime import datetime, timedelta
from typing import Any

import numpy as np
from stonesoup.base import Property
from stonesoup.buffered_generator import BufferedGenerator
from stonesoup.models.base import LinearModel
from stonesoup.reader.base import DetectionReader
from stonesoup.types.array import StateVector
from stonesoup.types.detection import Detection

from gmr_gym.stonesoup.mixtures import rows_of, vector


def scan_of(detections: Iterable, measurement_model: Any, time: datetime) -> tuple[list, np.ndarray]:
    """A scan of Stone Soup's detections.

    Parameters
    ----------
    detections : iterable of k Detection
    measurement_model : MeasurementModel
        That of all detections; one without a model of its own has this.
    time : datetime
        Of the scan.

    Returns
    -------
    detections : list of k Detection
        In order of their coordinates, so that a run does not depend on the order of a set.
    z : ndarray (k, p)
        Their coordinates in that order; of a radar range (m), azimuth and elevation (rad).

    Raises
    ------
    ValueError
        For a detection without a time or of another one, of another sensor, of another size, or with an angle
        where the sensor is linear.
    """
    found = list(detections)
    p = measurement_model.ndim_meas
    if not found:
        return found, np.empty((0, p))
    if {one.timestamp for one in found} != {time}:
        _refuse_times(found, time)
    models = [one.measurement_model for one in found]
    for own in {id(own): own for own in models}.values():
        if own is not None and own is not measurement_model and not same(own, measurement_model):
            raise ValueError(
                f"detections must be of one sensor, got one of {described(own)}, and the tracker's "
                f"measurement_model is {described(measurement_model)}"
            )
    linear = isinstance(measurement_model, LinearModel)
    z = rows_of("detections", [one.state_vector for one in found], angles=not linear)
    if z.shape[1] != p:
        raise ValueError(f"detections must have {p} coordinates, as measurement_model, got {z.shape[1]}")
    order = np.lexsort(z.T[::-1])
    z = z[order]
    return [found[i] for i in order.tolist()], z if linear else np.ascontiguousarray(z[:, ::-1])


def detections_of(z: np.ndarray, timestamp: datetime, measurement_model: Any = None) -> set[Detection]:
    """The detections of a scan as Stone Soup has them.

    Parameters
    ----------
    z : ndarray (k, p)
        Of a radar range (m), azimuth and elevation (rad).
    timestamp : datetime
    measurement_model : MeasurementModel, optional
        Theirs; a radar's detections are then in its order, elevation, bearing and range.
    """
    if measurement_model is None or isinstance(measurement_model, LinearModel):
        return {_detection(vector(row), timestamp, measurement_model) for row in z}
    empty = measurement_model._typed_vector()
    return {_detection(StateVector(empty + row[::-1, None]), timestamp, measurement_model) for row in z}


def _detection(x: StateVector, timestamp: datetime, measurement_model: Any) -> Detection:
    # field by field: its __init__ takes three times as long
    one = Detection.__new__(Detection)
    one.state_vector, one.timestamp, one.measurement_model, one.metadata = x, timestamp, measurement_model, {}
    return one


class ScanReader(DetectionReader):
    """Scans as a detector of Stone Soup, for any of its trackers.

    Parameters
    ----------
    scans : sequence of T ndarray (k, p)
    times : sequence of T float
        s, increasing.
    start : datetime
        Of time 0.
    measurement_model : MeasurementModel, optional
        Of all detections.
    """

    scans: Sequence[np.ndarray] = Property()
    times: Sequence[float] = Property()
    start: datetime = Property()
    measurement_model: Any = Property(default=None)

    @BufferedGenerator.generator_method  # type: ignore[untyped-decorator]
    def detections_gen(self) -> Iterator[tuple[datetime, set[Detection]]]:
        """Time and detections of each scan."""
        for time, z in zip(self.times, self.scans, strict=True):
            at = self.start + timedelta(seconds=float(time))
            yield at, detections_of(z, at, self.measurement_model)


def same(one: Any, other: Any, but: Sequence[str] = ()) -> bool:
    """Whether two measurement models are equal, but for these properties of theirs."""
    return type(one) is type(other) and all(
        np.array_equal(getattr(one, name), getattr(other, name))
        for name in type(one).properties
        if name not in ("seed", *but)
    )


def described(measurement_model: Any) -> str:
    """A measurement model in a few words."""
    mapping = tuple(measurement_model.mapping)
    return f"{type(measurement_model).__name__} with mapping {mapping}"


def _refuse_times(found: list, time: datetime) -> None:
    for one in found:
        if one.timestamp is None:
            raise ValueError(f"detections must have a timestamp, got one without: {one.state_vector.ravel()}")
        if one.timestamp != time:
            raise ValueError(
                f"detections of the scan at {time} must have that timestamp, got {one.timestamp}"
            )
