"""Bytes and lines of files, which may be compressed with gzip."""

import gzip
import io
import zlib
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path

GZIP = b"\x1f\x8b"  # how a gzip file begins


def file_bytes(path: Path | str, size: int = -1) -> bytes:
    """What a file holds, or its first bytes, decompressed where it is a gzip file."""
    with Path(path).open("rb") as file:
        if file.peek(2)[:2] != GZIP:
            return file.read(size)
        try:
            return gzip.GzipFile(fileobj=file).read(size)
        except (OSError, EOFError, zlib.error) as error:
            raise ValueError(f"{path}: a damaged gzip file: {error}") from None


def line_blocks(
    path: Path | str, raw: io.BufferedReader, encoding: str, size: int
) -> Iterator[tuple[Sequence[int], list[str]]]:
    """Numbers, from 1, and contents of the lines that are neither blank nor comments, `size` lines at a time;
    raw is the file, open. ValueError for a damaged gzip file, and naming the line that is no text."""
    packed = raw.peek(2)[:2] == GZIP
    file = io.TextIOWrapper(gzip.GzipFile(fileobj=raw) if packed else raw, encoding, newline="\n")
    line, mark = 1, "\ufeff"
    while block := _lines(path, file, encoding, size):
        block[0] = block[0].removeprefix(mark) or "\n"
        lines: Sequence[int] = range(line, line + len(block))
        contents = [content for content in block if content[0] != "#" and not content.isspace()]
        if len(contents) < len(block):
            lines = [i for i, s in zip(lines, block, strict=True) if s[0] != "#" and not s.isspace()]
        line, mark = line + len(block), ""
        if contents:
            yield lines, contents


def _lines(path: Path | str, file: io.TextIOWrapper, encoding: str, size: int) -> list[str]:
    """The next lines of a file."""
    try:
        return list(islice(file, size))
    except UnicodeDecodeError:
        data = file_bytes(path)
    except (OSError, EOFError, zlib.error) as error:
        if not isinstance(file.buffer, gzip.GzipFile):
            raise
        raise ValueError(f"{path}: a damaged gzip file: {error}") from None
    try:
        data.decode(encoding)
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        kind = "UTF-8" if encoding == "utf-8" else encoding
        raise ValueError(f"{path}, line {line}: not text in {kind}; save it as CSV in UTF-8") from None
    raise ValueError(f"{path}: changed while it was read")
