"""Readers of files as targets: what they were given to read, and the same with some bytes wrong."""

import io
from functools import lru_cache, partial
from pathlib import Path
from tempfile import mkdtemp
from typing import NamedTuple

import numpy as np

from fuzzing import checks
from fuzzing.cases import Finding, Spoilt, Target
from fuzzing.inputs import Rng, decades
from gmr_gym import blocks, instances, network
from gmr_gym.data import f16_flight, flight, flight_names
from gmr_gym.detections import Scans, read_scans, write_scans
from gmr_gym.threshold_features import FEATURES
from gmr_gym.thresholds import Thresholds

CELLS = ("nan", "inf", "x", "1_0", "", '"', "1e999", "--1", "0x10", "\x00", "٣", "1,5", "1;5", " ")
DIGEST = "0" * 32


def file_targets() -> list[Target]:
    """Every reader."""
    whole = [
        Target("file/read_scans", _draw_scans, _read_scans, _check_scans, _spoil_scans, share=0.5),
        Target("file/network", _draw_network, _read_network, _check_network, _spoil_network, share=0.2),
        Target("file/blocks", _draw_block, _read_block, _check_block, _spoil_block, share=0.2),
        Target("file/instances", _draw_table, _read_table, _check_table, _spoil_table, share=0.1),
        Target("file/flight", _draw_flight, flight, _check_flight, _spoil_flight, share=0.05),
        Target("file/f16_flight", lambda rng: (), f16_flight, _check_f16, share=0.01),
    ]
    sane = {"read_scans": _sane_scans, "network": _sane_network, "blocks": _sane_block, "instances": _sane_table}
    broken = [
        target._replace(
            name=f"{target.name}/bytes",
            draw=partial(_draw_broken, target.draw),
            check=sane[target.name.removeprefix("file/")],
            spoil=None,
            refuses=r"read\.csv|read\.npz|table\.csv|-0-\d+\.npz",
        )
        for target in whole[:4]
    ]
    return [*whole, *broken]


def _draw_broken(draw, rng: Rng) -> tuple:
    content, *rest = draw(rng)
    for _ in range(rng.integers(1, 4)):
        content = flipped(rng, content) or b" "
    return content, *rest


@lru_cache
def _folder() -> Path:
    return Path(mkdtemp(prefix="fuzz-"))


def _stored(content: bytes, name: str) -> Path:
    file = _folder() / name
    file.write_bytes(content)
    return file


def flipped(rng: Rng, content: bytes) -> bytes:
    """With bytes changed, lost, doubled or cut off."""
    data = bytearray(content)
    at = int(rng.integers(len(data)))
    kind = rng.integers(5)
    if kind == 0:
        data[at] ^= 1 << int(rng.integers(8))
    elif kind == 1:
        del data[at:]
    elif kind == 2:
        del data[at : at + int(rng.integers(1, 40))]
    elif kind == 3:
        data[at:at] = rng.bytes(int(rng.integers(1, 40)))
    else:
        data[at : at + 8] = rng.bytes(8)
    return bytes(data)


# ---- scans ----


def _draw_scans(rng: Rng) -> tuple:
    T, p = int(rng.integers(1, 8)), int(rng.integers(1, 4))
    times = decades(rng, -3, 9) + np.cumsum(decades(rng, -3, 3, T))
    z = [decades(rng, -8, 8) * rng.standard_normal((int(rng.choice([0, 1, 2, 5])), p)) for _ in range(T)]
    file = _folder() / "scans.csv"
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
    return read_scans(_stored(content, "read.csv"))


def _spoil_scans(rng: Rng, arguments: tuple) -> Spoilt:
    content, scans = arguments
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


# ---- policies ----


def _draw_network(rng: Rng) -> tuple:
    names = tuple(rng.permutation(Thresholds._fields).tolist()[: rng.integers(1, 5)])
    sizes = [len(FEATURES), *rng.integers(1, 9, rng.integers(0, 3)).tolist(), len(names)]
    layers = [
        (rng.standard_normal((out, width)) * decades(rng, -8, 8), rng.standard_normal(out))
        for width, out in zip(sizes, sizes[1:], strict=False)
    ]
    made = network.Network(
        FEATURES, names, rng.standard_normal(len(FEATURES)), decades(rng, -3, 3, len(FEATURES)),
        float(decades(rng, -1, 3)), str(rng.choice(network.ACTIVATIONS)), bool(rng.integers(2)),
        tuple(W for W, _ in layers), tuple(b for _, b in layers),
    )  # fmt: skip
    network.save(_folder() / "policy.npz", made)
    return (_folder() / "policy.npz").read_bytes(), made


