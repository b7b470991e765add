"""CSV files as columns: read block by block, each column converted as it is wanted."""

import csv
import sys
from collections.abc import Callable, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.evaluation.text_files import line_blocks

BLOCK = 2_000  # lines read together; larger ones keep the garbage collector busy
QUOTED = '"\r\0'  # signs in what a reader of CSV takes for more than itself
BLANK = frozenset({""})  # cells that stand for no value

# cells of a column and where each of them stands -> their values
Convert = Callable[[Sequence[str], Callable[[int], str]], np.ndarray | list]


class Columns(NamedTuple):
    """Columns of a file; those that were not wanted are left out."""

    where: str  # the file, and the line of its header
    names: tuple[str, ...]  # all of them
    values: dict[str, Any]  # an array or a list of each
    line: np.ndarray  # (n,) int, from 1
    remarks: tuple[str, ...] = ()  # what was left out


def read_columns(
    path: Path | str,
    choose: Callable[[str, list[str]], dict[str, Convert]],
    *,
    delimiter: str | None = ",",
    encoding: str = "utf-8",
    header: bool = True,
) -> Columns:
    """Read columns of a CSV file, which may be compressed with gzip.

    Blank lines and lines that start with # are ignored, and blanks around cells.

    Parameters
    ----------
    path : Path or str
    choose : callable
        Takes where the header stands and its names, and gives for each column that is wanted what converts
        its cells, such as `numbers` or `texts`.
    delimiter : str, optional
        A blank stands for any number of blanks; None takes the one the first line has most of.
    encoding : str
    header : bool
        Whether the first line names the columns. Otherwise they are named 1, 2, ..., and lines may differ in
        length.

    Returns
    -------
    Columns

    Raises
    ------
    ValueError
        Naming file, line and column.
    MemoryError
        Where the columns would not fit.
    """
    with Path(path).open("rb") as raw:
        blocks = line_blocks(path, raw, encoding, BLOCK)
        at, first = next(blocks, ([1], [""]))
        delimiter = delimiter or delimiter_of(first[0])
        names = [cell.strip() for cell in _rows(path, at[:1], first[:1], delimiter)[0]] or [""]
        where = f"{path}, line {at[0]}"
        if header:
            at, first = at[1:], first[1:]
        else:
            names = [str(i + 1) for i in range(max(map(len, _rows(path, at, first, delimiter))))]
        wanted = choose(where, names)
        parts: dict[str, list] = {name: [] for name in wanted}
        numbers: list[np.ndarray] = []
        for lines, contents in chain([(at, first)], blocks):
            columns = _columns(path, names, lines, contents, delimiter, header)
            for name, convert in wanted.items():
                parts[name].append(convert(columns[names.index(name)], _place(path, name, lines)))
            numbers.append(np.array(lines, int))
            if len(numbers) == 1:
                _check_memory(path, parts, len(lines), raw.tell() / max(Path(path).stat().st_size, 1))
    values = {name: _joined(parts.pop(name)) for name in wanted}
    return Columns(where, tuple(names), values, np.concatenate(numbers))


def numbers(
    cells: Sequence[str], at: Callable[[int], str], absent: frozenset[str] = BLANK, decimal: str = "."
) -> np.ndarray:
    """Cells as floats, NaN where one is absent.

    Parameters
    ----------
    cells : sequence of n str
    at : callable
        Where the cell of an index stands, for the message.
    absent : frozenset of str
        Cells, in lower case, that stand for no value.
    decimal : str
        What stands before the decimals.

    Returns
    -------
    ndarray (n,)

    Raises
    ------
    ValueError
        Naming file, line and column of a cell that is not a finite number.
    """
    if decimal != ".":
        cells = [cell.replace(decimal, ".") for cell in cells]
    try:
        found = np.fromiter(map(float, cells), float, len(cells))
    except ValueError:
        found = np.array([np.nan])
    if np.isfinite(found).all() and "_" not in "".join(cells):
        return found
    return np.array([_number(cell, absent, at, i) for i, cell in enumerate(cells)])


def texts(cells: Sequence[str], at: Callable[[int], str]) -> list[str]:
    """Cells as they are, without blanks around; equal ones are one object, where most have an equal."""
    kinds = set(cells)
    if len(kinds) > len(cells) / 2:
        return list(map(str.strip, cells))
    return list(map({cell: sys.intern(cell.strip()) for cell in kinds}.__getitem__, cells))


