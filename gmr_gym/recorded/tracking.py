"""Tracks of many targets, with labels, scan by scan: live, or over a whole file with the same numbers."""

import zipfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gmr_gym.evaluation.writing import whole
from gmr_gym.models.positions import Look
from gmr_gym.recorded.array_records import leaves, rebuilt
from gmr_gym.recorded.detections import Detections
from gmr_gym.recorded.fixed_lag import smoothed_late, with_scan, without_old
from gmr_gym.recorded.looks import checked_look
from gmr_gym.recorded.model import TrackingModel, as_text, from_text
from gmr_gym.recorded.report_runs import LONGEST, SHORTEST, reports_of, run
from gmr_gym.recorded.scans import Scan
from gmr_gym.recorded.track_state import initial_state
from gmr_gym.recorded.track_update import assumed, report, scan
from gmr_gym.recorded.tracks import Tracks, joined_rows, no_rows

TOGETHER = 1000  # scans whose rows are joined at a time
DAMAGES = zipfile.BadZipFile, EOFError, KeyError, StopIteration  # of a file that is not whole


class LiveTracker:
    """Tracks many targets from scans as they come.

    Parameters
    ----------
    model : TrackingModel
        What is assumed; `tracking_model` makes one.
    lag : int
        By how many scans rows can be smoothed late, see `smoothed`.

    Attributes
    ----------
    state : State
        All that changes from scan to scan.

    Examples
    --------
    >>> from gmr_gym.recorded import SensorSpec, tracking_model
    >>> model = tracking_model([SensorSpec("radar", deviation=(5.0, 5.0))], (-1e3, -1e3), (1e3, 1e3))
    >>> tracker = LiveTracker(model)
    >>> for scan in range(4):
    ...     rows = tracker.update(float(scan), [[10.0 * scan, 0.0]])
    >>> rows.track.tolist(), rows.status.tolist()
    ([1], [1])
    """

    def __init__(self, model: TrackingModel, lag: int = 0):
        if lag < 0 or lag != int(lag):
            raise ValueError(f"lag must be a number of scans, 0 or more, got {lag}")
        self.model = model
        self.lag = int(lag)
        self.state = initial_state(model, self.lag)
        self._of = assumed(model)

    def update(
        self,
        time: float,
        z: ArrayLike,
        *,
        range_rate: ArrayLike | None = None,
        times: ArrayLike | None = None,
        sensor: int = 0,
        identity: str | Sequence[str | None] | None = None,
        origin: ArrayLike | None = None,
        azimuths: tuple[float, float] | None = None,
    ) -> Tracks:
        """Update the tracks with a scan, or with a report of one target.

        Parameters
        ----------
        time : float
            To which the tracks are brought, s: the time of the last detection, not before the last scan.
        z : array_like (k, p)
            m, or range m, azimuth rad[, elevation rad] from the sensor. None of them: an empty list.
        range_rate : array_like (k,), optional
            m/s, NaN where not measured.
        times : array_like (k,), optional
            Time of each detection, s; all at `time` unless given.
        sensor : int
            Index into the model's sensors.
        identity : str or sequence of k str or None, optional
            Of each detection: it joins no track of another identity. One str for one detection: a report by
            itself, which is no false alarm and no miss of other targets.
        origin : array_like (3,) or (k, 3), optional
            Position of the sensor, m, where it moves.
        azimuths : tuple of float, optional
            From and to which the beam has turned in the scan, rad: counter-clockwise where the second is
            greater. All directions unless given.

        Returns
        -------
        Tracks
            A row for each track, also of those deleted now. After a report, of the tracks that it changed.

        Raises
        ------
        ValueError
            Naming the argument that has another shape, is not finite, or goes back in time.
        """
        look = checked_look(self.model, self.state.time, time, z, range_rate, times, sensor, origin)
        table, k = self.state.identities, len(look.at)
        if isinstance(identity, str):
            if k != 1:
                raise ValueError(f"an identity of one str is of one detection, got {k} detections")
            self.state, rows = report(
                self.state, self._of, look, sensor, table.setdefault(identity, len(table))
            )
            return self._kept(rows, look)
        names = [None] * k if identity is None else identity
        if len(names) != k:
            raise ValueError(f"identity must have {k} entries, one for each detection, got {len(names)}")
        known = [-1 if name is None else table.setdefault(name, len(table)) for name in names]
        self.state, rows = scan(self.state, self._of, look, sensor, np.array(known, np.int64), azimuths)
        return self._kept(rows, look)

    def smoothed(self, lag: int | None = None) -> Tracks:
        """Rows of an earlier scan, smoothed by all detections since.

        Parameters
        ----------
        lag : int, optional
            By how many scans it is before the last; the tracker's own `lag` unless given, and at most that.

        Returns
        -------
        Tracks
            Rows that `update` gave then, with x, P and modes that `smooth` gives for all up to the last scan;
            none where there was no such scan. The NIS is NaN.

        Raises
        ------
        ValueError
            If the tracker keeps fewer scans.
        """
        lag = self.lag if lag is None else lag
        if not (self.lag and lag in range(self.lag + 1)):
            raise ValueError(f"lag must be in 0..{self.lag}, got {lag}; give LiveTracker(model, lag=...)")
        return smoothed_late(self.state.last[0], lag, self.model)

    def save(self, path: str | Path) -> None:
        """Write model and state to a file, from which `load` goes on as if there had been no break. A file
        that is there stays as it was until the new one is whole.

        Parameters
        ----------
        path : str or Path
            `.npz` is appended if it is not there.
        """
        arrays: dict[str, Any] = {f"{i:03d}": leaf for i, leaf in enumerate(leaves(self.state))}
        name = f"{path}" if f"{path}".endswith(".npz") else f"{path}.npz"
        with whole(name) as partial:
            np.savez(partial, model=np.array(as_text(self.model)), lag=np.array(self.lag), **arrays)

    @classmethod
    def load(cls, path: str | Path) -> "LiveTracker":
        """The tracker of `save`.

        Parameters
        ----------
        path : str or Path

        Returns
        -------
        LiveTracker

        Raises
        ------
        ValueError
            For another file, or one that is damaged.
        """
        with Path(path).open("rb") as opened:
            try:
                file = np.lib.npyio.NpzFile(opened)
                tracker = cls(from_text(str(file["model"])), int(file["lag"]))
                names = sorted(name for name in file.files if name.isdigit())
                tracker.state = rebuilt(tracker.state, iter([file[name] for name in names]))
            except (*DAMAGES, ValueError, TypeError) as error:
                raise ValueError(f"{path}: no whole file of `LiveTracker.save`: {error!r}") from None
        return tracker

    def _kept(self, rows: Tracks, look: Look) -> Tracks:
        """The rows, kept too where they will be smoothed."""
        for last in self.state.last:
            alive = self.state.targets.lives.label
            last = without_old(with_scan(last, rows, look, self.model), self.lag, alive)
            self.state = self.state._replace(last=(last,))
        return rows


