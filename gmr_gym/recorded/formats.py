"""Where columns come from: text with any delimiter, JSON, Parquet, AIS, ASTERIX, arrays and data frames."""

import io
import json
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.evaluation.csv_columns import Columns, Convert, numbers, read_columns, texts
from gmr_gym.evaluation.text_files import file_bytes
from gmr_gym.recorded import ais, asterix
from gmr_gym.recorded.extras import Decoded, module_of
from gmr_gym.recorded.times import is_number

ABSENT = frozenset({"", "nan", "na", "n/a", "null", "none", "-"})  # cells that stand for no value
NOTHING = frozenset({"None", "nan", "NaT", "<NA>"})  # how values print that stand for none
RECORDS = re.compile(rb"\[?\s*\{")  # how JSON begins, and no log of sentences
JSON_LINES = re.compile(rb"\s*\{.*\}[ \t]*\r?\n\s*\{")  # a record, and another on the next line
PATH = re.compile(r"[^.\[\]]+")
TEXT, JSON, PARQUET, AIS, ASTERIX = "text", "JSON", "Parquet", "AIS", "ASTERIX"
PARQUET_MAGIC = b"PAR1"
DECODERS: dict[str, Callable[[Path | str, bytes], Decoded]] = {
    AIS: ais.reports,
    ASTERIX: asterix.surveillance,
}
HEAD = 4096  # bytes by which a form is known

# where the names of the columns stand, the names, and columns that have a role unless something else is said,
# by role -> which are read, True for numbers
Choose = Callable[[str, Sequence[str], Mapping[str, str]], Mapping[str, bool]]


class TextForm(NamedTuple):
    """How a text file is written."""

    delimiter: str | None = None  # by default the one that the first line has most of
    decimal: str = "."
    encoding: str = "utf-8"
    header: bool = True


def columns_of(source: Any, choose: Choose, form: TextForm, kept: Callable[[Mapping], bool]) -> Columns:
    """Columns of a file, of a data frame, or of a mapping of arrays.

    Parameters
    ----------
    source : Path, str, or anything with columns
        A data frame is read by `source.columns` and `source[name]`.
    choose : callable
        Takes where the names stand and the names, and gives those that are wanted; True for numbers.
    form : TextForm
    kept : callable
        Whether a record of JSON, a mapping of its cells, is kept.

    Returns
    -------
    Columns
        Of a JSON file the line is the number of the record.
    """
    if not isinstance(source, str | Path):
        return _of_frame(source, choose)
    form_there = form_of(source)
    if form_there == JSON:
        return _of_json(source, choose, kept)
    if form_there == PARQUET:
        return _of_parquet(source, choose)
    if form_there in DECODERS:
        where, values, line, remarks, usual = DECODERS[form_there](source, file_bytes(source))
        wanted = choose(where, [*values], usual)
        return Columns(where, tuple(values), {name: values[name] for name in wanted}, line, remarks)

    def convert(where: str, names: list[str]) -> dict[str, Convert]:
        _check_names(where, names)
        number = partial(numbers, absent=ABSENT, decimal=form.decimal)
        return {name: number if is_number else texts for name, is_number in choose(where, names, {}).items()}

    if b"\r" in (head := file_bytes(source, HEAD)) and b"\n" not in head:
        raise ValueError(
            f"{source}: lines end in a carriage return alone; make them end in line feeds first, as "
            r"`tr '\r' '\n' < OLD > NEW` does"
        )
    delimiter = delimiter_typed(form.delimiter)
    return read_columns(source, convert, delimiter=delimiter, encoding=form.encoding, header=form.header)


def delimiter_typed(delimiter: str | None) -> str | None:
    """The sign of a delimiter, which may have been typed by its name; None for none."""
    sign = {"tab": "\t", "\\t": "\t", "space": " "}.get(delimiter or "", delimiter)
    if sign and len(sign) > 1:
        raise ValueError(f"delimiter must be one character, tab or space, got {delimiter!r}")
    return sign or None


def form_of(path: Path | str) -> str:
    """`text`, `JSON`, `Parquet`, `AIS` or `ASTERIX`, by how a file begins."""
    data = file_bytes(path, HEAD)
    head = data.lstrip(b"\xef\xbb\xbf \t\r\n")
    if ais.is_ais(head) and not RECORDS.match(head):
        return AIS
    if head.startswith((b"[", b"{")):
        return JSON
    if data.startswith(PARQUET_MAGIC):
        return PARQUET
    return ASTERIX if asterix.is_asterix(data) else TEXT


def _check_names(where: str, names: Sequence[str]) -> None:
    if not any(names):
        raise ValueError(f"{where}: no names of columns, and no rows")
    if sum(map(is_number, names)) > 1 and names[0] != "1":
        raise ValueError(
            f"{where}: a header names the columns, got {', '.join(names)[:60]}; without one give "
            "--no-header, the columns are then called 1, 2, ..."
        )
    for i, name in enumerate(names):
        if not name.isprintable() or (name and name in names[:i]):
            raise ValueError(f"{where}, column {i + 1}: {name!r} is not a name, or is used twice")


