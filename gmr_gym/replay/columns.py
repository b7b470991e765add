"""Columns of an episode, gathered scan by scan from what trackers report."""

import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from gmr_gym.mixture import Mixture

LARGEST = float(np.finfo(np.float32).max)


class Reported:
    """Checks what one tracker reports: shapes that do not fit are refused, and numbers that are not finite
    are missing.

    Parameters
    ----------
    tracker : str
        Its name in messages.
    """

    def __init__(self, tracker: str):
        self.tracker = tracker
        self.scan = 0  # from 1, set by whoever goes through the scans
        self._unsound: set[int] = set()

    def array(self, what: str, value: Any, *shape: int | None) -> np.ndarray:
        """The value as floats, nan where it is not finite, or no float of 32 bits.

        Parameters
        ----------
        what : str
            Name of the field.
        value : array_like
        *shape : int or None
            What its shape must be; None for any length.

        Raises
        ------
        ValueError
            For another shape, and for what is no number.
        """
        try:
            numbers = np.array(value, float)
        except (TypeError, ValueError):
            raise ValueError(f"{self.place(what)}: expected numbers, got {value!r:.60}") from None
        sizes = zip(numbers.shape, shape, strict=False)
        if numbers.ndim != len(shape) or any(want not in (None, got) for got, want in sizes):
            wanted = ", ".join("n" if size is None else str(size) for size in shape)
            raise ValueError(f"{self.place(what)}: expected shape ({wanted}), got {numbers.shape}")
        sound = np.abs(numbers) <= LARGEST  # nan is not
        if not sound.all():
            self._unsound.add(self.scan)
            numbers[~sound] = np.nan
        return numbers

    def fields(self, what: str, value: Any, kind: type) -> None:
        """ValueError for a value that has not all the fields of a kind of NamedTuple."""
        lacking = [field for field in kind._fields if not hasattr(value, field)]  # type: ignore[attr-defined]
        if lacking:
            raise ValueError(f"{self.place(what)}: expected a {kind.__name__}, got {type(value).__name__}")

    def mixture(self, what: str, p: Any, d: int) -> Mixture:
        """The mixture of states (d,), checked by `array`."""
        try:
            w, m, P = p
        except (TypeError, ValueError):
            raise ValueError(f"{self.place(what)}: expected a Mixture, got {p!r:.60}") from None
        w = self.array(f"{what}.w", w, None)
        return Mixture(w, self.array(f"{what}.m", m, len(w), d), self.array(f"{what}.P", P, len(w), d, d))

    def rows(self, what: str, value: Any, length: int, below: int) -> np.ndarray:
        """The value as integers (length,) from -1 to `below` - 1; ValueError for anything else."""
        rows = np.asarray(value)
        whole = rows.shape == (length,) and (rows.dtype.kind in "iu" or length == 0)
        if not whole or rows.min(initial=-1) < -1 or rows.max(initial=-1) >= below:
            raise ValueError(f"{self.place(what)}: expected {length} whole numbers from -1 to {below - 1}")
        return rows.astype(int)

    def warn(self) -> None:
        """Warns, if there was any, of scans with numbers that were not finite."""
        if self._unsound:
            warnings.warn(
                f"tracker {self.tracker!r} reported numbers that are not finite in {len(self._unsound)} of "
                f"{self.scan} scans; they are not shown",
                stacklevel=4,  # at who calls `record`
            )

    def place(self, what: str) -> str:
        """The beginning of a message about a field."""
        return f"tracker {self.tracker!r}, {what} at scan {self.scan}"


def gathered(rows: Iterable[Mapping[str, Any]], groups: Mapping[str, Sequence[str]]) -> dict[str, np.ndarray]:
    """Columns of rows, one row a scan.

    Parameters
    ----------
    rows : iterable of mapping of str to array_like
        All with the same names.
    groups : mapping of str to sequence of str
        Names whose lengths change from scan to scan, together: they are joined, and scan t of the group G
        is at "G_start"[t] : "G_start"[t + 1].

    Returns
    -------
    dict of str to ndarray
    """
    rows = list(rows)
    columns = {name: np.array([row[name] for row in rows]) for name in _alone(rows[0], groups)}
    for group, names in groups.items():
        if names[0] in rows[0]:
            lengths = [len(row[names[0]]) for row in rows]
            columns[f"{group}_start"] = np.cumsum([0, *lengths])
            there = [name for name in names if name in rows[0]]
            columns |= {name: np.concatenate([row[name] for row in rows]) for name in there}
    return columns


def _alone(row: Mapping[str, Any], groups: Mapping[str, Sequence[str]]) -> list[str]:
    together = {name for names in groups.values() for name in names}
    return [name for name in row if name not in together]


def upper(P: np.ndarray, at: Sequence[int] = (0, 1)) -> np.ndarray:
    """The entries xx, xy and yy (n, 3) of matrices (n, d, d), x and y being the indices `at`."""
    x, y = at
    return np.stack([P[:, x, x], P[:, x, y], P[:, y, y]], axis=1)
