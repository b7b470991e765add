"""Finished blocks of runs on disk: named by their contents, checked when read, merged across machines."""

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
AXES = {  # of all other fields two, runs and scans
    "truth": 3, "x": 3, "P": 4, "modes": 3, "binned": 3, "binned_found": 3, "binned_existence": 3,
}  # fmt: skip
TYPES = {"off_target": "?", "components": "i8", "targets": "i8", "named": "i8"}  # of all others f8


class Merged(NamedTuple):
    """Result of a merge."""

    copied: list[Path]
    present: list[Path]  # already there, equal to the last bit but for `seconds`
    differing: list[Path]  # already there with other results, which stay
    foreign: list[Path]  # files that are not named like blocks
    refused: list[str]  # files named like blocks that are not readable blocks, each with the reason


def named(folder: Path | str, digest: str, first: int, stop: int) -> Path:
    """The file of the block of runs first, ..., stop - 1."""
    return Path(folder) / f"{digest}-{first}-{stop}.npz"


def check_folder(folder: Path) -> None:
    """Check that files can be made in a folder, without making one.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    OSError
        If they cannot.
    """
    nearest = next(path for path in (folder, *folder.parents) if path.exists())
    if not nearest.is_dir() or not os.access(nearest, os.W_OK):
        number = errno.EACCES if nearest.is_dir() else errno.ENOTDIR
        raise OSError(number, os.strerror(number), str(nearest))


def save(file: Path, result) -> None:
    """Write a block of runs, a named tuple of arrays, whole or not at all.

    The name of the file is part of the digest: a block copied to another name is not readable there.
    """
    fields = result._asdict().items()
    arrays = {field: array.astype(_dtype(field), casting="same_kind") for field, array in fields}
    archive.save(file, arrays, of=file.name)


def load(file: Path, *kinds: type) -> Any:
    """Read a block of runs.

    Parameters
    ----------
    file : Path
    *kinds : type
        The named tuples that it may be.

    Returns
    -------
    One of `kinds`

    Raises
    ------
    ValueError
        Naming the file, if it is not a readable block.
    """
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
    """Yield (key, block) of those of the files that exist.

    Parameters
    ----------
    files : mapping of key to Path
    *kinds : type
        The named tuples that a block may be.

    Raises
    ------
    ValueError
        At the end, naming all files that are not readable blocks.
    """
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
    """Copy every readable block of the folders that is not yet in the folder `into`.

    Parameters
    ----------
    folders : sequence of Path or str
    into : Path or str
        Made if it does not exist.
    *kinds : type
        The named tuples that a block may be.

    Returns
    -------
    Merged
    """
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
            raise ValueError(f"{field} has shape {array.shape}, but the file is for {runs} runs")
    if "P" in arrays:
        x, P = arrays["x"].shape, arrays["P"].shape
        if arrays["truth"].shape != x or P != (*x, x[-1]):
            raise ValueError(f"estimates {x}, truth {arrays['truth'].shape} and covariances {P} do not fit")


def _dtype(field: str) -> np.dtype:
    return np.dtype(TYPES.get(field, "f8"))


def _same(one, other) -> bool:
    """Whether two blocks are equal to the last bit, `seconds` apart."""
    return type(one) is type(other) and all(
        field == "seconds" or (a.dtype == b.dtype and a.shape == b.shape and a.tobytes() == b.tobytes())
        for field, a, b in zip(one._fields, one, other, strict=True)
    )