def _of_frame(frame: Any, choose: Choose) -> Columns:
    names = [str(name) for name in getattr(frame, "column_names", getattr(frame, "columns", frame))]
    where = type(frame).__name__
    wanted = choose(where, names, {})
    values: dict[str, Any] = {}
    for name in wanted:
        column = np.asarray(frame[name])
        values[name] = column if column.dtype.kind in "iufM" else [_text(cell) for cell in column.tolist()]
    lengths = {name: len(column) for name, column in values.items()}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"{where}: columns differ in length: {lengths}")
    return Columns(where, tuple(names), values, np.arange(1, 1 + max(lengths.values(), default=0)))


def _of_parquet(path: Path | str, choose: Choose) -> Columns:
    parquet = module_of("tables", "pyarrow.parquet", "Parquet")
    data = io.BytesIO(file_bytes(path))
    with _undamaged(path):
        file = parquet.ParquetFile(data)
    names = file.schema_arrow.names
    wanted = choose(f"{path}", names, {})
    with _undamaged(path):
        frame = file.read(columns=[*wanted])
    return _of_frame(frame, lambda *_: wanted)._replace(where=f"{path}", names=tuple(names))


@contextmanager
def _undamaged(path: Path | str) -> Iterator[None]:
    """What a reader of Parquet says of a damaged file, with its name and in one line."""
    try:
        yield
    except (ValueError, OSError) as error:
        raise ValueError(f"{path}: a damaged Parquet file: {error}".partition("\n")[0]) from None


def _of_json(path: Path | str, choose: Choose, kept: Callable[[Mapping], bool]) -> Columns:
    """Records of JSON as rows: `a.b` is an entry of an entry, `a[0]` of a list. Lists of numbers of equal
    length make a row for each of their entries."""
    try:
        records = json.loads(file_bytes(path), parse_float=str, parse_int=str, parse_constant=str)
    except ValueError as error:
        if JSON_LINES.match(file_bytes(path, HEAD)):
            raise ValueError(
                f"{path}: a record of JSON on each line; make them one list first, as `jq -s . FILE` does"
            ) from None
        raise ValueError(f"{path}: not JSON: {error}") from None
    if isinstance(records, dict):
        lists = [value for value in records.values() if isinstance(value, list)]
        records = lists[0] if len(lists) == 1 else [records]
    if not all(isinstance(record, dict) for record in records):
        raise ValueError(f"{path}: JSON must be a list of records in braces, one for each row or scan")
    names = list(dict.fromkeys(name for record in records for name in _entries(record)))
    if not names:
        raise ValueError(f"{path}: JSON without records")
    wanted = choose(f"{path}", names, {})
    rows: list[list[str]] = []
    lines: list[int] = []
    for line, record in enumerate(records, 1):
        if kept(_Cells(record)):
            for row in _rows(f"{path}, record {line}", wanted, [_at(record, name) for name in wanted]):
                rows.append(row)
                lines.append(line)
    cells = [*zip(*rows, strict=True)] or [()] * len(wanted)
    values: dict[str, Any] = {name: texts(column, str) for name, column in zip(wanted, cells, strict=True)}
    return Columns(f"{path}", tuple(names), values, np.array(lines, int))


class _Cells(dict):
    """Cells of a record by their path."""

    def __missing__(self, name: str) -> str:
        return _text(_at(self, name))


def _entries(record: dict, before: str = "") -> Iterator[str]:
    """Paths of a record's entries that are no records themselves, and of those in its lists."""
    for key, value in record.items():
        name = f"{before}{key}"
        if isinstance(value, dict):
            yield from _entries(value, f"{name}.")
        elif isinstance(value, list):
            yield from (f"{name}[{i}]" for i in range(min(len(value), 6)))
        else:
            yield name


def _at(record: Any, path: str) -> Any:
    """What stands at a path, None for nothing."""
    for step in PATH.findall(path):
        if isinstance(record, dict):
            record = dict.get(record, step)
        elif isinstance(record, list) and step.isdigit() and int(step) < len(record):
            record = record[int(step)]
        else:
            return None
    return record


def _rows(where: str, wanted: Mapping[str, bool], values: list) -> list[list[str]]:
    """A record as rows: one, or one for each entry of its lists of numbers; of texts others are left out."""
    lists = {
        name: len(v) for (name, n), v in zip(wanted.items(), values, strict=True) if n and isinstance(v, list)
    }
    if len(set(lists.values())) > 1:
        raise ValueError(f"{where}: lists differ in length: {lists}")
    k = next(iter(lists.values()), 1)
    even = [
        [None] * max(k, 1)
        if (isinstance(v, list) and len(v) != k) or v == []
        else v
        if isinstance(v, list)
        else [v] * max(k, 1)
        for v in values
    ]
    return [[_text(value) for value in row] for row in zip(*even, strict=True)]


def _text(value: Any) -> str:
    text = str(value)
    return "" if text in NOTHING and not isinstance(value, str) else text
