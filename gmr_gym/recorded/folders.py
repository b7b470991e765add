"""Folders of recordings: the detections of a radar in one file each, and where targets were in another."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from gmr_gym.recorded.positions import local_positions
from gmr_gym.recorded.reading import read
from gmr_gym.recorded.scans import cut
from gmr_gym.recorded.truth import Truth, truth_of

AUTOFERRY = "detections.json", "groundTruth.json"
FORMS = AUTOFERRY, ("plots.csv", "truth.csv")  # how the names of the two files of a recording end
COLUMNS = {
    "time": "time:s", "x": "measurement[1]:m", "y": "measurement[0]:m", "own_x": "ownshipPosition[1]:m",
    "own_y": "ownshipPosition[0]:m",
}  # fmt: skip
RADAR = "sensorID=2"  # of Autoferry's sensors
WANTED = (
    "NAME_detections.json and NAME_groundTruth.json, as in the Autoferry data set (CC0, "
    "https://github.com/Autoferry/sensor_fusion_dataset), or NAME_plots.csv and NAME_truth.csv"
)
SPARSE = 100  # times as many scans as there are, with those missing between: more are refused


class Recording(NamedTuple):
    """The scans of a radar, and where targets were. Scans that are not in the file are there, and empty."""

    name: str
    time: np.ndarray  # (T,), s
    z: np.ndarray  # (n, 2), m, of all scans
    first: np.ndarray  # (T + 1,), scan t has z[first[t] : first[t + 1]]
    truth: Truth

    @property
    def period(self) -> float:
        """Median time from scan to scan, s."""
        return float(np.median(np.diff(self.time)))


def recordings(folder: str | Path, name: str | None = None) -> list[Recording]:
    """The recordings in a folder and below it, in order of their names.

    Parameters
    ----------
    folder : str or Path
    name : str, optional
        Of the only one that is read.

    Returns
    -------
    list of Recording

    Raises
    ------
    ValueError
        For a folder without any, a name that none has, a file without its truth, and files that cannot be
        read.
    """
    if not folder or not Path(f"{folder}").is_dir():
        raise ValueError(f"folder must be one with {WANTED}; got {str(folder)!r}, which is no folder")
    pairs = sorted(_pairs(Path(f"{folder}")))
    there = dict(pairs)
    if not there:
        raise ValueError(f"folder must be one with {WANTED}; {str(folder)!r} has none of these")
    if len(there) < len(pairs):
        again = next(each for (each, _), (then, _) in pairwise(pairs) if each == then)
        raise ValueError(
            f"folder must have recordings of different names, got {again} twice in {str(folder)!r}"
        )
    if name is not None and str(name) not in there:
        raise ValueError(f"recording must be one of {', '.join(there)}, got {name!r}")
    return [_read(each, *files) for each, files in there.items() if name is None or each == str(name)]


def _pairs(folder: Path) -> Iterator[tuple[str, tuple[Path, Path]]]:
    """Names of recordings, and the files of detections and of truth of each."""
    for seen, known in FORMS:
        for file in folder.rglob(f"*{seen}"):
            before = file.name.removesuffix(seen)
            truth = file.with_name(before + known)
            if not truth.is_file():
                raise ValueError(
                    f"{file}: where its targets were must be in {truth.name}, which is not there"
                )
            yield before.rstrip("_") or file.resolve().parent.name, (file, truth)


def _read(name: str, file: Path, truth_file: Path) -> Recording:
    """A recording, its scans within the time of the truth."""
    autoferry = file.name.endswith(AUTOFERRY[0])
    seen = read(file, COLUMNS, where=[RADAR]) if autoferry else read(file)
    if len(seen.sensors) > 1:
        names = ", ".join(spec.name for spec in seen.sensors)
        raise ValueError(f"{file}: must be of one sensor, got {names}; leave the rows of one in it")
    truth, points = truth_of(truth_file, seen), local_positions(seen)[:, :2]
    begin, end = truth.time.min(initial=np.inf), truth.time.max(initial=-np.inf)
    scans = [scan for scan in cut(seen) if begin <= scan.time <= end]
    if len(scans) < 2:
        raise ValueError(f"{file}: two scans at least must be within the time of {truth_file.name}")
    time, at = _filled(np.array([scan.time for scan in scans]))
    if len(time) > SPARSE * len(scans):
        raise ValueError(f"{file}: scans must follow one another evenly, got gaps of up to {len(time)} scans")
    count = np.zeros(len(time), int)
    count[at] = [len(scan.rows) for scan in scans]
    rows = np.concatenate([scan.rows for scan in scans])
    return Recording(name, time, points[rows], np.concatenate([[0], np.cumsum(count)]), truth)


def _filled(time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times with those of scans that are missing between, by the median period, and where each given one
    is."""
    gaps = np.diff(time)
    steps = np.maximum(np.rint(gaps / np.median(gaps)), 1).astype(int)
    at = np.concatenate([[0], np.cumsum(steps)])
    return np.interp(np.arange(at[-1] + 1), at, time), at
