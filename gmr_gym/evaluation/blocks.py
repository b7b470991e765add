"""Finished blocks of runs on disk: named by what they hold, checked when they are read, merged from machines
that share nothing."""

import errno
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.evaluation import archive

# digest of scenario, tracker, source and seed; the block's first run and the one after its last
NAME = re.compile(r"[0-9a-f]{32}-(\d+)-(\d+)\.npz")
AXES = {"truth": 3, "x": 3, "P": 4, "modes": 3}  # of all other fields two, runs and scans
TYPES = {"off_target": "?", "components": "i8", "targets": "i8", "named": "i8"}  # of all others f8


class Merged(NamedTuple):
    """What became of the files of a merge."""

    copied: list[Path]
    present: list[Path]  # already there, equal to the last bit but for the clock
    differing: list[Path]  # already there with other results, which stay
    foreign: list[Path]  # no blocks by their names
    refused: list[str]  # blocks by their names that are none, each with why


def named(folder: Path | str, digest: str, first: int, stop: int) -> Path:
    """The file of a block."""
    return Path(folder) / f"{digest}-{first}-{stop}.npz"


def check_folder(folder: Path) -> None:
    """OSError for a folder in which no file could be made: before the work, and without leaving one."""
    there = next(path for path in (folder, *folder.parents) if path.exists())
    if not there.is_dir() or not os.access(there, os.W_OK):
        number = errno.EACCES if there.is_dir() else errno.ENOTDIR
        raise OSError(number, os.strerror(number), str(there))


def save(file: Path, result) -> None:
    """A block, a named tuple of arrays; the file is there whole or not at all, and is read by its name alone:
    copied to that of another block it is none."""
    fields = result._asdict().items()
    arrays = {field: array.astype(_dtype(field), casting="same_kind") for field, array in fields}
    archive.save(file, arrays, of=file.name)


def load(file: Path, *kinds: type) -> Any:
    """The block in a file, one of `kinds`, as it was written. ValueError names what is none."""
    try:
        arrays = archive.load(file, of=file.name)
        if arrays.pop(archive.DIGEST, None) is None:
            raise ValueError("it has no digest")
        for kind in kinds:
            if arrays.keys() == set(kind._fields):  # type: ignore[attr-defined]
                first, stop = map(int, NAME.fullmatch(file.name).groups())  # type: ignore[union-attr]
                _check_shapes(arrays, stop - first)
                return kind(**arrays)
        raise ValueError(f"it has arrays {', '.join(arrays)}")
    except ValueError as error:
        raise ValueError(f"{file} is not a block of runs ({error}); delete it to have it run again") from None


def load_all(files: Mapping[Any, Path], *kinds: type) -> Iterator[tuple[Any, Any]]:
    """(key, block) of those of the files that are there; ValueError at the end names all that are none."""
    refused = []
    for key, file in files.items():
        try:
            if file.exists():
                yield key, load(file, *kinds)
        except ValueError as error:
            refused.append(str(error))
    if refused:
        raise ValueError("; ".join(refused))


def merge(folders: Sequence[Path | str], into: Path | str, *kinds: type) -> Merged:
    """Copies every block of the folders that is not yet there, and none that is no block of `kinds`."""
    merged = Merged([], [], [], [], [])
    Path(into).mkdir(parents=True, exist_ok=True)
    for file in (file for folder in folders for file in sorted(Path(folder).iterdir())):
        if not NAME.fullmatch(file.name):
            merged.foreign.append(file)
            continue
        target = Path(into) / file.name
        try:
            block = load(file, *kinds)
            if not target.exists():
                save(target, block)
                merged.copied.append(file)
            elif _same(block, load(target, *kinds)):
                merged.present.append(file)
            else:
                merged.differing.append(file)
        except ValueError as error:
            merged.refused.append(str(error))
    return merged


def _check_shapes(arrays: dict[str, np.ndarray], runs: int) -> None:
    scans = arrays["seconds"].shape[1:2]
    for field, array in arrays.items():
        if array.dtype != _dtype(field):
            raise ValueError(f"{field} holds {array.dtype}, wanted {_dtype(field)}")
        if array.ndim != AXES.get(field, 2) or array.shape[:2] != (runs, *scans):
            raise ValueError(f"{field} has shape {array.shape}, and the file is of {runs} runs")
    if "P" in arrays:
        x, P = arrays["x"].shape, arrays["P"].shape
        if arrays["truth"].shape != x or P != (*x, x[-1]):
            raise ValueError(f"estimates {x}, truth {arrays['truth'].shape} and covariances {P} do not fit")


def _dtype(field: str) -> np.dtype:
    return np.dtype(TYPES.get(field, "f8"))


def _same(one, other) -> bool:
    """Whether two blocks hold the same bits, `seconds` apart."""
    return type(one) is type(other) and all(
        field == "seconds" or (a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes())
        for field, a, b in zip(one._fields, one, other, strict=True)
    )