def _read_network(content: bytes, made):
    read = network.load(_stored(content, "read.npz"), FEATURES, Thresholds._fields)
    if made is None:
        _check_network((content, read), read)  # what is taken must at least work
        return None
    return read


def _spoil_network(rng: Rng, arguments: tuple) -> Spoilt:
    content, made = arguments
    fields = {"format": network.FORMAT, **made._asdict()}
    del fields["weights"], fields["biases"]
    for i, (W, b) in enumerate(zip(made.weights, made.biases, strict=True)):
        fields |= {f"weights_{i}": W, f"biases_{i}": b}
    name = list(fields)[rng.integers(len(fields))]
    value = np.asarray(fields[name])
    kind = rng.integers(4)
    if kind == 0:
        del fields[name]
    elif kind == 1:
        fields[name] = np.full(value.shape, np.nan)
    elif kind == 2:
        fields[name] = value[None]
    else:
        fields[name] = np.array([b"object", None], object)
    stream = io.BytesIO()
    np.savez(stream, **fields)
    content = stream.getvalue() if rng.random() < 0.7 else content[: rng.integers(len(content))]
    return Spoilt((content, None), ("read.npz",), f"a policy with {name} {('gone', 'nan', 'deeper', 'objects')[kind]}, or cut")


def _check_network(arguments: tuple, result) -> None:
    _, made = arguments
    if result is not made:
        checks.same("value", "what was saved", tuple(made), tuple(result))
    acted = result(np.zeros((3, len(FEATURES))))
    checks.finite("actions", acted)
    if (np.abs(acted) > 1).any():
        raise Finding("value", f"actions {acted.tolist()}")


def _sane_network(arguments: tuple, result) -> None:
    _check_network((arguments[0], result), result)


# ---- blocks of runs ----


class Kept(NamedTuple):
    """A block of a kind of its own."""

    truth: np.ndarray
    x: np.ndarray
    P: np.ndarray
    off_target: np.ndarray
    seconds: np.ndarray


def _draw_block(rng: Rng) -> tuple:
    runs, scans, d = int(rng.integers(1, 4)), int(rng.integers(1, 5)), int(rng.integers(1, 4))
    x = rng.standard_normal((2, runs, scans, d))
    P = np.broadcast_to(np.eye(d), (runs, scans, d, d)).copy()
    block = Kept(x[0], x[1], P, rng.random((runs, scans)) < 0.5, rng.random((runs, scans)))
    file = blocks.named(_folder() / "written", DIGEST, 0, runs)
    blocks.save(file, block)
    return file.read_bytes(), block, runs


def _read_block(content: bytes, block, runs: int):
    read = blocks.load(_stored(content, f"{DIGEST}-0-{runs}.npz"), Kept)
    return read


def _spoil_block(rng: Rng, arguments: tuple) -> Spoilt:
    content, block, runs = arguments
    kind = rng.integers(3)
    if kind == 0:
        return Spoilt((content, block, runs + 1), (DIGEST,), "a block of other runs")
    if kind == 1:
        return Spoilt((content[: rng.integers(len(content))], block, runs), (DIGEST,), "a block cut off")
    field = ("truth", "x", "P", "seconds")[rng.integers(4)]
    broken = block._replace(**{field: getattr(block, field)[..., None]})
    file = blocks.named(_folder() / "written", DIGEST, 0, runs)
    blocks.save(file, broken)
    return Spoilt((file.read_bytes(), block, runs), (DIGEST,), f"a block whose {field} has another shape")


def _check_block(arguments: tuple, result) -> None:
    _, block, _ = arguments
    checks.same("value", "what was saved", tuple(block), tuple(result))


def _sane_block(arguments: tuple, result) -> None:
    _, block, _ = arguments
    changed = [name for name, a, b in zip(Kept._fields, block, result, strict=True) if not np.array_equal(a, b)]
    if changed:
        raise Finding("value", f"other {', '.join(changed)} than were saved")


# ---- tables of instances, flights ----


@lru_cache
def _rows() -> tuple[str, ...]:
    file = Path(instances.__file__).parent / "data" / "instances" / "test.csv"
    return tuple(file.read_text(encoding="utf-8").splitlines())


def _draw_table(rng: Rng) -> tuple:
    header, *rows = _rows()
    chosen = rng.permutation(len(rows))[:3]
    order = rng.permutation(header.count(",") + 1)
    lines = [header, *(rows[i] for i in chosen)]
    shuffled = [",".join(line.split(",")[i] for i in order) for line in lines]
    return "\n".join(shuffled).encode(), [rows[i].split(",")[0] for i in chosen]


def _read_table(content: bytes, names):
    return instances.instances(str(_stored(content, "table.csv")))


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
    return Spoilt(("\n".join([header, *rows]).encode(), names), ("table.csv",), "a table with something wrong")


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
