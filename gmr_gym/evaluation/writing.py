"""Files that are there whole or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def whole(file: Path | str) -> Iterator[Path]:
    """A path beside `file`, with its ending, to write to: when the block ends it takes the place of the file,
    and when it raises it is gone and the file is what it was. Makes the folders on the way; OSError names
    the file. What is no plain file, as /dev/stdout, is written to as it stands."""
    file = Path(file)
    if file.exists() and not file.is_file():
        yield file
        return
    target = file.resolve()  # a link stays one
    partial = target.with_name(f"{target.stem}.{os.getpid()}.part{target.suffix}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            yield partial
            partial.replace(target)
        finally:
            partial.unlink(missing_ok=True)
    except OSError as error:  # of a disk that is full it does not say which
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(file)) from error
