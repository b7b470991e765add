"""Where targets were, by another measurement than that which is tracked."""

import json
from datetime import UTC
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.recorded.detections import Detections, objects
from gmr_gym.recorded.positions import local_positions
from gmr_gym.recorded.reading import read

NAMES = "id", "target", "target_id", "track_id", "identity"  # of columns


class Truth(NamedTuple):
    """Positions of targets, in any order."""

    time: np.ndarray  # (m,), s, as `Detections.time`
    target: np.ndarray  # (m,), object: its name
    position: np.ndarray  # (m, p), m, in local coordinates


def truth_of(file: Path, detections: Detections) -> Truth:
    """The truth of a file, in the frame of the detections: of the Autoferry form, or read as detections
    are."""
    if is_autoferry(file):
        return read_autoferry_truth(file, detections)
    return truth_from(read(file, reference=detections.reference), detections)


def truth_from(found: Detections, detections: Detections) -> Truth:
    """The truth of a file that is read as detections are.

    Parameters
    ----------
    found : Detections
        Their identity, or else their column of the truth, or one that is called `id`, `target` or the like,
        names the target; without any there is one.
    detections : Detections
        What is tracked, in the same local coordinates.

    Returns
    -------
    Truth

    Raises
    ------
    ValueError
        If only one of the two has absolute times.
    """
    if (found.start is None) != (detections.start is None):
        raise ValueError("the truth and the detections must both have absolute times, or neither")
    after = found.zero - detections.zero
    if found.start and detections.start:
        after = (found.start - detections.start).total_seconds()
    return Truth(found.time + after, objects(_names(found)), local_positions(found))


def _names(found: Detections) -> list[str]:
    """Of the identities, the column of the truth, and the first column that is called as a target is, the
    first that there is."""
    columns = [found.identity.tolist(), found.truth.tolist()]
    columns += [found.metadata[name] for name in NAMES if name in found.metadata]
    named = (column for column in columns if any(one is not None for one in column))
    return [str(one) for one in next(named, ["1"] * len(found.time))]


def read_autoferry_truth(path: Path | str, detections: Detections) -> Truth:
    """Read the ground truth of a scenario of the Autoferry data set.

    Parameters
    ----------
    path : Path or str
        JSON: a list of lists of targets with targetID, position (north, east, down; m) and time (s since
        1970).
    detections : Detections
        What is tracked; its times must be absolute.

    Returns
    -------
    Truth

    Raises
    ------
    ValueError
        For a file of another form, and detections without absolute times.
    """
    if detections.start is None:
        raise ValueError(f"{path}: its times are since 1970, but those of the detections are not known to be")
    zero = detections.start.replace(tzinfo=UTC).timestamp()
    try:
        moments = json.loads(Path(path).read_text(encoding="utf-8"))
        each = {(str(one["targetID"]), float(one["time"])): one["position"] for now in moments for one in now}
        position = np.array([[east, north] for north, east, *_ in each.values()], float)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise ValueError(
            f"{path}: expected lists of targets with targetID, position and time, got {error!r:.80}"
        ) from None
    names, times = zip(*each, strict=True) if each else ((), ())
    return Truth(np.array(times) - zero, objects(names), position.reshape(-1, 2))


def is_autoferry(path: Path | str) -> bool:
    """Whether a file has the form that `read_autoferry_truth` reads."""
    with Path(path).open("rb") as file:
        head = file.read(200)
    return head.lstrip()[:1] == b"[" and b"targetID" in head


def at_times(
    time: np.ndarray, name: np.ndarray, position: np.ndarray, times: np.ndarray
) -> tuple[np.ndarray, list]:
    """Positions at other times, on straight lines between those that are known.

    Parameters
    ----------
    time : ndarray (m,)
        s.
    name : ndarray (m,)
        Whose each position is.
    position : ndarray (m, p)
    times : ndarray (T,)
        s.

    Returns
    -------
    points : ndarray (T, n, p)
        NaN before the first and after the last time of each.
    names : list of n
        In order.
    """
    names: list[Any] = sorted(set(name.tolist()))
    points = np.full((len(times), len(names), position.shape[1]), np.nan)
    for j, one in enumerate(names):
        rows = np.flatnonzero(name == one)
        rows = rows[np.argsort(time[rows], kind="stable")]
        within = (times >= time[rows[0]]) & (times <= time[rows[-1]])
        for axis in range(position.shape[1]):
            points[within, j, axis] = np.interp(times[within], time[rows], position[rows, axis])
    return points, names
