"""Columns of numbers as compact text: quantised, one after the other, deflated, in base64.

Integers are exact. Positions are multiples of a step. All other real numbers are 32-bit floats; of weights
and covariances, which are many and span orders of magnitude, nine significant bits are kept.
"""

import base64
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np

POSITIONS = "truth", "z", "gate", "kept", "full", "estimate", "declared", "guess", "clutter"
COARSEST = 0.5  # m, the largest step of a position
ROUNDED = "_w", "_P", "_shape"  # endings of the names of weights and covariances
DROPPED_BITS = 15  # of the 23 that a float32 has after the leading one
INTEGERS = "u1", "i1", "u2", "i2", "u4", "i4"
ALIGNMENT = 4  # bytes: a typed array begins at a multiple of its element


def pack(columns: Mapping[str, np.ndarray]) -> tuple[dict[str, Any], str]:
    """Pack columns.

    Parameters
    ----------
    columns : mapping of str to ndarray
        Booleans, integers, or real numbers with nan for what is missing. Names are NAME, or "i/NAME" of
        tracker i.

    Returns
    -------
    entries : dict of str to dict
        For each column its dtype, shape, and place "at" in the bytes; "low" and "step" where a value is
        low + step * integer, with "nan" where the largest integer stands for a missing value. A column equal
        to that of tracker 0 is stored once, and has its name as "same".
    blob : str
        The bytes of all columns, little-endian, deflated (RFC 1950), in base64.

    Raises
    ------
    ValueError
        For integers beyond 32 bits.
    """
    entries: dict[str, Any] = {}
    parts, size = [], 0
    for name, column in columns.items():
        first = f"0/{name.partition('/')[2]}"
        if name != first and first in columns and _equal(column, columns[first]):
            entries[name] = {"same": first}
            continue
        stored, scale = _coded(name, column)
        raw = stored.tobytes()
        raw += bytes(-len(raw) % ALIGNMENT)
        entries[name] = {"dtype": stored.dtype.str[1:], "shape": list(column.shape), "at": size, **scale}
        parts.append(raw)
        size += len(raw)
    return entries, base64.b64encode(zlib.compress(b"".join(parts))).decode("ascii")


def _equal(a: np.ndarray, b: np.ndarray) -> bool:
    return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=a.dtype.kind == "f")


def _coded(name: str, column: np.ndarray) -> tuple[np.ndarray, dict[str, Any]]:
    """What is stored of a column, and how values follow from it."""
    if column.dtype.kind in "bui":
        return _integers(name, column), {"low": 0, "step": 1}
    if name.rpartition("/")[2] in POSITIONS:
        return _steps(column)
    stored = column.astype("<f4")
    if name.endswith(ROUNDED):
        bits = stored.view("<u4") + np.uint32(1 << DROPPED_BITS - 1)
        stored = np.where(np.isnan(stored), np.nan, (bits >> DROPPED_BITS << DROPPED_BITS).view("<f4"))
    return stored.astype("<f4"), {}


def _integers(name: str, column: np.ndarray) -> np.ndarray:
    low, high = (int(end) for end in (column.min(initial=0), column.max(initial=0)))
    for dtype in INTEGERS:
        if np.iinfo(dtype).min <= low and high <= np.iinfo(dtype).max:
            return column.astype(f"<{dtype}")
    raise ValueError(f"{name} must be integers of 32 bits, got {low} to {high}")


def _steps(column: np.ndarray) -> tuple[np.ndarray, dict[str, Any]]:
    """Positions as multiples of a step from the lowest, of two bytes unless the step were too coarse."""
    there = np.isfinite(column)
    low, high = column.min(initial=np.inf, where=there), column.max(initial=-np.inf, where=there)
    if not there.any():
        low = high = 0.0
    missing = np.iinfo(np.uint16).max
    step = (high - low) / (missing - 1) or 1.0
    if step > COARSEST:
        missing = np.iinfo(np.uint32).max
        step = max(COARSEST, (high - low) / (missing - 1))
    whole = np.where(there, np.rint((np.where(there, column, low) - low) / step), missing)
    scale = {"low": float(low), "step": float(step)} | ({} if there.all() else {"nan": True})
    return whole.astype("<u2" if missing < 1 << 16 else "<u4"), scale
