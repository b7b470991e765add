"""Surveillance data in ASTERIX: target reports (category 48) and north markers (34), as columns."""

from collections.abc import Iterable
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gmr_gym.recorded.extras import Decoded, module_of
from gmr_gym.recorded.packets import PCAP, PCAPNG, payloads

SERVICE, REPORTS = 34, 48  # categories
NORTH = 1  # message type of a north marker
DAY = 86_400.0  # s
HEAD = 3  # bytes of a block before its records: category and length
LONGEST = 9 << 8  # bytes of a block, below: so no text begins like one
TURN, SENSOR = "turn", "sac_sic"
NAMES = (
    "time_of_day_s", SENSOR, "range_nmi", "azimuth_deg", TURN, "type", "mode_3a", "flight_level",
    "aircraft_address", "track_number",
)  # fmt: skip


class Report(NamedTuple):
    """A target report: cells of `NAMES` but for the turn."""

    time: float | None  # s since midnight
    sensor: str
    range: float | None  # nmi
    azimuth: float | None  # deg, clockwise from north
    cells: tuple[str, ...]  # of all other names


def is_asterix(head: bytes) -> bool:
    """Whether a file that begins so is a recording of a network, or data blocks one after the other."""
    if head.startswith((*PCAP, PCAPNG)):
        return True
    if len(head) > 7 and not any(head[1:8:2]):  # text in UTF-16, and no record without items
        return False
    return len(head) > HEAD and head[0] > 0 and HEAD < int.from_bytes(head[1:HEAD], "big") < LONGEST


def surveillance(path: Path | str, data: bytes) -> Decoded:
    """Target reports with a position and a time, in the order of the recording.

    Parameters
    ----------
    path : Path or str
        The file, for messages.
    data : bytes
        Data blocks, or a recording of a network (pcap) whose UDP datagrams hold them.

    Returns
    -------
    Decoded
        A record is a target report. `turn` counts the north markers of the report's radar up to its time; it
        is blank for radars without.

    Raises
    ------
    ValueError
        Naming the file, where it holds no target reports, or ends within a block.
    ImportError
        Without the extra `asterix`.
    """
    blocks, foreign = _blocks(path, data)
    known = [block for block in blocks if block[0] in (SERVICE, REPORTS)]
    parts = [*map(_reader(), known)]
    seen = [each for part in parts for each in part or ()]  # reports and north markers, in their order
    seen, empty = _with_empty_turns(seen)
    reports = [each for each in seen if isinstance(each, Report)]
    number = np.cumsum([each.range == each.range for each in reports])  # nan is a turn without any
    placed = np.array([None not in (each.time, each.range, each.azimuth) for each in reports], bool)
    if not placed.any():
        there = ", ".join(map(str, sorted({block[0] for block in blocks}))) or "none"
        raise ValueError(
            f"{path}: no target reports of category {REPORTS} with time, range and azimuth; blocks are of "
            f"categories {there}"
        )
    kept = [each for each, good in zip(reports, placed.tolist(), strict=True) if good]
    turns, markers = _turns(seen)
    columns = [
        np.array([each.time for each in kept]), [each.sensor for each in kept],
        np.array([each.range for each in kept]), np.array([each.azimuth for each in kept]), turns,
        *map(list, zip(*(each.cells for each in kept), strict=True)),
    ]  # fmt: skip
    counted = (
        (foreign, "datagrams that are not ASTERIX left out"),
        (len(blocks) - len(known), "data blocks of other categories left out"),
        (parts.count(None), "data blocks not understood left out"),
        (len(placed) - len(kept), "reports without time, range or azimuth dropped"),
        (markers, "north markers cut scans"),
        (empty, "turns without reports are scans that detected nothing"),
    )
    remarks = tuple(f"{count} {what}" for count, what in counted if count)
    values = dict(zip(NAMES, columns, strict=True))
    usual = {"sensor": SENSOR} | ({"scan": TURN} if any(turns) else {})
    return Decoded(f"{path}", values, number[placed], remarks, usual)


def _blocks(path: Path | str, data: bytes) -> tuple[list[bytes], int]:
    """Data blocks, and the number of datagrams that are others."""
    if not data.startswith((*PCAP, PCAPNG)):
        blocks, end = _whole_blocks(data)
        if end < len(data):
            raise ValueError(f"{path}: byte {end + 1} begins no whole data block of ASTERIX")
        return blocks, 0
    blocks, foreign = [], 0
    for datagram in payloads(path, data):
        found, end = _whole_blocks(datagram)
        foreign += end < len(datagram)
        blocks += found if end == len(datagram) else []
    return blocks, foreign


