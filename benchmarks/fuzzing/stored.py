"""Content on disk to be read, whole or with some bytes wrong."""

import os
from collections.abc import Callable
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from fuzzing.cases import Target
from fuzzing.inputs import Rng

HERE = TemporaryDirectory(prefix="fuzz-")  # gone when the process that runs the workers is
READ = r"read\.csv|read\.npz|table\.csv|-0-\d+\.npz"  # names of files, as messages have them


def folder() -> Path:
    """This process's own."""
    own = Path(HERE.name) / str(os.getpid())
    own.mkdir(exist_ok=True)
    return own


def stored(content: bytes, name: str) -> Path:
    """A file of that content."""
    file = folder() / name
    file.write_bytes(content)
    return file


def with_bytes_wrong(target: Target, sane: Callable[[tuple, object], None]) -> Target:
    """The target over files with some bytes changed: refused by name, or what is read is `sane`."""
    return target._replace(
        name=f"{target.name}/bytes",
        draw=partial(_draw_broken, target.draw),
        check=sane,
        spoil=None,
        refuses=READ,
    )


def _draw_broken(draw, rng: Rng) -> tuple:
    content, *rest = draw(rng)
    for _ in range(rng.integers(1, 4)):
        content = flipped(rng, content) or b" "
    return content, *rest


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
