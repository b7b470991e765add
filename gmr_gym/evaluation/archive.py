"""Arrays in a file, an .npz of NumPy, with a digest of its contents.

A file is written whole or not at all, and read without trust. The digest finds damage and files of other
programs. It is no protection against forgery: anyone can compute it.
"""

import hashlib
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any
from zipfile import ZIP_STORED, ZipFile, ZipInfo

import numpy as np
from numpy.lib import format as npy

from gmr_gym.evaluation.writing import whole

DIGEST = "digest"  # the member that holds it
HEADERS = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}


def save(file: Path, arrays: Mapping[str, Any], of: str = "") -> None:
    """Write arrays and their digest to a file.

    Parameters
    ----------
    file : Path
    arrays : mapping of str to array_like
    of : str
        What the arrays belong to, such as the name of the file; part of the digest.
    """
    members: dict[str, Any] = {name: np.asarray(array) for name, array in arrays.items()}
    members[DIGEST] = digest(members, of)
    with whole(file) as partial, partial.open("wb") as stream:
        np.savez(stream, **members)


def load(file: Path, of: str = "") -> dict[str, np.ndarray]:
    """Read the arrays of a file.

    Nothing is unpickled or inflated, and no more is read than the length of the file.

    Parameters
    ----------
    file : Path
    of : str
        What the arrays belong to, as given to `save`.

    Returns
    -------
    dict of str to ndarray
        The arrays, with their digest as `DIGEST` where the file has one.

    Raises
    ------
    ValueError
        If the file is no such archive, is damaged, or belongs to something else. The message does not name
        the file; the caller does.
    """
    try:
        if not file.is_file():  # a pipe or a device has no end
            raise ValueError("it is not a plain file")
        size = file.stat().st_size
        with ZipFile(file) as packed:
            members = packed.infolist()
            if (total := sum(member.file_size for member in members)) > size:
                raise ValueError(f"it unpacks to {total} bytes, and is {size} bytes long")
            arrays = {member.filename.removesuffix(".npy"): _array(packed, member) for member in members}
    except Exception as error:  # zipfile and NumPy raise many types for a damaged file
        raise ValueError(str(error) or type(error).__name__) from None
    kept = arrays.get(DIGEST)
    if kept is not None and not np.array_equal(kept, digest(arrays, of)):
        raise ValueError("its digest does not match its arrays and name: damaged, or not written here")
    return arrays


def digest(arrays: Mapping[str, np.ndarray], of: str = "") -> np.ndarray:
    """BLAKE2 digest (32,) of what the arrays belong to, and of their names, types, shapes and bytes."""
    hashed = hashlib.blake2b(of.encode(), digest_size=32)
    for name in sorted(arrays.keys() - {DIGEST}):
        array = arrays[name]
        hashed.update(f"{name} {array.dtype.str} {array.shape}\n".encode())
        hashed.update(array.tobytes())
    return np.frombuffer(hashed.digest(), np.uint8)


def _array(packed: ZipFile, member: ZipInfo) -> np.ndarray:
    """The array of a member. Its length is checked against its header before memory is allocated."""
    if member.compress_type != ZIP_STORED:
        raise ValueError(f"{member.filename} is compressed")
    with packed.open(member) as stream:
        version = npy.read_magic(stream)
        if version not in HEADERS:
            raise ValueError(f"{member.filename} has format {version}")
        shape, _, dtype = HEADERS[version](stream)
        if dtype.hasobject:
            raise ValueError(f"{member.filename} holds objects")
        if (bytes_ := math.prod(shape) * dtype.itemsize) != member.file_size - stream.tell():
            raise ValueError(f"{member.filename} does not have the {bytes_} bytes that its header states")
        stream.seek(0)
        return npy.read_array(stream, allow_pickle=False)
