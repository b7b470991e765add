"""Readers of text as targets: scans, tables of instances, flights."""

from functools import lru_cache
from pathlib import Path

import numpy as np

from fuzzing import checks
from fuzzing.cases import Finding, Spoilt, Target
from fuzzing.inputs import Rng, decades
from fuzzing.stored import folder, stored, with_bytes_wrong
from gmr_gym import data
from gmr_gym.data.loader import f16_flight, flight, flight_names
from gmr_gym.evaluation.recordings import Scans, read_scans, write_scans
from gmr_gym.tuning import instances

CELLS = ("nan", "inf", "x", "1_0", "", '"', "1e999", "--1", "0x10", "\x00", "٣", "1,5", "1;5", " ")


def file_targets() -> list[Target]:
    """Every reader of text."""
    scans = Target("file/read_scans", _draw_scans, _read_scans, _check_scans, _spoil_scans, share=0.5)
    table = Target("file/instances", _draw_table, _read_table, _check_table, _spoil_table, share=0.1)
    return [
        scans,
        with_bytes_wrong(scans, _sane_scans),
        table,
        with_bytes_wrong(table, _sane_table),
        Target("file/flight", _draw_flight, flight, _check_flight, _spoil_flight, share=0.05),
        Target("file/f16_flight", lambda rng: (), f16_flight, _check_f16, share=0.01),
    ]


# ---- scans ----


def _draw_scans(rng: Rng) -> tuple:
    T, p = int(rng.integers(1, 8)), int(rng.integers(1, 4))
    times = decades(rng, -3, 9) + np.cumsum(decades(rng, -3, 3, T))
    z = [decades(rng, -8, 8) * rng.standard_normal((int(rng.choice([0, 1, 2, 5])), p)) for _ in range(T)]
    file = folder() / "scans.csv"
    write_scans(file, times, z, ("x", "y", "z")[:p])
    text = file.read_text()
    kind = rng.integers(5)
    if kind == 0:
        text = text.replace("\n", "\r\n")
    elif kind == 1:
        text = "\ufeff# a comment, with commas\n\n" + text.replace("\n", "\n\n# and on\n", 3)
    elif kind == 2:
        text = text.replace(",", " , ").rstrip("\n")
    return text.encode(), Scans(times, z, ("x", "y", "z")[:p])


def _read_scans(content: bytes, scans):
    return read_scans(stored(content, "read.csv"))


def _spoil_scans(rng: Rng, arguments: tuple) -> Spoilt:
    content, _scans = arguments
    lines = content.decode().split("\n")
    row = int(rng.integers(len(lines)))
    if rng.random() < 0.5:
        cells = lines[-2 if len(lines) > 2 else -1].split(",")
        cells[rng.integers(len(cells))] = CELLS[rng.integers(4)]
        lines.append(",".join(cells))
    else:
        cut = rng.integers(3)
        lines = [["nothing"], lines[:1], [*lines, "1.0," * 9]][cut] if row >= 0 else lines
        lines = ["# only"] if cut == 1 else lines
    spoilt = "\n".join(lines).encode()
    if rng.random() < 0.2:
        spoilt = content + b"\xff\xfe1,2\n"
    return Spoilt((spoilt, None), ("read.csv",), "a file with something wrong")


def _check_scans(arguments: tuple, result: Scans) -> None:
    _, scans = arguments
    checks.same("value", "what was written", scans.times, result.times)
    for one, other in zip(scans.z, result.z, strict=True):
        checks.same("value", "what was written", one.reshape(other.shape), other)


def _sane_scans(arguments: tuple, result: Scans) -> None:
    checks.finite("times", result.times)
    if (np.diff(result.times) <= 0).any() or len(result.z) != len(result.times):
        raise Finding("value", f"times {result.times.tolist()} of {len(result.z)} scans")
    for z in result.z:
        checks.finite("z", z)
        if z.ndim != 2 or z.shape[1] != len(result.coordinates):
            raise Finding("shape", f"a scan of shape {z.shape} under {result.coordinates}")


# ---- tables of instances, flights ----


@lru_cache
def _rows() -> tuple[str, ...]:
    file = Path(data.__file__).parent / "instances" / "test.csv"
    return tuple(file.read_text(encoding="utf-8").splitlines())


def _draw_table(rng: Rng) -> tuple:
    header, *rows = _rows()
    chosen = rng.permutation(len(rows))[:3]
    order = rng.permutation(header.count(",") + 1)
    lines = [header, *(rows[i] for i in chosen)]
    shuffled = [",".join(line.split(",")[i] for i in order) for line in lines]
    return "\n".join(shuffled).encode(), [rows[i].split(",")[0] for i in chosen]


def _read_table(content: bytes, names):
    return instances.instances(str(stored(content, "table.csv")))


def _spoil_table(rng: Rng, arguments: tuple) -> Spoilt:
    content, names = arguments
    header, *rows = content.decode().split("\n")
    kind = rng.integers(4)
    if kind == 0:
        cells = rows[-1].split(",")
        numeric = [i for i, cell in enumerate(cells) if cell.replace(".", "").replace("-", "").isdigit()]
        cells[numeric[rng.integers(len(numeric))]] = ("nan", "-1", "x", "inf", "")[rng.integers(5)]
        rows[-1] = ",".join(cells)
    elif kind == 1:
        rows.append(rows[0])
    elif kind == 2:
        header = header[:-1]
    else:
        rows[-1] += ",1"
    return Spoilt(
        ("\n".join([header, *rows]).encode(), names), ("table.csv",), "a table with something wrong"
    )


def _check_table(arguments: tuple, result) -> None:
    if sorted(result) != sorted(arguments[1]):
        raise Finding("value", f"{list(result)} of {arguments[1]}")


def _sane_table(arguments: tuple, result) -> None:
    for instance in result.values():
        checks.finite("instance", np.array([x for x in instance if not isinstance(x, str)]))


def _draw_flight(rng: Rng) -> tuple:
    return (str(rng.choice(flight_names())),)


def _spoil_flight(rng: Rng, arguments: tuple) -> Spoilt:
    name = (arguments[0] + "x", "", "../f16", None, 3, "LICENCE.md")[rng.integers(6)]
    return Spoilt((name,), ("segment",), f"a flight called {name!r}")


def _check_flight(arguments: tuple, result) -> None:
    checks.finite("flight", result)
    if result.ndim != 2 or result.shape[1] != 2 or result[0].any():
        raise Finding("shape", f"{result.shape}, begins at {result[0]}")


def _check_f16(arguments: tuple, result) -> None:
    checks.finite("flight", result)
    if result.shape != (350, 6):
        raise Finding("shape", f"{result.shape}")
