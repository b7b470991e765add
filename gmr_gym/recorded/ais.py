"""AIS: sentences of NMEA 0183, with the times that a receiver or a log has put beside them, as columns."""

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.recorded.extras import Decoded, module_of

SENTENCE = re.compile(
    rb"^(?P<log>[^\\!]*)(?:\\(?P<tag>[^\\]*)\\)?(?P<sentence>![A-Z]{2}VD[MO],[^*]*\*[0-9A-Fa-f]{2})(?P<after>.*)"
)
TAGGED = re.compile(rb"(?:^|,)c:(\d+(?:\.\d+)?)")  # time of reception in a tag block
EDGES = b" \t,;|[]\"'"  # around the time of a log
POSITIONS = frozenset({1, 2, 3, 4, 9, 11, 18, 19, 21, 27})  # types of messages that say where their sender is
IDENTITY = "mmsi"
NOWHERE = 91.0, 181.0  # latitude and longitude that are not available
# column of a report -> field of a message, and the value from which on it is not available
OTHERS = {"sog_kn": ("speed", 102.3), "cog_deg": ("course", 360.0), "heading_deg": ("heading", 511)}


class _Line(NamedTuple):
    number: int
    sentence: bytes
    times: list[str]  # of the tag block, before the sentence, and after it; blank for none


def is_ais(head: bytes) -> bool:
    """Whether a file that begins so has an AIS sentence in its first line, or after lines of other ones."""
    lines = [line for line in head.splitlines() if line.strip() and not line.startswith(b"#")]
    first = next((i for i, line in enumerate(lines) if not line.startswith((b"$", b"!", b"\\"))), len(lines))
    return any(map(SENTENCE.match, lines[: first + 1]))


def reports(path: Path | str, data: bytes) -> Decoded:
    """Position reports, in the order of the file.

    Parameters
    ----------
    path : Path or str
        The file, for messages.
    data : bytes
        Lines with a sentence each. The time of reception is that of a tag block, or what stands before the
        sentence, or else after its checksum, behind the last comma.

    Returns
    -------
    Decoded
        A line is that of a report's last sentence. The time is `time_s` or `time_ms` of tag blocks, which
        count from 1970, and `time` of a log.

    Raises
    ------
    ValueError
        Naming the file, where it has no times, or no position reports.
    ImportError
        Without the extra `ais`.
    """
    name, which = _time_of(path, data)
    dropped: Counter[str] = Counter()
    rows = [*_rows(data, which, dropped)]
    if not rows:
        raise ValueError(
            f"{path}: AIS sentences, but no position reports with a time of reception among them"
        )
    line, *columns = zip(*rows, strict=True)
    names = (name, IDENTITY, "lat_deg", "lon_deg", "type", *OTHERS)
    values: dict[str, Any] = dict(zip(names, map(list, columns), strict=True))
    values |= {place: np.array(values[place], float) for place in ("lat_deg", "lon_deg")}
    remarks = tuple(f"{count} {what} dropped" for what, count in dropped.items())
    return Decoded(f"{path}, line {line[0]}", values, np.array(line, int), remarks, {"id": IDENTITY})


def _rows(data: bytes, which: int, dropped: Counter[str]) -> Iterator[tuple]:
    """Line, time and cells of each report; counts what is dropped."""
    pyais = module_of("ais", "pyais", "AIS")
    for sentence, line in _assembled(pyais, data):
        if not sentence.is_valid:
            dropped["sentences with a wrong checksum"] += 1
        elif sentence.ais_id in POSITIONS:
            try:
                cells = _cells(sentence.decode())
            except (pyais.exceptions.AISBaseException, ArithmeticError, LookupError, TypeError, ValueError):
                dropped["messages not understood"] += 1
                continue
            if line.times[which]:
                yield line.number, line.times[which], *cells
            else:
                dropped["reports without a time of reception"] += 1


def _lines(data: bytes) -> Iterator[_Line]:
    before = [""] * 3
    for number, content in enumerate(data.splitlines(), 1):
        found = SENTENCE.match(content)
        if not found or content.startswith(b"#"):
            continue
        tag = TAGGED.search(found["tag"] or b"")
        texts = tag[1] if tag else b"", found["log"], found["after"].rpartition(b",")[2]
        times = [text.strip(EDGES).decode("latin-1") for text in texts]
        follows = found["sentence"].split(b",", 3)[2] != b"1"
        before = before if follows and not any(times) else times  # a tag block may stand for a whole group
        yield _Line(number, found["sentence"], before)


def _time_of(path: Path | str, data: bytes) -> tuple[str, int]:
    """Name of the column of times, and which of a line's times it is: that of the first line with a time."""
    for line in _lines(data):
        for which, text in enumerate(line.times):
            if text:
                whole = text.partition(".")[0]
                return ("time" if which else "time_ms" if len(whole) > 11 else "time_s"), which
    raise ValueError(
        f"{path}: AIS sentences hold no time of reception, only the second of the minute; have the receiver "
        r"write tag blocks, as in \c:1714557600*5B\!AIVDM,..., or put a time before each sentence, as in "
        "2024-05-01T10:00:00Z !AIVDM,..., or give the receiver's CSV"
    )


def _assembled(pyais: Any, data: bytes) -> Iterator[tuple[Any, _Line]]:
    """Sentences, those of one message put together, each with its last line."""
    last: list[_Line] = []

    def heard() -> Iterator[bytes]:
        for line in _lines(data):
            last[:] = [line]
            yield line.sentence

    for sentence in pyais.IterMessages(heard()):
        yield sentence, last[0]


def _cells(message: Any) -> tuple[str | float, ...]:
    """Identity, latitude and longitude in degrees, type, and `OTHERS` of a message."""
    latitude, longitude = message.lat, message.lon
    if abs(latitude) >= NOWHERE[0] or abs(longitude) >= NOWHERE[1]:
        latitude = longitude = np.nan
    found = [(getattr(message, field, None), most) for field, most in OTHERS.values()]
    others = ("" if value is None or value >= most else f"{value:g}" for value, most in found)
    return f"{message.mmsi}", latitude, longitude, f"{message.msg_type}", *others