def _number(cell: str, absent: frozenset[str], at: Callable[[int], str], i: int) -> float:
    cell = cell.strip()
    if cell.lower() in absent:
        return np.nan
    try:
        number = float(cell.replace("_", "?"))  # float() would take 1_0 for ten
    except ValueError:
        number = np.nan
    if not -np.inf < number < np.inf:
        raise ValueError(f"{at(i)}: {cell!r} is not a finite number")
    return number


def _place(path: Path | str, name: str, lines: Sequence[int]) -> Callable[[int], str]:
    return lambda i: f"{path}, line {lines[i]}, column {name}"


def _columns(
    path: Path | str,
    names: Sequence[str],
    lines: Sequence[int],
    contents: list[str],
    delimiter: str,
    header: bool,
) -> Sequence[Sequence[str]]:
    """Cells of each column."""
    n = len(names)
    ended = [*contents[:-1], *(content.rstrip("\n") + "\n" for content in contents[-1:])]
    text = delimiter.join(ended)
    if delimiter != " " and not any(sign in text for sign in QUOTED):
        cells = text.split(delimiter)
        # where each n-th cell ends a line, all lines have n
        if len(cells) == n * len(lines) and "".join(cells[n - 1 :: n]).count("\n") == len(lines):
            return [cells[i::n] for i in range(n)]
    rows = _even(path, names, lines, _rows(path, lines, contents, delimiter), header)
    return [*zip(*rows, strict=True)] or [()] * n


def _rows(path: Path | str, lines: Sequence[int], contents: list[str], delimiter: str) -> list[list[str]]:
    """Cells of each line."""
    form: dict[str, Any] = {"delimiter": delimiter, "strict": True, "skipinitialspace": delimiter == " "}
    if delimiter == " ":
        contents = [content.strip() for content in contents]
    try:
        rows = [*csv.reader(contents, **form)]
    except csv.Error:
        rows = []
    if len(rows) == len(lines):
        return rows
    # a quote that is not closed takes in what follows
    for line, content in zip(lines, contents, strict=True):
        try:
            next(csv.reader([content], **form))
        except csv.Error as error:
            raise ValueError(f"{path}, line {line}: not a row of CSV: {error}") from None
    raise ValueError(f"{path}, line {lines[0]}: not rows of CSV")


def delimiter_of(content: str) -> str:
    """Of comma, semicolon, tab and bar the one that a line has most of; a blank where it has none."""
    best = max(",;\t|", key=content.count)
    return best if best in content.strip() else " " if " " in content.strip() else ","


def _even(
    path: Path | str, names: Sequence[str], lines: Sequence[int], rows: list[list[str]], header: bool
) -> list[list[str]]:
    """Rows of as many cells as there are names."""
    n = len(names)
    if set(map(len, rows)) <= {n}:
        return rows
    for line, cells in zip(lines, rows, strict=True):
        if len(cells) > n or (header and len(cells) < n):
            name = names[min(len(cells), n - 1)]
            raise ValueError(f"{path}, line {line}, column {name}: {len(cells)} cells under {n} columns")
    return [row + [""] * (n - len(row)) for row in rows]


def _joined(parts: list) -> np.ndarray | list:
    if isinstance(parts[0], np.ndarray):
        return np.concatenate(parts)
    return [value for part in parts for value in part]


def _check_memory(path: Path | str, parts: dict[str, list], rows: int, share: float) -> None:
    """Refuse a file of which the first rows, a share of it, say that the whole does not fit."""
    sizes = (p.nbytes if isinstance(p, np.ndarray) else 64 * len(p) for some in parts.values() for p in some)
    needed = 2 * sum(sizes) / max(share, 1e-9)  # parts, and what is joined of them
    if share < 1:
        check_memory(f"{path}: some {rows / share:.2g} rows", needed, "keep fewer columns")


def check_memory(what: str, needed: float, way: str) -> None:
    """Refuse what needs more bytes than are free; MemoryError, with a way out."""
    if needed > (free := _free_memory()):
        raise MemoryError(
            f"{what} need {needed / 1e9:.1f} GB, and {free / 1e9:.1f} GB are free; {way}, or cut the file in "
            "parts"
        )


def _free_memory() -> float:
    """Bytes that are free, where the system says so."""
    try:
        text = Path("/proc/meminfo").read_text(encoding="ascii")
        return 1024.0 * int(text.partition("MemAvailable:")[2].split()[0])
    except (OSError, ValueError, IndexError):
        return np.inf
