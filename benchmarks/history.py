"""What earlier runs of the benchmark measured, a record of JSON a line, and what has become slower since."""

import json
import subprocess
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from shutil import which
from typing import Any

from timing import Row

SLOWER = 0.1  # of the ratio, from which it is said
FILE = Path(__file__).parent / "history.jsonl"
Record = Mapping[str, Any]


def record(rows: Sequence[Row], version: str, machine: Mapping[str, str], load: Sequence[float]) -> Record:
    """One run: the `load` is that before and that after it."""
    return {
        "version": version,
        "commit": _commit(),
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "machine": machine,
        "load": {"before": load[0], "after": load[1]},
        "rows": [row._asdict() for row in rows],
    }


def read(file: Path) -> list[Record]:
    """The records of a file, the last one last; none where there is no file."""
    lines = file.read_text(encoding="utf-8").splitlines() if file.exists() else []
    return [json.loads(line) for line in lines]


def append(file: Path, one: Record) -> None:
    with file.open("a", encoding="utf-8") as stream:
        stream.write(json.dumps(one, ensure_ascii=False, allow_nan=False) + "\n")


def regressions(now: Record, earlier: Sequence[Record]) -> list[str]:
    """A line for each ratio whose interval lies more than a tenth below that of the last record of the same
    row, rival and kind of machine."""
    before: dict[tuple, tuple[str, Record]] = {}
    for one in earlier:
        before |= {key: (one["date"], row) for key, row in _judged(one)}
    return [
        f"{row['what']}, against {row['against']}: {ratio(row)}, {ratio(was)} on {date}"
        for key, row in _judged(now)
        for date, was in [before.get(key, ("", row))]
        if row["high"] < (1 - SLOWER) * was["low"]
    ]


def ratio(row: Record) -> str:
    """The ratio and its interval, or of how few pairs it is."""
    if row["ratio"] is None:
        return "-"
    if row["low"] is None:
        return f"{row['ratio']:.3g} ({row['pairs']} pair{'s' * (row['pairs'] > 1)})"
    return f"{row['ratio']:.3g} ({row['low']:.3g} to {row['high']:.3g})"


def _judged(one: Record) -> Iterator[tuple[tuple, Record]]:
    """Rows that have an interval, by what makes them comparable."""
    for row in one["rows"]:
        if row["low"] is not None:
            yield (row["what"], row["against"], one["machine"]["processor"]), row


def _commit() -> str | None:
    if not which("git"):
        return None
    describe = ["git", "describe", "--always", "--dirty", "--exclude=*"]
    done = subprocess.run(describe, cwd=FILE.parent, capture_output=True, text=True)
    return done.stdout.strip() or None