def _whole_blocks(data: bytes) -> tuple[list[bytes], int]:
    """Data blocks up to the first byte that begins none, and its index."""
    blocks, at = [], 0
    while at < len(data):
        length = int.from_bytes(data[at + 1 : at + HEAD], "big")
        if length < HEAD or at + length > len(data):
            break
        blocks.append(data[at : at + length])
        at += length
    return blocks, at


def _reader() -> Any:
    """What takes a data block and gives its reports and north markers, None where it cannot be read; feeds
    that are recorded twice are read once."""
    base = module_of("asterix", "asterix.base", "ASTERIX")
    editions = module_of("asterix", "asterix.generated", "ASTERIX")
    forms = {SERVICE: (editions.Cat_034_1_29, _marker), REPORTS: (editions.Cat_048_1_32, _report)}

    @cache
    def read(block: bytes) -> list | None:
        form, taken = forms[block[0]]
        records = form.cv_uap.parse(base.Bits.from_bytes(block[HEAD:]))
        return None if isinstance(records, ValueError) else [*filter(None, map(taken, records))]

    return read


def _marker(record: Any) -> tuple[float, str] | None:
    """Time of day and radar of a north marker; None for other messages."""
    time = _number(record, "030", "s")
    item = record.get_item("000")
    return (time, _radar(record)) if item and item.as_uint() == NORTH and time is not None else None


def _report(record: Any) -> Report:
    polar = record.get_item("040")
    away = polar.variation if polar else None
    part = partial(_part, record)
    cells = (
        part("020", "TYP", lambda item: item.table_value() or ""),
        part("070", "MODE3A", lambda item: item.as_string()),
        part("090", "FL", lambda item: f"{item.as_quantity('FL'):g}"),
        f"{record.get_item('220').as_uint():06x}" if record.get_item("220") else "",
        part("161", "TRN", lambda item: f"{item.as_uint()}"),
    )
    return Report(
        _number(record, "140", "s"),
        _radar(record),
        away and away.get_item("RHO").variation.content.as_quantity("NM"),
        away and away.get_item("THETA").variation.content.as_quantity("°"),
        cells,
    )


def _radar(record: Any) -> str:
    code = record.get_item("010").as_uint() if record.get_item("010") else 0
    return f"{code >> 8}/{code & 255}"


def _number(record: Any, name: str, unit: str) -> float | None:
    item = record.get_item(name)
    return item.variation.content.as_quantity(unit) if item else None


def _part(record: Any, name: str, part: str, text: Any) -> str:
    item = record.get_item(name)
    return text(item.variation.get_item(part).variation.content) if item else ""


def _with_empty_turns(seen: list) -> tuple[list, int]:
    """Reports and north markers with a report of nothing in every turn of a radar that has none, before the
    marker at its end; and the number of such turns."""
    timed = np.array([each[0] is not None for each in seen], bool)
    at = np.flatnonzero(timed)
    time = np.unwrap([seen[i][0] for i in at], period=DAY)
    radar = np.array([seen[i][1] for i in at])
    report = np.array([isinstance(seen[i], Report) for i in at], bool)
    placed = np.array([len(seen[i]) > 2 and None not in seen[i][:4] for i in at], bool)
    nothing: dict[int, Report] = {}
    for name in np.unique(radar[placed]).tolist():
        own, markers = np.sort(time[placed & (radar == name)]), np.flatnonzero(~report & (radar == name))
        marks, first = np.unique(time[markers], return_index=True)
        for i in np.flatnonzero(np.diff(np.searchsorted(own, marks)) == 0) if len(marks) else ():
            middle = float((marks[i] + marks[i + 1]) / 2 % DAY)
            nothing[at[markers[first[i + 1]]]] = Report(middle, name, np.nan, np.nan, ("",) * 5)
    out = [one for i, each in enumerate(seen) for one in ((nothing[i], each) if i in nothing else (each,))]
    return out, len(nothing)


def _turns(seen: Iterable[Any]) -> tuple[list[str], int]:
    """Turn of each placed report, and the number of north markers."""
    timed = [each for each in seen if each[0] is not None]
    time = np.unwrap([each[0] for each in timed], period=DAY)
    radar = np.array([each[1] for each in timed])
    north = np.array([not isinstance(each, Report) for each in timed], bool)
    turn = np.full(len(timed), -1)
    count = 0
    for name in np.unique(radar[north]).tolist():
        markers = np.unique(time[north & (radar == name)])
        count += len(markers)
        turn[radar == name] = np.searchsorted(markers, time[radar == name], side="right")
    placed = [isinstance(each, Report) and None not in each[:4] for each in timed]
    return [f"{number}" if number >= 0 else "" for number in turn[placed].tolist()], count