def track(
    detections: Detections, scans: Iterable[Scan], model: TrackingModel, *, reports: bool = False
) -> Tracks:
    """Track over a file: the numbers of `LiveTracker.update` scan by scan.

    Parameters
    ----------
    detections : Detections
    scans : iterable of Scan
        In order of time.
    model : TrackingModel
        Of the sensors of the detections.
    reports : bool
        Whether a scan of one detection with an identity is a report by itself (see `LiveTracker.update`).

    Returns
    -------
    Tracks
        `detection` is an index into the detections.
    """
    tracker, scans, none = LiveTracker(model), list(scans), no_rows(model.axes, len(model.modes))
    alone = reports_of(detections, scans, model) if reports and len(detections.time) else None
    parts, joined, i, most = [none], [], 0, SHORTEST
    while i < len(scans):
        rows = none
        if alone is not None:
            tracker.state, rows = run(tracker.state, tracker._of, detections, alone, i, most)
            most = min(max(4 * len(rows.time), SHORTEST), LONGEST)
        i += max(len(rows.time), 1)
        if not len(rows.time):
            one = scans[i - 1]
            rows = tracker.update(**_arguments(detections, one, model, reports))
            rows = rows._replace(detection=np.append(one.rows, -1)[rows.detection])  # the last is of none
        parts.append(rows)
        if len(parts) > TOGETHER:
            joined.append(joined_rows(parts))
            parts = [none]
    return joined_rows([*joined, *parts])


def _arguments(detections: Detections, scan: Scan, model: TrackingModel, reports: bool) -> dict:
    """The arguments of `LiveTracker.update` for a scan of the detections."""
    rows = scan.rows
    names = detections.identity[rows].tolist()
    alone = reports and len(names) == 1 and names[0] is not None
    return {
        "time": scan.time,
        "z": detections.z[rows, : model.axes],
        "range_rate": detections.range_rate[rows],
        "times": detections.time[rows],
        "sensor": scan.sensor,
        "identity": names[0] if alone else names,
        "origin": detections.origin[rows],
        "azimuths": scan.azimuths,
    }
