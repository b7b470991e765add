"""The input's own rows, each with the track that it is of."""

import csv
import io
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from gmr_gym.evaluation.csv_columns import delimiter_of
from gmr_gym.evaluation.text_files import file_bytes
from gmr_gym.evaluation.writing import whole
from gmr_gym.recorded.detections import Detections
from gmr_gym.recorded.formats import TEXT, delimiter_typed, form_of
from gmr_gym.recorded.positions import geodetic, local_positions
from gmr_gym.recorded.tracks import Tracks

DECIMALS, DEGREES = 6, 9  # decimals of a weight, and of latitude and longitude
APPENDED = "track_id", "weight"


def labels(tracks: Tracks, n: int) -> tuple[np.ndarray, np.ndarray]:
    """The track of each detection.

    Parameters
    ----------
    tracks : Tracks
    n : int
        Number of detections.

    Returns
    -------
    track : ndarray of int (n,)
        That for which the detection has most weight, 0 for none.
    weight : ndarray (n,)
        This weight; 0 for none.
    """
    track, weight = np.zeros(n, int), np.zeros(n)
    rows = np.flatnonzero((tracks.detection >= 0) & (tracks.weight > 0))
    rows = rows[np.argsort(tracks.weight[rows], kind="stable")]  # the heaviest comes last, and stays
    track[tracks.detection[rows]] = tracks.track[rows]
    weight[tracks.detection[rows]] = tracks.weight[rows]
    return track, weight


def write_labelled(
    path: Path | str,
    tracks: Tracks,
    detections: Detections,
    source: Path | str,
    *,
    delimiter: str | None = None,
    encoding: str = "utf-8",
    header: bool = True,
) -> None:
    """Write the rows of a file with two columns more: track_id, empty for none, and weight.

    A text file keeps every line as it is, comments and lines that were not tracked too. Of all others the
    detections are written as CSV.

    Parameters
    ----------
    path : Path or str
    tracks : Tracks
    detections : Detections
        As read from the file.
    source : Path or str
        The file.
    delimiter, encoding, header
        As it was read, see `gmr_gym.recorded.read`.

    Raises
    ------
    OSError
        Naming the file.
    """
    track, weight = labels(tracks, len(detections.time))
    cells = [
        (str(one), f"{heavy:.{DECIMALS}g}") if one else ("", "")
        for one, heavy in zip(track.tolist(), weight.tolist(), strict=True)
    ]
    if form_of(source) != TEXT:
        lines = _table(detections, cells)
    else:
        of_line = dict(zip(detections.row.tolist(), cells, strict=True))
        text = file_bytes(source).decode(encoding).removeprefix("\ufeff")
        lines = _labelled(io.StringIO(text, newline="\n"), of_line, delimiter, header)
    with whole(path) as partial, partial.open("w", encoding=encoding, newline="") as file:
        file.writelines(lines)


def _labelled(
    lines: Iterable[str], of_line: dict[int, tuple[str, str]], delimiter: str | None, header: bool
) -> Iterator[str]:
    """The lines with two cells more."""
    for number, line in enumerate(lines, 1):
        content = line.rstrip("\r\n")
        if not content.strip() or content.startswith("#"):
            yield line
            continue
        delimiter = delimiter_typed(delimiter) or delimiter_of(content)
        more, header = APPENDED if header else of_line.get(number, ("", "")), False
        yield delimiter.join([content, *more]) + line[len(content) :]


def _table(detections: Detections, cells: Iterable[tuple[str, str]]) -> Iterator[str]:
    """Detections as lines of CSV, in local coordinates and on Earth."""
    points = local_positions(detections)
    columns = {"record": detections.row.tolist(), "time": detections.time.tolist()}
    columns |= dict(zip(("x_m", "y_m", "z_m"), points.T.tolist(), strict=False))
    if detections.reference:
        latitude, longitude, _ = geodetic(points, detections.reference).T
        columns |= {"lat": latitude.round(DEGREES).tolist(), "lon": longitude.round(DEGREES).tolist()}
    columns |= {"identity": [one or "" for one in detections.identity]} | detections.metadata
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow([*columns, *APPENDED])
    writer.writerows(
        [*row, *more] for row, more in zip(zip(*columns.values(), strict=True), cells, strict=True)
    )
    yield file.getvalue()
